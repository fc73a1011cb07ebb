"""What a motion is: what should be at every time, for a tracker to follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain.prism import Solid


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionSample:
    """What should be at one time; N limbs.

    com_m, rotation_rad: body; frame: progress in key frames, e.g. 1.5 half way from frame 1 to 2. feet_m: centres of
    the feet, shape (N, 3). forces_n: on the robot, shape (N, 3). foothold: what every limb stands on, −1 in the air.
    normals, friction: of the surface that a limb stands on, leaves or comes to, shape (N, 3), (N,).
    """

    com_m: Array
    rotation_rad: Array
    frame: float
    feet_m: Array
    forces_n: Array
    foothold: tuple[int, ...]
    normals: Array
    friction: Array

    @property
    def steep(self) -> NDArray[np.bool_]:
        """Surfaces on which friction alone holds no weight: their slope is beyond atan μ; shape (N,)."""
        return np.asarray(self.normals[:, 2] * np.hypot(1.0, self.friction) < 1.0)


class Motion(Protocol):
    """What a tracker can follow. knots_s: times from 0 to its end at which postures of the limbs are chosen, the same
    moments at every pace; solids: what limbs keep off."""

    solids: tuple[Solid, ...]

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        ...

    @property
    def knots_s(self) -> Array:
        """shape (T,) [s]."""
        ...

    def at(self, time_s: float) -> MotionSample:
        """What should be at a time; the ends are held."""
        ...


class _OtherForces:
    """A motion as another one, but for what its feet carry."""

    def __init__(self, motion: Motion) -> None:
        self._motion, self.solids = motion, motion.solids

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return self._motion.seconds

    @property
    def knots_s(self) -> Array:
        """As of ``Motion``."""
        return self._motion.knots_s


class Hung(_OtherForces):
    """A motion of a robot that hangs in a stand: its feet carry nothing."""

    def at(self, time_s: float) -> MotionSample:
        """What should be at a time; the ends are held."""
        sample = self._motion.at(time_s)
        return replace(sample, forces_n=np.zeros_like(sample.forces_n))


class LoadTransfer(_OtherForces):
    """A motion that begins at rest, taken up by a robot that stands already.

    Its load moves evenly from the feet that carry it now to those that shall: both sets of forces balance the same
    posture and are within cones, and so is everything between them. forces_n: those of now, shape (N, 3) [N].
    within_s: how long that takes [s], no longer than the motion is at rest.
    """

    def __init__(self, motion: Motion, forces_n: Array, within_s: float) -> None:
        super().__init__(motion)
        self._forces, self._within_s = forces_n, within_s

    def at(self, time_s: float) -> MotionSample:
        """What should be at a time; the ends are held."""
        sample = self._motion.at(time_s)
        if time_s >= self._within_s:
            return sample
        part = smooth(max(time_s, 0.0) / self._within_s)
        return replace(sample, forces_n=self._forces + part * (sample.forces_n - self._forces))


def smooth(s: float) -> float:
    """From 0 to 1 with no velocity and no acceleration at the ends."""
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
