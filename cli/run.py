"""``stancekit run``, ``simulate`` and ``replay``: an accepted plan forwarded to a world, simulated or
real, and what the log of a run says.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.text import Text

from stancekit.planners.errors import InvalidInput

from .console import (
    as_options,
    complain,
    draw_to_file,
    emit,
    err,
    facts,
    out,
    progress,
    say,
    show,
    tell,
)
from .options import (
    OptionalFloat,
    OptionalInt,
    OptionalPath,
    OptionalText,
    OptionalWrench,
    check_drawn,
    check_log,
    check_out,
    wrench_numbers,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import LoopReport, Motion, Problem, RunReport, RunSettings
    from stancekit.runner.acceptance import Accepted
    from stancekit.runner.control.envelope_choice import SelectorPolicy
    from stancekit.runner.report import Execution
    from stancekit.runner.safety.estop import Source
    from stancekit.runner.safety.guard import Ended
    from stancekit.runner.worlds.world import EstopCheck, JointBus


_BUSY = 1.0
"""A computer with more processes than processors keeps no time."""


def _run_table(report: RunReport) -> Table:
    """The report, for people."""
    word = "dry run, nothing was sent" if report.dry else "run as planned"
    slowed = f", slowed down by the {report.bound_by}" if report.bound_by else ""
    sent = f"{report.sent} {'computed' if report.dry else 'sent'}"
    joints = body = odometry = cycle = busy = ""
    if report.joint_worst:
        worst, rms = 1e3 * report.joint_worst_rad, 1e3 * report.joint_rms_rad
        joints = (
            f"{worst:.1f} mrad from the plan at most ({report.joint_worst}), {rms:.1f} mrad (RMS)"
        )
    if report.body_from == "leg odometry":
        body = "fed back by leg odometry: the joints, and the feet that stand"
    elif not report.body_measured:
        body = "not measured: joints alone were followed"
    if math.isfinite(report.odometry_m):
        odometry = f"{1e3 * report.odometry_m:.1f} mm from the plan at most, by leg odometry"
    median, late = (1e3 * value for value in report.cycle_s)
    if math.isfinite(median):
        cycle = f"{median:.1f} ms median, {late:.1f} ms 99th percentile"
    if report.message and not report.dry and report.load > _BUSY:
        busy = (
            f"{report.load:.1f} processes for each processor: a run that comes too late may stop "
            "for that"
        )
    found = report.friction
    return facts(
        [
            *_begun(word, report.message, report.ended),
            (
                "motion",
                f"{report.seconds:.1f} s on {report.world}, {report.pace:.2f} of the pace asked for{slowed}",
            ),
            (report.counted, f"{report.frames_done:.1f} of {round(report.frames - 1, 1):g}"),
            ("commands", f"{sent}, {report.clipped} clipped, {report.refused} refused"),
            ("joints", joints),
            ("needs", "" if report.needs is None else report.needs.line),
            ("measured", "" if report.loads is None else report.loads.line),
            ("body", body),
            ("", odometry),
            *([] if report.execution is None else _executed(report.execution, report.loop_share)),
            ("friction", "" if found is None else found.line),
            ("world", report.lacks),
            ("cycle", cycle),
            ("computer", busy),
        ]
    )


def _executed(run: Execution, loop_share: float) -> list[tuple[str, str]]:
    """What a simulated world had of the motion."""
    late_ms, slid_mm = 1e3 * float(run.late_s.max()), 1e3 * float(run.slip_m.max())
    stiff = f"joints found {loop_share:.2f} times as stiff as they should be"
    return [
        (
            "body",
            f"{1e3 * run.com_final_m:.1f} mm from the plan at the end, "
            f"{1e3 * run.com_worst_m:.1f} mm at most",
        ),
        (
            "",
            f"its origin {1e3 * run.body_rms_m:.1f} mm (RMS), {1e3 * run.body_worst_m:.1f} mm at "
            "most",
        ),
        ("feet", f"slid {slid_mm:.1f} mm at most, touched up to {late_ms:.0f} ms late"),
        ("forces", f"{run.force_rms_n:.1f} N (RMS) from what was planned"),
        ("loops", stiff if abs(loop_share - 1.0) > 0.05 else ""),
    ]


def loop_table(report: LoopReport, answers: tuple[int, int] | None) -> Table:
    """The report of a closed loop.

    Arguments:
        answers: plans made within what a selector chose, and without.
    """
    warning, chosen = Text(), ""
    if answers is not None:
        warning = Text("" if answers[0] else unused(answers), style="yellow")
        chosen = f"{answers[0]} plans within the envelopes that it chose, {answers[1]} without"
    return facts(
        [
            *_begun("walked to the end", report.message, report.ended),
            ("warning", warning),
            ("key frames", f"{report.frames} reached"),
            ("plans", f"{report.plans}, {report.replans} of them because of a deviation"),
            ("selector", chosen),
            ("friction", f"{report.friction.line}; planned on {report.planned_share:.2f}"),
            ("surfaces", report.surfaces),
            ("deviation", f"{1e3 * report.deviation_m:.1f} mm from the plan at most"),
            ("body", f"{1e3 * report.com_final_m:.1f} mm from the last plan at the end"),
            ("time", f"{report.seconds:.1f} s of motion, {report.plan_s:.1f} s of planning"),
        ]
    )


def unused(answers: tuple[int, int]) -> str:
    """Line about a run to which a policy contributed nothing.

    Arguments:
        answers: see ``loop_table``.
    """
    return f"the policy made none of the {answers[1]} plans that were made" + (
        ": the lift did" if answers[1] else ""
    )


def _begun(word: str, message: str, ended: Ended) -> list[tuple[str, str | Text]]:
    """The verdict, and how the robot was left."""
    left = f"{ended.left}, after {1e3 * ended.seconds:.1f} ms"
    return [
        ("verdict", Text("failed" if message else word, style="red" if message else "green")),
        ("", message),
        ("robot left", f"{left}: {ended.message}" if ended.message else left),
    ]


@contextmanager
def _stop_sources(
    stack: ExitStack,
    stop_file: Path | None,
    stop_topic: str | None,
    *,
    armed: bool,
    check: EstopCheck,
) -> Iterator[list[Source]]:
    """Keys, the stop file, the stop topic; of what is armed also a terminal that is gone.

    Arguments:
        check: how the stop topic is known to work, where something is armed.
    """
    from stancekit.runner.safety.estop import (
        file_source,
        is_open,
        key_source,
        raw_keys,
        reader_source,
    )

    sources: list[Source] = [] if stop_file is None else [file_source(stop_file)]
    if armed:
        sources.append(reader_source(*(stream for stream in (1, 2) if is_open(stream))))
    if stop_topic is not None:
        from stancekit.runner.worlds.ros.bridge import StopTopic

        with as_options():
            topic = StopTopic(stop_topic, check=check if armed else None)
        sources.append(stack.enter_context(topic))
    if sys.stdin is None or not sys.stdin.isatty():
        yield sources
        return
    err.print("any key stops the robot")
    with raw_keys(sys.stdin.fileno()):
        yield [*sources, key_source(sys.stdin.fileno())]


@dataclass
class RunMotion:
    """Run a plan, or a policy, on a world: a simulator, servos on a bus, or a robot behind a
    rosbridge.

    Only a plan that the verifier accepted is run, unchanged since, on the robot that it was made
    for. Joints, limits and the way to the first pose are checked before anything moves. Without
    --arm nothing is sent to anything real: it is a dry run that says what would have been sent. Any
    key, Ctrl-C, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, a terminal that is gone, the stop file and the
    stop topic stop the robot; after a stop nothing is sent any more.

    With --policy the loop is closed: the coming key frames are observed, a selector chooses
    envelopes for them, they are planned, verified and run, and planned anew from the measured pose
    where body or feet are off the plan. PLAN may then be a course, too; a plan is what it begins
    with. A gait and a leap are dynamic: they run at their own pace, or are refused; a leap in
    simulations alone, where a stop that comes in the air lands it first.

      stancekit run plan.json --world mujoco --log run.mcap
      stancekit run walls --policy envelope.json --friction-share 0.75
      stancekit run walk.json --world bullet
      stancekit run plan.json --world mine.py:MyWorld
      stancekit run plan.json --world dynamixel --setup servos.yaml
      stancekit run plan.json --world dynamixel --setup servos.yaml --arm --ending torque-off

    Exit code 0 where the plan was run as planned, 1 where it was stopped or missed its goal, 2 for
    bad input: then nothing has moved.
    """

    plan: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN")]
    """Plan file, gait file or leap file; with --policy also a course, by name or file."""
    world: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = "mujoco"
    """Where to run it: bullet, mujoco, dynamixel, ros, one of another package, or a class in a
    file."""
    setup: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """What the world is made from. dynamixel: the calibration file. ros: the set-up file."""
    policy: Annotated[OptionalText, tyro.conf.arg(metavar="lift|FILE|NAME")] = None
    """Who plans on the way: any trained selector, a file or one that ships, or the lift, which
    needs none."""
    horizon: Annotated[
        OptionalInt, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: 0)")
    ] = None
    """Key frames that a policy plans at once, 0 for all that are left, which is usual."""
    replan_m: Annotated[
        OptionalFloat, tyro.conf.arg(metavar="M", help_behavior_hint="(default: 0.012 m)")
    ] = None
    """A policy plans anew where body or feet are farther than this from the plan; inf for never."""
    friction_share: float = 1.0
    """Simulations: the terrain has only this share of the friction that the plan counts on."""
    contact_stiffness_n_m: Annotated[OptionalFloat, tyro.conf.arg(metavar="N/M")] = None
    """Simulations: feet sink into the ground by their force over this; without it the ground is
    hard."""
    contact_damping_ns_m: Annotated[OptionalFloat, tyro.conf.arg(metavar="NS/M")] = None
    """Simulations: damping of that; without it a robot on all its feet sinks without swinging."""
    least_push: Annotated[
        OptionalFloat, tyro.conf.arg(metavar="SHARE", help_behavior_hint="(default: 0.01)")
    ] = None
    """Plans: every stance of a robot with legs of its own file has to bear a push of this share of
    the weight, in any direction; 0 runs all the same what is about to tip."""
    wrench: OptionalWrench = None
    """Simulations: force on the body beside its weight [N], and moment about the centre of mass
    [Nm], in world axes. Without it what the plan was made for; 0,0,0 for none."""
    actuators: Annotated[OptionalText, tyro.conf.arg(metavar="NAME|FILE")] = None
    """What turns the joints: XM540-W270, XM430-W350, or a file that says which joint has which.
    Without it: what the robot's own file says, or the device."""
    blind: bool = False
    """Simulations: send what a robot that measures its joints alone is sent."""
    odometry: bool = False
    """Plans: feed back where the body is by its joints and the feet that stand, whatever the world
    measures."""
    arm: bool = False
    """Move something real. Simulations need no arming."""
    try_estop: bool = False
    """Press the e-stop, of the set-up file or the stop topic, and release it before the robot is
    armed. Without it the robot is armed once the e-stop was heard, or its topic has a publisher.
    """
    without_estop: bool = False
    """Arm although nobody hears the e-stop; the log says so."""
    ending: Literal["hold", "home", "torque-off"] = "hold"
    """The state to leave the robot in. home: the pose that it was found in; after a stop it holds
    instead."""
    hung: bool = False
    """The robot hangs in a stand, off the ground: its feet carry nothing, and torques are checked
    for that."""
    pace: float = 1.0
    """How fast at most; slower where the joints' limits ask for it."""
    rate_hz: OptionalFloat = None
    """Commands per second, where not the world's own: 200 in simulations, 50 on robots."""
    speed_rad_s: float = 0.4
    """Speed of the soft start, and of the way home."""
    log: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.mcap")] = None
    """Log of everything, for `stancekit replay`; readable up to the last message whatever ends the
    run."""
    stop_file: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Stop as soon as this file is there."""
    stop_topic: Annotated[OptionalText, tyro.conf.arg(metavar="HOST:PORT/TOPIC")] = None
    """Stop as soon as this topic of std_msgs/Bool, read through a rosbridge, is true, or is lost.
    (The `estop` of a set-up file does the same for world ros.)"""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the tracking, .png, .pdf or .svg; with --log."""
    video: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Film of what a simulated world had: the robot's own links, and the forces that its feet felt
    (extra viz, and a GL library). A plan's is twice as fast as the world."""
    json: bool = False
    """Print the report as one JSON object."""

    def run(self) -> int:
        """Check, run, report."""
        from stancekit import RunReport
        from stancekit.motions import LIFT, WORLDS, check_run, policy_of, run
        from stancekit.planners.robot.leg import read_actuators
        from stancekit.runner.acceptance import Accepted
        from stancekit.runner.safety.estop import on_signals
        from stancekit.runner.worlds.world import SoftContact, WorldSettings

        with as_options("world"):
            kind = WORLDS.get(self.world)
        self._check(kind)
        with as_options("speed_rad_s", "friction_share", "least_push", "wrench"):
            settings = self._settings()
        request, policy, led = self._request(), None, self.policy is not None
        given = ("friction_share", "wrench", "blind", "policy", "least_push")
        with as_options(*given, timing="pace"):
            try:
                check_run(request, self.world, settings, led=led)
            except InvalidInput as error:
                raise InvalidInput(str(error).replace("got a policy", "got --policy")) from None
        with ExitStack() as stack:
            with as_options(
                "setup", "rate_hz", "actuators", "contact_stiffness_n_m", "contact_damping_ns_m"
            ):
                world = kind.make(
                    WorldSettings(
                        robot=request.robot,
                        gravity_m_s2=request.gravity_m_s2,
                        setup=self.setup,
                        rate_hz=self.rate_hz,
                        actuators=None
                        if self.actuators is None
                        else read_actuators(self.actuators),
                        estop=self._estop(),
                        contact=SoftContact.of(
                            self.contact_stiffness_n_m, self.contact_damping_ns_m
                        ),
                    )
                )
            stack.callback(world.close)
            stack.enter_context(on_signals(world.latch))
            if self.try_estop:
                err.print("--try-estop: press the e-stop and release it; the robot is armed then")
            sources = stack.enter_context(
                _stop_sources(
                    stack, self.stop_file, self.stop_topic, armed=self.arm, check=self._estop()
                )
            )
            if led:
                course = request.plan.problem if isinstance(request, Accepted) else request
                policy = policy_of(self.policy or LIFT, course)
            bar = stack.enter_context(progress(f"run {request.name} on {self.world}"))
            try:
                report = run(
                    request,
                    world,
                    settings=replace(settings, stops=tuple(sources)),
                    arm=self._estop() if self.arm else None,
                    policy=(policy or LIFT) if led else None,
                    log=self.log,
                    progress=bar,
                )
            except InvalidInput as error:
                raise InvalidInput(
                    str(error).replace("least_push 0 runs", "--least-push 0 runs")
                ) from None
        if isinstance(report, RunReport):
            assert isinstance(request, Accepted)
            if report.execution is not None:
                show(request.plan, report.execution, video=self.video)
            elif self.video is not None:
                complain(f"stancekit: no film: {report.message or 'nothing was measured'}")
            return self._report(report.succeeded, report.to_json(), _run_table(report))
        return self._report(report.succeeded, *_led(report, policy))

    def _request(self) -> Accepted[Any] | Problem:
        """Motion that PLAN names.

        Raises InvalidInput for what cannot be run, or not with these options.
        """
        from stancekit.motions import accepted_of, led_by_policy

        with as_options("policy"):
            if self.policy is not None:
                return led_by_policy(self.plan)
            try:
                return accepted_of(self.plan)
            except InvalidInput as error:
                raise InvalidInput(str(error).replace("with a policy", "with --policy")) from None

    def _report(self, succeeded: bool, record: dict[str, Any], table: Table) -> int:
        """Draw and print; the exit code."""
        if self.picture is not None and self.log is not None:
            from stancekit.runner.log import read_log
            from stancekit.views.plots import draw_tracking

            draw_to_file(draw_tracking(read_log(self.log)), self.picture)
        try:
            if self.json:
                emit({"plan": str(self.plan), **record})
            else:
                out.print(table)
                say(record["doubts"], "doubt: {}")
                say((self.log, self.picture, self.video), "written: {}")
        except BrokenPipeError:  # nobody reads it, but the exit code is of the robot
            if succeeded:
                raise
        return 0 if succeeded else 1

    def _settings(self) -> RunSettings:
        from stancekit.planners.motion.plan_motion import Timing
        from stancekit.runner.settings import LoopSettings, RunSettings

        loop = {"horizon": self.horizon, "replan_m": self.replan_m}
        options: dict[str, Any] = {name: value for name, value in loop.items() if value is not None}
        limits: dict[str, Any] = {} if self.least_push is None else {"least_push": self.least_push}
        return RunSettings(
            wrench=wrench_numbers(self.wrench),
            timing=Timing().at_pace(self.pace),
            speed_rad_s=self.speed_rad_s,
            ending=self.ending,
            hung=self.hung,
            blind=self.blind,
            odometry=self.odometry,
            friction_share=self.friction_share,
            loop=LoopSettings(**options),
            **limits,
        )

    def _estop(self) -> EstopCheck:
        return "try" if self.try_estop else "without" if self.without_estop else "heard"

    def _check(self, kind: type[JointBus]) -> None:
        """Raise InvalidInput for an option out of range, or with another world, and a file that
        cannot be written.
        """
        from stancekit.planners.files.arrays import checked, checked_int
        from stancekit.planners.files.writing import check_writable

        checked(self.pace, "--pace", least=0.05, most=4.0)
        if self.rate_hz is not None:
            checked(self.rate_hz, "--rate-hz", least=1.0, most=1000.0)
        if self.horizon is not None:
            checked_int(self.horizon, "--horizon", least=0)
        if self.replan_m is not None and not self.replan_m > 0.0:
            raise InvalidInput(
                f"--replan-m: expected a number above 0, or inf, got {self.replan_m:g}"
            )
        simulated, led = kind.kind == "simulation", self.policy is not None
        soft = self.contact_stiffness_n_m is not None or self.contact_damping_ns_m is not None
        expected = f"expected a plan or a gait in a simulated world with it, got {'--policy' if led else self.world}"
        without = "expected --policy with it, got none"
        for wrong, message in (
            (self.try_estop and not self.arm, "--try-estop: expected --arm with it, got none"),
            (
                self.without_estop and not self.arm,
                "--without-estop: expected --arm with it, got none",
            ),
            (
                self.try_estop and self.without_estop,
                "--try-estop: expected it without --without-estop, got both",
            ),
            (
                soft and not simulated,
                f"--contact-stiffness-n-m: expected a simulated world with it, got {self.world}",
            ),
            (self.horizon is not None and not led, f"--horizon: {without}"),
            (self.replan_m is not None and not led, f"--replan-m: {without}"),
        ):
            if wrong:
                raise InvalidInput(message)
        if self.log is not None:
            others = {
                "PLAN": self.plan,
                "--setup": self.setup,
                "--policy": self.policy,
                "--picture": self.picture,
            }
            check_log(self.log, others)
            check_writable(self.log)
        check_drawn(video=self.video)
        if self.video is not None and (led or not simulated):
            raise InvalidInput(f"--video: {expected}")
        if self.picture is not None and self.log is None:
            raise InvalidInput(
                "--picture: expected --log FILE.mcap with it, from which it is drawn, got none"
            )
        check_drawn(self.picture)


def _led(report: LoopReport, policy: SelectorPolicy | None) -> tuple[dict[str, Any], Table]:
    """The report of a policy, as JSON and for people."""
    answers, record = None if policy is None else policy.answers, report.to_json()
    if answers is not None:
        record |= {
            "chosen": answers[0],
            "lifted": answers[1],
            "warning": "" if answers[0] else unused(answers),
        }
    return record, loop_table(report, answers)


@dataclass
class Simulate:
    """Execute a plan in a world: position control, friction as in the course; what was planned
    against what happened.

    The robot presses with the forces of the plan and follows it by joint positions. It succeeds if
    it does not fall, its centre of mass ends within 3 cm of the plan's and every joint within 0.1
    rad, and no foot slides by more than 2 cm. Nothing is slowed down: `stancekit run` does that, or
    says what no pace helps with. A film takes longer than the execution. Needs the extra robots,
    and for bullet catalogue.

      stancekit plan walls --out plan.json
      stancekit simulate plan.json --picture end.png --video film.mp4
      stancekit simulate plan.json --world bullet

    Exit code 0 where the execution succeeded, 1 where it failed, 2 for bad input, as a plan that the
    verifier rejects.
    """

    plan: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN")]
    """File of a plan, a walk, a leap or a crossing."""
    world: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = "mujoco"
    """Which simulation: bullet, mujoco, one of another package, or a class in a file."""
    forces: Literal["shared", "planned"] = "shared"
    """Press as planned, or with forces shared anew among the limbs of every stance, with a reserve
    of friction."""
    pace: float = 1.0
    """How fast: 2 takes half the time, as far as the joints can turn."""
    contact_stiffness_n_m: Annotated[OptionalFloat, tyro.conf.arg(metavar="N/M")] = None
    """Feet sink into the ground by their force over this; without it the ground is hard."""
    contact_damping_ns_m: Annotated[OptionalFloat, tyro.conf.arg(metavar="NS/M")] = None
    """Damping of that; without it a robot on all its feet sinks without swinging."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the end, .png, .pdf or .svg."""
    video: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Film, .mp4, at twice the pace (extra viz, and a GL library)."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File for what was recorded every 5 ms, .npz."""
    json: bool = False
    """Print the report as one JSON object."""

    def run(self) -> int:
        """Read, execute, compare."""
        from stancekit import RunSettings
        from stancekit.motions import WORLDS, accepted_of, check_run, simulate
        from stancekit.planners.files.arrays import checked
        from stancekit.planners.motion.plan_motion import Timing
        from stancekit.runner.worlds.world import SoftContact, WorldSettings

        checked(self.pace, "--pace", least=0.1, most=4.0)
        check_drawn(self.picture, self.video)
        check_out(self.out, ".npz")
        accepted = accepted_of(self.plan)
        if self.picture is not None and accepted.plan.has("times_s"):
            raise InvalidInput(
                "--picture: expected none with a walk: --video films what was executed"
            )
        timing = Timing().at_pace(self.pace)
        settings = RunSettings(timing=timing, forces=self.forces, check_limits=False)
        with as_options("world", timing="pace"):
            check_run(accepted, self.world, settings, led=False)
        world: str | JointBus = self.world
        with as_options("world", "contact_stiffness_n_m", "contact_damping_ns_m"):
            contact = SoftContact.of(self.contact_stiffness_n_m, self.contact_damping_ns_m)
            if contact is not None and (kind := WORLDS.get(self.world)).kind == "simulation":
                world = kind.make(
                    WorldSettings(
                        robot=accepted.robot, gravity_m_s2=accepted.gravity_m_s2, contact=contact
                    )
                )
        with as_options("world"), progress(f"simulate {accepted.name} in {self.world}") as bar:
            report = simulate(accepted, world, settings=settings, progress=bar)
        execution = report.execution
        if execution is None:
            complain(f"stancekit: failed: {self.plan}: {report.message}")
            return 1
        self._write(accepted.plan, execution)
        if self.json:
            verdict = {
                "succeeded": report.succeeded,
                "message": _why(report, execution),
                "doubts": list(report.doubts),
            }
            emit({"plan": str(self.plan), **execution.to_json(), **verdict})
        else:
            out.print(_simulated_table(report, execution))
            say(report.doubts, "doubt: {}")
            say((self.picture, self.video, self.out), "written: {}")
        return 0 if report.succeeded else 1

    def _write(self, motion: Motion[Any], execution: Execution) -> None:
        if self.out is not None:
            from stancekit.planners.files.writing import write_bytes

            write_bytes(self.out, execution.trace.to_npz())
        show(motion, execution, picture=self.picture, video=self.video)


def _why(report: RunReport, run: Execution) -> str:
    """Why it failed: what stopped it before its end, or else what was off the plan."""
    if report.stopped_s is None:
        return run.message or report.message
    done = f"{report.frames_done:.0f} of {report.frames:.0f} {report.counted}"
    return f"stopped after {done}: {report.message}"


def _simulated_table(report: RunReport, run: Execution) -> Table:
    final, worst, slid, shift, error = (
        1e3 * value
        for value in (
            run.com_final_m,
            run.com_worst_m,
            float(run.slip_m.max()),
            run.shift_m,
            run.error_m,
        )
    )
    done = report.succeeded
    verdict = "executed as planned" if done else "failed" if report.stopped_s is None else "stopped"
    torques = f"{run.torque_worst_nm:.1f} Nm at most, planned {run.planned_torque_nm:.1f}, limit {run.torque_limit_nm:g}"
    bump = f"touched something other than a foot for {run.bump_s:.2f} s"
    return facts(
        [
            ("verdict", Text(verdict, style="green" if done else "red")),
            ("", _why(report, run)),
            (
                "centre of mass",
                f"{final:.1f} mm from the plan's at its end, {worst:.1f} mm at most on the way",
            ),
            ("feet", f"slid {slid:.1f} mm at most, over {len(run.slip_m)} footholds"),
            ("forces", f"{run.force_rms_n:.1f} N (RMS) from what was planned"),
            ("joints", f"{torques}; inverse kinematics within {error:.2g} mm"),
            (
                "body",
                f"turned {run.tilt_worst_rad:.3f} rad from the plan; its origin {shift:.1f} mm "
                "from the centre of mass",
            ),
            ("terrain", bump if run.bump_s > 0.0 else ""),
            ("time", f"{run.seconds:.1f} s in {run.world}, {run.wall_s:.1f} s to compute"),
        ]
    )


@dataclass
class Replay:
    """Read the log of a run: which plan, what was decided, how well it was followed, and how it
    ended.

    A log whose writer was killed is read up to its last message.

    Exit code 0 where the run ended well, 1 where it did not or the log breaks off, 2 for what is no
    log.
    """

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """Log file, as `stancekit run --log` writes it."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the tracking, .png, .pdf or .svg."""
    json: bool = False
    """Print everything as one JSON object."""

    def run(self) -> int:
        """Read, and tell."""
        from stancekit.runner.log import read_log
        from stancekit.views.plots import differences, draw_tracking, tracked

        check_drawn(self.picture)
        recorded = read_log(self.log)
        plan, verdicts = recorded.of("plan")[0], recorded.of("verdict")
        commands = recorded.of("command")
        record: dict[str, Any] = {
            "log": str(self.log),
            "whole": recorded.whole,
            **{
                name: plan.get(name)
                for name in ("digest", "course", "world", "dry", "rate_hz", "pace")
            },
            "commands": len(commands),
            "decisions": recorded.of("decision"),
            "verdict": verdicts[-1] if verdicts else None,
            **(differences(tracked(recorded)) if commands else {}),
        }
        if self.picture is not None:
            draw_to_file(draw_tracking(recorded), self.picture)
        tell(self.json, record, _replay_table(record))
        say(() if self.json else (self.picture,), "written: {}")
        return 0 if recorded.whole and verdicts and verdicts[-1]["succeeded"] else 1


def _replay_table(record: dict[str, Any]) -> Table:
    verdict, dry = record["verdict"], ", dry" if record["dry"] else ""
    word = Text("none: the process was ended", style="red")
    if verdict is not None:
        done = verdict["succeeded"]
        word = Text("run as planned" if done else verdict["message"], "green" if done else "red")
    joints = ""
    if "joint_worst_rad" in record:
        worst, rms = 1e3 * record["joint_worst_rad"], 1e3 * record["joint_rms_rad"]
        joints = f"{worst:.1f} mrad from the plan at most, {rms:.1f} mrad (RMS)"
    return facts(
        [
            ("verdict", word),
            (
                "plan",
                f"{record['course']} on {record['world']}{dry}, digest "
                f"{str(record['digest'])[:16]}…",
            ),
            ("commands", f"{record['commands']} at {record['rate_hz']:g} Hz"),
            ("joints", joints),
            *((decision["what"], str(decision["why"])) for decision in record["decisions"]),
        ]
    )
