"""The motion of a leap: the body as its forces move it, and feet that go from foothold to
foothold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import LeapPlan
from ..arguments import cached_property
from ..files.arrays import Array
from ..physics import GRAVITY_M_S2
from ..robot.rotation import rotations_of
from ..terrain.patch import solids_of
from .motion import Samples


class LeapMotion:
    """A leap over time; ``Samples.frame`` counts seconds, and joints are not known.

    c and v are exact, Θ is a cubic between the ends of an interval, and forces are constant within
    one. A foot in the air goes straight in the frame of the body, from where it left to where it
    lands.
    """

    def __init__(self, plan: LeapPlan) -> None:
        self.plan, leap = plan, plan.problem
        patches = [leap.patch(j, plan.choice) for j in range(len(leap.footholds))]
        self.solids = solids_of(patches)
        self._normals = np.array([patch.normal for patch in patches])
        self._friction = np.array([patch.friction for patch in patches])
        self._radii = leap.robot.source.foot_radii_m
        self._holds = leap.holds[leap.interval_phases]

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return float(self.plan.times_s[-1])

    @property
    def knots_s(self) -> Array:
        """Ends of the intervals, shape (M + 1,) [s]."""
        return self.plan.times_s

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        plan, leap = self.plan, self.plan.problem
        ends = plan.times_s
        when = np.clip(np.asarray(times_s, dtype=np.float64), ends[0], ends[-1])
        k = np.clip(np.searchsorted(ends, when, side="right") - 1, 0, len(ends) - 2)
        t, last = (when - ends[k])[..., None], (ends[k + 1] - ends[k])[..., None]
        push = plan.forces_n[k].sum(axis=-2) / leap.robot.mass_kg - [0.0, 0.0, GRAVITY_M_S2]
        com = plan.com_m[k] + t * plan.velocity_m_s[k] + 0.5 * t**2 * push
        rotation, rate = self._turned(k, t / last, last)
        surface, normals = self._surface[k], self._normals[self._surface[k]]
        return Samples(
            com_m=com,
            velocity_m_s=plan.velocity_m_s[k] + t * push,
            rotation_rad=rotation,
            rotation_rate_rad_s=rate,
            frame=when,
            feet_m=self._toes(k, when, com, rotation) + self._radii[:, None] * normals,
            radii_m=self._radii,
            forces_n=plan.forces_n[k],
            foothold=self._holds[k],
            normals=normals,
            friction=self._friction[surface],
        )

    def _turned(self, k: NDArray[np.int_], s: Array, last: Array) -> tuple[Array, Array]:
        """Θ and its rate a share s into interval k, which lasts so long, shape (…, 3) each."""
        robot = self.plan.problem.robot
        assert robot.inertia is not None
        rates = self.plan.momentum_m2_s @ np.linalg.inv(robot.inertia / robot.mass_kg).T
        first, second = self.plan.rotation_rad[k], self.plan.rotation_rad[k + 1]
        rotation = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * second
        rotation += last * ((s**3 - 2 * s**2 + s) * rates[k] + (s**3 - s**2) * rates[k + 1])
        rate = 6 * (s**2 - s) * (first - second) / last
        rate += (3 * s**2 - 4 * s + 1) * rates[k] + (3 * s**2 - 2 * s) * rates[k + 1]
        return np.asarray(rotation), np.asarray(rate)

    def _toes(self, k: NDArray[np.int_], when: Array, com: Array, rotation: Array) -> Array:
        """Places of all toes, shape (…, N, 3) [m]."""
        left, lands = self._flights
        ends = self.plan.times_s
        begin, end = ends[left[k]], ends[lands[k]]
        share = (when[..., None] - begin) / np.maximum(end - begin, 1e-12)
        legs = np.arange(self._holds.shape[1])
        first, second = self._from_body[left[k], legs, 0], self._from_body[lands[k], legs, 1]
        aside = first + share[..., None] * (second - first)
        flying = com[..., None, :] + np.einsum("...ij,...nj->...ni", rotations_of(rotation), aside)
        holds = self._holds[k]
        return np.where((holds >= 0)[..., None], self.plan.toes_m[np.maximum(holds, 0)], flying)

    @cached_property
    def _surface(self) -> NDArray[np.int_]:
        """The foothold that every limb has, comes to, or else had last, in every interval, shape
        (M, N).
        """
        surface = self._holds.copy()
        for i in range(surface.shape[1]):
            stands = np.flatnonzero(surface[:, i] >= 0)
            after = np.searchsorted(stands, np.arange(len(surface)))
            surface[:, i] = surface[stands[np.minimum(after, len(stands) - 1)], i]
        return surface

    @cached_property
    def _flights(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Ends of intervals at which each limb left last and lands next, itself where it stands,
        shape (M, N) each.
        """
        left, lands = np.zeros_like(self._holds), np.full_like(self._holds, len(self._holds))
        for k in range(len(left)):
            before = left[k - 1] if k else np.zeros(left.shape[1], dtype=int)
            left[k] = np.where(self._holds[k] >= 0, k + 1, before)
        for k in reversed(range(len(lands))):
            after = lands[k + 1] if k + 1 < len(lands) else np.full(lands.shape[1], len(lands))
            lands[k] = np.where(self._holds[k] >= 0, k, after)
        return left, lands

    @cached_property
    def _from_body(self) -> Array:
        """Toes seen from the body at the ends of intervals, of the foothold before and after each
        of them, shape (M + 1, N, 2, 3) [m]; where a limb has none on one side the other one's.
        """
        none = np.full((1, self._holds.shape[1]), -1)
        before = np.concatenate([none, self._holds])
        after = np.concatenate([self._holds, none])
        last = np.concatenate([self._surface[:1], self._surface])
        around = np.stack(
            [np.where(before >= 0, before, last), np.where(after >= 0, after, last)], axis=2
        )
        toes = self.plan.toes_m[around] - self.plan.com_m[:, None, None]
        return np.asarray(np.einsum("mji,mnsj->mnsi", rotations_of(self.plan.rotation_rad), toes))
