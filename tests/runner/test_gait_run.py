"""Gaits on worlds: walked as planned by the hexapod in both simulators, and refused before any
motion where not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.formats.trajectory_file import write_trajectory
from stancekit.planners.gait.method.attempt import Attempted
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S, GaitMotion, footholds
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M, Servo
from stancekit.planners.robot.single_body import anymal, hexapod_walker
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.runner.acceptance import Accepted
from stancekit.runner.execution import Tolerance
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from tests.emulators.memory_world import PATIENT, MemoryWorld
from tests.refusals import refuses


@pytest.fixture
def accepted(gait: Attempted, tmp_path: Path) -> Accepted:
    write_trajectory(tmp_path / "walk.json", gait.trajectory, gait.report)
    return Accepted.from_file(tmp_path / "walk.json")


def walked(accepted: Accepted, world: str, friction_share: float = 1.0) -> RunReport:
    with make_world(world, accepted.robot) as made:
        return Runner(made).run(accepted, accepted.ground(friction_share))


@pytest.mark.parametrize("world", ["bullet", "mujoco"])
def test_a_gait_is_walked_as_planned(accepted: Accepted, world: str) -> None:
    pytest.importorskip({"bullet": "pybullet", "mujoco": "mujoco"}[world])
    report = walked(accepted, world)
    assert report.succeeded, report.message
    assert (report.digest, report.clipped, report.refused) == (accepted.digest, 0, 0)
    run = report.execution
    assert run is not None
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
    assert report.execution is not None
    assert report.execution.slip_m.max() > Tolerance().slip_m


def test_on_something_real_its_joints_are_sent_and_nothing_is_pressed(
    accepted: Accepted,
) -> None:
    world, settings = MemoryWorld(), RunSettings(limits=PATIENT)
    report = Runner(world, dry=False, settings=settings).run(accepted)
    assert report.succeeded, report.message
    assert report.execution is None
    sent = np.array([targets for _, targets in world.commands])
    motion = GaitMotion(accepted.plan)
    assert len(sent) == pytest.approx(motion.duration_s * world.rate_hz, abs=2)
    assert report.joint_worst_rad < 0.1


def test_a_gait_that_was_edited_or_rejected_or_of_another_robot_is_refused(
    gait: Attempted, tmp_path: Path
) -> None:
    path = tmp_path / "walk.json"
    pushed = replace(gait.trajectory, forces_n=1.3 * gait.trajectory.forces_n)
    write_trajectory(path, pushed, check_trajectory(pushed))
    with refuses("walk.json"):
        Accepted.from_file(path)
    write_trajectory(path, gait.trajectory, gait.report)
    path.write_text(path.read_text().replace('"friction": 0.75', '"friction": 0.85'))
    with refuses("digest"):
        Accepted.from_file(path)
    with refuses("robot anymal"):
        walking_robot(anymal())
    assert walking_robot(hexapod_walker()).mass_kg == hexapod_walker().mass_kg


def test_feet_that_stick_are_in_no_world(accepted: Accepted) -> None:
    sticky = replace(accepted.plan, adhesive=np.arange(6) < 2)
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
    motion = GaitMotion(trajectory)
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
