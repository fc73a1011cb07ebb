"""The closed loop: observe, choose an envelope, plan, verify, forward the next key frames, and look
again.

A policy is a callable from an observation to the planner of the next key frames: a trained selector
that chooses an envelope, or always the same. Where the robot is not where its plan has it, the rest
is planned anew from where it is measured to stand. Feet that slid, and feet that held, tell how
much friction there really is, as an interval: plans are made for its lower end, and for the most
likely only where that has none. Feet tell where surfaces are, too, and a step onto nothing is
undone and planned anew without that place. Where there is no such plan the robot stands still.

No plan is made where feet slide: at once the body stays at the pose that was measured, the feet
that stand press with forces that hold on the friction that they just felt, with a reserve
(``force_distribution``), and feet in the air go straight to the surface next to them. Then there is
time to plan anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Played, Samples, smooth, smooth_rate
from stancekit.planners.motion.plan_motion import step_s
from stancekit.planners.problem import Problem
from stancekit.planners.projection.force_distribution import ForceDistribution, wrench_at
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.pieces import Standing
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch

from ..acceptance import Accepted
from ..log import Record, plain
from ..prepared import Prepared, Resumption, Tracked
from ..run import Runner
from ..safety.guard import Ended
from ..settings import LoopSettings
from ..worlds.world import State
from .envelope_choice import Policy, Replanner
from .estimation import (
    EmptyStep,
    FrictionEstimator,
    FrictionInterval,
    SlipDetector,
    deviation_m,
    estimate_standing,
    found_offsets,
    measured_com_m,
    nearest_on,
    without,
)
from .tracker import Target, Tracker

Shares = tuple[float, ...]
"""Shares of the friction that a plan counts on, that there may be: the most cautious first."""
_Estimate = Callable[[Record, float], Shares]
LAND_M_S = 0.3
STAND_S = 0.3
"""Feet in the air come down with this mean speed; then everybody stands for a while."""
_STAND_KNOTS = 9
_ATTEMPTS = 8
"""So often forces are chosen anew while feet slide on."""
_GRIP_S = 0.1
"""So long new forces take to stop a foot."""


def standing_motion(
    now: Samples,
    *,
    com_m: Array,
    rotation_rad: Array,
    feet_m: Array,
    toes_m: Array,
    normals: Array,
    forces_n: tuple[Array, Array],
    foothold: NDArray[np.int_],
) -> Played:
    """A motion that goes nowhere: the body stays, feet in the air are put down.

    Arguments:
        now: whose feet stand, at which frame.
        com_m, rotation_rad: the measured body.
        feet_m: the measured centres of the feet, shape (N, 3) [m].
        toes_m, normals: where all feet shall stand.
        forces_n: before and after feet in the air came down, shape (N, 3) [N] each.
        foothold: after that.
    """
    goes, air = toes_m + now.radii_m[:, None] * normals - feet_m, ~now.stands
    land_s = float(np.linalg.norm(goes, axis=1)[air].max(initial=0.0)) / LAND_M_S

    def at(times_s: float | Array) -> Samples:
        when, limbs = np.asarray(times_s, dtype=np.float64), len(feet_m)
        down = when >= land_s
        moved = np.where(down, 1.0, when / max(land_s, 1e-9))[..., None, None] * goes
        landed, still = down[..., None], np.zeros((*when.shape, 3))
        return Samples(
            com_m=still + com_m,
            velocity_m_s=still,
            rotation_rad=still + rotation_rad,
            rotation_rate_rad_s=still,
            frame=np.broadcast_to(now.frame, when.shape),
            feet_m=feet_m + np.where(air[:, None], moved, 0.0),
            radii_m=now.radii_m,
            forces_n=np.where(landed[..., None], forces_n[1], forces_n[0]),
            foothold=np.where(landed, foothold, now.foothold),
            normals=np.broadcast_to(normals, (*when.shape, limbs, 3)),
            friction=np.broadcast_to(now.friction, (*when.shape, limbs)),
        )

    return Played(at=at, knots_s=np.linspace(0.0, land_s + STAND_S, _STAND_KNOTS))


def _tracked(runner: Runner, kinematics: Kinematics, motion: Played, state: State) -> Tracked:
    """A motion that is ready to be followed from where the robot was measured."""
    near = Kinematics(
        kinematics.robot,
        kinematics.servo,
        gravity_m_s2=kinematics.gravity_m_s2,
        near_rad=np.array(state.angles_rad),
    )
    world = runner.world
    tracker = Tracker(motion, near, world.rate_hz, runner.settings.feedback, drives=world.drives)
    return Tracked(motion=motion, tracker=tracker, first=tracker.start(), sees=True)


class SlipRecovery:
    """Brings a robot whose feet slide to a stand on a runner's world.

    Arguments:
        kinematics: of its robot.
    """

    def __init__(self, runner: Runner, kinematics: Kinematics) -> None:
        self._runner, self._kinematics = runner, kinematics
        self._distribution = ForceDistribution(len(kinematics.robot.limbs))

    def recover(
        self, plan: Plan, record: Record, shares: Shares, estimate: _Estimate
    ) -> tuple[Target, State, float]:
        """Recover and return the last target, the last state and the time that it took [s].

        Arguments:
            record: of the plan's motion so far.
            estimate: the shares by what was measured with forces for such a share.

        Raises Stopped, HardwareFault.
        """
        target, state = record.pairs[-1]
        now, rate_hz, periods = target.sample, self._runner.world.rate_hz, 0
        for _ in range(_ATTEMPTS):
            self._runner.decide(
                "stand", f"feet slide, counting on {shares[0]:.2f} of the planned friction"
            )
            record, slips = Record(), SlipDetector(rate_hz)
            motion = self._motion(plan, now, state, shares)
            tracked = _tracked(self._runner, self._kinematics, motion, state)
            felt = replace(tracked.first.sample, forces_n=state.forces_n)
            tracked = replace(tracked, first=replace(tracked.first, sample=felt))
            still = self._runner.follow(
                tracked, record, partial(_still_slips, slips, record, rate_hz)
            )
            periods += len(record.pairs)
            target, state = record.pairs[-1]
            now, shares = target.sample, estimate(record, shares[0])
            if still:
                break
        return target, state, periods / rate_hz

    def _motion(self, plan: Plan, now: Samples, state: State, shares: Shares) -> Played:
        """Standing where the robot is, with forces for the first share that has any, else those of
        now.
        """
        course, index = plan.problem, round(float(now.frame))
        holds = course.holds[index]
        patches = [course.patch(int(foothold), plan.choice) for foothold in holds]
        normals, friction = (
            np.array([getattr(patch, name) for patch in patches]) for name in ("normal", "friction")
        )
        under = state.feet_m - now.radii_m[:, None] * normals
        toes = np.array([nearest_on(patch, toe) for patch, toe in zip(patches, under, strict=True)])
        com_m, stands = measured_com_m(self._kinematics, state), now.stands
        wrench = wrench_at(course, index)
        turned = Rotation.from_matrix(state.rotation).as_rotvec()

        def shared(legs: NDArray[np.bool_]) -> Array | None:
            for share in shares:
                dulled = [patch.with_friction(share * patch.friction) for patch in patches]
                forces_n = self._distribution.forces(
                    course, toes - com_m, dulled, legs, wrench=wrench
                )
                if forces_n is not None:
                    return forces_n
            return None

        first, then = shared(stands), shared(np.full_like(stands, True))
        first = now.forces_n if first is None else first
        return standing_motion(
            replace(now, frame=np.array(float(index)), friction=shares[0] * friction),
            com_m=com_m,
            rotation_rad=turned,
            feet_m=state.feet_m,
            toes_m=toes,
            normals=normals,
            forces_n=(first, first if then is None else then),
            foothold=holds,
        )


def _still_slips(
    slips: SlipDetector, record: Record, rate_hz: float, target: Target, state: State
) -> bool:
    """Tell whether feet slide although they were pressed for a while."""
    return bool(slips.slipping(target, state).any()) and len(record.pairs) > _GRIP_S * rate_hz


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopReport:
    """Report on the run of a policy.

    Arguments:
        succeeded: to its end, with the centre of mass where it should be.
        message: why not.
        ended: how the robot was left.
        plans: made and run.
        replans: plans made because of a deviation.
        frames: key frames reached, of all but the first.
        friction: as feet felt it.
        planned_share: share of the course's friction that the last plan counts on.
        surfaces: what feet found otherwise than planned, empty for nothing.
        com_final_m: distance of the centre of mass from the last plan's end [m].
        deviation_m: farthest that body or feet were off the plan [m].
        seconds: duration of the motion [s].
        plan_s: spent on planning [s].
        wall_s: wall-clock time [s].
        doubts: of the robot and its ground, one line each.
    Source:
        None: planned against measured.

    Example:
        >>> import stancekit
        >>> report = stancekit.run("walls", policy="lift")  # doctest: +SKIP
        >>> stancekit.LoopReport.__name__
        'LoopReport'
    """

    succeeded: bool
    message: str
    ended: Ended
    plans: int
    replans: int
    frames: int
    friction: FrictionInterval
    planned_share: float
    surfaces: str
    com_final_m: float
    deviation_m: float
    seconds: float
    plan_s: float
    wall_s: float
    doubts: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON-ready values; a number that is not finite becomes None."""
        return dict(plain(vars(self)))


Answer = TypeVar("Answer")


def _held_while(runner: Runner, work: Callable[[], Answer]) -> Answer:
    """The answer of some work, while something real is sent again and again where it is."""
    world = runner.world
    if not world.real or world.dry:
        return work()
    pool = ThreadPoolExecutor(1)
    try:
        future = pool.submit(work)
        while not future.done():
            runner.send(world.last_rad, world.last_rad)
        return future.result()
    finally:
        pool.shutdown(
            wait=False, cancel_futures=True
        )  # the ending of a run that is stopped waits for no planner


_KNOTS = 31
_SLOWER = 2.0
"""The way back takes so many times as long as the way there: then nothing is faster than it was."""


def _retreat(motion: Played, frame: int) -> Played:
    """The step of a plan's motion to a key frame backwards, from rest to rest."""
    begin_s, end_s = step_s(motion, frame)
    duration_s, back_s = _SLOWER * (end_s - begin_s), begin_s - end_s

    def at(times_s: float | Array) -> Samples:
        share = np.clip(np.asarray(times_s) / duration_s, 0.0, 1.0)
        there = motion.at(end_s + smooth(share) * back_s)
        rate = (smooth_rate(share) * back_s / duration_s)[..., None]
        return replace(
            there,
            velocity_m_s=rate * there.velocity_m_s,
            rotation_rate_rad_s=rate * there.rotation_rate_rad_s,
        )

    return Played(at=at, knots_s=np.linspace(0.0, duration_s, _KNOTS), solids=motion.solids)


_NEXT = 3
"""Key frames that are planned alone where not all that are left can be done; and then one."""
_OTHERWISE = (
    ("bend the plan", WholeBodyLimits(), 0),
    ("the next key frames alone", None, _NEXT),
    ("bend the next key frames", WholeBodyLimits(), _NEXT),
    ("the next key frame alone", None, 1),
    ("bend the next key frame", WholeBodyLimits(), 1),
)


class ClosedLoop:
    """One course walked by one policy on the runner's world.

    Arguments:
        course: as far as it is known.
        policy: None for the two-stage planner over the lift.
    """

    def __init__(
        self,
        course: Problem,
        runner: Runner,
        policy: Policy | None = None,
        settings: LoopSettings = LoopSettings(),
    ) -> None:
        planner = TwoStage()
        self.runner, self.settings = runner, settings
        self._friction = FrictionEstimator(1.0 / runner.world.rate_hz)
        self._planning = Replanner(
            course, policy or (lambda observation: planner), settings, runner, self._friction
        )
        self._frame = self._replans = self._stuck = 0
        self._least = len(course.footholds)
        self._kinematics = Kinematics(
            course.robot, runner.world.servo, gravity_m_s2=course.gravity_m_s2
        )
        self._recovery = SlipRecovery(runner, self._kinematics)
        self._watch()
        self._surfaces = list[str]()
        self._seconds = self._worst = 0.0

    def run(
        self, terrain: Sequence[Patch] | None = None, first: Accepted[Plan] | None = None
    ) -> LoopReport:
        """Walk the course, and plan the rest anew where the robot does not stand as planned.

        Raises InvalidInput and PlanningFailed before anything moves; what goes wrong later is in
        the report.

        Arguments:
            terrain: what the world really has, where that is not the course's.
            first: a plan of the whole course to begin with, where there is one already.
        """
        begin, runner = time.perf_counter(), self.runner
        prepared = self._ready(None) if first is None else runner.prepare(first)
        self._prepared, self._planning.plans = prepared, 1
        ended, message = runner.perform(prepared, self._walk, terrain)
        prepared = self._prepared
        final = float("nan")
        if runner.state is not None:
            final = float(
                np.linalg.norm(
                    measured_com_m(prepared.kinematics, runner.state) - prepared.ends_m[1]
                )
            )
        if not message and final > self.settings.goal_m:
            message = f"the centre of mass ended {1e3 * final:.0f} mm from its last plan's"
        report = LoopReport(
            succeeded=not message,
            message=message,
            ended=ended,
            plans=self._planning.plans,
            replans=self._replans,
            frames=self._frame,
            friction=self._friction.interval,
            planned_share=self._planning.counted,
            surfaces="; ".join(self._surfaces),
            com_final_m=final,
            deviation_m=self._worst,
            seconds=self._seconds,
            plan_s=self._planning.plan_s,
            wall_s=time.perf_counter() - begin,
            doubts=prepared.accepted.plan.doubts,
        )
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

    def _stretch(self, prepared: Prepared) -> bool:
        """One plan to its end, or to where it is left for another, which is made; whether it was
        the last.
        """
        runner = self.runner
        record, begun = Record(), self._frame
        self._watch()
        try:
            whole = runner.follow(prepared, record, self._astray)
        finally:
            self._count(record, begun)
        shares = self._feel(record)
        if whole and self._frame == self._planning.course.frames - 1:
            return True
        self._replans += not whole
        target, state = record.pairs[-1]
        if self._fell.any():
            target, state = self._undone(prepared, record, begun)
        elif self._slid:
            target, state, seconds = self._recovery.recover(
                prepared.accepted.plan, record, shares, self._feel
            )
            self._seconds += seconds
        # feet that are still to be put down: key frames for the body alone take none away
        left = sum(each.frame > self._frame for each in self._planning.course.footholds)
        self._stuck = 0 if left < self._least else self._stuck + 1
        self._least = min(self._least, left)
        if self._stuck >= self.settings.tries:
            stuck = f"{self._stuck} of them in a row that came no farther, at frame {self._frame}"
            raise PlanningFailed(f"no plan to the end in {self._planning.plans} plans, {stuck}")
        why = f"frame {self._frame}, friction {self._friction.interval.line}"
        runner.decide("go on" if whole else "plan anew", why)
        self._prepared = self._next(prepared, target, state)
        return False

    def _watch(self) -> None:
        """Look anew, as nothing is known of feet that begin to stand."""
        rate_hz, course = self.runner.world.rate_hz, self._planning.course
        limbs = len(course.robot.limbs)
        self._slips = SlipDetector(rate_hz)
        self._steps = EmptyStep(rate_hz, limbs, course.weight_n)
        self._slid, self._fell = False, np.zeros(limbs, dtype=bool)
        self._begun_m: float | None = None

    def _feel(self, record: Record, part: float = 1.0) -> Shares:
        """Shares of the plan's friction that there may be, the lower end first, with what this
        record says of it.

        Arguments:
            part: of the plan's friction that the record's targets count on.
        """
        if self.settings.learn_friction:
            self._friction.add(record, part * self._planning.planned_share)
        interval = self._friction.interval
        return tuple(
            share / self._planning.planned_share
            for share in dict.fromkeys((interval.planned_on, interval.share))
        )

    def _undone(self, prepared: Prepared, record: Record, begun: int) -> tuple[Target, State]:
        """The step that came down on nothing is taken back, and its place is forgotten; where that
        leads to.
        """
        runner, plan = self.runner, prepared.accepted.plan
        target, state = record.pairs[-1]
        places = list[tuple[Patch, NDArray[np.float64]]]()
        for limb in np.flatnonzero(self._fell):
            patch = plan.problem.patch(int(target.sample.foothold[limb]), plan.choice)
            places.append((patch, state.feet_m[limb]))
            self._surfaces.append(
                f"limb {plan.problem.robot.limb_names[limb]}: nothing at frame {self._frame}"
            )
            runner.decide("step back", self._surfaces[-1])
        retreat, back = _retreat(prepared.motion, self._frame - begun), Record()
        tracked = _tracked(runner, prepared.kinematics, retreat, state)
        runner.follow(replace(tracked, sees=prepared.sees), back)
        self._count(back, begun)
        for patch, toe_m in places:
            self._planning.course = without(self._planning.course, patch, toe_m, self._frame + 1)
        return back.pairs[-1]

    def _next(self, before: Prepared, target: Target, state: State) -> Prepared:
        """The next plan, from where the robot is measured to stand, or else from where it
        should.
        """
        index, plan = round(float(target.sample.frame)), before.accepted.plan
        near = np.array(state.angles_rad if before.sees else target.angles_rad)
        held = [plan.problem.patch(int(p), plan.choice) for p in plan.problem.holds[index]]
        patches = tuple(
            patch.with_friction(patch.friction / self._planning.planned_share) for patch in held
        )
        ends = Standing(
            com_m=plan.com_m[index],
            rotation_rad=plan.rotation_rad[index],
            toes_m=plan.toes_at(index),
            patches=patches,
            angles_rad=near,
        )
        starts = [ends]
        if before.sees:
            offsets = found_offsets(patches, state, self._kinematics)
            if offsets.planes:
                self._planning.course = offsets.course(self._planning.course)
                self._surfaces.append(offsets.line)
                self.runner.decide("surfaces", offsets.line)
            moved = tuple(map(offsets.moved, patches))
            measured = estimate_standing(
                moved, state, self._kinematics, self._planning.course.terrain
            )
            starts = ([] if measured is None else [measured]) + ([] if offsets.planes else [ends])
        course, servo = self._planning.course, self.runner.world.servo
        failures = []
        for standing in starts:
            self._planning.course = course
            kinematics = Kinematics(
                course.robot, servo, gravity_m_s2=course.gravity_m_s2, near_rad=near
            )
            pace = 1.0 / (1.0 + self._stuck)  # legs that swing more slowly push feet less
            try:
                return self._ready(
                    standing,
                    Resumption(kinematics=kinematics, carried_n=target.sample.forces_n, pace=pace),
                )
            except (PlanningFailed, InvalidInput) as error:
                failures.append(str(error))
                self.runner.decide("no plan", str(error))
        why = failures[0] if failures else "a foot left its patch"
        raise PlanningFailed(f"frame {self._frame}: no plan from here: {why}")

    def _ready(self, standing: Standing | None, resumption: Resumption | None = None) -> Prepared:
        """A plan from there, prepared.

        Where the contacts hold but joints or bodies cannot follow, the plan is bent until they
        can. Where that fails, only the next key frames are planned, since what the robot cannot
        do is often far ahead.
        """
        runner, course = self.runner, self._planning.course

        def made(limits: WholeBodyLimits | None, horizon: int) -> Prepared:
            self._planning.course = (
                course  # what was put in for a plan that cannot be run is forgotten
            )
            accepted = self._planning.plan(
                self._frame, standing, slid=self._slid, limits=limits, horizon=horizon
            )
            return runner.prepare(accepted, resumption)

        if standing is None:  # a log begins with its plan
            try:
                return made(None, 0)
            except InvalidInput:
                return made(WholeBodyLimits(), 0)
        try:
            return _held_while(runner, partial(made, None, 0))
        except InvalidInput as error:
            failed: InvalidInput | PlanningFailed = error
        for what, limits, horizon in _OTHERWISE:
            runner.decide(what, str(failed))
            try:
                return _held_while(runner, partial(made, limits, horizon))
            except (InvalidInput, PlanningFailed) as error:
                failed = error
        raise failed

    def _astray(self, target: Target, state: State) -> bool:
        """Feet slide or came down on nothing, or all stand and the robot is astray; where anything
        is done about it.
        """
        if not self.runner.world.senses:
            return False
        if self._prepared.sees:
            self._fell = self._steps.found(target, state)
        away = deviation_m(target, state, self._kinematics, self._steps.seeks)
        self._worst, limit_m = max(self._worst, away), self.settings.replan_m
        self._begun_m = away if self._begun_m is None else self._begun_m
        if not np.isfinite(limit_m):
            return False
        self._slid = bool(self._slips.slipping(target, state).any())
        stands, new = bool(target.sample.stands.all()), away - self._begun_m > limit_m
        return self._slid or bool(self._fell.any()) or (stands and away > limit_m and new)

    def _count(self, record: Record, begun: int) -> None:
        """Count how far it came."""
        if record.pairs:
            self._frame = begun + round(float(record.pairs[-1][0].sample.frame))
            self._seconds += len(record.pairs) / self.runner.world.rate_hz
