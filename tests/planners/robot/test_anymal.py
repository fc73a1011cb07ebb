"""ANYmal's legs agree with its boxes, and its walks are judged whole; walks of the boxes are judged
as ever.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import Answer, Motion
from stancekit.planners.answer.trajectory import robot_from_json
from stancekit.planners.formats.motion_file import check_file, read_motion, write_motion
from stancekit.planners.robot import walker as walkers
from stancekit.planners.robot.inverse_kinematics import InverseKinematics
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.walker import anymal, legged_anymal, named_walker
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY
from tests.refusals import refuses

pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def walker() -> Robot:
    return legged_anymal()


@pytest.fixture(scope="module")
def model(walker: Robot) -> RobotModel:
    assert walker.model is not None
    return walker.model


def test_its_legs_weigh_and_stand_as_its_boxes(walker: Robot, model: RobotModel) -> None:
    boxes = anymal()
    assert model.leg_names == boxes.limb_names
    assert model.mass_kg == pytest.approx(boxes.mass_kg, rel=1e-9)
    np.testing.assert_allclose(model.inertia_kgm2, boxes.inertia_kgm2, atol=1e-9)
    assert model.stand_height_m == pytest.approx(boxes.stand_height_m, abs=1e-9)
    for leg, foot in zip(model.legs, boxes.feet, strict=True):
        np.testing.assert_allclose(leg.hip_m - model.com_m, foot.hip_m, atol=1e-9)
        toe = leg.nominal_m - [0.0, 0.0, leg.radius_m] - model.com_m
        np.testing.assert_allclose(toe, foot.nominal_m, atol=1e-9)
    (trunk,) = [shape for shape in model.shapes if shape.link == "base" and shape.collides]
    np.testing.assert_allclose(trunk.origin_m, model.com_m, atol=1e-9)
    np.testing.assert_allclose(0.5 * np.array(trunk.size_m), boxes.trunk_half_m, atol=1e-9)
    assert boxes.to_json() == {
        name: value for name, value in walker.to_json().items() if name != "model"
    }
    assert [*model.guesses, *model.doubts] == ["posture to stand in, from the SRDF: standing"]
    assert {joint.torque_nm for leg in model.legs for joint in leg.joints} == {80.0}
    assert {joint.velocity_rad_s for leg in model.legs for joint in leg.joints} == {12.0}


def test_its_legs_reach_all_of_its_boxes(walker: Robot, model: RobotModel) -> None:
    """Every corner and 2,000 places inside, on level ground and on ground of up to 10°."""
    rng = np.random.default_rng(0)
    for leg, foot in zip(model.legs, walker.feet, strict=True):
        low, high = foot.reach_min_m, foot.reach_max_m
        corners = np.array([np.where(bits, high, low) for bits in np.ndindex(2, 2, 2)])
        toes = np.vstack([corners, rng.uniform(low, high, (2000, 3))])
        tilt = np.where(
            np.arange(len(toes)) % 2, 0.0, rng.uniform(0.0, np.deg2rad(10.0), len(toes))
        )
        turn = rng.uniform(0.0, 2.0 * np.pi, len(toes))
        sine = np.sin(tilt)
        normals = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), np.cos(tilt)])
        centres = toes + leg.radius_m * normals + model.com_m
        _, error = InverseKinematics([leg], [leg.random_angles(8000, rng)]).solve(centres[:, None])
        assert error.max() < 1e-4, leg.name


def test_names_say_whether_it_has_legs() -> None:
    assert named_walker("anymal").model is not None
    assert named_walker("anymal-boxes").model is None


def test_without_pinocchio_it_is_its_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walkers, "find_spec", lambda name: None)
    assert named_walker("anymal").model is None


def test_it_is_written_with_its_legs_and_read_again(walker: Robot, model: RobotModel) -> None:
    again = robot_from_json(walker.to_json())
    assert again.model is not None
    assert again.model.digest == model.digest
    other = {**anymal().to_json(), "mass_kg": 31.0}
    with refuses("anymal"):
        robot_from_json(other)


def walked(robot: Robot) -> Answer[Motion]:
    """Two seconds on level ground."""
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    return stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled", robot=robot)


def test_a_walk_of_the_boxes_is_written_and_judged_by_them(tmp_path: Path) -> None:
    found = walked(anymal())
    assert found.solution is not None
    write_motion(tmp_path / "walk.json", found.solution, check_trajectory(found.solution))
    assert "urdf" not in (tmp_path / "walk.json").read_text()
    trajectory = read_motion(tmp_path / "walk.json")[0]
    assert trajectory.robot.model is None
    report = check_file(tmp_path / "walk.json").report
    assert report.accepted
    assert report.unchecked == WHOLE_BODY
    assert trajectory.hindrance(()).startswith("robot anymal: no legs are known")


def test_a_walk_with_legs_is_the_same_walk_and_runs_in_mujoco(walker: Robot) -> None:
    pytest.importorskip("mujoco")
    from stancekit.runner.acceptance import Accepted
    from stancekit.runner.run import Runner
    from stancekit.runner.worlds.world import make_world

    boxes, found = walked(anymal()).solution, walked(walker).solution
    assert boxes is not None
    assert found is not None
    for name, array in boxes.arrays().items():
        np.testing.assert_array_equal(array, found.arrays()[name])
    report = check_trajectory(found)
    assert report.accepted
    assert set(report.unchecked).isdisjoint(WHOLE_BODY)
    accepted = Accepted.verified(found, "walk")
    with make_world("mujoco", accepted.robot) as world:
        run = Runner(world).run(accepted, accepted.plan.ground())
    assert run.succeeded, run.message
