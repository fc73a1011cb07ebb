"""Joints that follow a joint trajectory controller: second order, with a limit of speed, each
stoppable by a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_S = 0.002


@dataclass
class CommandedPath:
    """Points in time; before the first from ``start``, after the last at rest there."""

    begun_s: float
    start: Array
    rate: Array
    times: Array
    positions: Array
    velocities: Array | None

    def at(self, now_s: float) -> tuple[Array, Array]:
        """Desired positions and velocities: cubic with velocities, straight lines without."""
        t = now_s - self.begun_s
        if t >= self.times[-1]:
            return self.positions[-1], np.zeros_like(self.start)
        k = int(np.searchsorted(self.times, t, side="right"))
        t0 = self.times[k - 1] if k else 0.0
        p0, p1 = self.positions[k - 1] if k else self.start, self.positions[k]
        h = self.times[k] - t0
        s = (t - t0) / h
        if self.velocities is None:
            return p0 + s * (p1 - p0), (p1 - p0) / h
        v0, v1 = self.velocities[k - 1] if k else self.rate, self.velocities[k]
        a, b, c, d = (
            (1 + 2 * s) * (1 - s) ** 2,
            s * (1 - s) ** 2,
            s * s * (3 - 2 * s),
            s * s * (s - 1),
        )
        e, f, g = 6 * s * s - 6 * s, 3 * s * s - 4 * s + 1, 3 * s * s - 2 * s
        return a * p0 + b * h * v0 + c * p1 + d * h * v1, e * (p0 - p1) / h + f * v0 + g * v1


@dataclass
class Controller:
    """A controller and its joints; ``advance`` moves them to a time.

    Not thread-safe.
    """

    names: Sequence[str]
    position: Array
    bandwidth_rad_s: float = 60.0
    most_rad_s: float = 6.0
    now_s: float = 0.0
    on: bool = True
    rate: Array = field(init=False)
    stuck: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.position = np.array(self.position, dtype=float)
        self.rate = np.zeros(len(self.names))
        self.stuck = np.zeros(len(self.names), dtype=bool)
        self.stop()

    def stop(self) -> None:
        """Hold where the joints are."""
        zero = np.zeros(len(self.names))
        self.path = CommandedPath(
            self.now_s,
            self.position.copy(),
            zero,
            np.array([1e-9]),
            self.position[None, :].copy(),
            None,
        )

    def desired(self) -> tuple[Array, Array]:
        """Desired positions and speeds of the joints now."""
        return self.path.at(self.now_s)

    def load(self, message: dict[str, Any], nanos: str, epoch_s: float = 0.0) -> bool:
        """Take a JointTrajectory in place of the one before; False if its joints are not the
        controller's, it does not run, or all points of a trajectory with a stamp are over. Without
        points it holds where it is, in ROS 1.

        Arguments:
            epoch_s: the robot's clock at ``now_s`` 0, by which the stamp counts.
        """
        names, points = message["joint_names"], message["points"]
        if not self.on or sorted(names) != sorted(self.names):
            return False
        if not points and nanos == "nsecs":
            self.stop()
        if not points:
            return nanos == "nsecs"
        order = [names.index(name) for name in self.names]
        stamp_s = _seconds(message.get("header", {}).get("stamp", {}), nanos)
        late_s = self.now_s + epoch_s - stamp_s if stamp_s > 0.0 else 0.0
        points = [point for point in points if _seconds(point["time_from_start"], nanos) > late_s]
        if not points:
            return False
        times = np.array([_seconds(point["time_from_start"], nanos) - late_s for point in points])
        positions = np.array([[point["positions"][i] for i in order] for point in points])
        has = all(len(point.get("velocities", [])) == len(names) for point in points)
        velocities = (
            np.array([[point["velocities"][i] for i in order] for point in points]) if has else None
        )
        start, rate = self.desired()
        self.path = CommandedPath(
            self.now_s, start.copy(), rate.copy(), times, positions, velocities
        )
        return True

    def advance(self, to_s: float) -> None:
        """Move on to a time [s]."""
        while self.now_s + STEP_S <= to_s:
            self.now_s += STEP_S
            wanted = self.desired()[0]
            w = self.bandwidth_rad_s
            self.rate = self.rate + STEP_S * (
                w * w * (wanted - self.position) - 2.0 * w * self.rate
            )
            self.rate = np.clip(
                np.where(self.stuck | (not self.on), 0.0, self.rate),
                -self.most_rad_s,
                self.most_rad_s,
            )
            self.position = self.position + STEP_S * self.rate


def _seconds(message: dict[str, int], nanos: str) -> float:
    return float(
        message.get("sec" if nanos == "nanosec" else "secs", 0) + 1e-9 * message.get(nanos, 0)
    )
