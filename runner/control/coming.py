"""Samples that a motion expects of the coming control periods: the same whatever is measured, and
found for many at once.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Motion, Samples

from ..motion.redundancy import RedundancyResolution

AHEAD = 64
"""The most periods that are looked up together."""

Expected = tuple[Samples, Array]
"""A sample, and the posture that joints are drawn to then, shape (J,) [rad]."""


class Coming:
    """Samples of one motion at the times that its tracker asks for.

    The next periods are looked up with the one that is asked for, twice as many each time as long
    as they are asked for to the last. A motion that slows down, or waits, asks for others, and
    begins with a single one again.
    """

    def __init__(self, motion: Motion, wished: RedundancyResolution, period_s: float) -> None:
        self._motion, self._wished, self._period_s = motion, wished, period_s
        self._known, self._count = dict[float, Expected](), 1
        self._asked = self._last = -1.0

    def at(self, time_s: float, pace: float = 1.0) -> Expected:
        """Sample that is expected at a time [s].

        Arguments:
            pace: how fast the motion's time goes on.
        """
        if time_s not in self._known:
            self._look_up(time_s, pace)
        self._asked = time_s
        return self._known[time_s]

    def _look_up(self, time_s: float, pace: float) -> None:
        """Compute the expected samples from this time on.

        The last request's sample is kept.
        """
        self._count = min(2 * self._count, AHEAD) if self._asked == self._last else 1
        known = {self._asked: self._known[self._asked]} if self._asked in self._known else {}
        times = list(accumulate([pace * self._period_s] * (self._count - 1), initial=time_s))
        when = np.array(times)
        samples = zip(self._motion.at(when).rows(), self._wished.at(when), strict=True)
        self._known = known | dict(zip(times, samples, strict=True))
        self._last = times[-1]
