"""How steadily a plan is forwarded to 24 servos on an emulated bus: cycle time, lag, answers asked
for again.

    python benchmarks/bus_rate.py [--courses walls …] [--plan FILE] [--rate 50] [--pace 0.9]
    [--seconds 0]
        [--realtime] [--json]

The plan's joint angles go through the real SDK over a pseudo-terminal to servos in a process of
their own (``tests/emulators``), which take as long as the bytes would at 1 Mbaud; they stand on a
desk, so that nothing presses on a foot and the planned forces are taken for felt. The motion is as
slow as the servos need it (``pace``), and --pace slower still. A cycle is from the start of one
control period to that of the next, with the inverse kinematics of the next target in it. bus: what
sending and reading alone took. cpu: of the host's process, a period. error: measured angle against
the planned one at the same time, root mean square and worst of all joints; an emulated servo lags
by about 50 ms behind a steady turn. --seconds ends every run early. --realtime gives host and
servos a real-time priority (SCHED_FIFO, as root), as a robot's host would have: on a machine that
is busy with other things the rest measures those.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, launch, realtime

from stancekit.planners.answer.plan import Plan
from stancekit.planners.formats.plan_file import read_plan
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import builtin_courses, read_course
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.runner.control.foot_placement import ContactFeedback
from stancekit.runner.control.tracker import Tracker
from stancekit.runner.emulators.bus_process import BusProcess
from stancekit.runner.motion.time_parametrization import parametrize
from stancekit.runner.worlds.dynamixel.calibration import nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which plans, and how they are forwarded."""

    courses: tuple[str, ...] = builtin_courses()
    plan: Path | None = None
    rate: float = 50.0
    pace: float = 0.9
    seconds: float = 0.0
    realtime: bool = False


def main(arguments: Arguments) -> None:
    """Measure and print."""
    if arguments.plan is not None:
        plans = {arguments.plan.name: read_plan(arguments.plan)[0]}
    else:
        plans = {name: planned(name) for name in arguments.courses}
    realtime(arguments.realtime)
    for name, plan in plans.items():
        found = {"plan": name} | forward(
            plan, arguments.rate, arguments.pace, arguments.seconds or float("inf")
        )
        arguments.say(found, line)


def planned(name: str) -> Plan:
    """The plan of a built-in course."""
    outcome = TwoStageCoursePlanner().solve(read_course(name))
    assert outcome.solution is not None, outcome.message
    return outcome.solution


def forward(plan: Plan, rate_hz: float, pace: float, seconds: float) -> dict[str, Any]:
    """One plan over the bus."""
    robot = plan.problem.robot
    kinematics = Kinematics(robot, gravity_m_s2=plan.problem.gravity_m_s2)
    can = DynamixelWorld(
        robot, nominal(kinematics.joints, port="none"), rate_hz=rate_hz
    ).capabilities
    timed = parametrize(plan, kinematics, can, Timing().at_pace(pace), hung=True)
    tracker = Tracker(timed.motion, kinematics, rate_hz, ContactFeedback(press_hz=0.0, seek_m=0.0))
    first = tracker.start()
    with BusProcess(first.angles_rad.tolist()) as bus:
        world = DynamixelWorld(
            robot, nominal(kinematics.joints, port=bus.path, watchdog_s=0.5), rate_hz=rate_hz
        )
        with world:
            pose = first.origin_m, rotation_of(first.sample.rotation_rad)
            world.reset(plan.problem.terrain, first.angles_rad, *pose)
            world.torque(True)
            starts, busy, errors, clipped = list[float](), list[float](), list[Any](), 0
            felt, begin, cpu = first.sample.forces_n, time.monotonic(), time.process_time()
            while (target := tracker.next(felt)) is not None and time.monotonic() - begin < seconds:
                felt = target.sample.forces_n
                starts.append(time.monotonic())
                clipped += bool(
                    np.abs(world.sendable(target.angles_rad) - target.angles_rad).max() > 1e-9
                )
                state = world.step(target.angles_rad)
                busy.append(world.bus_s)
                errors.append(state.angles_rad - target.angles_rad)
            took, cpu = time.monotonic() - begin, time.process_time() - cpu
            world.relax()
    cycles, off = 1e3 * np.diff(starts), np.array(errors)
    return {
        "pace": pace * timed.pace,
        "seconds": took,
        "periods": len(starts),
        "rate_hz": (len(starts) - 1) / (starts[-1] - starts[0]),
        "cycle_p50_ms": float(np.percentile(cycles, 50)),
        "cycle_p99_ms": float(np.percentile(cycles, 99)),
        "cycle_worst_ms": float(cycles.max()),
        "bus_p50_ms": float(1e3 * np.percentile(busy, 50)),
        "bus_p99_ms": float(1e3 * np.percentile(busy, 99)),
        "cpu_ms": 1e3 * cpu / len(starts),
        "late": world.late,
        "asked_again": world.bus.retried,
        "clipped": clipped,
        "error_rms_rad": float(np.sqrt((off**2).mean())),
        "error_worst_rad": float(abs(off).max()),
    }


def line(found: dict[str, Any]) -> str:
    """One line."""
    return (
        f"{found['plan']}: pace {found['pace']:.2f}, {found['periods']} periods in {found['seconds']:.1f} s, "
        f"{found['rate_hz']:.2f} Hz; cycle "
        f"p50 {found['cycle_p50_ms']:.2f} p99 {found['cycle_p99_ms']:.2f} worst {found['cycle_worst_ms']:.1f} ms; bus "
        f"p50 {found['bus_p50_ms']:.2f} p99 {found['bus_p99_ms']:.2f} ms; cpu {found['cpu_ms']:.1f} ms; "
        f"{found['late']} late, {found['asked_again']} "
        f"asked again, {found['clipped']} clipped; error {found['error_rms_rad']:.4f} rad RMS, worst "
        f"{found['error_worst_rad']:.4f}"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
