"""Contact planning for a robot's file: inner and outer sets, a climb that its own legs reach, and
what is refused.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.errors import InvalidInput
from stancekit.planners.motion.joints import plan_angles
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import whole_body
from stancekit.planners.robot.reach_sets import standing_toes, workspaces_of
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import contact_robot
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

pin = pytest.importorskip("pinocchio")

COURSE = """
name: step
robot: dog.urdf
frames: 10
gait: wave
start_m: [0.0, 0.0, 0.44]
goal_m: [0.3, 0.0, 0.45]
body: {com_radius_m: 0.05, first_radius_m: 0.03}
steps: {com_m: 0.12, toe_m: 0.4}
candidates: {window_m: 0.2}
terrain: {kind: stairs, friction: 0.7, first_m: 0.42, run_m: 3.0, rises_m: [0.05]}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("course")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "step.yaml").write_text(COURSE)
    return folder


@pytest.fixture
def plan(folder: Path) -> Motion:
    outcome = TwoStage().solve(read_course(folder / "step.yaml"))
    assert outcome.solution is not None, outcome.message
    return outcome.solution


def test_inner_sets_are_reached(folder: Path) -> None:
    model = named_robot(folder / "dog.urdf")
    inner = contact_robot(model)
    assert (inner.limb_names, inner.mass_kg) == (model.leg_names, model.mass_kg)
    rng = np.random.default_rng(0)
    for leg, within in zip(model.legs, inner.limbs, strict=True):
        away = rng.normal(size=(20_000, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        workspace = workspaces_of(model)[model.leg_names.index(leg.name)]
        points = workspace.inner.sample(20_000, rng) - model.com_m
        assert within.reach_rows is not None
        held = np.all(points @ within.reach_rows.normals.T <= within.reach_rows.bounds_m, axis=1)
        assert 0.5 < held.mean() < 1.0
        assert np.all(np.linalg.norm(points - within.shoulder_m, axis=1) <= within.reach_m)
        feet = (
            points[held] + leg.radius_m * away[: held.sum()] + model.com_m
        )  # whatever way the surface looks
        assert np.all(workspace.inner.contains(feet))


def test_a_plan_over_a_step_is_reached_by_the_urdf_itself(folder: Path, plan: Motion) -> None:
    bent = whole_body(plan).plan  # clear of the step on the way, too
    assert check_plan(bent, joints=True).accepted
    plan = bent
    model = plan.problem.robot.model
    assert model is not None
    assert plan.joints_rad is not None
    assert plan.joints_rad.shape == (10, 12)
    columns = {name: plan.joints_rad[:, i] for i, name in enumerate(model.joint_names)}
    known = pin.buildModelFromXML(model.urdf)
    data = known.createData()
    for k in range(plan.problem.frames):
        q = pin.neutral(known)
        for leg in model.legs:
            angles = np.array([columns[name][k] for name in leg.joint_names])
            assert np.all((angles >= leg.lower_rad) & (angles <= leg.upper_rad))
            for name, angle in zip(leg.joint_names, angles, strict=True):
                q[known.joints[known.getJointId(name)].idx_q] = angle
        pin.framesForwardKinematics(known, data, q)
        turn = pin.exp3(plan.rotation_rad[k])
        for i, leg in enumerate(model.legs):
            foot = data.oMf[known.getFrameId(leg.foot)].translation
            centre = plan.com_m[k] + turn @ (foot - model.com_m)
            normal = plan.problem.patch(int(plan.problem.holds[k][i]), plan.choice).normal
            np.testing.assert_allclose(
                centre - leg.radius_m * normal, plan.toes_at(k)[i], atol=1e-4
            )


def test_toes_stand_where_the_model_stands_unless_the_course_says_otherwise(folder: Path) -> None:
    model = named_robot(folder / "dog.urdf")
    course = read_course(folder / "step.yaml")
    first = [foothold for foothold in course.footholds if foothold.frame == 0]
    toes = standing_toes(model)
    for index, foothold in enumerate(first):
        leg, corners = model.leg_names.index(foothold.limb), foothold.candidates[0].vertices_m
        here = course.com_nominal_m[course.holds[:, leg] == index].mean(
            axis=0
        )  # of the body while it stands there
        wanted = np.minimum((here + toes[leg])[:2], [0.42, np.inf])  # where the step begins
        assert np.all(corners[:, :2].min(axis=0) - 1e-9 <= wanted)
        assert np.all(
            wanted - 0.04 <= corners[:, :2].max(axis=0)
        )  # as far as a riser keeps it away


def test_toes_keep_as_far_from_a_riser_as_their_feet_roll_unless_all_that_they_reach_is_asked_for(
    folder: Path,
) -> None:
    radius_m = named_robot(folder / "dog.urdf").legs[0].radius_m
    (folder / "all.yaml").write_text(COURSE.replace("{window_m: 0.2}", "{everywhere: true}"))
    (folder / "near.yaml").write_text(
        COURSE.replace("{window_m: 0.2}", "{window_m: 0.2, margin_m: 0.005}")
    )
    for name, margin_m in (
        ("step", 1.6 * radius_m + 0.002),
        ("all", max(radius_m + 0.002, 0.02)),
        ("near", 0.005),
    ):
        corners = np.concatenate(
            [
                patch.vertices_m
                for foothold in read_course(folder / f"{name}.yaml").footholds
                for patch in foothold.candidates
            ]
        )
        assert np.abs(corners[:, 0] - 0.42).min() == pytest.approx(margin_m, abs=1e-9), name


def test_a_body_keeps_to_its_path_where_the_robot_has_a_file_and_the_course_does_not_say_otherwise(
    folder: Path,
) -> None:
    course = read_course(folder / "step.yaml")
    (folder / "loose.yaml").write_text(f"{COURSE}weights: {{com_path: 0.0}}\n")
    loose = read_course(folder / "loose.yaml")
    assert (
        course.weights.com_path,
        loose.weights.com_path,
        read_course("walls").weights.com_path,
    ) == (0.1, 0.0, 0.0)
    assert (course.weights.stance, loose.weights.stance, read_course("walls").weights.stance) == (
        0.3,
        0.3,
        0.0,
    )
    pulled = [
        replace(course, weights=replace(course.weights, stance=0.0, com_path=pull))
        for pull in (0.0, 10.0)
    ]
    far, near = (TwoStage(gap=0.05).solve(each).solution for each in pulled)
    assert near is not None
    assert far is not None
    off_m = [
        np.linalg.norm(each.com_m - each.problem.com_nominal_m, axis=1).mean()
        for each in (near, far)
    ]
    assert off_m[0] < 0.8 * off_m[1]


@pytest.mark.parametrize(("x_m", "raised"), [(0.0, 0.0), (0.45, 0.5), (2.0, 1.0)])
def test_a_start_without_a_height_stands_on_the_terrain_there(
    folder: Path, x_m: float, raised: float
) -> None:
    model = named_robot(folder / "dog.urdf")
    text = COURSE.replace("[0.0, 0.0, 0.44]", f"[{x_m}, 0.0]").replace(
        "[0.3, 0.0, 0.45]", f"[{x_m + 0.3}, 0, 0.5]"
    )
    (folder / "start.yaml").write_text(text)
    course = read_course(folder / "start.yaml")
    expected = [
        x_m,
        0.0,
        model.stand_height_m + 0.05 * raised,
    ]  # so many of the feet are on the step
    np.testing.assert_allclose(course.com_nominal_m[0], expected, atol=1e-9)


def test_a_start_without_ground_under_a_foot_is_refused(folder: Path) -> None:
    corners = "[[-2, 0, 0], [2, 0, 0], [2, 2, 0], [-2, 2, 0]]"
    text = COURSE.replace("[0.0, 0.0, 0.44]", "[0.0, 0.0]").split("terrain:")[0]
    (folder / "half.yaml").write_text(
        f"{text}terrain: {{kind: polygons, polygons: [{{vertices_m: {corners}}}]}}\n"
    )
    with refuses(f"{folder}/half.yaml", "start_m"):
        read_course(folder / "half.yaml")


def test_another_robot_may_take_the_courses_place(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "cat.yaml").write_text(f"urdf: {folder}/dog.urdf\nname: cat\n")
    robot = read_course(folder / "step.yaml", robot=str(tmp_path / "cat.yaml")).robot
    assert robot.model is not None
    assert robot.name == robot.model.name == "cat"
    assert read_course("walls").robot.model is None


def test_angles_of_shorter_legs_are_the_nearest_ones(plan: Motion) -> None:
    robot = plan.problem.robot
    short = model_of(quadruped().replace('xyz="0 0 -.3"', 'xyz="0 0 -.02"'))
    postures, error, _ = plan_angles(
        replace(plan, problem=replace(plan.problem, robot=replace(robot, model=short)))
    )
    assert error.min() > 0.03
    for angles in postures:
        for i, leg in enumerate(short.legs):
            q = angles[3 * i : 3 * i + 3]
            assert np.all((q >= leg.lower_rad) & (q <= leg.upper_rad))


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        ("centipede.yaml", "robot: {0}/centipede.yaml: expected a file, found nothing there"),
        ("none.urdf", "robot: {0}/none.urdf: expected a file, found nothing there"),
    ],
)
def test_a_course_whose_robot_cannot_be_had_is_refused(
    folder: Path, robot: str, message: str
) -> None:
    (folder / "bad.yaml").write_text(COURSE.replace("dog.urdf", robot))
    with pytest.raises(InvalidInput) as caught:
        read_course(folder / "bad.yaml")
    assert str(caught.value) == f"{folder}/bad.yaml: {message.format(folder)}"
