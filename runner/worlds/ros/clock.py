"""The clock by which a robot stamps its messages, as it is seen from here: it need not agree with
ours.
"""

from __future__ import annotations

import threading
from collections import deque
from itertools import pairwise
from statistics import median
from typing import Any

KEPT = 100
"""Messages that are remembered: two seconds of 50 Hz."""
FEW = 5
"""Fewer messages say nothing of a clock."""
DRIFT = 0.05
"""A clock that goes so much faster or slower than ours is that of a simulation, and no time can be
told by it."""


class RobotClock:
    """Stamps [s] of a publisher's messages against the times at which they came,
    ``time.monotonic``.
    """

    def __init__(self) -> None:
        self._heard: deque[tuple[float, float]] = deque(maxlen=KEPT)  # arrival, and stamp
        self._arrivals: deque[float] = deque(maxlen=KEPT)
        self._lock = threading.Lock()

    def take(self, stamp_s: float | None, arrival_s: float) -> float:
        """Note a message; return when it was measured, by our clock [s].

        The quickest of the messages counts as one that took no time. A message without a stamp, or
        of a clock that goes at another speed than ours, counts as measured when it came.
        """
        with self._lock:
            self._arrivals.append(arrival_s)
            if stamp_s is None:
                self._heard.clear()
                return arrival_s
            self._heard.append((arrival_s, stamp_s))
            if not self._steady():
                return arrival_s
            return min(arrival_s, stamp_s + self._offset_s())

    def at(self, time_s: float) -> float | None:
        """The robot's time [s] at a time of ours, a little early; None where it cannot be told."""
        with self._lock:
            if len(self._heard) < FEW or not self._steady():
                return None
            return time_s - self._offset_s()

    def period_s(self) -> float:
        """Median time between two messages [s]; 0 before there are some."""
        with self._lock:
            times = list(self._arrivals)
        return median(b - a for a, b in pairwise(times)) if len(times) > 2 else 0.0

    def _offset_s(self) -> float:
        return min(arrival - stamp for arrival, stamp in self._heard)

    def _steady(self) -> bool:
        """Tell whether it goes as fast as ours: the quickest messages of both halves took the same
        time.
        """
        heard = list(self._heard)
        half = len(heard) // 2
        if half < FEW:
            return True
        early, late = (
            min(part, key=lambda each: each[0] - each[1]) for part in (heard[:half], heard[half:])
        )
        apart_s = late[0] - early[0]
        return abs((late[0] - late[1]) - (early[0] - early[1])) <= max(DRIFT * apart_s, 0.02)


def stamp_of(message: Any) -> float | None:
    """The stamp of a message of ROS 1 or 2 [s]; None where it has none, or 0."""
    stamp = _stamp(message)
    whole, nanos = stamp.get("secs", stamp.get("sec")), stamp.get("nsecs", stamp.get("nanosec"))
    if type(whole) is not int or type(nanos) is not int:
        return None
    seconds = float(whole) + 1e-9 * float(nanos)
    return seconds if 0.0 < seconds < 1e11 else None


def version_of(message: Any) -> int | None:
    """The version of ROS whose stamps look like this message's; None where it has none."""
    stamp = _stamp(message)
    return 1 if "secs" in stamp else 2 if "sec" in stamp else None


def _stamp(message: Any) -> dict[str, Any]:
    header = message.get("header") if isinstance(message, dict) else None
    stamp = header.get("stamp") if isinstance(header, dict) else None
    return stamp if isinstance(stamp, dict) else {}
