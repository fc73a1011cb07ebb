"""A plan as a timed motion: load moves to the limbs that stay, the others lift, swing and are put
down, the body moves.

Between two key frames one support holds. Body pose and forces run along the straight line between
its two stances with one common progress, so that every point on the way is in balance as both ends
are (toes held, linear in c and f).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..arguments import cached_property
from ..files.arrays import Array, check_numbers
from ..robot.chain import rotation_of
from .joints import support_forces
from .motion import Samples, smooth, smooth_rate
from .path import PathMoments, PlanPath, Segment

KNOTS = 10
"""Postures are chosen so often in every phase."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Durations of the phases.

    Arguments:
        settle_s: at rest before and after.
        transfer_s: load from one stance to the next.
        lift_s, place_s: along the patch's normal.
        foot_m_s, body_m_s, body_rad_s: greatest mean speeds of a swing, which lasts swing_s or
            longer.
    """

    settle_s: float = 0.4
    transfer_s: float = 0.5
    lift_s: float = 0.25
    place_s: float = 0.3
    swing_s: float = 0.6
    foot_m_s: float = 0.4
    body_m_s: float = 0.15
    body_rad_s: float = 0.3

    def __post_init__(self) -> None:
        check_numbers(self, "timing.", above=self.__annotations__)

    def at_pace(self, pace: float) -> Timing:
        """Timing that is faster by this factor."""
        faster = {item.name: getattr(self, item.name) for item in fields(self)}
        for name in faster:
            if name.endswith("_s"):
                faster[name] *= (
                    pace if name in ("foot_m_s", "body_m_s", "body_rad_s") else 1.0 / pace
                )
        return Timing(**faster)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Phase:
    """A segment of the path in time, with forces between two sets."""

    seconds: float
    segment: Segment
    forces: tuple[Array, Array]


class PlanMotion:
    """A plan over time.

    Raises InvalidInput where all limbs lift at once unless they may: no limb carries, and no
    position control can do that.

    Arguments:
        forces_n: of its stances, shape (S, N, 3) [N]; the plan's own where None. Those of soles have
            their moments about their middles behind them, shape (S, N, 6) [N, Nm].
        longer: so many times as long as ``Timing`` says every phase lasts, shape (P,).
        standing_n: of all limbs where no limb lifts, at its beginning and while the body moves
            alone, by key frame, shape (N, 3) [N] each; where there are none those carry that are to
            carry next.
        uncarried: all limbs may lift at once.
    """

    counted = "key frames"

    def __init__(
        self,
        plan: Plan,
        timing: Timing = Timing(),
        forces_n: Array | None = None,
        longer: Array | None = None,
        standing_n: Mapping[int, Array] | None = None,
        *,
        uncarried: bool = False,
    ) -> None:
        self.plan, self.timing = plan, timing
        self.path = PlanPath(plan, uncarried=uncarried)
        self.forces_n, self.longer = plan.forces_n if forces_n is None else forces_n, longer
        if (moments := plan.moments_nm) is not None:
            self.forces_n = np.concatenate([self.forces_n[..., :3], moments], axis=2)
        self.standing_n = standing_n or {}
        course = plan.problem
        self.solids, self.normals = self.path.solids, self.path.normals
        patches = [course.patch(p, plan.choice) for p in range(len(course.footholds))]
        self._friction = np.array([patch.friction for patch in patches])

    @property
    def last_frame(self) -> float:
        """The last key frame."""
        return self.plan.problem.frames - 1

    @property
    def goal_m(self) -> Array:
        """The plan's last centre of mass, shape (3,) [m]."""
        return np.asarray(self.plan.com_m[-1])

    @property
    def stances(self) -> Sequence[str]:
        """Name of every foothold."""
        return [
            f"{each.limb}, put down at frame {each.frame}," for each in self.plan.problem.footholds
        ]

    def entry(self) -> dict[str, Any]:
        """The key frames, for a log."""
        plan = self.plan
        return {"com_m": plan.com_m, "toes_m": plan.toes_m, "holds": plan.problem.holds}

    @cached_property
    def phases(self) -> tuple[_Phase, ...]:
        """All phases in order."""
        course, timing = self.plan.problem, self.timing
        result, carried = [], self._support_forces(0, 1)
        result.append(self._still(0, timing.settle_s, self.standing_n.get(0, carried), carried))
        for k in range(1, course.frames):
            before, after = self._support_forces(k - 1, k), self._support_forces(k, k)
            result.append(self._still(k - 1, timing.transfer_s, carried, before))
            result += self._step(k, before, after)
            carried = after
        last = self._support_forces(course.frames - 1, course.frames)
        result.append(self._still(course.frames - 1, timing.transfer_s, carried, last))
        result.append(self._still(course.frames - 1, 2.0 * timing.settle_s, last, last))
        result = [phase for phase in result if phase.seconds > 0.0]
        longer = np.ones(len(result)) if self.longer is None else self.longer
        return tuple(
            replace(phase, seconds=phase.seconds * float(times))
            for phase, times in zip(result, longer, strict=True)
        )

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return float(self._ends[-1])

    @property
    def rest_s(self) -> float:
        """Time at rest before anything moves, load among it [s]."""
        return self.phases[0].seconds

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        phase, s, rate = self._passed(times_s)
        of, along, speed = self._tables, s[..., None], rate[..., None]
        forces = of["forces"][phase] + along[..., None] * of["loaded"][phase]
        return Samples(
            com_m=of["com"][phase] + along * of["moved"][phase],
            velocity_m_s=speed * of["moved"][phase],
            rotation_rad=of["rotation"][phase] + along * of["turned"][phase],
            rotation_rate_rad_s=speed * of["turned"][phase],
            frame=of["frame"][phase] + s * of["frames"][phase],
            feet_m=of["feet"][phase] + along[..., None] * of["stepped"][phase],
            radii_m=self.path.radii_m,
            forces_n=forces[..., :3],
            moments_nm=forces[..., 3:] if forces.shape[-1] > 3 else None,
            foothold=self._foothold[phase],
            normals=of["normals"][phase] + along[..., None] * of["tilted"][phase],
            friction=of["friction"][phase],
        )

    def key(self, frame: int) -> Samples:
        """A key frame as the plan has it, at rest, with the mean force of its stances.

        Angles are the plan's, the body is where legs that weigh nothing have it.
        """
        plan = self.plan
        holds = plan.problem.holds[frame]
        origin = (
            plan.com_m[frame] - rotation_of(plan.rotation_rad[frame]) @ plan.problem.robot.origin_m
        )
        return Samples(
            com_m=plan.com_m[frame],
            velocity_m_s=np.zeros(3),
            rotation_rad=plan.rotation_rad[frame],
            rotation_rate_rad_s=np.zeros(3),
            frame=np.array(float(frame)),
            feet_m=self.path.feet_m[holds],
            radii_m=self.path.radii_m,
            forces_n=plan.forces_at(frame),
            foothold=holds,
            normals=self.normals[holds],
            friction=self._friction[holds],
            origin_m=None if plan.joints_rad is None else origin,
            angles_rad=None if plan.joints_rad is None else plan.joints_rad[frame],
        )

    def moments(self, times_s: Array) -> PathMoments:
        """Moments of body and feet at times, whatever the forces."""
        phases, s, _ = self._passed(times_s)
        return self.path.at(
            [(self.phases[phase].segment, s[k : k + 1]) for k, phase in enumerate(phases.tolist())]
        )

    @property
    def knots_s(self) -> Array:
        """Times, the same number in every phase, and the end, shape (T,) [s]."""
        starts = self._ends - [phase.seconds for phase in self.phases]
        parts = np.arange(KNOTS) / KNOTS
        times = [
            start + parts * phase.seconds for start, phase in zip(starts, self.phases, strict=True)
        ]
        return np.concatenate([*times, self._ends[-1:]])

    @cached_property
    def _ends(self) -> Array:
        return np.cumsum([phase.seconds for phase in self.phases])

    def step_s(self, frame: int) -> tuple[float, float]:
        """When the step to a key frame begins, and when it ends [s]."""
        of = {id(segment) for segment in self.path.steps[frame - 1]}
        indices = [index for index, phase in enumerate(self.phases) if id(phase.segment) in of]
        return float(self._ends[indices[0]] - self.phases[indices[0]].seconds), float(
            self._ends[indices[-1]]
        )

    @cached_property
    def reached_s(self) -> Array:
        """When each key frame is reached, shape (M,) [s]."""
        steps = [self.step_s(frame)[1] for frame in range(1, self.plan.problem.frames)]
        return np.array([0.0, *steps])

    def _passed(self, times_s: float | Array) -> tuple[NDArray[np.int_], Array, Array]:
        """Phase at each time, the share of its path that is passed, and the rate of that [1/s]."""
        when = np.asarray(times_s, dtype=np.float64)
        phase = np.minimum(self._ends.searchsorted(when, side="left"), len(self._ends) - 1)
        seconds = self._seconds[phase]
        passed = np.minimum(np.maximum((when - (self._ends[phase] - seconds)) / seconds, 0.0), 1.0)
        return phase, smooth(passed), smooth_rate(passed) / seconds

    @cached_property
    def _seconds(self) -> Array:
        return np.array([phase.seconds for phase in self.phases])

    @cached_property
    def _foothold(self) -> NDArray[np.int_]:
        return np.array([phase.segment.foothold for phase in self.phases])

    @cached_property
    def _tables(self) -> dict[str, Array]:
        """Tables of what every phase begins with and adds, by name, one row per phase."""
        plan = self.plan
        frames = np.array([phase.segment.frames for phase in self.phases])
        feet = np.array([phase.segment.feet_m for phase in self.phases])
        forces = np.array([phase.forces for phase in self.phases])
        surface = np.array([phase.segment.surface for phase in self.phases])
        (a, b), last = frames.T, frames[:, 1] - frames[:, 0]
        ups = np.array([phase.segment.ups for phase in self.phases])
        return {
            "com": plan.com_m[a],
            "moved": plan.com_m[b] - plan.com_m[a],
            "rotation": plan.rotation_rad[a],
            "turned": plan.rotation_rad[b] - plan.rotation_rad[a],
            "frame": a.astype(np.float64),
            "frames": last.astype(np.float64),
            "feet": feet[:, 0],
            "stepped": feet[:, 1] - feet[:, 0],
            "forces": forces[:, 0],
            "loaded": forces[:, 1] - forces[:, 0],
            "normals": ups[:, 0],
            "tilted": ups[:, 1] - ups[:, 0],
            "friction": self._friction[surface],
        }

    def _still(self, frame: int, seconds: float, first: Array, last: Array) -> _Phase:
        """All limbs stand, only the load moves."""
        return _Phase(seconds=seconds, segment=self.path.standing(frame), forces=(first, last))

    def _step(self, k: int, before: Array, after: Array) -> list[_Phase]:
        """Lift, swing and place the limbs of frame k; the body moves during the swing."""
        plan, timing, parts = self.plan, self.timing, self.path.steps[k - 1]
        lift, across, down = parts if len(parts) == 3 else (None, parts[0], None)
        swing_s = max(
            timing.swing_s,
            across.length_m / timing.foot_m_s,
            float(np.linalg.norm(plan.com_m[k] - plan.com_m[k - 1])) / timing.body_m_s,
            float(np.linalg.norm(plan.rotation_rad[k] - plan.rotation_rad[k - 1]))
            / timing.body_rad_s,
        )
        phases = [_Phase(seconds=swing_s, segment=across, forces=(before, after))]
        if lift is not None and down is not None:
            lift_s, place_s = (
                seconds * segment.length_m / self.path.lift_m
                for seconds, segment in ((timing.lift_s, lift), (timing.place_s, down))
            )
            phases.insert(0, _Phase(seconds=lift_s, segment=lift, forces=(before, before)))
            phases.append(_Phase(seconds=place_s, segment=down, forces=(after, after)))
        return phases

    def _support_forces(self, frame: int, step: int) -> Array:
        """Forces at a frame of those that carry during the step to key frame ``step``; where all of
        them do, those with which all stand, or else the mean of what the plan has there.
        """
        support = self.path.support(step)
        if len(support) == len(self.plan.problem.robot.limbs) and frame in self.standing_n:
            return self.standing_n[frame]
        return support_forces(self.plan, self.forces_n, frame, support)
