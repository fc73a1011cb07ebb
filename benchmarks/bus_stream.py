"""The stream that simulation gets, forwarded to 24 emulated servos: is it the same, how steady is
it, who follows it?

    python benchmarks/bus_stream.py [--course ground-to-wall] [--frames 4] [--mass-kg 5] [--rate 50]
    [--realtime]
        [--json]

A plan of a hexapod that is light enough for XM540-W270 is run in MuJoCo as a robot that measures
its joints alone is (``blind``), and then by the same runner over a pseudo-terminal by servos that
take as long as the bytes would at 1 Mbaud (``tests/emulators``), and are loaded as a robot would
load them that stands as planned.

same: commands that are equal, of those that simulation was sent, and goals in ticks that the bus
took. cycle: from one command to the next, median and 99th percentile [ms]; late: periods that began
late; asked again: answers that did not come. joints: measured against planned, root mean square and
worst [rad], in simulation and on the bus. On a machine that is busy with other things these are
figures of those; --realtime as in ``bus_rate.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from _bench import Options, launch, realtime

from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.runner.acceptance import Accepted
from stancekit.runner.emulators.servo_bus import EmulatedBus
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from stancekit.runner.worlds.dynamixel.calibration import ServoTicks, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld

SERVOS = Actuators(joints={"*": "XM540-W270"})
STIFFNESS_NM_RAD, CURRENT_A = 28.4, 5.5
"""Of the emulated servos, and their limit."""
LATENCY_MS, WATCHDOG_S = 200.0, 1.0
"""Emulated servos answer when a loaded machine gives them a turn."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What is forwarded, and how fast."""

    course: str = "ground-to-wall"
    frames: int = 4
    mass_kg: float = 5.0
    rate: float = 50.0
    realtime: bool = False


class Sent:
    """A log that keeps commands; bus: its servos are loaded by what they are sent for loads."""

    def __init__(self, bus: EmulatedBus | None = None) -> None:
        self.asked, self.sent, self.lean, self._bus = (
            list[Array](),
            list[Array](),
            list[Array](),
            bus,
        )

    def write(self, topic: str, content: Mapping[str, Any]) -> None:
        """Keep commands."""
        if topic == "command":
            self.asked.append(np.array(content["asked_rad"]))
            self.sent.append(np.array(content["sent_rad"]))
            self.lean.append(self.asked[-1] - content["planned_rad"])
            if self._bus is not None:
                self._bus.servos.load_nm = -STIFFNESS_NM_RAD * self.lean[-1]


def main(arguments: Arguments) -> None:
    """Measure and print."""
    course = read_course(arguments.course, frames=arguments.frames)
    outcome = TwoStageCoursePlanner().solve(
        replace(course, robot=replace(course.robot, mass_kg=arguments.mass_kg))
    )
    if outcome.solution is None:
        raise SystemExit(f"{arguments.course}: {outcome.message or outcome.status.value}")
    accepted = Accepted.verified(outcome.solution, arguments.course)
    realtime(arguments.realtime)
    arguments.say({"course": arguments.course} | measured(accepted, arguments.rate), line)


def measured(accepted: Accepted, rate_hz: float) -> dict[str, Any]:
    """The plan in simulation, and on the bus."""
    robot, simulated = accepted.plan.problem.robot, Sent()
    world = make_world("mujoco", robot, rate_hz=rate_hz, actuators=SERVOS)
    first = Runner(world, settings=RunSettings(blind=True), log=simulated).run(accepted)
    with EmulatedBus(position_rad=(simulated.asked[0] - simulated.lean[0]).tolist()) as bus:
        calibration = nominal(world.joints, port=bus.path, watchdog_s=WATCHDOG_S)
        joints = {
            name: replace(each, current_a=CURRENT_A) for name, each in calibration.joints.items()
        }
        calibration, real = replace(calibration, latency_ms=LATENCY_MS, joints=joints), Sent(bus)
        servos = DynamixelWorld(robot, calibration, rate_hz=rate_hz)
        then = Runner(servos, dry=False, log=real).run(accepted)
        ticks = ServoTicks(calibration.ordered(world.joints)).ticks
        goals = list(bus.goals)
    count = len(simulated.asked)
    same = (k for k, asked in enumerate(real.asked) if np.array_equal(asked, simulated.asked[0]))
    begin = next(same, len(real.asked))
    pairs = zip(real.asked[begin:], simulated.asked, strict=False)
    taken = zip(goals[begin - len(real.asked) :], simulated.sent, strict=False)
    return {
        "commands": count,
        "same": sum(np.array_equal(a, b) for a, b in pairs),
        "same_ticks": sum(goal == ticks(sent).tolist() for goal, sent in taken),
        "cycle_p50_ms": 1e3 * then.cycle_s[0],
        "cycle_p99_ms": 1e3 * then.cycle_s[1],
        "late": servos.late,
        "asked_again": servos.bus.retried,
        "simulated_rad": joints_off(first),
        "bus_rad": joints_off(then),
        "bus": then.message or "to the end",
        "simulation": first.message or "to the end",
    }


def joints_off(report: RunReport) -> list[float]:
    """Root mean square and worst [rad]."""
    return [report.joint_rms_rad, report.joint_worst_rad]


def line(found: dict[str, Any]) -> str:
    """One line."""
    simulated, bus = (
        "{:.4f} RMS {:.4f} worst".format(*found[key]) for key in ("simulated_rad", "bus_rad")
    )
    return (
        f"{found['course']}: same {found['same']} of {found['commands']} commands, {found['same_ticks']} goals in "
        f"ticks; cycle p50 {found['cycle_p50_ms']:.2f} p99 {found['cycle_p99_ms']:.2f} ms, {found['late']} late, "
        f"{found['asked_again']} asked again; joints {simulated} rad in simulation ({found['simulation']}), {bus} on "
        f"the bus ({found['bus']})"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
