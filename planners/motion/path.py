"""Path of body and feet from one key frame to the next, whatever the time that it takes.

The limbs of a frame lift along their surface's normal, go across while the body moves on a straight
line from one key frame to the next, and come down along the normal of the surface that they come
to. The others stay.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..arguments import cached_property
from ..errors import InvalidInput, check_time
from ..files.arrays import Array, way_to
from ..robot.inverse_kinematics import descend
from ..robot.leg import levelled, rotations_of
from ..robot.robot_file import FOOT_RADIUS_M
from ..terrain.patch import Solids, solids_of

if TYPE_CHECKING:
    from ..robot.kinematics import Kinematics

_TOUCH_DOWN_M = 0.02
"""No foot comes down farther beyond its place [m]."""
_ONE_IN = 1.0 + math.erf(-3.0 / math.sqrt(2.0))
"""How often a single toe is farther off than three deviations."""


def _deviations(toes: int) -> float:
    """Number of standard deviations that a foot comes down, for as many toes; 3 for one, 3.9 for
    thirty.
    """
    from statistics import NormalDist  # loads decimals and fractions, and few grounds ask for it

    return -NormalDist().inv_cdf(0.5 * _ONE_IN / max(toes, 1))


def touch_downs_m(plan: Plan) -> Array:
    """Distance beyond its place that each foot comes down along its patch's normal, 0 where the
    ground is exact, (P,) [m].
    """
    patches = plan.patches
    spread = np.zeros(len(patches))
    if all(patch.certainty is None for patch in patches):
        return spread
    for p, patch in enumerate(patches):
        if patch.certainty is not None:
            spread[p] = patch.normal[2] * float(patch.certainty.height_sd_m(plan.toes_m[p, :2]))
    known = sum(patch.certainty is not None for patch in patches)
    return np.asarray(np.minimum(_deviations(known) * spread, _TOUCH_DOWN_M))


_KEPT_M = 0.006
"""Feet of a robot of size 1 stay this far from the terrain on their path across [m]."""
_ROOM_M = 0.01
"""Feet are so much larger all around than their soles [m]."""
_RAISES_M = np.array(
    sorted(
        product((0.0, 0.02, 0.04, 0.07, 0.10, 0.14), repeat=2),
        key=lambda pair: (sum(pair), max(pair)),
    )
)
"""Heights beyond the usual to which a foot may be lifted, and by which higher it may come from, the
lowest first (36, 2)."""
_SHARES = np.linspace(0.0, 1.0, 21)


def clear_swing(
    ends: tuple[Array, Array],
    normals: tuple[Array, Array],
    lift_m: float | Array,
    solids: Solids,
    radius_m: float = FOOT_RADIUS_M,
    kept_m: float = _KEPT_M,
    raises_m: Array = _RAISES_M,
    corners_m: Array | None = None,
) -> Array:
    """The lowest swing that stays ``kept_m`` off the terrain on its path across; the clearest one
    where none does: where it begins, is lifted to, lowered from and ends, which straight lines join,
    shape (4, 3) [m].

    Arguments:
        ends, normals: of the two toes' surfaces, the foot's centres, shape (3,) [m].
        lift_m: least lift, or that of either end, shape (2,).
        radius_m: of the foot.
        corners_m: of a sole about its centre where it leaves and where it comes, shape (2, K, 3)
            [m]; None for a ball.
    """
    up, down = np.broadcast_to(lift_m, 2)
    lifted = ends[0] + (up + raises_m[:, :1]) * normals[0]
    lowered = ends[1] + (down + raises_m[:, 1:]) * normals[1]

    def gaps(its: slice) -> Array:
        paths = lifted[its, None] + _SHARES[:, None] * (lowered[its] - lifted[its])[:, None]
        if corners_m is not None:
            around = corners_m[0] + _SHARES[:, None, None] * (corners_m[1] - corners_m[0])
            paths = (paths[:, :, None] + around).reshape(len(paths), -1, 3)
        return np.asarray(solids.distances(paths).min(axis=(1, 2), initial=np.inf) - radius_m)

    gap = gaps(slice(1))
    if gap[0] < kept_m:
        gap = np.concatenate([gap, gaps(slice(1, None))])
    clear = gap >= kept_m
    k = int(np.argmax(clear) if clear.any() else np.argmax(gap))
    return np.array([ends[0], lifted[k], lowered[k], ends[1]])


LIFT_M = 0.05
"""Least height to which feet of a robot of size 1 are lifted [m]."""
_SOLE_LIFT_M = 0.02
"""The same of soles, whose ankles have no room to keep them level high behind the body [m]."""
_TIPS_RAD = np.array(
    sorted(
        product((0.0, 0.15, 0.3, 0.45, 0.6, -0.15, -0.3), repeat=2),
        key=lambda pair: (abs(pair[0]) + abs(pair[1]), abs(pair[0])),
    )
)
"""Angles by which the toes of a sole in the air may hang down where it is lifted and where it comes
down from, the smallest first (49, 2): a heel is lifted before the toes are, where the ankle has no
room."""
_ON_THE_WAY, _ROUNDS = np.arange(1, 12) / 4.0, 2
"""Moments of a swing at which a leg is asked whether it gets there: the part, and how much of it is
behind; and how often, as where the body is depends on its answer."""
_FOLLOWED_M = 1e-5
"""A leg whose sole's corners stay no farther from their way follows it [m]."""
APART_M = 0.01
"""Between two moments that are judged no foot and no body's origin of a robot of size 1 goes
farther [m]."""
MOST = 50_000
"""More moments than this are not judged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A straight part of the path, N limbs: body between two key frames, or at one, feet from here
    to there.

    Arguments:
        frames: between which the body goes.
        foothold: what every limb stands on, −1 in the air.
        surface: the foothold that it stands on, leaves or comes to, shape (N,).
        feet_m: centres of the feet at both ends, shape (2, N, 3).
        ups: directions that feet have up at both ends, shape (2, N, 3).
        part: of a step: 0 lifts, 1 goes across, 2 comes down; −1 of none.
    """

    frames: tuple[int, int]
    foothold: tuple[int, ...]
    surface: NDArray[np.int_]
    feet_m: Array
    ups: Array
    part: int = -1

    @property
    def length_m(self) -> float:
        """The way of the foot that goes farthest."""
        return float(np.linalg.norm(self.feet_m[1] - self.feet_m[0], axis=1).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMoments:
    """T moments of a path, N limbs.

    Arguments:
        before, after, share: the key frames that the body is between, and how far, (T,) each.
        com_m, rotation_rad: of the body, shape (T, 3).
        feet_m, ups: centres and directions that feet have up, shape (T, N, 3).
        foothold: as of ``Segment``, shape (T, N).
        part, passed: of a step, as of ``Segment``, and how much of it is behind, (T,) each.
    """

    before: NDArray[np.int_]
    after: NDArray[np.int_]
    share: Array
    com_m: Array
    rotation_rad: Array
    feet_m: Array
    ups: Array
    foothold: NDArray[np.int_]
    part: NDArray[np.int_]
    passed: Array

    @property
    def step(self) -> NDArray[np.int_]:
        """The key frame that the step goes to, shape (T,): where a moment is of one (``part``)."""
        return np.where(self.part == 0, self.before + 1, self.after)

    @property
    def lifted(self) -> Array:
        """Share of their lift that feet have behind them, 0 where they stand and 1 later on, shape
        (T, N).
        """
        return np.where(self.foothold >= 0, 0.0, np.where(self.part > 0, 1.0, self.passed)[:, None])

    @property
    def frame(self) -> Array:
        """Progress in key frames, e.g. 1.5 half way from frame 1 to 2, shape (T,)."""
        return np.asarray(self.before + self.share * (self.after - self.before))


class PlanPath:
    """The path of a plan.

    normals, feet_m: of every foothold, shape (P, 3): of its patch, and the foot's centre there [m];
    friction: of its patch, shape (P,);
    size: that of the robot, which all lengths of swings follow. lift_m: how far feet are lifted.
    touch_downs_m: how far beyond that it may come down until it feels, shape (P,) [m]. Raises
    InvalidInput where all limbs lift at once unless they may: no limb carries, and no position
    control can do that.

    Arguments:
        uncarried: all limbs may lift at once.
    """

    def __init__(self, plan: Plan, *, uncarried: bool = False) -> None:
        self.plan, course = plan, plan.problem
        self.size = course.robot.size
        self._names = course.robot.limb_names
        if course.uncarried and not uncarried:
            raise InvalidInput(
                f"frame {course.uncarried[0]}: expected limbs that stay and carry the robot, got a "
                "schedule that lifts "
                "all of them at once: no position control can execute that"
            )
        self.solids = solids_of(course.terrain)
        self._around = Solids(self.solids)
        patches = plan.patches
        self.normals = np.array([patch.normal for patch in patches])
        self.friction = np.array([patch.friction for patch in patches])
        self.radii_m = course.robot.foot_radii_m
        radii = self.radii_m[[self._names.index(each.limb) for each in course.footholds]]
        self.feet_m = plan.toes_m + radii[:, None] * self.normals
        self._holds = np.asarray(course.holds)
        legs = course.robot.own_model().legs if course.robot.own else ()
        self._legs = {leg.name: leg for leg in legs if leg.sole is not None}
        self.lift_m = (_SOLE_LIFT_M if self._legs else LIFT_M) * self.size
        insets = [0.0 if patch.certainty is None else patch.certainty.inset_m for patch in patches]
        self.touch_downs_m = touch_downs_m(plan)
        self._kept_m = (
            _KEPT_M * self.size + self.touch_downs_m + insets
        )  # steps may be higher, and begin earlier, than they seem

    def standing(self, frame: int) -> Segment:
        """All limbs where they are at a key frame."""
        holds = self._holds[frame]
        return Segment(
            frames=(frame, frame),
            foothold=tuple(holds.tolist()),
            surface=holds,
            feet_m=np.stack([self.feet_m[holds]] * 2),
            ups=np.stack([self.normals[holds]] * 2),
        )

    @cached_property
    def steps(self) -> tuple[tuple[Segment, ...], ...]:
        """Segments of the steps to every key frame but the first: lift, across and down; across
        alone where no limb moves.
        """
        return tuple(self._step(k) for k in range(1, self.plan.problem.frames))

    def support(self, frame: int) -> tuple[int, ...]:
        """The limbs that carry while those of ``frame`` lift; after the last frame, while the next
        would.
        """
        course = self.plan.problem
        lifted = course.lifts[frame] if frame < course.frames else course.next_lift
        support = tuple(i for i, name in enumerate(self._names) if name not in lifted)
        return support or tuple(range(len(self._names)))

    def _step(self, k: int) -> tuple[Segment, ...]:
        check_time(doing="while paths of feet were looked for")
        old, new = self._holds[k - 1], self._holds[k]
        moving = [self._names.index(name) for name in self.plan.problem.lifts[k]]
        comes = old.copy()
        comes[moving] = new[moving]
        corners = np.stack([self.feet_m[old]] * 4)
        left, came = self.normals[old], self.normals[comes]
        ups = np.array([[left, left], [came, came], [came, came]])
        for i in moving:
            if self._names[i] in self._legs:
                swing, turned = self._sole_swing(k, i, old[i], new[i])
                ups[:, :, i] = np.stack([turned[:-1], turned[1:]], axis=1)
            else:
                swing = self._swing(i, old[i], new[i])
            corners[:, i] = swing
        held = np.isin(np.arange(len(old)), moving, invert=True)
        foothold = tuple(np.where(held, old, -1).tolist())
        parts = tuple(
            Segment(
                frames=frames,
                foothold=foothold,
                surface=comes if part else old,
                feet_m=corners[part : part + 2],
                ups=ups[part],
                part=part,
            )
            for part, frames in enumerate(((k - 1, k - 1), (k - 1, k), (k, k)))
        )
        return parts if moving else parts[1:2]

    def _swing(
        self,
        limb: int,
        old: int,
        new: int,
        drops_m: Array | float = 0.0,
        corners_m: Array | None = None,
    ) -> Array:
        """The clear swing of a limb from one foothold to another.

        Arguments:
            drops_m: how much higher than others it is lifted at either end, shape (2,).
            corners_m: as of ``clear_swing``.
        """
        return clear_swing(
            (self.feet_m[old], self.feet_m[new]),
            (self.normals[old], self.normals[new]),
            self.lift_m + drops_m,
            self._around,
            float(self.radii_m[limb]),
            float(self._kept_m[[old, new]].max()),
            self.size * _RAISES_M,
            corners_m,
        )

    def _sole_swing(self, k: int, limb: int, old: int, new: int) -> tuple[Array, Array]:
        """The swing to key frame k of a limb with a sole whose toes hang down the least, of those
        that its leg can follow, and directions that the sole has up at its four corners, shape (4,
        3). The one that is followed best where its leg follows none.
        """
        sole = self._legs[self._names[limb]].sole
        assert sole is not None
        out = sole.points_m * (1.0 + _ROOM_M / np.linalg.norm(sole.points_m, axis=1)[:, None])
        flat = levelled(self.normals[[old, new]])
        best: tuple[float, Array, Array] | None = None
        for tips in _TIPS_RAD:
            sine, cosine = np.sin(tips)[:, None], np.cos(tips)[:, None]
            ups = cosine * flat[:, :, 2] + sine * flat[:, :, 0]
            corners = out @ np.swapaxes(levelled(ups)[:, :, :2], 1, 2)
            drops = np.maximum(-np.einsum("ski,si->sk", corners, flat[:, :, 2]).min(axis=1), 0.0)
            swing = self._swing(limb, old, new, drops, corners)
            turned = np.array([flat[0, :, 2], *ups, flat[1, :, 2]])
            if self.plan.joints_rad is None:
                return swing, turned
            missed = self._missed_m(k, limb, swing, turned)
            if best is None or missed < best[0]:
                best = missed, swing, turned
            if missed <= _FOLLOWED_M:
                break
        assert best is not None
        return best[1:]

    def _missed_m(self, k: int, limb: int, corners: Array, ups: Array) -> float:
        """Largest distance that a leg stays from such a swing to key frame k [m].

        Arguments:
            corners, ups: the sole's middles, and directions that it has up, shape (4, 3).
        """
        plan, kinematics = self.plan, self._kinematics
        assert plan.joints_rad is not None
        part = _ON_THE_WAY.astype(int)
        passed = (_ON_THE_WAY - part)[:, None]
        body = np.clip(_ON_THE_WAY - 1.0, 0.0, 1.0)[:, None]

        def on_line(first: Array, last: Array) -> Array:
            return np.asarray(first + body * (last - first))

        ends, joints = (k - 1, k), kinematics.joints_of(limb)
        turns = rotations_of(on_line(*plan.rotation_rad[[*ends]]))
        com, drawn = on_line(*plan.com_m[[*ends]]), on_line(*plan.joints_rad[[*ends]])
        feet, up = (line[part] + passed * (line[part + 1] - line[part]) for line in (corners, ups))
        angles, missed = drawn.copy(), np.zeros(len(part))
        for _ in range(_ROUNDS):  # legs weigh something
            shifts = np.array([kinematics.com_offset(posture) for posture in angles])
            origins = com - np.einsum("tij,tj->ti", turns, shifts)
            angles[:, joints], missed = descend(
                kinematics.model.legs[limb],
                np.einsum("tij,ti->tj", turns, feet - origins),
                drawn[:, joints],
                np.einsum("tij,ti->tj", turns, up),
            )
        return float(missed.max())

    @cached_property
    def _kinematics(self) -> Kinematics:
        from ..robot.kinematics import Kinematics  # slow to import

        return Kinematics(self.plan.problem.robot)

    def swing(self, foothold: int, shares: Array) -> Array:
        """Place of a toe at shares of its way to a foothold, shape (K, 3) [m]: up, across and
        down.
        """
        foothold_ahead = self.plan.problem.footholds[foothold]
        step, limb = self.steps[foothold_ahead.frame - 1], self._names.index(foothold_ahead.limb)
        ends = [(segment.feet_m[:, limb], self.normals[segment.surface[limb]]) for segment in step]
        feet = [feet[end] for feet, _ in ends for end in (0, 1)]
        normals = [ends[0][1]] * (len(feet) // 2) + [ends[-1][1]] * (len(feet) // 2)
        toes = np.array(feet) - self.radii_m[limb] * np.array(normals)
        way = way_to(toes)
        return np.stack([np.interp(shares * way[-1], way, axis) for axis in toes.T], axis=1)

    def moments(self, apart_m: float = APART_M) -> PathMoments:
        """The whole path, with its first and its last moment; none goes farther than this, times
        the robot's size, from the one before.

        Raises InvalidInput for a path of more than ``MOST`` moments.
        """
        return self.divided(self.counts(apart_m))

    def counts(self, apart_m: float = APART_M) -> NDArray[np.int_]:
        """Number of moments of every segment at this spacing, the one before it left out.

        Raises InvalidInput as above.
        """
        lengths = np.array([self._length(segment) for segment in self._segments()])
        apart_m *= self.size
        if not lengths.sum() <= MOST * apart_m:
            raise InvalidInput(
                f"path: expected at most {MOST * apart_m:g} m of it, got {lengths.sum():.3g} m"
            )
        return np.maximum(1, np.ceil(lengths / apart_m)).astype(int)

    def divided(self, counts: NDArray[np.int_]) -> PathMoments:
        """The whole path, so many moments of every segment."""
        parts = zip(self._segments(), counts.tolist(), strict=True)
        return self.at([(of, np.arange(1, n + 1) / n) for of, n in parts])

    def at(self, parts: list[tuple[Segment, Array]]) -> PathMoments:
        """Moments of segments, at shares of them of shape (K,)."""
        plan, counts = self.plan, [len(shares) for _, shares in parts]
        share = np.concatenate([shares for _, shares in parts])
        ends = np.repeat(np.array([segment.frames for segment, _ in parts]), counts, axis=0)
        feet, ups = (
            [ends[0] + shares[:, None, None] * (ends[1] - ends[0]) for ends, shares in lines]
            for lines in (
                [(segment.feet_m, shares) for segment, shares in parts],
                [(segment.ups, shares) for segment, shares in parts],
            )
        )
        foothold = np.repeat(np.array([segment.foothold for segment, _ in parts]), counts, axis=0)
        body = np.where(ends[:, 0] == ends[:, 1], 0.0, share)[:, None]
        before, after = ends.T
        return PathMoments(
            before=before,
            after=after,
            share=body[:, 0],
            com_m=plan.com_m[before] + body * (plan.com_m[after] - plan.com_m[before]),
            rotation_rad=plan.rotation_rad[before]
            + body * (plan.rotation_rad[after] - plan.rotation_rad[before]),
            feet_m=np.concatenate(feet),
            ups=np.concatenate(ups),
            foothold=foothold,
            part=np.repeat([segment.part for segment, _ in parts], counts),
            passed=share,
        )

    def _segments(self) -> Iterator[Segment]:
        yield self.standing(0)
        for step in self.steps:
            yield from step
            yield self.standing(step[-1].frames[1])

    def _length(self, segment: Segment) -> float:
        """Length of the way of the foot, or of the body's origin, that goes farthest [m]."""
        first, last = segment.frames
        return max(
            segment.length_m, float(np.linalg.norm(self.plan.com_m[last] - self.plan.com_m[first]))
        )


def path_of(plan: Plan) -> PlanPath:
    """The path of body and feet through a plan's key frames; made once for whoever judges, runs or
    shows it.

    Raises InvalidInput where all limbs lift at once.
    """
    path: PlanPath = vars(plan).get("_path") or vars(plan).setdefault("_path", PlanPath(plan))
    return path
