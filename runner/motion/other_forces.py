"""Motions that differ from others in what their feet carry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Motion, Samples, smooth

MIDDLES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Places in a control period at which forces are looked at, as shares of it before its end."""


class LoadTransfer:
    """A motion that begins at rest, taken up by a robot whose feet carry other forces.

    Their load moves evenly from the feet that carry it now to those that shall: both sets of forces
    balance the same posture and are within cones, and so is everything between them.

    Arguments:
        forces_n: those of now, shape (N, 3) [N]; 0 of a robot that hangs in a stand.
        within_s: how long that takes [s], no longer than the motion is at rest; infinite for a
            robot that never carries itself.
    """

    def __init__(
        self, motion: Motion, forces_n: Array | float = 0.0, within_s: float = math.inf
    ) -> None:
        self._motion, self.solids = motion, motion.solids
        self._forces, self._within_s = np.asarray(forces_n), within_s

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self._motion.duration_s

    @property
    def knots_s(self) -> Array:
        """Times of the knots, as in ``Motion`` [s]."""
        return self._motion.knots_s

    def at(self, times_s: float | Array) -> Samples:
        """Sample that should be reached at a time; the ends are held."""
        sample = self._motion.at(times_s)
        part = smooth(np.clip(np.asarray(times_s) / self._within_s, 0.0, 1.0))[..., None, None]
        mixed = self._forces + part * (sample.forces_n - self._forces)
        return replace(sample, forces_n=np.where(part < 1.0, mixed, sample.forces_n))


class MeanForces:
    """A dynamic motion whose forces are, at every time, their means over the control period that
    ends then, as a tracker commands them: feet lift and land within periods, and at full force. One
    that carries during any part of a period stands in it.

    Arguments:
        period_s: of control [s].
    """

    def __init__(self, motion: Motion, period_s: float) -> None:
        self._motion, self._period_s, self.solids = motion, period_s, motion.solids

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self._motion.duration_s

    @property
    def knots_s(self) -> Array:
        """Times of the knots, as in ``Motion`` [s]."""
        return self._motion.knots_s

    def at(self, times_s: float | Array) -> Samples:
        """Sample that should be reached at a time; the ends are held."""
        sample = self._motion.at(times_s)
        forces, foothold = np.zeros_like(sample.forces_n), np.array(sample.foothold)
        for share in MIDDLES:
            within = self._motion.at(np.asarray(times_s) - share * self._period_s)
            forces += within.forces_n / len(MIDDLES)
            foothold = np.where(foothold < 0, within.foothold, foothold)
        return replace(sample, forces_n=forces, foothold=foothold)
