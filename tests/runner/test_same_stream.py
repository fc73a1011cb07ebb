"""What hardware is sent is what simulation was sent: q + τ/Kp, from one function, to the tick."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.actuators import ActuatorModel, Actuators
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.tracker import command
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from stancekit.runner.worlds.drives import Drives
from stancekit.runner.worlds.dynamixel import port
from stancekit.runner.worlds.dynamixel.control_table import ServoTicks, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.runner.worlds.world import State
from tests.emulators.memory_world import PATIENT
from tests.emulators.servo_bus import EmulatedBus

SERVOS = Actuators(joints={"*": "XM540-W270"})
RATE_HZ = 50.0


class Sent:
    """A log of commands that is looked at, and that loads servos as a robot would that stands as
    planned.
    """

    def __init__(self, bus: EmulatedBus | None = None, stiffness_nm_rad: float = 0.0) -> None:
        self.asked, self.sent, self.lean = list[Any](), list[Any](), list[Any]()
        self._bus, self._stiffness = bus, stiffness_nm_rad

    def write(self, topic: str, content: Mapping[str, Any]) -> None:
        """Keep commands."""
        if topic == "command":
            self.asked.append(np.array(content["asked_rad"]))
            self.sent.append(np.array(content["sent_rad"]))
            self.lean.append(self.asked[-1] - content["planned_rad"])
            if self._bus is not None:
                self._bus.servos.load_nm = -self._stiffness * self.lean[-1]


@cache
def light() -> Plan:
    """A step on level ground of a robot that such servos carry."""
    course = read_course("ground-to-wall", frames=2)
    robot = replace(course.robot, mass_kg=5.0)
    outcome = TwoStagePlanner().solve(replace(course, robot=robot))
    assert outcome.solution is not None
    return outcome.solution


def test_a_loop_that_is_sent_a_command_gives_the_torque_at_the_angle() -> None:
    drives = Drives.of(hexapod(), Servo(), hexapod().legs, SERVOS)
    q, torque, rate, rising = np.random.default_rng(0).normal(size=(4, 24))
    found = (
        drives.stiffness_nm_rad * (command(drives, q, torque, rate, rising) - q)
        - drives.damping_nms_rad * rate
    )
    assert found == pytest.approx(torque + drives.rotor_kg_m2 * rising, abs=1e-12)
    assert np.array_equal(command(replace(drives, yields=False), q, torque, rate, rising), q)


def test_the_bus_is_sent_what_the_simulation_was_sent_to_the_tick_and_its_servos_stay_with_the_plan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        port, "WRITE_S", 2.0
    )  # the emulator has its turn when a loaded machine gives it one
    accepted, simulated = Accepted.verified(light(), "light"), Sent()
    robot = accepted.plan.problem.robot
    world = make_world("mujoco", robot, rate_hz=RATE_HZ, actuators=SERVOS)
    report = Runner(world, settings=RunSettings(blind=True), log=simulated).run(accepted)
    assert report.succeeded, report.message
    with EmulatedBus(position_rad=(simulated.asked[0] - simulated.lean[0]).tolist()) as bus:
        calibration = nominal(world.joints, port=bus.path, watchdog_s=1.0)
        calibration = replace(
            calibration,
            latency_ms=200.0,  # as above
            joints={
                name: replace(each, current_a=5.5) for name, each in calibration.joints.items()
            },
        )
        real = Sent(bus, 28.4)
        patient = RunSettings(limits=PATIENT)
        body = DynamixelWorld(robot, calibration, rate_hz=RATE_HZ)
        done = Runner(body, settings=patient, dry=False, log=real).run(accepted)
        turning = ServoTicks(calibration.ordered(world.joints))
    assert done.succeeded, done.message
    count = len(simulated.asked)
    assert np.array_equal(real.asked[-count:], simulated.asked)
    assert bus.goals[-count:] == [turning.ticks(sent).tolist() for sent in simulated.sent]
    assert (
        np.abs(simulated.lean[-1]).max() > 3.0 * done.joint_rms_rad
    )  # joints do not go where loads are sent for


def test_the_guard_counts_no_load_as_deviation_whether_feet_feel_or_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    accepted, log = Accepted.verified(light(), "light"), Sent()
    world = make_world("mujoco", accepted.plan.problem.robot, actuators=SERVOS)
    runner = Runner(world, settings=RunSettings(check_limits=False), log=log)
    leans, step = list[Any](), runner.world.step

    def watched(targets: Any, lean: Any = None) -> State:
        leans.append(lean)
        return step(targets, lean)

    monkeypatch.setattr(runner.world, "step", watched)
    report = runner.run(accepted)
    assert report.succeeded, report.message
    moving = [k for k, lean in enumerate(leans) if lean is not None]
    assert len(moving) > 0.9 * len(leans)
    np.testing.assert_allclose(
        [leans[k] for k in moving], [log.lean[k] for k in moving], atol=1e-12
    )
    assert max(np.abs(leans[k]).max() for k in moving) > 0.05


@pytest.mark.parametrize(("yields", "stands"), [(True, True), (False, False)])
def test_a_robot_between_walls_stands_by_the_loads_that_it_is_sent(
    step: Any, monkeypatch: pytest.MonkeyPatch, yields: bool, stands: bool
) -> None:
    accepted = Accepted.verified(step("walls"), "walls")
    world = make_world("mujoco", accepted.plan.problem.robot)
    runner = Runner(world, settings=RunSettings(blind=True, check_limits=False))
    monkeypatch.setitem(vars(runner.world), "drives", replace(runner.world.drives, yields=yields))
    report = runner.run(accepted)
    assert report.succeeded is stands, report.message


@pytest.mark.parametrize("name", ["mujoco", "bullet"])
def test_a_joint_that_turns_with_its_torque_gives_no_more_than_its_curve(name: str) -> None:
    pytest.importorskip({"bullet": "pybullet"}.get(name, name))
    kind = ActuatorModel(stall_nm=6.0, no_load_rad_s=2.0, stiffness_nm_rad=400.0)
    world: Any = make_world(
        name,
        hexapod(),
        rate_hz=1000.0,
        actuators=Actuators(joints={"*": "m"}, actuators={"m": kind}),
    )
    with world:
        before: State = world.reset(
            (), np.tile([0.1, 0.4, 0.0, 0.8], 6), np.array([0.0, 0.0, 2.0]), np.eye(3)
        )
        seen = 0.0
        for _ in range(300):
            state = world.step(before.angles_rad + 0.5)
            low, high = world.drives.torque_range(before.rates_rad_s)
            assert (state.torques_nm >= low - 1e-6).all()
            assert (state.torques_nm <= high + 1e-6).all()
            seen, before = max(seen, float(np.abs(before.rates_rad_s).max())), state
    assert seen > 1.0
