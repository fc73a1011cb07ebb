"""Feet of robots on two legs: what their shapes are, how they stand, and plans that stand on them."""

from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.plan import Plan
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import FootContact
from stancekit.planners.robot.reach_sets import limbs_over
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import contact_robot
from stancekit.planners.verify import check_plan
from tests.planners.robot.small_urdfs import joint, link, robot, small
from tests.refusals import refuses

BOX = '<box size="0.16 0.08 0.02"/>'
CORNERS = [f"{x} {y} -0.035" for x in (-0.08, 0.08) for y in (-0.04, 0.04)]
FEET = {
    "box": [(BOX, "0 0 -0.03")],
    "balls": [('<sphere radius="0.005"/>', corner) for corner in CORNERS],
    "ankle": [(BOX, "0 0 -0.03"), ('<box size="0.3 0.3 0.01"/>', "0 0 0.01")],
    "ball": [('<sphere radius="0.03"/>', "0 0 -0.01")],
    "wheel": [('<sphere radius="0.03"/>', "0 0 0")],
}
JOINTS = (
    ("hip_roll", "1 0 0", 0.0),
    ("hip_pitch", "0 1 0", 0.0),
    ("hip_yaw", "0 0 1", 0.0),
    ("knee", "0 1 0", -0.3),
    ("heel", "0 1 0", -0.3),
    ("foot", "1 0 0", 0.0),
)


def biped(foot: str = "box", effort: float = 60.0) -> str:
    """Hips of three joints, a knee and ankles of two; thigh and shank of 0.3 m."""
    shapes = "".join(
        f'<collision><origin xyz="{at}"/><geometry>{what}</geometry></collision>'
        for what, at in FEET[foot]
    )
    parts = []
    for side, y in (("left", 0.08), ("right", -0.08)):
        before = "base"
        for name, axis, drop in JOINTS:
            low, high = (0.0, 2.2) if name == "knee" else (-1.2, 1.2)
            held = f'<limit lower="{low}" upper="{high}" effort="{effort}" velocity="8"/>'
            if foot == "wheel" and name == "foot":
                axis, held = "0 1 0", '<limit lower="-9" upper="9" effort="9" velocity="8"/>'
            place, own = f"0 {y if before == 'base' else 0} {drop}", f"{side}_{name}"
            parts += [joint(f"{own}_j", before, own, place, axis, held), small(link(own, 0.3), 0.3)]
            before = own
        parts[-1] = parts[-1].replace("</link>", f"{shapes}</link>")
    return robot(parts, "biped")


@pytest.mark.parametrize("foot", ["box", "balls", "ankle"])
def test_flat_feet_are_soles_on_which_two_alike_legs_stand_level_with_bent_knees(foot: str) -> None:
    model = model_of(biped(foot))
    left, right = model.legs
    assert left.sole is not None
    np.testing.assert_allclose(left.sole.size_m, (0.16, 0.08), atol=1e-6)
    np.testing.assert_allclose(left.nominal_m, right.nominal_m * [1.0, -1.0, 1.0], atol=1e-6)
    assert 0.5 < left.stance_rad[3] < 0.8
    level = left.chain.frames(left.stance_rad[None])[0][0, -1] @ left.sole.rotation
    np.testing.assert_allclose(level, np.eye(3), atol=1e-4)
    assert any("0.160 × 0.080 m" in remark.text for remark in model.remarks)
    with refuses("robot biped", "soles"):
        limbs_over(model, "outer")


def test_a_ball_is_no_sole_a_wheel_is_no_foot_and_a_person_says_what_else() -> None:
    assert model_of(biped("ball")).legs[0].radius_m == 0.03
    with refuses("wheel"):
        model_of(biped("wheel")).check_known()
    said = FootContact(
        point_m=np.array([0.0, 0.0, -0.04]),
        sole_m=np.array([[0.05, 0.03], [-0.05, 0.03], [-0.05, -0.03], [0.05, -0.03]]),
    )
    sole = model_of(biped("ball"), contacts={"*foot": said}).legs[0].sole
    assert sole is not None
    assert sole.size_m == pytest.approx((0.1, 0.06))
    with refuses("radius_m"):
        replace(said, radius_m=0.01)


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    ground = tmp_path_factory.mktemp("flat") / "flat.obj"
    ground.write_text("v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3 4\n")
    body = contact_robot(model_of(biped()))
    answer = stancekit.plan(ground, robot=body, start_xy_m=(0.0, 0.0), goal_xy_m=(0.2, 0.0))
    assert answer.status.value == "feasible"
    return answer.solution


def test_plans_stand_on_whole_soles_that_are_apart_and_level(walked: Plan) -> None:
    toes = walked.toes_m[walked.problem.holds]
    assert np.abs(toes[:, 0, 1] - toes[:, 1, 1]).min() >= 0.08
    tilted = np.array(walked.joints_rad)
    tilted[1, 5] += 1e-3
    report = check_plan(replace(walked, joints_rad=tilted), joints=True)
    assert report.group("joints").verdict == "violated"


def test_ankles_bear_the_moments_of_forces_at_the_corners_of_soles(walked: Plan) -> None:
    solver, course = Kinematics(walked.problem.robot), walked.problem
    stance = next(i for i, of in enumerate(course.stances) if len(of.limbs) == 1)
    (limb,), frame = course.stances[stance].limbs, course.stances[stance].frame
    moved = np.zeros_like(walked.point_forces_n)
    moved[:, :, 0] = walked.forces_n  # all of it at one corner
    plan = replace(walked, point_forces_n=moved)
    torques = solver.torques(
        plan.joints_rad[frame], np.eye(3), plan.forces_n[stance], plan.moments_nm[stance]
    )
    ankle = torques[solver.joints_of(limb)[-2:]]
    arm = plan.points_m[course.holds[frame, limb], 0] - plan.toes_m[course.holds[frame, limb]]
    np.testing.assert_allclose(
        np.abs(ankle), float(plan.forces_n[stance, limb, 2]) * np.abs(arm[:2])[[0, 1]], rtol=0.15
    )
