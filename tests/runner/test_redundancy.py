"""The choice of postures along a motion: optimal, continuous, the same at every pace, and possible
where feet go.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.joints import JointPath, path_torques, plan_angles
from stancekit.planners.motion.plan_motion import PlanMotion, Timing
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import distribute_forces
from stancekit.planners.projection.whole_body import WholeBodyLimits, whole_body
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.runner.motion.redundancy import (
    JUMP_RAD,
    LEFT,
    TURNED,
    RedundancyResolution,
    _cheapest,
)
from stancekit.runner.motion.time_parametrization import joint_profile


@pytest.fixture(scope="module")
def plan() -> Plan:
    found = TwoStagePlanner().solve(read_course("walls", frames=2)).solution
    assert found is not None
    return found


@pytest.mark.parametrize("near", [None, np.array([0.3, -0.2, 0.1, 0.4])])
def test_the_way_through_a_table_is_the_cheapest_of_all(near: Array | None) -> None:
    rng = np.random.default_rng(3)
    table = [(rng.uniform(-0.5, 0.5, (5, 4)), rng.uniform(0.0, 20.0, 5)) for _ in range(4)]

    def cost(ways: tuple[int, ...]) -> float:
        rows = [family[k] for (family, _), k in zip(table, ways, strict=True)]
        own = sum(float(costs[k]) for (_, costs), k in zip(table, ways, strict=True))
        begun = 0.0 if near is None else LEFT * float(np.sum((rows[0] - near) ** 2))
        return own + begun + TURNED * float(np.sum(np.diff(rows, axis=0) ** 2))

    best = min(product(range(5), repeat=4), key=cost)
    expected = np.array([family[k] for (family, _), k in zip(table, best, strict=True)])
    if near is not None:
        expected[0] = near
    families, costs = (np.array(each) for each in zip(*table, strict=True))
    np.testing.assert_array_equal(_cheapest((families, costs), near), expected)


def test_the_choice_is_the_same_at_every_pace(plan: Plan) -> None:
    kinematics = Kinematics(plan.problem.robot)
    fast, slow = (
        RedundancyResolution(PlanMotion(plan, Timing().at_pace(pace)), kinematics)
        for pace in (1.0, 0.5)
    )
    for time_s in np.linspace(0.0, PlanMotion(plan).duration_s, 23):
        np.testing.assert_allclose(fast.at(time_s), slow.at(2.0 * time_s), atol=1e-6)


def test_limbs_that_stand_take_the_angles_of_a_plan_that_has_some_and_so_its_torques() -> None:
    plan = TwoStagePlanner().solve(read_course("walls", frames=4)).solution
    assert plan is not None
    kinematics = Kinematics(plan.problem.robot)
    bent = whole_body(plan, WholeBodyLimits(torque_nm=10.0), kinematics)
    assert bent.plan.joints_rad is not None

    def largest(of: Plan) -> float:
        motion = PlanMotion(of, forces_n=distribute_forces(of, kinematics))
        return float(np.abs(joint_profile(motion, kinematics, rate_hz=20.0).static_nm).max())

    assert largest(bent.plan) < 1.1 * bent.after.torque_nm
    assert np.abs(path_torques(bent.plan, kinematics)).max() <= 10.0
    assert largest(replace(bent.plan, joints_rad=None)) > 1.2 * bent.after.torque_nm


def twisted(plan: Plan) -> Plan:
    """With its own angles, but for a limb that stands elsewhere at frame 1, and jumps there on the
    straight line.
    """
    joints = np.array([answer.angles for answer in plan_angles(plan)])
    joints[1, 5:7] += [-2.0, 2.0]
    return replace(plan, joints_rad=joints)


def test_a_limb_that_would_jump_between_a_plans_own_angles_is_led_round_and_stands_as_planned(
    plan: Plan,
) -> None:
    kinematics = Kinematics(plan.problem.robot)
    motion = PlanMotion(twisted(plan))
    own = JointPath(motion.path, kinematics).postures(motion.moments(motion.knots_s)).angles
    assert np.abs(np.diff(own, axis=0)).max() > JUMP_RAD
    resolution = RedundancyResolution(motion, kinematics)
    found = np.array([resolution.at(float(time_s)) for time_s in motion.knots_s])
    assert np.abs(np.diff(found, axis=0)).max() < 0.3 * JUMP_RAD
    stands = np.array([motion.at(float(time_s)).foothold for time_s in motion.knots_s]) >= 0
    held = np.repeat(stands, 4, axis=1)
    assert held.any(axis=0).all()
    np.testing.assert_allclose(found[held], own[held], atol=1e-9)


def test_a_swing_by_way_of_comfortable_postures_ends_in_the_plans_own(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "stancekit.planners.motion.joints.STRAY_M", -1.0
    )  # as if no limb followed its foot's path
    kinematics, motion = Kinematics(plan.problem.robot), PlanMotion(twisted(plan))
    path = JointPath(motion.path, kinematics)
    moments = motion.moments(motion.knots_s)
    angles = path.postures(moments).angles
    assert path.corners
    for (step, limb), corners in path.corners.items():
        assert corners.shape == (2, 4)
        landed = np.flatnonzero((moments.step == step) & (moments.part == 2))[-1]
        turned = angles[landed + 1] - angles[landed]
        assert np.abs(turned[kinematics.joints_of(limb)]).max() < 0.05


def test_a_robot_that_is_somewhere_goes_on_from_there(plan: Plan) -> None:
    robot = plan.problem.robot
    motion, kinematics = PlanMotion(plan), Kinematics(robot)
    alone = RedundancyResolution(motion, kinematics).at(0.0)
    other = alone.copy()
    other[0] -= 1.5  # of the left front limb: its knee elsewhere
    feet = kinematics.feet(alone)
    near, error = kinematics.reach(feet, other, other)
    assert error.max() < 1e-4
    assert np.abs(near - alone).max() > 0.3, "another posture of the same feet"
    first = joint_profile(motion, Kinematics(robot, near_rad=near)).angles_rad[0]
    assert np.abs(first - near).max() < 0.15


@pytest.mark.parametrize("index", [2, 3, 4])
def test_courses_on_which_joints_once_jumped_or_feet_stayed_behind_are_walked_smoothly(
    index: int,
) -> None:
    course = perturbed("walls", np.random.default_rng([0, index]), frames=3)
    plan = TwoStagePlanner().solve(course).solution
    assert plan is not None
    seen = joint_profile(PlanMotion(plan), Kinematics(course.robot))
    assert seen.error_m.max() < 1e-5
    assert np.abs(seen.acceleration_rad_s2).max() < 60.0
