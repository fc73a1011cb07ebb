"""Joints and spared joints: angles that reach, forces that are the best for the weakest joint by another model."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import ForceDistribution, Loads
from stancekit.planners.projection.whole_body import EASY, with_joints
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.joints import joint_report
from tests.planners.robot.small_urdfs import quadruped

pytest.importorskip("pinocchio")
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

COURSE = """
name: flat
robot: dog.urdf
frames: 5
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.2, 0.0, 0.45]
steps: {com_m: 0.12, toe_m: 0.4}
terrain: {kind: flat, friction: 0.7}
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    folder = tmp_path_factory.mktemp("course")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(COURSE)
    outcome = plan_with_reserve(TwoStageCoursePlanner(), read_course(folder / "flat.yaml"))
    assert outcome.plan is not None
    return outcome.plan


@pytest.fixture
def with_effort(plan: Plan) -> Callable[[float], Plan]:
    """The plan for the same robot with other torque limits."""

    def make(effort: float) -> Plan:
        robot = replace(plan.course.robot, model=model_of(quadruped(effort=effort)))
        return replace(plan, course=replace(plan.course, robot=robot))

    return make


def largest_share(plan: Plan) -> float:
    return float(check_plan(plan, joints=True).torque["share"])


def test_forces_that_ask_little_stay_as_they_are(with_effort: Callable[[float], Plan]) -> None:
    plan = with_effort(60.0)
    jointed = with_joints(plan)
    assert largest_share(jointed) <= EASY
    np.testing.assert_array_equal(jointed.forces_n, plan.forces_n)
    report = joint_report(jointed)
    assert report.error_m.max() < 1e-6
    assert report.accepted


def test_other_forces_spare_a_joint_that_has_too_little(plan: Plan, with_effort: Callable[[float], Plan]) -> None:
    weak = with_effort(0.9 * joint_report(plan).torque_nm.max())
    own = replace(weak, joints_rad=with_joints(weak).joints_rad)
    refused = check_plan(own, joints=True)
    assert refused.contacts
    assert not refused.accepted
    assert refused.message == "rejected: contacts hold, the joints cannot do it"
    assert refused.torque["verdict"] == "failed"
    spared = with_joints(weak)
    accepted = check_plan(spared, joints=True)
    assert accepted.accepted
    assert accepted.torque["share"] <= 1.0
    np.testing.assert_array_equal(spared.com_m, plan.com_m)
    np.testing.assert_array_equal(spared.toes_m, plan.toes_m)


def test_what_no_forces_can_spare_stays_refused(with_effort: Callable[[float], Plan]) -> None:
    report = check_plan(with_joints(with_effort(5.0)), joints=True)
    assert report.contacts
    assert not report.accepted
    assert "Nm in a joint, where " in report.torque["message"]
    assert report.torque["message"].endswith(" has 5")


def test_the_largest_torque_is_the_least_that_forces_can_have(plan: Plan) -> None:
    course, stance = plan.course, 0
    of = course.stances[stance]
    solver = Kinematics(course.robot)
    angles = with_joints(plan).joints_rad
    assert angles is not None
    weight, levers = solver.loads(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]))
    patches = [course.patch(int(p), plan.choice) for p in course.holds[of.frame]]
    arms = plan.toes_at(of.frame) - plan.com_m[of.frame]
    found = ForceDistribution(4, solver.legs.tolist()).forces(
        course, arms, patches, np.isin(np.arange(4), of.limbs), reserves=(0.8,), least=0.0,
        loads=Loads(weight_nm=weight, levers_m=levers, limit_nm=solver.torque_nm),
    )  # fmt: skip
    assert found is not None
    mine = np.abs(solver.torques(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]), found)).max()

    forces, most = cp.Variable((4, 3)), cp.Variable()
    rows = [cp.sum(forces, axis=0) == [0.0, 0.0, course.weight_n]]
    rows.append(sum(np.cross(np.eye(3), arm) @ forces[i] for i, arm in enumerate(arms)) == 0)
    for i, patch in enumerate(patches):
        n = patch.normal
        rows.append(cp.norm((np.eye(3) - np.outer(n, n)) @ forces[i]) <= 0.8 * patch.friction * (n @ forces[i]))
        rows.append(forces[i] == 0 if i not in of.limbs else n @ forces[i] >= 0)
    for j, leg in enumerate(solver.legs):
        rows.append(cp.abs(weight[j] - levers[j] @ forces[leg]) <= most)
    best = float(cp.Problem(cp.Minimize(most), rows).solve(solver=cp.CLARABEL))
    assert mine == pytest.approx(best, rel=2e-3)
    assert mine < np.abs(solver.torques(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]),
                                        plan.forces_n[stance])).max()  # fmt: skip


def test_torques_of_loads_are_the_torques(plan: Plan) -> None:
    solver, rng = Kinematics(plan.course.robot), np.random.default_rng(0)
    angles, turn, forces = rng.uniform(-0.5, 0.5, 12), rotation_of([0.1, -0.2, 0.3]), rng.normal(size=(4, 3))
    weight, levers = solver.loads(angles, turn)
    by_hand = [weight[j] - levers[j] @ forces[j // 3] for j in range(12)]
    np.testing.assert_allclose(solver.torques(angles, turn, forces), by_hand, atol=1e-12)


def test_a_plan_of_drawn_up_legs_gets_joints_too(tmp_path: Path) -> None:
    outcome = TwoStageCoursePlanner().solve(read_course("stairs", frames=2))
    assert outcome.plan is not None
    jointed = with_joints(outcome.plan)
    assert jointed.joints_rad is not None
    assert jointed.joints_rad.shape == (2, 24)
    assert check_plan(jointed, joints=True).accepted
