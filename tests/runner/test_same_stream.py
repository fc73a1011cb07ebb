"""What hardware is sent is what simulation was sent: q + τ/Kp, from one function, to the tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.plan_motion import Timing, plan_motion
from stancekit.planners.problem.contact import at_point
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import ActuatorModel, Actuators
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.foot_placement import ContactFeedback
from stancekit.runner.control.tracker import Tracker, command
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.dynamixel.control_table import nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.runner.worlds.mujoco import MujocoWorld
from stancekit.runner.worlds.world import Drives, State, make_world
from tests.emulators.fast_time import fast_bus
from tests.emulators.memory_world import PATIENT
from tests.emulators.servo_bus import EmulatedBus
from tests.refusals import refuses

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
def light() -> Motion:
    """A step on level ground of a robot that such servos carry."""
    course = read_course("ground-to-wall", frames=2)
    robot = replace(course.robot, mass_kg=5.0)
    outcome = TwoStage().solve(replace(course, robot=robot))
    assert outcome.solution is not None
    return outcome.solution


def test_a_loop_that_is_sent_a_command_gives_the_torque_at_the_angle() -> None:
    drives = Drives.of(hexapod().legs, SERVOS)
    q, torque, rate, rising = np.random.default_rng(0).normal(size=(4, 24))
    found = (
        drives.stiffness_nm_rad * (command(drives, q, torque, rate, rising) - q)
        - drives.damping_nms_rad * rate
    )
    assert found == pytest.approx(torque + drives.rotor_kg_m2 * rising, abs=1e-12)
    assert np.array_equal(command(replace(drives, yields=False), q, torque, rate, rising), q)


def test_the_bus_is_sent_what_the_simulation_was_sent_to_the_tick_and_its_servos_stay_with_the_plan() -> (
    None
):
    accepted, simulated = Accepted.verified(light(), "light"), Sent()
    robot = accepted.plan.problem.robot
    world = make_world("mujoco", robot, rate_hz=RATE_HZ, actuators=SERVOS)
    report = Runner(world, settings=RunSettings(blind=True), log=simulated).run(accepted)
    assert report.succeeded, report.message
    with fast_bus(position_rad=(simulated.asked[0] - simulated.lean[0]).tolist()) as bus:
        calibration = nominal(robot, port=bus.path, watchdog_s=1.0)
        calibration = replace(
            calibration,
            joints={
                name: replace(each, current_a=5.5) for name, each in calibration.joints.items()
            },
        )
        real = Sent(bus, 28.4)
        patient = RunSettings(limits=PATIENT)
        body = DynamixelWorld(robot, calibration, rate_hz=RATE_HZ)
        done = Runner(body, settings=patient, dry=False, log=real).run(accepted)
        turning = calibration.turning(world.joints)
    assert done.succeeded, done.message
    count = len(simulated.asked)
    assert np.array_equal(real.asked[-count:], simulated.asked)
    assert bus.goals[-count:] == [np.rint(turning.told(sent)).tolist() for sent in simulated.sent]
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
        before: State = world.connect(
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


def added(course: str, deaf: int | None = None, **settings: float) -> tuple[Array, Array]:
    """Joint targets with pressing less those without, after forces were missing: of those that are
    asked for a half.

    deaf: the foot that feels nothing. settings: of the pressing.
    """
    plan = TwoStage().solve(read_course(course, frames=2)).solution
    motion, kinematics = plan_motion(plan), Kinematics(plan.problem.robot)
    felt = 0.5 * motion.at(0.0).forces_n
    if deaf is not None:
        felt[deaf] = 0.0
    targets = []
    for press_hz in (4.0, 0.0):
        tracker = Tracker(motion, kinematics, 100.0, ContactFeedback(press_hz=press_hz, **settings))
        tracker.start()
        for _ in range(20):
            target = tracker.next(felt)
            assert target is not None
        targets.append(target.targets_rad)
    return targets[0] - targets[1], np.array(motion.at(0.0).normals)


def test_feet_between_walls_press_harder_where_they_feel_too_little() -> None:
    more, normals = added("walls")
    assert np.abs(normals[:, 2]).max() < 1e-9
    assert np.abs(more).max() > 1e-3


def test_feet_on_level_ground_do_not() -> None:
    more, normals = added("stairs")
    np.testing.assert_allclose(normals[:, 2], 1.0)
    np.testing.assert_array_equal(more, 0.0)


def test_a_foot_that_feels_nothing_is_pressed_no_harder() -> None:
    heard, _ = added("walls")
    more, _ = added("walls", deaf=0)
    assert np.abs(heard[:4]).max() > 1e-3
    np.testing.assert_allclose(more[:4], 0.0, atol=1e-12)
    assert np.abs(more[4:]).max() > 1e-3


def test_no_more_is_added_than_the_settings_say() -> None:
    usual, _ = added("walls")
    some, _ = added("walls", press_n=1.0, press_share=0.0)
    none, _ = added("walls", press_n=0.0, press_share=0.0)
    assert 0.0 < np.abs(some).max() < 0.5 * np.abs(usual).max()
    np.testing.assert_allclose(none, 0.0, atol=1e-9)


FAST = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)
WORLDS = ("mujoco", "bullet")
STANDING = np.tile([0.0, 0.3, 0.0, 1.2], 6)
SQUARE = Patch(
    vertices_m=0.5
    * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]),
    normal=np.array([0.0, 0.0, 1.0]),
    shear_reference=np.array([1.0, 0.0, 0.0]),
    friction=0.7,
)


def falling(name: str, wrench: list[float], leans: bool = False) -> np.ndarray:
    """Velocity of a robot after a tenth of a second of falling with this on it, shape (6,). leans:
    its centre of mass is beside that of its body.
    """
    if name == "bullet":
        pytest.importorskip("pybullet")
    pose = STANDING.copy()
    if leans:
        pose[:12:4] = 0.6
        pose[1:12:4] = -0.5
    with make_world(name, hexapod()) as world:
        world.connect((SQUARE,), pose, np.array([0.0, 0.0, 3.0]), np.eye(3))
        world.carry(np.array(wrench))  # type: ignore[attr-defined]
        return np.array([world.step(pose).velocity for _ in range(20)][-1])


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("leans", [False, True])
def test_a_force_moves_a_falling_robot_and_does_not_turn_it(name: str, leans: bool) -> None:
    still, pulled = (
        falling(name, [force, -0.5 * force, 0.0, 0.0, 0.0, 0.0], leans) for force in (0.0, 30.0)
    )
    gained = pulled - still
    np.testing.assert_allclose(gained[:2], [0.3, -0.15], rtol=0.05)  # F t / m
    assert np.abs(gained[3:]).max() < 0.02


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("axis", range(3))
def test_a_moment_turns_a_falling_robot_and_does_not_move_it(name: str, axis: int) -> None:
    wrench = np.zeros(6)
    wrench[3 + axis] = 2.0
    gained = falling(name, wrench.tolist()) - falling(name, [0.0] * 6)
    assert gained[3 + axis] > 0.2
    assert np.abs(np.delete(gained[3:], axis)).max() < 0.1 * gained[3 + axis]
    assert np.abs(gained[:3]).max() < 0.02


@pytest.mark.parametrize("name", WORLDS)
def test_feet_of_a_robot_that_stands_carry_what_is_on_it(name: str) -> None:
    if name == "bullet":
        pytest.importorskip("pybullet")
    wrench = at_point((3.0, -2.0, -15.0), (0, 0, 0), (0.1, 0.05, 0.05))
    answer = stancekit.plan("stairs", frames=2, settings=stancekit.PlanSettings(wrench=wrench))
    plan = answer.solution
    assert plan is not None
    report = stancekit.simulate(plan, name, settings=FAST)
    assert report.succeeded, report.message
    assert report.execution.com_worst_m < 0.01
    assert report.execution.force_rms_n < 8.0


@pytest.fixture
def carried(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """What worlds in MuJoCo are told that the body bears."""
    told, carry = list[np.ndarray](), MujocoWorld.carry

    def noted(self: MujocoWorld, wrench: np.ndarray) -> None:
        told.append(np.array(wrench))
        carry(self, wrench)

    monkeypatch.setattr(MujocoWorld, "carry", noted)
    return told


def test_a_world_is_told_what_the_plan_was_told(
    carried: list[np.ndarray], step: Callable[[str], Motion]
) -> None:
    course = replace(
        read_course("stairs", 2),
        wrench=np.array([[0, 0, -5.0, 0, 0, 0], [0, 4.0, -10.0, 0, 0, 0.2]]),
    )
    plan = stancekit.plan(course).solution
    assert plan is not None
    assert stancekit.simulate(plan, settings=FAST).succeeded
    np.testing.assert_array_equal(carried[0], course.wrench[0])
    np.testing.assert_allclose(carried[-1], course.wrench[1])
    steps = np.diff(np.array(carried), axis=0)
    assert (steps[:, 2] <= 1e-12).all()  # from the one to the other
    assert len({round(float(each[2]), 6) for each in carried}) > 10

    carried.clear()
    assert stancekit.simulate(plan, settings=replace(FAST, wrench=(0.0, 1.0, 0.0))).succeeded
    assert {tuple(each) for each in carried} == {(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)}

    carried.clear()
    assert stancekit.simulate(step("stairs"), settings=FAST).succeeded
    assert not carried


def test_a_plan_that_was_told_of_a_load_presses_as_it_says_and_another_does_not(
    step: Callable[[str], Motion],
) -> None:
    load = at_point((0.0, 0.0, -20.0), (0, 0, 0), (0.12, 0.1, 0.05))
    told = stancekit.plan("stairs", frames=2, settings=stancekit.PlanSettings(wrench=load)).solution
    assert told is not None
    said = stancekit.simulate(told, settings=FAST).execution
    other = stancekit.simulate(
        step("stairs"), settings=replace(FAST, wrench=tuple(load.tolist()))
    ).execution
    assert said.force_rms_n < 0.6 * other.force_rms_n
    assert said.planned_torque_nm > 1.1 * other.planned_torque_nm


def test_what_is_no_wrench_or_no_simulation_is_refused(step: Callable[[str], Motion]) -> None:
    wrong: Any
    for wrong in ((1.0, 2.0), ("a", "b", "c"), (np.nan, 0.0, 0.0), 3.0):
        with refuses("wrench"):
            RunSettings(wrench=wrong)
    with refuses("wrench"):
        stancekit.run(step("stairs"), "dynamixel", settings=RunSettings(wrench=(1.0, 0.0, 0.0)))


def test_feet_sink_into_ground_that_yields_and_a_made_world_has_its_own() -> None:
    plan = stancekit.plan("stairs", frames=2).solution
    assert plan is not None
    hard, soft = (
        stancekit.simulate(plan, settings=FAST, contact_stiffness_n_m=stiffness).execution
        for stiffness in (None, 2e4)
    )
    assert soft.com_worst_m > hard.com_worst_m
    world = make_world("mujoco", plan.robot)
    with world, refuses("contact_stiffness_n_m", "world"):
        stancekit.simulate(plan, world, contact_stiffness_n_m=2e4)
