"""A gait's trajectory as a motion that the tracker follows: at rest before and after, at its own
pace in between.

A gait is dynamic: at another pace its forces balance no longer, so it is run as planned or not at
all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Crossing
from ..answer.motion import Motion
from ..answer.plan import LeapPlan, Plan
from ..answer.trajectory import Trajectory
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from ..robot.robot_file import FOOT_RADIUS_M
from ..terrain.patch import Solid
from .leap_motion import SETTLE_S, LeapMotion, LeapRun
from .motion import Samples, rotation_rate, smooth, smooth_rate, stacked
from .plan_motion import PlanMotion

BLEND_S = 1.0
"""From the end of one part to the beginning of the next."""
_BLEND_KNOTS = 10


class CrossingMotion:
    """A crossing over time; ``Samples.frame`` counts seconds.

    Arguments:
        crossing: the crossing.
        climbs: the motions of its plans of key frames, timed by whoever follows them; None for
            those of the plans as they are.

    Raises:
        InvalidInput: for a robot without legs of its own.
    """

    counted = "seconds"

    def __init__(self, crossing: Crossing, climbs: Sequence[PlanMotion] | None = None) -> None:
        self.crossing = crossing
        timed = iter(climbs or [])
        self.parts: list[PlanMotion | LeapRun] = []
        for part in crossing.parts:
            if isinstance(part, LeapPlan):
                self.parts.append(LeapRun(part, rest_s=SETTLE_S))
            else:
                self.parts.append(next(timed) if climbs is not None else PlanMotion(part))
        lasts = [part.duration_s for part in self.parts]
        self._begins = np.concatenate([[0.0], np.cumsum(np.array(lasts[:-1]) + BLEND_S)])
        self._ends = self._begins + lasts
        self._numbers, self.stances = self._numbered()
        self.solids: tuple[Solid, ...] = tuple(self.parts[0].solids)

    def _numbered(self) -> tuple[list[NDArray[np.int_]], Sequence[str]]:
        """Number of every foothold of every part in the whole, those that stand when a part begins
        being those of the one before; and what each is called.
        """
        numbers, names, standing = list[NDArray[np.int_]](), list[str](), None
        for k, (part, motion) in enumerate(zip(self.crossing.parts, self.parts, strict=True), 1):
            holds, mine = part.problem.holds, np.zeros(len(part.problem.footholds), dtype=int)
            for j, foothold in enumerate(part.problem.footholds):
                if standing is not None and foothold.frame == 0:
                    limb = part.problem.robot.limb_names.index(foothold.limb)
                    mine[j] = standing[limb]
                    continue
                mine[j] = len(names)
                names.append(f"part {k}: {motion.stances[j]}")
            numbers.append(mine)
            standing = mine[holds[-1]]
        return numbers, tuple(names)

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return float(self._ends[-1])

    @property
    def last_frame(self) -> float:
        """The end [s]."""
        return self.duration_s

    @property
    def goal_m(self) -> Array:
        """Place at which the centre of mass ends, shape (3,) [m]."""
        return np.asarray(self.crossing.parts[-1].com_m[-1])

    def entry(self) -> dict[str, Any]:
        """Start and goal, and when every part begins, for a log."""
        first = self.crossing.parts[0]
        return {"start_m": first.com_m[0], "goal_m": self.goal_m, "begins_s": self._begins}

    @property
    def committed_s(self) -> tuple[tuple[float, float], ...]:
        """From when to when the body is on its way through the air whatever its legs do, per leap
        [s].
        """
        spans = list[tuple[float, float]]()
        for begin, part in zip(self._begins, self.parts, strict=True):
            if isinstance(part, LeapRun):
                spans += [(begin + first, begin + last) for first, last in part.committed_s]
        return tuple(spans)

    @property
    def knots_s(self) -> Array:
        """Times at which postures are chosen, shape (K,) [s]."""
        knots = [self._begins[0] + self.parts[0].knots_s]
        for k in range(1, len(self.parts)):
            between = np.linspace(self._ends[k - 1], self._begins[k], _BLEND_KNOTS + 1)
            knots += [between[1:-1], self._begins[k] + self.parts[k].knots_s]
        return np.concatenate(knots)

    def part_at(self, time_s: float) -> int:
        """Number of the part that is under way, or that comes next."""
        return int(np.searchsorted(self._ends, time_s).clip(0, len(self.parts) - 1))

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        times = np.asarray(times_s, dtype=np.float64)
        if times.ndim == 0:
            return self._one(float(times))
        when, rows = times.ravel(), dict[int, Samples]()
        part = np.array([self.part_at(float(time)) for time in when])
        within = when - self._begins[part]
        for k in range(len(self.parts)):
            here = np.flatnonzero((part == k) & ((within >= 0.0) | (k == 0)))
            if len(here):
                samples = self._of(k, within[here], when[here]).rows()
                rows.update(zip(here.tolist(), samples, strict=True))
        return stacked([rows.get(i) or self._one(float(time)) for i, time in enumerate(when)])

    def _one(self, time_s: float) -> Samples:
        """The sample at one time."""
        k = self.part_at(time_s)
        if k == 0 or time_s >= self._begins[k]:
            return self._of(k, time_s - float(self._begins[k]), time_s)
        s = (time_s - float(self._ends[k - 1])) / BLEND_S
        share, rate = smooth(s), smooth_rate(s) / BLEND_S
        before = self._of(k - 1, self.parts[k - 1].duration_s, time_s)
        after = self._of(k, 0.0, time_s)

        def mixed(name: str) -> Array:
            a, b = getattr(before, name), getattr(after, name)
            return np.asarray(a + share * (b - a))

        def moving(name: str) -> Array:
            return np.asarray(rate * (getattr(after, name) - getattr(before, name)))

        return replace(
            after,
            com_m=mixed("com_m"),
            velocity_m_s=moving("com_m"),
            rotation_rad=mixed("rotation_rad"),
            rotation_rate_rad_s=moving("rotation_rad"),
            feet_m=mixed("feet_m"),
            forces_n=mixed("forces_n"),
        )

    def _of(self, k: int, within_s: float | Array, time_s: float | Array) -> Samples:
        """The samples of a part at times of its own, by the numbers of the whole."""
        sample = self.parts[k].at(within_s)
        held = self._numbers[k][np.maximum(sample.foothold, 0)]
        foothold = np.where(sample.foothold >= 0, held, -1)
        frame = np.clip(np.asarray(time_s), 0.0, self.duration_s)
        return replace(sample, foothold=foothold, frame=frame)


def plans_of(crossing: Crossing) -> list[Plan]:
    """The plans of key frames of a crossing, in order.

    Raises InvalidInput for one whose plans are not executed.
    """
    plans = [part for part in crossing.parts if isinstance(part, Plan)]
    for plan in plans:
        if plan.problem.uncarried:
            raise InvalidInput(
                f"crossing {crossing.name}: expected climbs in which limbs carry, got something else"
            )
    return plans


WALK_SETTLE_S = 0.5
"""At rest before and after."""
_KNOT_S = 0.05
"""Comfortable postures are looked for so often."""


class GaitMotion:
    """A trajectory over time.

    Feet are spheres: a radius above what they touch. ``Samples.frame`` counts seconds.

    Arguments:
        radii_m: of the feet, shape (N,), or of all of them. stances: what every stance is called,
            of all feet; ``Samples.foothold`` counts them.
    """

    counted = "seconds"
    solids: tuple[Solid, ...] = ()

    def __init__(self, trajectory: Trajectory, radii_m: Array | float = FOOT_RADIUS_M) -> None:
        from scipy.spatial.transform import Rotation, Slerp  # slow to import

        self.trajectory = trajectory
        self._radii = np.broadcast_to(radii_m, (len(trajectory.robot.feet),))
        self._friction = np.full(len(self._radii), trajectory.friction)
        self._turned = Slerp(trajectory.times_s, Rotation.from_matrix(trajectory.rotation))
        self._normals = trajectory.terrain.normal(trajectory.feet_m[..., :2])
        self._foothold = footholds(trajectory.contact)
        self.stances: Sequence[str] = tuple(
            f"{trajectory.robot.limb_names[foot]}, put down at {trajectory.times_s[row]:.2f} s,"
            for row, foot in (
                np.argwhere(self._foothold == k)[0] for k in range(int(self._foothold.max()) + 1)
            )
        )

    @property
    def last_frame(self) -> float:
        """The end [s]."""
        return self.duration_s

    @property
    def goal_m(self) -> Array:
        """Goal of the torso, shape (3,) [m]."""
        return np.asarray(self.trajectory.torso_m[-1])

    def entry(self) -> dict[str, Any]:
        """Start and goal, for a log."""
        return {"start_m": self.trajectory.torso_m[0], "goal_m": self.trajectory.torso_m[-1]}

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.trajectory.duration_s + 2.0 * WALK_SETTLE_S

    @property
    def knots_s(self) -> Array:
        """Times at which postures are chosen, shape (T,) [s]."""
        return np.linspace(0.0, self.duration_s, int(np.ceil(self.duration_s / _KNOT_S)) + 1)

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        when, times = np.asarray(times_s, dtype=np.float64), self.trajectory.times_s
        now = np.clip(times[0] + when - WALK_SETTLE_S, times[0], times[-1])
        k = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(times) - 2)
        last = times[k + 1] - times[k]
        s = (now - times[k]) / last

        def between(table: Array) -> Array:
            share = s.reshape(s.shape + (1,) * (table.ndim - 1))
            return np.asarray(table[k] + share * (table[k + 1] - table[k]))

        normals = between(self._normals)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        walks = (now == times[0] + when - WALK_SETTLE_S)[..., None] / last[..., None]
        torso, rotation = self.trajectory.torso_m, np.asarray(self._turned(now).as_rotvec())
        return Samples(
            com_m=between(torso),
            velocity_m_s=walks * (torso[k + 1] - torso[k]),
            rotation_rad=rotation,
            rotation_rate_rad_s=rotation_rate(rotation, walks * self._turns[k]),
            frame=np.clip(when, 0.0, self.duration_s),
            feet_m=between(self.trajectory.feet_m) + self._radii[:, None] * normals,
            radii_m=self._radii,
            forces_n=between(self.trajectory.forces_n),
            foothold=self._foothold[k + (s >= 1.0)],
            normals=normals,
            friction=np.broadcast_to(self._friction, (*when.shape, len(self._friction))),
        )

    @cached_property
    def _turns(self) -> Array:
        """Rotation vectors of the body from each sample to the next, world frame, shape (K − 1, 3)
        [rad].
        """
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_matrix(self.trajectory.rotation)
        return np.asarray((turns[1:] * turns[:-1].inv()).as_rotvec())


def footholds(contact: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of the stance that every foot is in, counted over all feet, −1 in the air; contact and
    result: shape (K, E).
    """
    begins = contact & ~np.vstack([np.zeros((1, contact.shape[1]), dtype=np.bool_), contact[:-1]])
    count = np.cumsum(begins, axis=0)
    before = np.concatenate([[0], np.cumsum(count[-1])[:-1]])
    return np.where(contact, before + count - 1, -1)


def feet_motion(
    subject: Motion,
) -> PlanMotion | GaitMotion | LeapMotion | CrossingMotion:
    """The motion of a plan, a walk, a leap or a crossing, timed as ``run`` times it where no joint asks for
    more time.

    A plan may also lift all limbs at once; the runner refuses such a plan.
    """
    match subject:
        case Plan():
            return PlanMotion(subject, uncarried=True)
        case Trajectory():
            return GaitMotion(subject, subject.robot.source.foot_radii_m)
        case LeapPlan():
            return LeapMotion(subject)
        case Crossing():
            return CrossingMotion(subject)
    raise TypeError(f"expected a motion, got a {type(subject).__name__}")
