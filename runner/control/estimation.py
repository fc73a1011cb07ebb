"""State of the robot as the closed loop estimates it from measurements: where the robot stands, how
far off that is, surfaces as feet find them, and friction as they feel it.

A foot that was lowered as far as it may be, and bears nothing, stands on nothing: the place is cut
out of every candidate there is. Feet that stand say where their surfaces are, along the normals:
planes are moved there. Feet that slid say how much friction there is, those that held say how much
at least: a foot that slides feels |f_t| = s μ f_n, where μ is the course's friction and s the share
of it that there is; one that holds feels |f_t| ≤ s μ f_n. With ratios r = |f_t| / (μ f_n), σ of a
slide and σ_h of a stance that held,

    log L(s) = − Σ_slides (s − r)² / 2σ² + Σ_held log Φ((s − r) / σ_h),    0 < s ≤ 1,

and the interval is that of 90 % of L, a flat prior below the course's friction. Without a slide it
is one-sided. It is as good as the noise that is counted on: in simulated climbs s was .01 to .03
too high, which the noise does not cover (docs/concepts/following.md).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import log_ndtr

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.pieces import Standing
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import Surface

from ..log import Record
from ..worlds.world import State
from .foot_placement import TOUCH_N, touch_n
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

    def __init__(self, rate_hz: float, limbs: int, weight_n: float = np.inf) -> None:
        self._periods, self._touch_n = max(1, round(_EMPTY_S * rate_hz)), touch_n(weight_n)
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
        felt = np.einsum("ij,ij->i", state.forces_n, sample.normals) >= self._touch_n
        wanted = np.einsum("ij,ij->i", sample.forces_n, sample.normals) >= _BEARS * self._touch_n
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
                toe_m=None
                if foothold.toe_m is None
                else foothold.toe_m
                + (
                    moved(foothold.candidates[0]).vertices_m[0]
                    - foothold.candidates[0].vertices_m[0]
                ),
            )
            for foothold in course.footholds
        )
        return replace(course, terrain=tuple(map(moved, course.terrain)), footholds=footholds)


def found_offsets(patches: tuple[Patch, ...], state: State, kinematics: Kinematics) -> _Offsets:
    """Find the planes of the patches under feet that bear: the mean of theirs.

    Arguments:
        patches: under all feet, as planned.
    """
    planes, offsets = list[Patch](), list[list[float]]()
    for foot, force, radius, patch in zip(
        state.feet_m, state.forces_n, kinematics.radii_m, patches, strict=True
    ):
        if force @ patch.normal < touch_n(kinematics.weight_n):
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
            touches = np.linalg.norm(state.forces_n, axis=1) > touch_n(self._kinematics.weight_n)
            stood = np.where(touches, stood, -1)
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


_PRESSES, _OF_WEIGHT = 8.0, 0.2
"""A foot that should press with so many times what a touch is, or with this share of a light
robot's weight,"""
SILENT_S = 0.3
"""for this time, in one stance or several, and felt nothing meanwhile, is silent."""


class SilentFeet:
    """Counts, for every foot, the time in which it should have pressed and felt nothing.

    Arguments:
        weight_n: of the robot.
        names: of its limbs.
    """

    def __init__(self, rate_hz: float, weight_n: float, names: Sequence[str]) -> None:
        self._periods, self._names = SILENT_S * rate_hz, names
        self._presses_n = min(_PRESSES * TOUCH_N, _OF_WEIGHT * weight_n)
        self._touch_n = touch_n(weight_n)
        self._silent = np.zeros(len(names))

    def found(
        self, target: Target, state: State, seeks: NDArray[np.bool_] | Literal[False] = False
    ) -> str:
        """Message about a silent foot, and since when it is known, in one line; empty where none
        is. One more period.

        Arguments:
            seeks: feet that are still being lowered to uncertain ground, shape (N,): their time
                does not count.
        """
        sample = target.sample
        wanted_n, felt_n = sample.along_n, np.vecdot(state.forces_n, sample.normals)
        presses = sample.stands & (wanted_n >= self._presses_n) & np.logical_not(seeks)
        self._silent = np.where(felt_n >= self._touch_n, 0.0, self._silent + presses)
        limb = int(self._silent.argmax())
        if self._silent[limb] < self._periods:
            return ""
        return (
            f"foot of {self._names[limb]}: expected {wanted_n[limb]:.0f} N where it stands, felt "
            "none for "
            f"{SILENT_S:g} s: nothing is under it, or its sensor is dead"
        )


_BLOCK_S = 0.05
"""What a foot feels is looked at in blocks of this length."""
_STOOD_S = 0.1
"""A foot that was put down less than this ago may still find its place."""
_SLIDES_M_S, _HELD_M_S = 0.01, 0.002
"""A foot that should stand and moves faster than this slides, one that is slower than that
holds."""
_LOADED_N = 3.0
_CARRIED = 0.5
"""Share of what feet together should carry; where they carry less the body falls, and what they
feel is no friction."""
_SHARED_NOISE, _SLIDE_NOISE, _HELD_NOISE = 0.015, 0.015, 0.03
"""Standard deviations σ_0 of what all feet err by together; σ of one slide, besides the spread
within it and between slides; σ_h of the largest ratio that held."""
_CHANGED = 3.0
"""Evidence so many standard deviations above a slide that comes after it was of other ground."""
_NEWEST = 4
"""So many slides count, the newest: the same foot that slides again tells nothing new."""
_SHARES = np.linspace(0.005, 1.0, 200)
_TAIL = 0.05


_WINDOW_S = 0.05
_SLID_M = 0.0015
"""A loaded foot that moved so far along its surface within the window slides."""


class SlipDetector:
    """Detector of feet that slide, from the measurements of every control period."""

    def __init__(self, rate_hz: float) -> None:
        self._window, self._stood = max(1, round(_WINDOW_S * rate_hz)), round(_STOOD_S * rate_hz)
        self._feet = deque[Array](maxlen=self._window + 1)
        self._foothold: NDArray[np.int_] | None = None
        self._since = np.zeros(0, dtype=int)

    def slipping(self, target: Target, state: State) -> NDArray[np.bool_]:
        """shape (N,)."""
        sample = target.sample
        if self._foothold is None:
            self._since = np.full(len(sample.foothold), self._stood)
        else:
            same = sample.foothold == self._foothold
            self._since = np.where(same, self._since + 1, 0)
        self._foothold = sample.foothold
        self._feet.append(state.feet_m - target.rolled_m)
        moved = self._feet[-1] - self._feet[0]
        along = moved - np.einsum("ij,ij->i", moved, sample.normals)[:, None] * sample.normals
        loaded = np.einsum("ij,ij->i", state.forces_n, sample.normals) > _LOADED_N
        stands = sample.stands & (self._since >= self._stood)
        return np.asarray(stands & loaded & (np.linalg.norm(along, axis=1) > _SLID_M))


@dataclass(frozen=True, kw_only=True)
class FrictionInterval:
    """Shares of the course's friction: the most likely, and the ends of 90 % of the likelihood.

    Arguments:
        slides, held: how many stances slid, and how many held, that it is estimated from.
    """

    share: float = 1.0
    low: float = 0.0
    high: float = 1.0
    slides: int = 0
    held: int = 0

    @property
    def planned_on(self) -> float:
        """Share of friction to plan with: the lower end as soon as a foot slid, before that the
        course's own friction.
        """
        return self.low if self.slides else 1.0

    @property
    def line(self) -> str:
        """For people."""
        feet = f"{self.slides} stance{'s' * (self.slides != 1)} that slid, {self.held} that held"
        if self.slides:
            return f"{self.share:.2f} of the course's, {self.low:.2f} to {self.high:.2f} (90 %), by {feet}"
        return f"at least {self.low:.2f} of the course's (95 %), by {feet}"


_Felt = tuple[bool, float, float]
"""Evidence of one stance: whether it slid, its ratio, that of the slide or the largest that held,
and its noise."""


class FrictionEstimator:
    """Sums up what feet feel over a run; ``interval`` is what it says just now.

    Arguments:
        period_s: of control.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._felt = list[_Felt]()

    def add(self, record: Record, unit: float = 1.0) -> None:
        """Add the next measurements.

        Arguments:
            unit: the share of the course's friction that its targets count on.
        """
        if len(record.pairs) < 2:
            return
        for felt in _stances(record, self._period_s, unit):
            if felt[0]:
                self._felt = [old for old in self._felt if not _contradicted(old, felt)]
            self._felt.append(felt)

    @property
    def interval(self) -> FrictionInterval:
        """By all that was added, but for what a later slide contradicts: friction may have
        changed.
        """
        slides = np.array([felt[1:] for felt in self._felt if felt[0]][-_NEWEST:])
        held = [ratio for slid, ratio, _ in self._felt if not slid]
        likelihood = np.zeros(len(_SHARES))
        if len(slides):
            ratios, noises = slides.T
            between = float(np.var(ratios, ddof=1)) if len(slides) > 1 else 0.0
            each = float(np.mean(noises**2)) + between
            likelihood -= (_SHARES - ratios.mean()) ** 2 / (
                2.0 * (_SHARED_NOISE**2 + each / len(slides))
            )
        if held:
            likelihood += log_ndtr((_SHARES - max(held)) / _HELD_NOISE)
        best = len(_SHARES) - 1 - int(np.argmax(likelihood[::-1]))
        mass = np.cumsum(np.exp(likelihood - likelihood[best]))
        low, high = (
            float(_SHARES[np.searchsorted(mass, part * mass[-1])]) for part in (_TAIL, 1.0 - _TAIL)
        )
        share = float(_SHARES[best])
        return FrictionInterval(
            share=share,
            low=min(low, share),
            high=max(high, share) if len(slides) else 1.0,
            slides=len(slides),
            held=len(held),
        )


def estimated(record: Record, period_s: float) -> FrictionInterval:
    """Friction that one record alone shows."""
    estimator = FrictionEstimator(period_s)
    estimator.add(record)
    return estimator.interval


def _contradicted(old: _Felt, slide: _Felt) -> bool:
    """Tell whether there was more friction then than this slide, which came later, leaves room
    for.
    """
    (_, before, one), (_, now, other) = old, slide
    return before - now > _CHANGED * float(np.hypot(one, other))


def _stances(record: Record, period_s: float, unit: float) -> Iterator[_Felt]:
    """Evidence of every stance of a record, in the order of their ends."""
    targets, states = zip(*record.pairs, strict=True)
    feet = np.array([state.feet_m - target.rolled_m for target, state in record.pairs])
    normals = np.array([target.sample.normals for target in targets])
    forces = np.array([state.forces_n for state in states])
    friction = np.array([target.sample.friction for target in targets]) / unit
    foothold = np.array([target.sample.foothold for target in targets])
    normal = np.einsum("tij,tij->ti", forces, normals)
    across = np.linalg.norm(forces - normal[:, :, None] * normals, axis=2)
    wanted = np.array([target.sample.forces_n[:, 2].sum() for target in targets])
    carried = forces[:, :, 2].sum(axis=1) >= _CARRIED * wanted
    counts = (foothold >= 0) & (normal >= _LOADED_N) & (friction > 0.0) & carried[:, None]
    ratio = across / np.where(counts, normal * friction, np.inf)
    moved = np.diff(feet, axis=0, prepend=feet[:1])
    moved -= np.einsum("tij,tij->ti", moved, normals)[:, :, None] * normals
    result = list[tuple[int, _Felt]]()
    for limb in range(foothold.shape[1]):
        for begin, end in _runs(foothold[:, limb], round(_STOOD_S / period_s)):
            rows = slice(begin, end)
            columns = ratio[rows, limb], moved[rows, limb], counts[rows, limb]
            felt = _stance(*columns, period_s)
            result += [] if felt is None else [(end, felt)]
    return (felt for _, felt in sorted(result, key=lambda pair: pair[0]))


def _runs(foothold: NDArray[np.int_], stood: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 row of every stance; one that begins within the record has time to find
    its place.
    """
    borders = [0, *(np.flatnonzero(np.diff(foothold)) + 1).tolist(), len(foothold)]
    for begin, end in pairwise(borders):
        first = begin + (stood if begin else 0)
        if foothold[begin] >= 0 and end > first:
            yield first, end


def _stance(ratio: Array, moved: Array, counts: NDArray[np.bool_], period_s: float) -> _Felt | None:
    """Evidence of a stance, in blocks counted from its end; None where it bore nothing all the
    time.
    """
    block, held, slid = max(2, round(_BLOCK_S / period_s)), 0.0, list[float]()
    for end in range(len(ratio), block - 1, -block):
        rows = slice(end - block, end)
        if not counts[rows].all():
            continue
        speed = float(np.linalg.norm(moved[rows].sum(axis=0))) / (block * period_s)
        if speed >= _SLIDES_M_S:
            slides = np.linalg.norm(moved[rows], axis=1) >= _SLIDES_M_S * period_s
            slid += ratio[rows][slides].tolist()
        elif speed < _HELD_M_S:
            held = max(held, float(np.median(ratio[rows])))
    if slid:
        return True, float(np.median(slid)), float(np.hypot(_SLIDE_NOISE, _spread(slid)))
    return (False, held, _HELD_NOISE) if held > 0.0 else None


def _spread(values: Sequence[float]) -> float:
    """Standard deviation by the median of what is off the median."""
    some = np.asarray(values)
    return 1.4826 * float(np.median(np.abs(some - np.median(some))))
