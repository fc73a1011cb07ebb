"""Gaits on worlds: walked as planned by the hexapod in both simulators, and refused before any
motion where not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.gait.method.attempt import Attempted
from stancekit.planners.leap.finder import find_leap
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S, footholds, gait_motion
from stancekit.planners.motion.leap_motion import SETTLE_S, leap_motion
from stancekit.planners.motion.motion import Played
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.robot.model import walking_robot
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M, Servo
from stancekit.planners.robot.walker import anymal, hexapod_walker
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.runner.acceptance import Accepted
from stancekit.runner.motion.redundancy import mean_forces
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings, Tolerance
from stancekit.runner.worlds.world import make_world
from tests.emulators.memory_world import PATIENT, MemoryWorld
from tests.refusals import refuses


@pytest.fixture
def accepted(gait: Attempted, tmp_path: Path) -> Accepted:
    write_motion(tmp_path / "walk.json", gait.trajectory, gait.report)
    return Accepted.from_file(tmp_path / "walk.json")


def walked(accepted: Accepted, world: str, friction_share: float = 1.0) -> RunReport:
    with make_world(world, accepted.robot) as made:
        return Runner(made).run(accepted, accepted.plan.ground(friction_share))


@pytest.mark.parametrize("world", ["bullet", "mujoco"])
def test_a_gait_is_walked_as_planned(accepted: Accepted, world: str) -> None:
    pytest.importorskip({"bullet": "pybullet", "mujoco": "mujoco"}[world])
    report = walked(accepted, world)
    assert report.succeeded, report.message
    assert (report.digest, report.clipped, report.refused) == (accepted.digest, 0, 0)
    run = report.execution
    assert run.com_final_m < 3e-3
    assert run.com_worst_m < 5e-3
    assert run.slip_m.max() < 3e-3
    assert (
        run.force_rms_n < 8.0
    )  # 16 N a foot: on ground that holds by itself feet share the load as their loops do
    assert run.bump_s == 0.0
    walked_m = run.trace.com_m[-1] - run.trace.com_m[0]
    np.testing.assert_allclose(walked_m[:2], [0.1, 0.05], atol=5e-3)


def test_where_there_is_less_friction_than_it_counts_on_feet_slide_and_the_report_says_so(
    accepted: Accepted,
) -> None:
    report = walked(accepted, "mujoco", 0.1)
    assert not report.succeeded
    assert report.execution.slip_m.max() > Tolerance().slip_m


def test_on_something_real_its_joints_are_sent_and_nothing_is_pressed(
    accepted: Accepted,
) -> None:
    world, settings = MemoryWorld(), RunSettings(limits=PATIENT)
    report = Runner(world, dry=False, settings=settings).run(accepted)
    assert report.succeeded, report.message
    assert report.execution is None
    sent = np.array([targets for _, targets in world.commands])
    assert len(sent) == pytest.approx(gait_motion(accepted.plan).duration_s * world.rate_hz, abs=2)
    assert report.joint_worst_rad < 0.1


def test_a_gait_that_was_edited_or_rejected_or_of_another_robot_is_refused(
    gait: Attempted, tmp_path: Path
) -> None:
    path = tmp_path / "walk.json"
    pushed = replace(gait.trajectory, forces_n=1.3 * gait.trajectory.forces_n)
    write_motion(path, pushed, check_trajectory(pushed))
    with refuses("walk.json"):
        Accepted.from_file(path)
    write_motion(path, gait.trajectory, gait.report)
    path.write_text(path.read_text().replace('"friction": 0.75', '"friction": 0.85'))
    with refuses("digest"):
        Accepted.from_file(path)
    with refuses("robot anymal"):
        walking_robot(anymal())
    assert walking_robot(hexapod_walker()).mass_kg == hexapod_walker().mass_kg


def test_feet_that_stick_are_in_no_world(accepted: Accepted) -> None:
    sticky = accepted.plan.asked(adhesive=np.arange(6) < 2)
    with refuses("walk", "LF", "LM"):
        Accepted.verified(sticky, "walk")


@pytest.mark.parametrize(
    ("servo", "name"),
    [
        (Servo(velocity_rad_s=0.8), "velocity"),
        (Servo(torque_nm=2.0), "2 Nm"),
        (Servo(lower_rad=(-1.9, -1.8, -2.6, 1.7)), "foot"),
    ],
)
def test_joints_that_cannot_do_it_are_named_before_anything_moves(
    accepted: Accepted, servo: Servo, name: str
) -> None:
    with make_world("mujoco", accepted.robot, servo) as made:
        runner = Runner(made)
        with refuses(name):
            runner.run(accepted)
        assert runner.state is None


def test_the_motion_is_the_trajectory_between_two_rests(gait: Attempted) -> None:
    trajectory = gait.trajectory
    motion = gait_motion(trajectory)
    k = trajectory.samples // 3
    sample = motion.at(WALK_SETTLE_S + float(trajectory.times_s[k] - trajectory.times_s[0]))
    np.testing.assert_allclose(sample.com_m, trajectory.torso_m[k], atol=1e-9)
    np.testing.assert_allclose(sample.forces_n, trajectory.forces_n[k], atol=1e-6)
    away = np.linalg.norm(sample.feet_m - trajectory.feet_m[k], axis=1)
    np.testing.assert_allclose(away, FOOT_RADIUS_M, atol=1e-9)
    np.testing.assert_array_equal(sample.stands, trajectory.contact[k])
    for time_s, row in ((0.0, 0), (motion.duration_s + 1.0, -1)):
        np.testing.assert_allclose(motion.at(time_s).com_m, trajectory.torso_m[row], atol=1e-9)


def test_stances_are_counted_over_all_feet() -> None:
    contact = np.array([[True, False], [True, True], [False, True], [True, True]])
    np.testing.assert_array_equal(footholds(contact), [[0, -1], [0, 2], [-1, 2], [1, 2]])


FILE = Path(__file__).parents[1] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def leap() -> Accepted:
    return Accepted.from_file(FILE)


def stopped_at(leap: Accepted, when_s: float) -> RunReport:
    """The report of a run whose e-stop is pressed at a time of the world."""
    runners = list[Runner]()

    def pressed() -> str:
        state = runners[0].state if runners else None
        return "e-stop" if state is not None and state.time_s >= when_s else ""

    runners.append(Runner(make_world("mujoco", leap.robot), sources=(pressed,)))
    return runners[0].run(leap)


@pytest.fixture(scope="module")
def ran(leap: Accepted, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunReport, Path]:
    """A run that nothing stops, and its log."""
    log = tmp_path_factory.mktemp("ran") / "leap.mcap"
    return stancekit.run(leap, "mujoco", log=log), log


def test_a_leap_lands_where_it_should_and_stands(ran: tuple[RunReport, Path]):
    report, _ = ran
    assert report.succeeded, report.message
    assert report.execution.com_final_m < 0.01
    assert report.execution.trace.rotation[-1, 2, 2] > 0.95
    flies = ~(report.execution.trace.foothold >= 0).any(axis=1)
    assert np.count_nonzero(flies) > 20


def test_a_stop_before_take_off_is_obeyed_at_once(leap: Accepted):
    report = stopped_at(leap, 0.6)
    assert report.message == "e-stop"
    assert report.execution.seconds < 0.75
    assert report.execution.trace.rotation[-1, 2, 2] > 0.95


def test_a_stop_in_the_air_lands_first(leap: Accepted):
    report = stopped_at(leap, 1.4)
    assert report.message == "e-stop"
    assert not report.succeeded
    assert report.execution.seconds > 2.0
    assert report.execution.trace.rotation[-1, 2, 2] > 0.95
    assert report.execution.com_final_m < 0.02


def test_a_fault_in_the_air_leaves_no_leap_that_a_stop_waits_for(leap: Accepted):
    runner = Runner(make_world("mujoco", leap.robot))

    def fails(state: object) -> None:
        if runner.latch.lands:
            raise ValueError("in the air")

    runner.check_body = lambda target, state: fails(state)
    with refuses(kind=ValueError):
        runner.run(leap)
    assert not runner.latch.lands


def test_a_leap_that_nobody_judged_with_legs_is_not_run():
    plan = find_leap(leap_class("leap-given").draw(np.random.default_rng(0))).solution
    with refuses("leap", "legs", "--robot"):
        stancekit.run(plan, "mujoco")


def test_a_leap_has_one_pace(leap: Accepted):
    with refuses("timing"):
        stancekit.run(
            leap, "mujoco", settings=RunSettings(timing=RunSettings().timing.at_pace(0.5))
        )


def test_a_leap_that_begins_in_motion_is_not_run(leap: Accepted):
    given = leap.plan.problem
    start = replace(given.start, velocity_m_s=np.array([5e-4, 0.0, 0.0]))
    with refuses("x1"):
        stancekit.run(replace(leap.plan, problem=replace(given, start=start)), "mujoco")


def test_no_push_is_asked_of_a_leap(leap: Accepted):
    with refuses("least_push"):
        stancekit.run(leap, "mujoco", settings=RunSettings(least_push=0.5))


@pytest.fixture(scope="module")
def motion(leap: Accepted) -> Played:
    return leap_motion(leap.plan)


@pytest.mark.parametrize("period_s", [0.005, 0.0061])
def test_a_tracker_commands_the_impulse_of_a_leap(leap: Accepted, motion: Played, period_s: float):
    times = np.arange(0.0, motion.duration_s, period_s)
    commanded = mean_forces(motion, period_s).at(times).forces_n.sum(axis=(0, 1)) * period_s
    fine = np.arange(-period_s, times[-1], 1e-4) + 5e-5
    planned = motion.at(fine).forces_n.sum(axis=(0, 1)) * 1e-4
    weight = leap.plan.problem.weight_n
    np.testing.assert_allclose(
        commanded, planned, atol=0.3 * period_s * weight
    )  # a tenth of a period each change


def test_what_carries_in_a_part_of_a_period_stands_in_it(leap: Accepted, motion: Played):
    first = leap.plan.problem.timings_s[leap.plan.timing][0] + SETTLE_S
    mean = mean_forces(motion, 0.005)
    assert (mean.at(first + 0.001).foothold >= 0).all()
    assert (mean.at(first + 0.0051).foothold < 0).all()
    half = mean.at(first + 0.0025).forces_n
    np.testing.assert_allclose(half, 0.4 * motion.at(first - 1e-4).forces_n, rtol=0.51)


def test_loads_may_lead_beyond_the_limits_of_angles(leap: Accepted):
    robot = leap.robot
    with make_world("mujoco", robot) as world:
        model = robot.own_model()
        stance = np.concatenate([leg.stance_rad for leg in model.legs])
        upper = np.minimum(world.drives.upper_rad, 9.0)
        world.connect((), stance, np.array([0.0, 0.0, 5.0]), np.eye(3))
        loads = np.full(len(stance), 0.7)
        for _ in range(100):
            world.send(upper + 0.5 + loads, loads)
            apart = world.read()
        np.testing.assert_allclose(apart.sent_rad, upper + loads, atol=1e-9)
        for _ in range(100):
            together = world.step(upper + 0.5 + loads)
        np.testing.assert_allclose(together.sent_rad, upper, atol=1e-9)
