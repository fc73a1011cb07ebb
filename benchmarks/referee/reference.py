"""Where body and feet are to be, and what feet press with, every few milliseconds: from key frames,
samples or a leap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from .files import KeyFrames, Leap, Samples
from .ground import Solids, Surface
from .settings import Settings

Array = NDArray[np.float64]
HIGHER_M = (0.0, 0.02, 0.04, 0.07, 0.1, 0.14)
"""How much more than usual a foot may be lifted, and how much higher it may come down from."""
ALONG = np.linspace(0.0, 1.0, 25)[:, None]
LANDED_S, DRAWN_UP = 2.0, 1.1
"""A leap is watched for so long after its end [s]; legs are drawn up to no less than so many of
their least lengths."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """A motion at T moments, N feet.

    Attributes:
        step_s: time between moments [s].
        com_m: centre of mass, shape (T, 3) [m].
        turn: quaternions of the body, shape (T, 4).
        centres_m: of the feet's balls, shape (T, N, 3) [m].
        forces_n: on the feet, shape (T, N, 3) [N].
        stands: which feet stand, shape (T, N).
        normals: of the ground under feet, shape (T, N, 3).
        friction: of the ground under feet, shape (T, N).
        near: what joints are drawn to, by name, shape (T,) each.
        dynamic: whether forces also carry what the body accelerates.
        stances: of a plan, the moment at which each row of its forces carries alone.
    """

    step_s: float
    com_m: Array
    turn: Array
    centres_m: Array
    forces_n: Array
    stands: NDArray[np.bool_]
    normals: Array
    friction: Array
    near: Mapping[str, Array]
    dynamic: bool
    stances: Mapping[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """A corner of a plan's motion: key frames on both sides of it and its place between them, feet,
    forces.
    """

    frame: int
    centres: Array
    forces: Array
    surface: NDArray[np.int64]


def of_plan(plan: KeyFrames, radii_m: Array, settings: Settings) -> Reference:
    """The motion of a plan: load to those that stay, up, across with the body, down, load to
    all.
    """
    return _PlanMotion(plan, radii_m, settings).reference()


class _PlanMotion:
    def __init__(self, plan: KeyFrames, radii_m: Array, settings: Settings) -> None:
        self.plan, self.radii, self.settings = plan, radii_m, settings
        self.solids = Solids(plan.patches, settings.thick_m)
        self.parts = list[tuple[int, _State, _State, frozenset[int]]]()
        self.marks = dict[tuple[int, frozenset[int]], int]()
        self.count = 0

    def reference(self) -> Reference:
        """Lay all phases one after another, and sample them."""
        plan, times = self.plan, self.settings.timing
        now = self._standing(0)
        self._add(times.rest_s, now, now)
        self._mark(0, self._others(frozenset()))
        for frame in range(1, len(plan.com_m)):
            now = self._step(frame, now)
        ends = plan.lifted[-1]
        if ends:
            last = self._with(now, self._force(len(plan.com_m) - 1, self._others(ends)))
            self._add(times.shift_s, now, last)
            self._mark(len(plan.com_m) - 1, self._others(ends))
            now = last
        self._add(times.rest_s, now, now)
        return self._sampled()

    def _step(self, frame: int, now: _State) -> _State:
        """From one key frame to the next."""
        plan, times = self.plan, self.settings.timing
        lifted = plan.lifted[frame]
        stay = self._others(lifted)
        if not stay:
            raise ValueError(
                f"course: lifts: frame {frame}: expected limbs that carry, all of them lift"
            )
        after = self._standing(frame)
        before, loaded = self._force(frame - 1, stay), self._force(frame, stay)
        ready = self._with(now, before)
        self._add(times.shift_s, now, ready)
        high, over = self._swing(frame, lifted, now.centres, after.centres)
        up = _State(frame=frame - 1, centres=high, forces=before, surface=now.surface)
        down = _State(frame=frame, centres=over, forces=loaded, surface=after.surface)
        there = self._with(after, loaded)
        if lifted:
            self._add(times.lift_s, ready, up, lifted)
        self._mark(frame - 1, stay)
        self._add(times.across_s, up, down, lifted)
        self._mark(frame, stay)
        if lifted:
            self._add(times.down_s, down, there, lifted)
        self._add(times.load_s, there, after)
        return after

    def _standing(self, frame: int) -> _State:
        """All feet stand, with the mean of the frame's stances."""
        plan, holds = self.plan, self.plan.holds[frame]
        centres = plan.toes_m[holds] + self.radii[:, None] * plan.normals[holds]
        rows = [force for (k, _), force in plan.forces_n.items() if k == frame]
        return _State(frame=frame, centres=centres, forces=np.mean(rows, axis=0), surface=holds)

    def _force(self, frame: int, carry: frozenset[int]) -> Array:
        """What these carry with at a frame; where the file has no such stance, the mean of those it
        has.
        """
        found = self.plan.forces_n.get((frame, carry))
        return self._standing(frame).forces if found is None else found

    def _others(self, lifted: frozenset[int]) -> frozenset[int]:
        return frozenset(range(len(self.radii))) - lifted

    def _with(self, state: _State, forces: Array) -> _State:
        return _State(
            frame=state.frame, centres=state.centres, forces=forces, surface=state.surface
        )

    def _swing(
        self, frame: int, lifted: frozenset[int], begin: Array, end: Array
    ) -> tuple[Array, Array]:
        """Corners of the ways of those that swing: the lowest that stay clear of the ground, or the
        clearest.
        """
        plan, settings = self.plan, self.settings
        high, over = begin.copy(), end.copy()
        for limb in lifted:
            first = plan.normals[plan.holds[frame - 1, limb]]
            second = plan.normals[plan.holds[frame, limb]]
            best = -np.inf
            for up, down in sorted(product(HIGHER_M, repeat=2), key=sum):
                left = begin[limb] + (settings.lift_m + up) * first
                right = end[limb] + (settings.lift_m + down) * second
                gap = self.solids.clearance(left + ALONG * (right - left)) - self.radii[limb]
                if gap > best:
                    best, high[limb], over[limb] = gap, left, right
                if gap >= settings.clear_m:
                    break
        return high, over

    def _add(
        self, seconds: float, begin: _State, end: _State, lifted: frozenset[int] = frozenset()
    ) -> None:
        moments = max(1, round(seconds / self.settings.control_s))
        self.parts.append((moments, begin, end, lifted))
        self.count += moments

    def _mark(self, frame: int, carry: frozenset[int]) -> None:
        self.marks[frame, carry] = self.count - 1

    def _sampled(self) -> Reference:
        plan, feet = self.plan, len(self.radii)
        columns: dict[str, list[Array]] = {
            name: [] for name in ("com", "turn", "centres", "forces", "stands", "surface", "share")
        }
        near = {name: list[Array]() for name in plan.joints_rad}
        for moments, begin, end, lifted in self.parts:
            share = _smooth(np.arange(1, moments + 1) / moments)[:, None]

            def between(one: Array, two: Array, share: Array = share) -> Array:
                weights = share.reshape(-1, *(1,) * one.ndim)
                return np.asarray(one + weights * (two - one))

            columns["com"].append(between(plan.com_m[begin.frame], plan.com_m[end.frame]))
            rotation = between(plan.rotation_rad[begin.frame], plan.rotation_rad[end.frame])
            columns["turn"].append(np.array([quaternion(vector) for vector in rotation]))
            columns["centres"].append(between(begin.centres, end.centres))
            columns["forces"].append(between(begin.forces, end.forces))
            stands = np.array([foot not in lifted for foot in range(feet)])
            columns["stands"].append(np.tile(stands, (moments, 1)))
            columns["surface"].append(np.tile(end.surface, (moments, 1)))
            for name, angles in plan.joints_rad.items():
                near[name].append(between(angles[begin.frame], angles[end.frame]))
        surface = np.concatenate(columns["surface"]).astype(int)
        return Reference(
            step_s=self.settings.control_s,
            com_m=np.concatenate(columns["com"]),
            turn=np.concatenate(columns["turn"]),
            centres_m=np.concatenate(columns["centres"]),
            forces_n=np.concatenate(columns["forces"]),
            stands=np.concatenate(columns["stands"]).astype(bool),
            normals=plan.normals[surface],
            friction=plan.friction[surface],
            near={name: np.concatenate(parts) for name, parts in near.items()},
            dynamic=False,
            stances={
                index: self.marks[stance]
                for index, stance in enumerate(plan.stances)
                if stance in self.marks
            },
        )


def of_walk(walk: Samples, surface: Surface, radii_m: Array, settings: Settings) -> Reference:
    """The motion of a walk, at rest before and after."""
    rest = settings.timing.rest_s
    duration = float(walk.times_s[-1] - walk.times_s[0])
    count = round((duration + 2.0 * rest) / settings.control_s)
    times = walk.times_s[0] - rest + settings.control_s * np.arange(1, count + 1)
    now = np.clip(times, walk.times_s[0], walk.times_s[-1])
    before = np.clip(np.searchsorted(walk.times_s, now, side="right") - 1, 0, len(walk.times_s) - 2)
    share = (now - walk.times_s[before]) / (walk.times_s[before + 1] - walk.times_s[before])

    def between(table: Array) -> Array:
        weights = share.reshape(-1, *(1,) * (table.ndim - 1))
        return np.asarray(table[before] + weights * (table[before + 1] - table[before]))

    turns = np.array([_quaternion_of(matrix) for matrix in walk.rotation])
    turns[np.cumsum(np.r_[False, (turns[1:] * turns[:-1]).sum(axis=1) < 0.0]) % 2 == 1] *= -1.0
    turn = between(turns)
    feet = between(walk.feet_m)
    normals = surface.normals(feet[..., 0], feet[..., 1])
    return Reference(
        step_s=settings.control_s,
        com_m=between(walk.com_m),
        turn=turn / np.linalg.norm(turn, axis=1, keepdims=True),
        centres_m=feet + radii_m[:, None] * normals,
        forces_n=between(walk.forces_n),
        stands=walk.contact[before],
        normals=normals,
        friction=np.full(feet.shape[:2], walk.friction),
        near={},
        dynamic=True,
        stances={},
    )


def of_leap(leap: Leap, radii_m: Array, settings: Settings) -> Reference:
    """The motion of a leap, at rest before and after; feet in the air begin and end at rest."""
    end, rest = float(leap.times_s[-1]), settings.timing.rest_s
    count = round((rest + end + LANDED_S) / settings.control_s)
    now = np.clip(settings.control_s * np.arange(1, count + 1) - rest, 0.0, end)
    k = np.clip(np.searchsorted(leap.times_s, now + 1e-9, side="right") - 1, 0, len(leap.holds) - 1)
    since, lasts = (now - leap.times_s[k])[:, None], np.diff(leap.times_s)[:, None]
    pull = np.diff(leap.velocity_m_s, axis=0) / lasts
    vectors = leap.rotation_rad[k] + since / lasts[k] * np.diff(leap.rotation_rad, axis=0)[k]
    com = leap.com_m[k] + since * leap.velocity_m_s[k] + 0.5 * since**2 * pull[k]
    normals = np.array([patch.normal for patch in leap.patches])
    friction = np.array([patch.friction for patch in leap.patches])
    surface, centres = leap.holds[k], np.empty((count, len(radii_m), 3))
    for foot, holds in enumerate(leap.holds.T):
        stands = np.flatnonzero(holds >= 0)
        centre = {j: leap.toes_m[j] + radii_m[foot] * normals[j] for j in set(holds[stands])}
        for q in range(len(holds)):
            here = k == q
            if holds[q] >= 0:
                centres[here, foot] = centre[holds[q]]
                continue
            first, last = stands[stands < q][-1] + 1, stands[stands > q][0]
            ends = np.array([centre[holds[first - 1]], centre[holds[last]]])
            path = _through_the_air(leap, foot, (int(first), int(last)), ends)
            centres[here, foot] = com[here] + path(now[here])
            surface[here, foot] = holds[last]
    return Reference(
        step_s=settings.control_s,
        com_m=com,
        turn=np.array([quaternion(vector) for vector in vectors]),
        centres_m=centres,
        forces_n=leap.forces_n[k],
        stands=leap.holds[k] >= 0,
        normals=normals[surface],
        friction=friction[surface],
        near={},
        dynamic=True,
        stances={},
    )


def _through_the_air(leap: Leap, foot: int, nodes: tuple[int, int], centres: Array) -> CubicSpline:
    """A foot's way from the centre of mass between two ends of intervals, at rest in the world at
    both: drawn up to its hip, as the file says.
    """
    (edge, fold), at = leap.gather, list(nodes)
    ends = centres - leap.com_m[at]
    hips = np.empty((2, 3))
    for hip, vector in zip(hips, leap.rotation_rad[at], strict=True):
        mujoco.mju_rotVecQuat(hip, leap.hips_m[foot], quaternion(vector))
    shares = np.array([[edge], [1.0 - edge]])
    straight, over = (pair[0] + shares * (pair[1] - pair[0]) for pair in (ends, hips))
    short = max(
        fold * float(np.linalg.norm(ends - hips, axis=1).min()), DRAWN_UP * leap.folded_m[foot]
    )
    away = straight - over
    length = np.linalg.norm(away, axis=1, keepdims=True)
    inner = over + np.minimum(short / np.maximum(length, 1e-9), 1.0) * away
    begin, end = leap.times_s[at]
    knots = begin + (end - begin) * np.array([0.0, edge, 1.0 - edge, 1.0])
    moves = -leap.velocity_m_s[at]
    places = np.vstack([ends[:1], inner, ends[1:]])
    return CubicSpline(knots, places, bc_type=((1, moves[0]), (1, moves[1])))


def quaternion(rotation: Sequence[float] | Array) -> Array:
    """The quaternion of a rotation vector, shape (3,) to (4,)."""
    vector, found = np.asarray(rotation, dtype=float), np.empty(4)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 1e-12 else np.array([1.0, 0.0, 0.0])
    mujoco.mju_axisAngle2Quat(found, axis, angle)
    return found


def rotation_between(wanted: Array, found: Array) -> Array:
    """The rotation vector, in world axes, that takes the found quaternion to the wanted one, shape
    (3,) [rad].
    """
    inverse, difference, vector = np.empty(4), np.empty(4), np.empty(3)
    mujoco.mju_negQuat(inverse, found)
    mujoco.mju_mulQuat(difference, wanted, inverse)
    mujoco.mju_quat2Vel(vector, difference, 1.0)
    return vector


def cross(one: Array, two: Array) -> Array:
    """The cross product of two vectors, shape (3,): faster than NumPy's, which is for arrays of
    them.
    """
    (a, b, c), (x, y, z) = one.tolist(), two.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def _quaternion_of(matrix: Array) -> Array:
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(matrix).ravel())
    return found


def _smooth(share: Array) -> Array:
    """Rest to rest, smooth twice."""
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))
