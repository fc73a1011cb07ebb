"""State of the robot as the closed loop estimates it from measurements: where the robot stands, how
far off that is, and surfaces as feet find them.

A foot that was lowered as far as it may be, and bears nothing, stands on nothing: the place is cut
out of every candidate there is. Feet that stand say where their surfaces are, along the normals:
planes are moved there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.pieces import Standing
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import Surface

from ..log import TOUCH_N, Record
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


LEAST = 3
"""So many feet tell how the body is turned."""
_SMOOTH_S = 0.03
"""Time constant of the body's velocity."""


class LegOdometry:
    """Odometry of one motion.

    Arguments:
        first: what is sent first; the first body is where it should be.
        felt: feet feel forces.
    """

    def __init__(
        self, kinematics: Kinematics, first: Target, rate_hz: float, *, felt: bool = False
    ) -> None:
        self._kinematics, self._rate_hz, self._felt = kinematics, rate_hz, felt
        self.origin_m, self.rotation = first.origin_m, rotation_of(first.sample.rotation_rad)
        limbs = len(first.sample.foothold)
        self._before, self._places = np.full(limbs, -1), np.zeros((limbs, 3))
        self._velocity: Array | None = None

    def seen(self, target: Target, state: State) -> State:
        """A state with the body's pose, velocity and feet by odometry.

        Arguments:
            target: what this state came of.
        """
        feet, stood = self._kinematics.feet(state.angles_rad), target.sample.foothold
        if self._felt:
            stood = np.where(np.linalg.norm(state.forces_n, axis=1) > TOUCH_N, stood, -1)
        held, (origin, rotation) = (
            (stood >= 0) & (stood == self._before),
            (self.origin_m, self.rotation),
        )
        if held.any():
            self.origin_m, self.rotation = _body(
                feet[held], (self._places + target.rolled_m)[held], rotation
            )
        now = self.origin_m + feet @ self.rotation.T
        self._places = np.where(held[:, None], self._places, now - target.rolled_m)
        self._before = stood
        turned = Rotation.from_matrix(self.rotation @ rotation.T).as_rotvec()
        moved = self._rate_hz * np.concatenate([self.origin_m - origin, turned])
        share = 1.0 - np.exp(-1.0 / (_SMOOTH_S * self._rate_hz))
        before = moved if self._velocity is None else self._velocity
        self._velocity = before + share * (moved - before)
        return replace(
            state,
            position_m=self.origin_m,
            rotation=self.rotation,
            velocity=self._velocity,
            feet_m=now,
        )


def leg_odometry(record: Record, kinematics: Kinematics) -> tuple[Array, Array]:
    """p_WB and R_WB of the base's frame at every control period, shape (T, 3) [m] and (T, 3, 3).

    The first body is where it should be. Which feet stand is the plan's to say.
    """
    odometry = LegOdometry(kinematics, record.pairs[0][0], 1.0)
    states = [odometry.seen(target, state) for target, state in record.pairs]
    return np.array([state.position_m for state in states]), np.array(
        [state.rotation for state in states]
    )


def odometry_error_m(record: Record, kinematics: Kinematics) -> float:
    """Largest distance of the body from where it should be, by leg odometry [m]."""
    origins, _ = leg_odometry(record, kinematics)
    return float(
        np.linalg.norm(origins - [target.origin_m for target, _ in record.pairs], axis=1).max()
    )


def _body(feet: Array, places: Array, rotation: Array) -> tuple[Array, Array]:
    """The body whose feet, in its frame, come nearest to their places.

    Arguments:
        rotation: the one before.
    """
    middle, goal = feet.mean(axis=0), places.mean(axis=0)
    if len(feet) >= LEAST:
        rotation = Rotation.align_vectors(places - goal, feet - middle)[0].as_matrix()
    return goal - rotation @ middle, rotation


_ROUNDING_M = 1e-9
BORDER_M = 0.02
"""So far beyond its patch's border a foot may have slid and still be taken for standing on the
border."""


def measured_com_m(kinematics: Kinematics, state: State) -> Array:
    """The measured centre of mass, shape (3,) [m]."""
    return np.asarray(state.position_m + state.rotation @ kinematics.com_offset(state.angles_rad))


def deviation_m(
    target: Target, state: State, kinematics: Kinematics, seeks: NDArray[np.bool_]
) -> float:
    """Distance of the body, or of a foot that stands, from the plan [m].

    Arguments:
        seeks: feet that do not yet, shape (N,).
    """
    sample = target.sample
    body = float(np.linalg.norm(measured_com_m(kinematics, state) - sample.com_m))
    stands = sample.stands & ~seeks
    feet = np.linalg.norm(state.feet_m - target.rolled_m - sample.feet_m, axis=1)[stands]
    return max(body, float(feet.max(initial=0.0)))


def estimate_standing(
    patches: tuple[Patch, ...], state: State, kinematics: Kinematics, terrain: Sequence[Patch] = ()
) -> Standing | None:
    """Estimate how the robot stands; None where a foot left its patch.

    Arguments:
        patches: under all feet. Feet are put back into the planes of theirs. One that slid beyond
            its patch stands on what terrain there is in the same plane, or, where it is only a
            little beyond all that, on the border: what a plan takes feet to be off by, joints would
            make them slide.
    """
    toes, under = list[Array](), list[Patch]()
    for foot, radius, patch in zip(state.feet_m, kinematics.radii_m, patches, strict=True):
        toe = foot - radius * patch.normal
        inside = nearest_on(patch, toe)
        if _along(patch, inside - toe) > 0.0:
            around = [
                (other, nearest_on(other, toe)) for other in terrain if coplanar(patch, other)
            ]
            patch, inside = min(
                [(patch, inside), *around], key=lambda pair: _along(pair[0], pair[1] - toe)
            )
        if np.linalg.norm(inside - toe) > BORDER_M:
            return None
        toes.append(inside)
        under.append(patch)
    return Standing(
        com_m=measured_com_m(kinematics, state),
        rotation_rad=Rotation.from_matrix(state.rotation).as_rotvec(),
        toes_m=np.array(toes),
        patches=tuple(under),
        angles_rad=np.array(state.angles_rad),
    )


def _along(patch: Patch, away_m: Array) -> float:
    """Part of a way that is along a patch [m]; 0 for rounding errors."""
    along = float(np.linalg.norm(away_m - (away_m @ patch.normal) * patch.normal))
    return along if along > _ROUNDING_M else 0.0


def nearest_on(patch: Patch, point: Array) -> Array:
    """The point of a patch's surface nearest to a point, shape (3,) [m]."""
    corners, normal = patch.vertices_m, patch.normal
    flat = point - ((point - patch.centre_m) @ normal) * normal
    nearest = list[Array]()
    inside = True
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        inwards = np.cross(normal, edge)
        inwards = inwards * np.sign(inwards @ (patch.centre_m - a))
        inside &= bool((flat - a) @ inwards >= 0.0)
        s = np.clip((flat - a) @ edge / max(float(edge @ edge), 1e-18), 0.0, 1.0)
        nearest.append(a + s * edge)
    return flat if inside else min(nearest, key=lambda p: float(np.linalg.norm(p - flat)))
