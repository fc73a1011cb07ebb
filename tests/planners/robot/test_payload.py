"""A robot with a payload: heavier by what was asked for, on its body, and read so by whoever reads
its URDF.
"""

from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.formats.motion_file import check_file, write_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.robot_file import ModelJson, model_from_json, model_to_json
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import with_mass
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

pytest.importorskip("pinocchio")


def test_the_body_has_the_difference_and_the_centre_of_mass_is_the_weighted_mean() -> None:
    plain = model_of(quadruped())
    loaded = with_mass(plain, plain.mass_kg + 6.0)
    assert loaded.mass_kg == pytest.approx(plain.mass_kg + 6.0)
    # the payload is at the trunk's own centre of mass, its origin
    expected = plain.mass_kg * plain.com_m / loaded.mass_kg
    assert loaded.com_m == pytest.approx(expected, abs=1e-9)
    assert loaded.digest != plain.digest
    assert loaded.leg_names == plain.leg_names
    for one, other in zip(loaded.legs, plain.legs, strict=True):
        assert one.stance_rad == pytest.approx(other.stance_rad)
    again = model_from_json(ModelJson(**model_to_json(loaded)), loaded.name)
    assert again.mass_kg == pytest.approx(loaded.mass_kg)


@pytest.mark.parametrize("mass_kg", [0.0, 1.0])
def test_what_the_legs_alone_weigh_is_no_mass_of_a_robot(mass_kg: float) -> None:
    with refuses("mass_kg"):
        with_mass(model_of(quadruped()), mass_kg)


def test_a_course_says_the_mass_of_its_robots_file_and_its_plan_is_read_again(
    tmp_path: Path,
) -> None:
    (tmp_path / "robot.urdf").write_text(quadruped())
    plain = model_of(quadruped())
    mass = plain.mass_kg + 3.0
    height = plain.stand_height_m
    (tmp_path / "course.yaml").write_text(
        f"{{name: load, robot: robot.urdf, mass_kg: {mass}, frames: 3, gait: wave, start_m: [0, 0, {height}], "
        f"goal_m: [0.05, 0, {height}], steps: {{com_m: 0.12, toe_m: 0.3}}, terrain: {{kind: flat, friction: 0.8}}}}"
    )
    course = read_course(tmp_path / "course.yaml")
    assert course.weight_n == pytest.approx(9.81 * mass)
    plan = TwoStage().solve(course).solution
    assert plan is not None
    carried = plan.forces_n.sum(axis=1)
    assert carried == pytest.approx(np.tile([0.0, 0.0, 9.81 * mass], (len(carried), 1)), abs=1e-3)
    write_motion(tmp_path / "plan.json", plan, check_plan(plan))
    assert check_file(tmp_path / "plan.json", joints=False).accepted
