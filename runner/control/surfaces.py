"""Surfaces as feet find them: places where nothing is, and planes that are nearer or farther than
planned.

A foot that was lowered as far as it may be, and bears nothing, stands on nothing: the place is cut
out of every candidate there is. Feet that stand say where their surfaces are, along the normals:
planes are moved there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import Surface

from ..log import TOUCH_N
from ..worlds.world import State
from .tracker import Target

_BEARS = 4.0
"""A foot that should bear so many times what a touch is, and feels none, has found nothing,"""
_EMPTY_S = 0.05
"""after this time; one that bore for so long since it came down has found something."""
MISSING_M = 0.08
"""So far around a foot that found nothing, along the shear axes, nothing is counted on."""
_PLANE_M = 1e-3
"""Patches of the same normal less than this apart are of one plane."""
_MOVED_M = 0.004
"""A plane that feet find so far from where it should be is moved there; less is how feet and joints
give way."""


class EmptyStep:
    """Detector of feet that came down on nothing, from the measurements of every control period."""

    def __init__(self, rate_hz: float, limbs: int) -> None:
        self._periods = max(1, round(_EMPTY_S * rate_hz))
        self._foothold: NDArray[np.int_] | None = None
        self._bore = self._empty = np.zeros(limbs, dtype=int)

    def found(self, target: Target, state: State) -> NDArray[np.bool_]:
        """Tell which feet came down on nothing, shape (N,), by the commands and measurements of
        this period and before.
        """
        sample = target.sample
        foothold = sample.foothold
        if self._foothold is None:  # those that stand from the beginning stand on something
            self._bore, self._empty = (
                np.where(foothold >= 0, self._periods, 0),
                np.zeros(len(foothold), dtype=int),
            )
            self._foothold = foothold
        same = foothold == self._foothold
        felt = np.einsum("ij,ij->i", state.forces_n, sample.normals) >= TOUCH_N
        wanted = np.einsum("ij,ij->i", sample.forces_n, sample.normals) >= _BEARS * TOUCH_N
        self._bore = np.where(same, self._bore, 0) + felt
        self._empty = np.where(same & ~felt & wanted, self._empty + 1, 0)
        self._foothold = foothold
        return np.asarray(self.seeks & (self._empty >= self._periods))

    @property
    def seeks(self) -> NDArray[np.bool_]:
        """Tell which feet should stand and bore nothing yet, shape (N,)."""
        if self._foothold is None:
            return np.zeros(len(self._bore), dtype=bool)
        return np.asarray((self._foothold >= 0) & (self._bore < self._periods))


def without(course: Problem, place: Patch, toe_m: Array, frame: int) -> Problem:
    """The course with nothing around a toe that came down on nothing, at this frame or later.

    Arguments:
        place: what it should have stood on.

    Raises:
        PlanningFailed: where a foothold has no candidate left.
    """

    def cut(foothold: Foothold) -> Foothold:
        if foothold.frame < frame or foothold.toe_m is not None:
            return foothold
        turned = foothold.yaws_rad or (0.0,) * len(foothold.candidates)
        pairs = [
            (piece, yaw)
            for patch, yaw in zip(foothold.candidates, turned, strict=True)
            for piece in _around(patch, place, toe_m)
        ]
        if not pairs:
            raise PlanningFailed(
                f"limb {foothold.limb}, frame {foothold.frame}: no ground where its patch should "
                "be, and no other patch"
            )
        yaws = tuple(yaw for _, yaw in pairs) if foothold.yaws_rad else ()
        return replace(foothold, candidates=tuple(piece for piece, _ in pairs), yaws_rad=yaws)

    return replace(course, footholds=tuple(map(cut, course.footholds)))


def _around(patch: Patch, place: Patch, toe_m: Array) -> tuple[Patch, ...]:
    """The patch, or its pieces around the toe where it is of the same plane and covers some of what
    is missing.
    """
    surface = Surface(patch, 0.0)
    if not coplanar(patch, place) or surface.window(toe_m, 2.0 * MISSING_M) is None:
        return (patch,)
    return surface.around(toe_m, 2.0 * MISSING_M)


def coplanar(patch: Patch, other: Patch) -> bool:
    """Tell whether two patches are of one plane, and look the same way."""
    apart = (patch.vertices_m[0] - other.vertices_m[0]) @ other.normal
    return bool(patch.normal @ other.normal > 1.0 - 1e-6 and abs(apart) < _PLANE_M)


@dataclass(frozen=True, kw_only=True)
class _Offsets:
    """Distances of planes from where a course has them: for every plane a patch in it, and its
    offset along n [m].
    """

    planes: tuple[Patch, ...] = ()
    offsets_m: tuple[float, ...] = ()

    @property
    def line(self) -> str:
        """For people."""
        by = ", ".join(f"{1e3 * offset:+.0f}" for offset in self.offsets_m)
        return (
            f"{len(self.planes)} surface{'s' * (len(self.planes) != 1)} found {by} mm from the plan"
        )

    def moved(self, patch: Patch) -> Patch:
        """The patch where it was found to be."""
        for plane, offset in zip(self.planes, self.offsets_m, strict=True):
            if coplanar(patch, plane):
                return patch.with_vertices(patch.vertices_m + offset * patch.normal)
        return patch

    def course(self, course: Problem) -> Problem:
        """The course with its surfaces where they were found to be."""
        moved: Callable[[Patch], Patch] = cache(self.moved)
        footholds = tuple(
            replace(
                foothold,
                candidates=tuple(map(moved, foothold.candidates)),
                toe_m=None if foothold.toe_m is None else foothold.toe_m + _shift(foothold, moved),
            )
            for foothold in course.footholds
        )
        return replace(course, terrain=tuple(map(moved, course.terrain)), footholds=footholds)


def _shift(foothold: Foothold, moved: Callable[[Patch], Patch]) -> Array:
    patch = foothold.candidates[0]
    return np.asarray(moved(patch).vertices_m[0] - patch.vertices_m[0])


def found_offsets(patches: tuple[Patch, ...], state: State, kinematics: Kinematics) -> _Offsets:
    """Find the planes of the patches under feet that bear: the mean of theirs.

    Arguments:
        patches: under all feet, as planned.
    """
    planes, offsets = list[Patch](), list[list[float]]()
    for foot, force, radius, patch in zip(
        state.feet_m, state.forces_n, kinematics.radii_m, patches, strict=True
    ):
        if force @ patch.normal < TOUCH_N:
            continue
        offset = float((foot - radius * patch.normal - patch.centre_m) @ patch.normal)
        same = [k for k, plane in enumerate(planes) if coplanar(patch, plane)]
        if same:
            offsets[same[0]].append(offset)
        else:
            planes.append(patch)
            offsets.append([offset])
    moved = [(plane, float(np.mean(each))) for plane, each in zip(planes, offsets, strict=True)]
    moved = [(plane, offset) for plane, offset in moved if abs(offset) >= _MOVED_M]
    return _Offsets(
        planes=tuple(plane for plane, _ in moved), offsets_m=tuple(offset for _, offset in moved)
    )
