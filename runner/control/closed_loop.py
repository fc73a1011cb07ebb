"""The closed loop: observe, choose an envelope, plan, verify, forward the next key frames, and look again.

A policy is a callable from an observation to the planner of the next key frames: a trained selector that chooses an
envelope, or always the same. Where the robot is not where its plan has it, the rest is planned anew from where it is
measured to stand. Feet that slid, and feet that held, tell how much friction there really is, as an interval: plans
are made for its lower end, and for the most likely only where that has none. Feet tell where surfaces are, too, and a
step onto nothing is undone and planned anew without that place. Where there is no such plan the robot stands still.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.plan import PlanOutcome
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem.course import Course
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.answer import CoursePlanner
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.plan_window import Standing, with_pause
from stancekit.planners.search.replan import replan
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain import Patch

from ..acceptance import Accepted
from ..motion.redundancy import Continued
from ..motion.timeline import PlanMotion
from ..prepared import Prepared
from ..record import Record
from ..run import Runner
from ..worlds.world import State
from .estimation import deviation_m, estimate_standing, measured_com_m
from .friction import FrictionEstimator
from .loop_report import LoopReport
from .loop_settings import LoopSettings
from .retreat import step_back
from .slip_recovery import Shares, SlipDetector, SlipRecovery
from .surfaces import EmptyStep, found_offsets, without
from .tracker import Target
from .waiting import held_while

NEAR = (0.94, 0.97)
"""More shares of the lower end, between the last two, once feet slid: every bit of reserve counts then."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """What a policy sees. window: the coming key frames as a course, from where the robot stands (``standing``, None
    at the beginning); state: measured last, None at the beginning. friction_share: of the course's friction, the most
    likely by what feet felt so far. frame: of the whole course."""

    window: Course
    standing: Standing | None
    state: State | None
    friction_share: float
    frame: int


Policy = Callable[[Observation], CoursePlanner]


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
        self._friction = FrictionEstimator(1.0 / runner.world.rate_hz)
        self._planned_share = self._counted = 1.0
        self._frame = self._plans = self._replans = self._stuck = 0
        self._kinematics = Kinematics(course.robot, runner.world.servo, gravity_m_s2=course.gravity_m_s2)
        self._recovery = SlipRecovery(runner, self._kinematics)
        self._watch()
        self._surfaces, self._body = list[str](), runner.settings.body
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
            frames=self._frame, friction=self._friction.interval, planned_share=self._counted,
            surfaces="; ".join(self._surfaces), com_final_m=final, deviation_m=self._worst, seconds=self._seconds,
            plan_s=self._plan_s, wall_s=time.perf_counter() - begin,
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
        self._watch()
        try:
            whole = runner.follow(prepared, record, self._astray)
        finally:
            self._count(record, begun)
        shares = self._feel(record)
        if whole and self._frame == self.course.frames - 1:
            return True
        self._replans += not whole
        target, state = record.pairs[-1]
        if self._fell.any():
            target, state = self._undone(prepared, record, begun)
        elif self._slid:
            state, seconds = self._recovery.recover(prepared.motion.plan, record, shares, self._feel)
            self._seconds += seconds
        self._stuck = 0 if self._frame > begun else self._stuck + 1
        if self._plans >= self.settings.most or self._stuck >= self.settings.tries:
            stuck = f"{self._stuck} of them in a row that came no farther, at frame {self._frame}"
            raise PlanningFailed(f"no plan to the end in {self._plans} plans, {stuck}")
        why = f"frame {self._frame}, friction {self._friction.interval.line}"
        runner.decide("go on" if whole else "plan anew", why)
        self._prepared = after = self._next(prepared, target, state)
        runner.go([after.first.targets_rad])
        return False

    def _watch(self) -> None:
        """Look anew, as nothing is known of feet that begin to stand."""
        rate_hz, limbs = self.runner.world.rate_hz, len(self.course.robot.limbs)
        self._slips, self._steps = SlipDetector(rate_hz), EmptyStep(rate_hz, limbs)
        self._slid, self._fell = False, np.zeros(limbs, dtype=bool)
        self._begun_m: float | None = None

    def _feel(self, record: Record, part: float = 1.0) -> Shares:
        """Shares of the plan's friction that there may be, the lower end first, with what this record says of it.

        part: of the plan's friction that the record's targets count on.
        """
        if self.settings.learn_friction:
            self._friction.add(record, part * self._planned_share)
        found = self._friction.interval
        return tuple(share / self._planned_share for share in dict.fromkeys((found.planned_on, found.share)))

    def _undone(self, prepared: Prepared[PlanMotion], record: Record, begun: int) -> tuple[Target, State]:
        """The step that came down on nothing is taken back, and its place is forgotten; where that leads to."""
        runner, plan = self.runner, prepared.motion.plan
        target, state = record.pairs[-1]
        places = list[tuple[Patch, NDArray[np.float64]]]()
        for limb in np.flatnonzero(self._fell):
            patch = plan.course.patch(target.sample.foothold[limb], plan.choice)
            places.append((patch, state.feet_m[limb]))
            self._surfaces.append(f"limb {plan.course.robot.limb_names[limb]}: nothing at frame {self._frame}")
            runner.decide("step back", self._surfaces[-1])
        back = step_back(runner, prepared, self._frame - begun, state)
        self._count(back, begun)
        for patch, toe_m in places:
            self.course = without(self.course, patch, toe_m, self._frame + 1)
        return back.pairs[-1]

    def _next(self, before: Prepared[PlanMotion], target: Target, state: State) -> Prepared[PlanMotion]:
        """The next plan, from where the robot is measured to stand, or else from where it should."""
        index, plan = round(target.sample.frame), before.motion.plan
        patches = tuple(plan.course.patch(int(p), plan.choice) for p in plan.course.holds[index])
        ends = Standing(
            com_m=plan.com_m[index], rotation_rad=plan.rotation_rad[index], toes_m=plan.toes_at(index), patches=patches
        )  # fmt: skip
        starts = [ends]
        if before.sees:
            offsets = found_offsets(patches, state, self._kinematics)
            if offsets.planes:
                self.course = offsets.course(self.course)
                self._surfaces.append(offsets.line)
                self.runner.decide("surfaces", offsets.line)
            moved = tuple(map(offsets.moved, patches))
            measured = estimate_standing(moved, state, self._kinematics)
            starts = ([] if measured is None else [measured]) + ([] if offsets.planes else [ends])
        near = np.array(state.angles_rad if before.sees else target.angles_rad)
        course, servo = self.course, self.runner.world.servo
        failures = []
        for standing in starts:
            kinematics = Continued(course.robot, servo, gravity_m_s2=course.gravity_m_s2, near=near)
            try:
                accepted = held_while(self.runner, partial(self._planned, standing))
                return held_while(self.runner, partial(self.runner.prepare, accepted, kinematics))
            except (PlanningFailed, InvalidInput) as error:
                failures.append(str(error))
                self.runner.decide("no plan", str(error))
        why = failures[0] if failures else "a foot left its patch"
        raise PlanningFailed(f"frame {self._frame}: no plan from here: {why}")

    def _planned(self, standing: Standing | None) -> Accepted:
        """Observe, choose, plan, verify. Raises PlanningFailed.

        Where feet slid and there is no reserve, the body may first move to where there is some, before anybody lifts.
        """
        begin, found, shares = time.perf_counter(), self._friction.interval, self.settings.shares
        share = found.share if found.slides else 1.0
        if found.planned_on < share:  # the most likely comes last: where the lower end has no plan
            nearer = (*shares[:-1], *NEAR, shares[-1])
            shares = (*(cautious * found.planned_on / share for cautious in nearer), 1.0)
        if standing is not None:
            duller = share / self._planned_share
            patches = tuple(patch.with_friction(duller * patch.friction) for patch in standing.patches)
            standing = replace(standing, patches=patches)
        course, frame = self.course, self._frame
        outcome = self._answer(course, share, standing, shares)
        if (
            self._slid
            and standing is not None
            and any(course.lifts[frame + 1 : frame + 2])
            and _counts(outcome, share) > share * shares[0]
        ):
            paused = with_pause(course, frame)
            other = self._answer(paused, share, standing, shares)
            if _counts(other, share) < _counts(outcome, share):
                outcome, self.course = other, paused
                self.runner.decide("body first", f"frame {frame}: it leaves more friction to move before feet do")
        self._plan_s += time.perf_counter() - begin
        if outcome.plan is None:
            raise PlanningFailed(f"frame {frame}: {outcome.message or outcome.claim or outcome.status.value}")
        try:
            accepted = Accepted.verified(outcome.plan, f"plan {self._plans + 1}")
        except InvalidInput as error:
            raise PlanningFailed(str(error)) from None
        self._plans, self._planned_share, self._counted = self._plans + 1, share, _counts(outcome, share)
        body = self._body  # that pulls the body with less than a plan counts on bends the plan's own forces
        whole = standing is not None and self._counted > body.cone_share * share
        self.runner.settings = replace(self.runner.settings, body=replace(body, cone_share=1.0) if whole else body)
        if standing is not None:  # a log begins with its plan
            self.runner.decide("planned", f"counting on {self._counted:.2f} of the course's friction")
        return accepted

    def _answer(
        self, course: Course, share: float, standing: Standing | None, shares: tuple[float, ...]
    ) -> PlanOutcome:
        """What a policy's planner says of a course with this share of its friction."""

        def planner_of(window: Course) -> CoursePlanner:
            observation = Observation(
                window=window, standing=standing, state=self.runner.state, friction_share=share, frame=self._frame
            )
            return self._policy(observation)

        return replan(
            standing, slippery(course, share), frame=self._frame, horizon=self.settings.horizon or None,
            planner=planner_of, shares=shares,
        )  # fmt: skip

    def _astray(self, target: Target, state: State) -> bool:
        """Feet slide or came down on nothing, or all stand and the robot is astray; where anything is done about it."""
        if not self.runner.world.capabilities.has_body_pose:
            return False
        if self._prepared.sees:
            self._fell = self._steps.found(target, state)
        away = deviation_m(target, state, self._kinematics, self._steps.seeks)
        self._worst, limit_m = max(self._worst, away), self.settings.replan_m
        self._begun_m = away if self._begun_m is None else self._begun_m
        if not np.isfinite(limit_m):
            return False
        self._slid = bool(self._slips.slipping(target, state).any())
        stands, new = min(target.sample.foothold) >= 0, away - self._begun_m > limit_m
        return self._slid or bool(self._fell.any()) or (stands and away > limit_m and new)

    def _count(self, record: Record, begun: int) -> None:
        """How far it came."""
        if record.pairs:
            self._frame = begun + round(record.pairs[-1][0].sample.frame)
            self._seconds += len(record.pairs) / self.runner.world.rate_hz


def _counts(outcome: PlanOutcome, share: float) -> float:
    """How much of a course's friction a plan counts on that was made with this share of it; inf where there is none."""
    return np.inf if outcome.plan is None else share * float(outcome.plan.provenance.get("friction_share", 1.0))
