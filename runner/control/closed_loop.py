"""The closed loop: observe, choose an envelope, plan, verify, forward the next key frames, and look again.

A policy is a callable from an observation to the planner of the next key frames: a trained selector that chooses an
envelope, or always the same. Where the robot is not where its plan has it, the rest is planned anew from where it is
measured to stand, and feet that slid tell how much friction there really is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import checked, collect_errors
from stancekit.planners.problem.course import Course
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.answer import CoursePlanner
from stancekit.planners.search.friction_margin import SHARES, slippery
from stancekit.planners.search.plan_window import Standing
from stancekit.planners.search.replan import replan
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain import Patch

from ..acceptance import Accepted
from ..motion.redundancy import Continued
from ..motion.timeline import PlanMotion
from ..prepared import Prepared
from ..record import Record
from ..run import Runner
from ..safety.ending import Ended
from ..worlds.world import State
from .estimation import deviation_m, estimate_friction, estimate_standing, measured_com_m
from .slip_recovery import SlipDetector, SlipRecovery
from .tracker import Target

Answer = TypeVar("Answer")
FELT_S = 0.1
"""So far back the friction that sliding feet feel is taken from."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """What a policy sees. window: the coming key frames as a course, from where the robot stands (``standing``, None
    at the beginning); state: measured last, None at the beginning. friction_share: of the course's friction, as feet
    felt it so far. frame: of the whole course."""

    window: Course
    standing: Standing | None
    state: State | None
    friction_share: float
    frame: int


Policy = Callable[[Observation], CoursePlanner]


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """horizon: key frames a plan; 0 for all that are left. replan_m: a body or a foot farther than this from the plan
    has the rest planned anew, at the next moment when all feet stand; inf for never. most: so many plans at most.
    shares: of the estimated friction, that are planned with. goal_m: how far from where its last plan has it the
    centre of mass may end. learn_friction: estimate it from what sliding feet feel."""

    horizon: int = 0
    replan_m: float = 0.012
    most: int = 30
    shares: tuple[float, ...] = SHARES
    goal_m: float = 0.03
    learn_friction: bool = True

    def __post_init__(self) -> None:
        collect_errors(
            lambda: checked(self.horizon, "loop.horizon", least=0.0),
            lambda: checked(self.most, "loop.most", least=1.0),
            lambda: checked(self.goal_m, "loop.goal_m", above=0.0),
        )
        if not self.replan_m > 0.0:
            raise InvalidInput(f"loop.replan_m: expected a number above 0, or inf, got {self.replan_m!r}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopReport:
    """How it went. plans: made and run; replans: of these, because of a deviation. frames: key frames reached, of all
    but the first. friction_share: estimated at the end. com_final_m: from the last plan's end. seconds: of motion."""

    succeeded: bool
    message: str
    ended: Ended
    plans: int
    replans: int
    frames: int
    friction_share: float
    com_final_m: float
    deviation_m: float
    seconds: float
    plan_s: float
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        numbers = {n: None if isinstance(v, float) and not np.isfinite(v) else v for n, v in self.__dict__.items()}
        return numbers | {"ended": self.ended.to_json()}


class ClosedLoop:
    """One course walked by one policy on the runner's world.

    course: as far as it is known. policy: None for the two-stage planner over the lift.
    """

    def __init__(
        self, course: Course, runner: Runner, policy: Policy | None = None, settings: LoopSettings = LoopSettings()
    ) -> None:
        planner = TwoStageCoursePlanner()
        self.course, self.runner, self.settings = course, runner, settings
        self._policy: Policy = policy or (lambda observation: planner)
        self._share = self._planned_share = 1.0
        self._frame = self._plans = self._replans = 0
        self._kinematics = Kinematics(course.robot, runner.world.servo, gravity_m_s2=course.gravity_m_s2)
        self._recovery = SlipRecovery(runner, self._kinematics)
        self._slips, self._slid = SlipDetector(runner.world.rate_hz), False
        self._plan_s = self._seconds = self._worst = 0.0

    def run(self, terrain: Sequence[Patch] | None = None, first: Accepted | None = None) -> LoopReport:
        """Walk. terrain: what the world really has, where that is not the course's. first: a plan of the whole course
        to begin with, where there is one already.

        Raises InvalidInput and PlanningFailed before anything moves; what goes wrong later is in the report.
        """
        begin, runner = time.perf_counter(), self.runner
        prepared = runner.prepare(self._planned(None) if first is None else first)
        self._plans, self._prepared = 1, prepared
        ended, message = runner.perform(prepared, self._walk, terrain)
        prepared = self._prepared
        final = float("nan")
        if runner.state is not None:
            final = float(np.linalg.norm(measured_com_m(prepared.kinematics, runner.state) - prepared.motion.goal_m))
        if not message and final > self.settings.goal_m:
            message = f"the centre of mass ended {1e3 * final:.0f} mm from its last plan's"
        report = LoopReport(
            succeeded=not message, message=message, ended=ended, plans=self._plans, replans=self._replans,
            frames=self._frame, friction_share=self._share, com_final_m=final, deviation_m=self._worst,
            seconds=self._seconds, plan_s=self._plan_s, wall_s=time.perf_counter() - begin,
        )  # fmt: skip
        runner.log.write("verdict", report.to_json())
        return report

    def _walk(self) -> str:
        """Plan after plan to the last key frame; why not so far."""
        try:
            while not self._stretch(self._prepared):
                pass
        except (PlanningFailed, InvalidInput) as error:
            return str(error)
        return ""

    def _stretch(self, prepared: Prepared[PlanMotion]) -> bool:
        """One plan to its end, or to where it is left for another, which is made; whether it was the last."""
        runner = self.runner
        record, begun = Record(), self._frame
        self._slips, self._slid = SlipDetector(runner.world.rate_hz), False
        try:
            whole = runner.follow(prepared, record, self._astray)
        finally:
            self._count(record, begun)
        if whole and self._frame == self.course.frames - 1:
            return True
        if self._plans >= self.settings.most:
            raise PlanningFailed(f"no plan to the end in {self._plans} plans, at frame {self._frame}")
        self._replans += not whole
        target, state = record.pairs[-1]
        if not whole:
            self._estimate(prepared, record)
        if self._slid:
            state, seconds = self._recovery.recover(prepared.motion.plan, record, partial(self._estimate, prepared))
            self._seconds += seconds
        why = f"frame {self._frame}, friction estimated at {self._share:.2f} of the course's"
        runner.decide("go on" if whole else "plan anew", why)
        self._prepared = after = self._next(prepared, target, state)
        runner.go([after.first.targets_rad])
        return False

    def _estimate(self, prepared: Prepared[PlanMotion], record: Record) -> float:
        """The share of the plan's friction that there is, by what feet that slide feel just now."""
        if self.settings.learn_friction:
            felt = estimate_friction(prepared.motion.plan, record, 1.0 / self.runner.world.rate_hz, FELT_S)
            self._share = min(self._share, self._planned_share * felt)
        return self._share / self._planned_share

    def _next(self, before: Prepared[PlanMotion], target: Target, state: State) -> Prepared[PlanMotion]:
        """The next plan, from where the robot is measured to stand, or else from where it should."""
        index, plan = round(target.sample.frame), before.motion.plan
        measured = estimate_standing(plan, index, target, state, self._kinematics) if before.sees else None
        ends = Standing(
            com_m=plan.com_m[index], rotation_rad=plan.rotation_rad[index], toes_m=plan.toes_at(index),
            patches=tuple(plan.course.patch(int(p), plan.choice) for p in plan.course.holds[index]),
        )  # fmt: skip
        near = np.array(state.angles_rad if before.sees else target.angles_rad)
        course, servo = self.course, self.runner.world.servo
        failures = []
        for standing in ([] if measured is None else [measured]) + [ends]:
            kinematics = Continued(course.robot, servo, gravity_m_s2=course.gravity_m_s2, near=near)
            try:
                accepted = self._while_held(partial(self._planned, standing))
                return self._while_held(partial(self.runner.prepare, accepted, kinematics))
            except (PlanningFailed, InvalidInput) as error:
                failures.append(str(error))
                self.runner.decide("no plan", str(error))
        raise PlanningFailed(f"frame {self._frame}: no plan from here: {failures[0]}")

    def _planned(self, standing: Standing | None) -> Accepted:
        """Observe, choose, plan, verify. Raises PlanningFailed."""
        begin = time.perf_counter()
        estimate = self.course if self._share >= 1.0 else slippery(self.course, self._share)
        if standing is not None:
            duller = self._share / self._planned_share
            patches = tuple(replace(patch, friction=duller * patch.friction) for patch in standing.patches)
            standing = replace(standing, patches=patches)

        def planner_of(window: Course) -> CoursePlanner:
            observation = Observation(
                window=window, standing=standing, state=self.runner.state, friction_share=self._share, frame=self._frame
            )
            return self._policy(observation)

        outcome = replan(
            standing, estimate, frame=self._frame, horizon=self.settings.horizon or None, planner=planner_of,
            shares=self.settings.shares,
        )  # fmt: skip
        self._plan_s += time.perf_counter() - begin
        if outcome.plan is None:
            raise PlanningFailed(f"frame {self._frame}: {outcome.message or outcome.claim or outcome.status.value}")
        try:
            accepted = Accepted.verified(outcome.plan, f"plan {self._plans + 1}")
        except InvalidInput as error:
            raise PlanningFailed(str(error)) from None
        self._plans, self._planned_share = self._plans + 1, self._share
        return accepted

    def _while_held(self, work: Callable[[], Answer]) -> Answer:
        """The answer of some work, while something real is sent again and again where it is."""
        world = self.runner.world
        if not world.real or world.dry:
            return work()
        pool = ThreadPoolExecutor(1)
        try:
            future = pool.submit(work)
            while not future.done():
                self.runner.send(world.last_rad, world.last_rad)
            return future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)  # the ending of a run that is stopped waits for no planner

    def _astray(self, target: Target, state: State) -> bool:
        """Feet slide, or all stand and the robot is not where it should be; where anything is done about it."""
        away = deviation_m(target, state, self._kinematics, self.runner.world.capabilities)
        self._worst = max(self._worst, away)
        if not np.isfinite(self.settings.replan_m):
            return False
        self._slid = bool(self._slips.slipping(target, state).any())
        return self._slid or (min(target.sample.foothold) >= 0 and away > self.settings.replan_m)

    def _count(self, record: Record, begun: int) -> None:
        """How far it came."""
        if record.pairs:
            self._frame = begun + round(record.pairs[-1][0].sample.frame)
            self._seconds += len(record.pairs) / self.runner.world.rate_hz
