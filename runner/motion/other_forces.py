"""Motions that differ from others in what their feet carry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Motion, Samples, smooth


class _OtherForces:
    """A motion as another one, but for what its feet carry."""

    def __init__(self, motion: Motion) -> None:
        self._motion, self.solids = motion, motion.solids

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self._motion.duration_s

    @property
    def knots_s(self) -> Array:
        """Times of the knots, as in ``Motion`` [s]."""
        return self._motion.knots_s


class Hung(_OtherForces):
    """A motion of a robot that hangs in a stand: its feet carry nothing."""

    def at(self, times_s: float | Array) -> Samples:
        """Sample that should be reached at a time; the ends are held."""
        sample = self._motion.at(times_s)
        return replace(sample, forces_n=np.zeros_like(sample.forces_n))


class LoadTransfer(_OtherForces):
    """A motion that begins at rest, taken up by a robot that stands already.

    Its load moves evenly from the feet that carry it now to those that shall: both sets of forces
    balance the same posture and are within cones, and so is everything between them.

    Arguments:
        forces_n: those of now, shape (N, 3) [N].
        within_s: how long that takes [s], no longer than the motion is at rest.
    """

    def __init__(self, motion: Motion, forces_n: Array, within_s: float) -> None:
        super().__init__(motion)
        self._forces, self._within_s = forces_n, within_s

    def at(self, times_s: float | Array) -> Samples:
        """Sample that should be reached at a time; the ends are held."""
        sample = self._motion.at(times_s)
        part = smooth(np.clip(np.asarray(times_s) / self._within_s, 0.0, 1.0))[..., None, None]
        mixed = self._forces + part * (sample.forces_n - self._forces)
        return replace(sample, forces_n=np.where(part < 1.0, mixed, sample.forces_n))
