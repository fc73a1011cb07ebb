"""Joints and spared joints: angles that reach, forces that are the best for the weakest joint by
another model; whole plans that are bent to torque limits, and never to worse ones.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np
import pytest

from stancekit import Group, Motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import ForceDistribution
from stancekit.planners.projection.whole_body import (
    EASY,
    WholeBodyLimits,
    largest,
    whole_body,
    with_joints,
)
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.postures import joint_groups
from tests.planners.robot.small_urdfs import quadruped

pytest.importorskip("pinocchio")
from stancekit.planners.robot.bodies import TOUCH_M
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from tests.refusals import assert_names, refuses


@pytest.fixture
def plan(dog_plan: Motion) -> Motion:
    return dog_plan


@pytest.fixture
def with_effort(plan: Motion) -> Callable[[float], Motion]:
    """The plan for the same robot with other torque limits."""

    def make(effort: float) -> Motion:
        robot = replace(plan.problem.robot, model=model_of(quadruped(effort=effort)))
        return replace(plan, problem=replace(plan.problem, robot=robot))

    return make


def largest_share(plan: Motion) -> float:
    return float(check_plan(plan, joints=True).group("torque").figures["share"])


def test_forces_that_ask_little_stay_as_they_are(with_effort: Callable[[float], Motion]) -> None:
    plan = with_effort(60.0)
    jointed = with_joints(plan)
    assert largest_share(jointed) <= EASY
    np.testing.assert_array_equal(jointed.forces_n, plan.forces_n)
    _, *groups = joint_groups(jointed)
    assert groups[0].value < 1e-6
    assert [group.verdict for group in groups] == ["holds", "holds"]


def torque_nm(plan: Motion) -> float:
    """The largest torque that a plan asks of a joint."""
    *_, torque = joint_groups(plan)
    return float(torque.figures["torque_nm"])


def test_other_forces_spare_a_joint_that_has_too_little(
    plan: Motion, with_effort: Callable[[float], Motion]
) -> None:
    weak = with_effort(0.9 * torque_nm(plan))
    own = replace(weak, joints_rad=with_joints(weak).joints_rad)
    refused = check_plan(own, joints=True)
    assert refused.contacts
    assert not refused.accepted
    assert refused.group("torque").verdict == "violated"
    spared = with_joints(weak)
    accepted = check_plan(spared, joints=True)
    assert accepted.accepted
    assert accepted.group("torque").figures["share"] <= 1.0
    np.testing.assert_array_equal(spared.com_m, plan.com_m)
    np.testing.assert_array_equal(spared.toes_m, plan.toes_m)


def test_without_limits_the_largest_torque_is_the_one_with_the_most_nm(
    with_effort: Callable[[float], Motion],
) -> None:
    plan = replace(with_effort(60.0), joints_rad=with_joints(with_effort(60.0)).joints_rad)
    solver = Kinematics(plan.problem.robot)
    unlimited = largest(plan, solver, np.full_like(solver.torque_nm, np.inf))
    assert unlimited == (0.0, pytest.approx(torque_nm(plan)))


def test_what_no_forces_can_spare_stays_refused(with_effort: Callable[[float], Motion]) -> None:
    report = check_plan(with_joints(with_effort(5.0)), joints=True)
    assert report.contacts
    assert not report.accepted
    assert report.group("torque").verdict == "violated"
    assert_names(report.group("torque").message, "Nm", "5")


def test_the_largest_torque_is_the_least_that_forces_can_have(plan: Motion) -> None:
    course, stance = plan.problem, 0
    of = course.stances[stance]
    solver = Kinematics(course.robot)
    angles = with_joints(plan).joints_rad
    assert angles is not None
    weight, levers = solver.loads(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]))
    patches = [course.patch(int(p), plan.choice) for p in course.holds[of.frame]]
    arms = plan.toes_at(of.frame) - plan.com_m[of.frame]
    found = ForceDistribution(4, solver.legs.tolist()).forces(
        course,
        arms,
        patches,
        np.isin(np.arange(4), of.limbs),
        reserves=(0.8,),
        least=0.0,
        loads=(weight, levers, solver.torque_nm),
    )
    assert found is not None
    mine = np.abs(
        solver.torques(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]), found)
    ).max()

    forces, most = cp.Variable((4, 3)), cp.Variable()
    rows = [cp.sum(forces, axis=0) == [0.0, 0.0, course.weight_n]]
    rows.append(sum(np.cross(np.eye(3), arm) @ forces[i] for i, arm in enumerate(arms)) == 0)
    for i, patch in enumerate(patches):
        n = patch.normal
        rows.append(
            cp.norm((np.eye(3) - np.outer(n, n)) @ forces[i])
            <= 0.8 * patch.friction * (n @ forces[i])
        )
        rows.append(forces[i] == 0 if i not in of.limbs else n @ forces[i] >= 0)
    for j, leg in enumerate(solver.legs):
        rows.append(cp.abs(weight[j] - levers[j] @ forces[leg]) <= most)
    best = float(cp.Problem(cp.Minimize(most), rows).solve(solver=cp.CLARABEL))
    assert mine == pytest.approx(best, rel=2e-3)
    assert (
        mine
        < np.abs(
            solver.torques(
                angles[of.frame], rotation_of(plan.rotation_rad[of.frame]), plan.forces_n[stance]
            )
        ).max()
    )


def test_torques_of_loads_are_the_torques(plan: Motion) -> None:
    solver, rng = Kinematics(plan.problem.robot), np.random.default_rng(0)
    angles, turn, forces = (
        rng.uniform(-0.5, 0.5, 12),
        rotation_of([0.1, -0.2, 0.3]),
        rng.normal(size=(4, 3)),
    )
    weight, levers = solver.loads(angles, turn)
    by_hand = [weight[j] - levers[j] @ forces[j // 3] for j in range(12)]
    np.testing.assert_allclose(solver.torques(angles, turn, forces), by_hand, atol=1e-12)


def test_a_plan_of_drawn_up_legs_gets_joints_too(tmp_path: Path) -> None:
    outcome = TwoStage().solve(read_course("stairs", frames=2))
    assert outcome.solution is not None
    jointed = with_joints(outcome.solution)
    assert jointed.joints_rad is not None
    assert jointed.joints_rad.shape == (2, 24)
    assert check_plan(jointed, joints=True).accepted


@pytest.fixture(scope="module")
def climb() -> Motion:
    """Between walls; its largest torque is 20 Nm."""
    outcome = plan_with_reserve(TwoStage(), read_course("walls"))
    assert outcome.solution is not None
    return outcome.solution


def test_a_climb_is_bent_to_what_its_servos_have(climb: Motion) -> None:
    limits = WholeBodyLimits(torque_nm=10.0)
    assert torque_nm(climb) > 15.0
    assert torque_nm(with_joints(climb)) > 15.0  # forces alone do not do
    bent = whole_body(climb, limits)
    report = check_plan(bent.plan, joints=True)
    assert report.accepted, report.message
    assert report.group("torque").figures["torque_nm"] <= 9.0 + 1e-9  # the default share
    assert bent.before.torque_nm == pytest.approx(torque_nm(climb), rel=1e-6)
    assert bent.share == pytest.approx(report.group("torque").figures["share"], rel=1e-9)
    assert bent.torque_nm == pytest.approx(report.group("torque").figures["torque_nm"], rel=1e-9)
    assert bent.depth_m <= TOUCH_M
    assert 1 <= bent.steps <= 6
    assert bent.plan.provenance["friction_share"] == climb.provenance["friction_share"]
    np.testing.assert_array_equal(bent.plan.choice, climb.choice)


def test_a_quadruped_is_bent_to_less_than_its_forces_alone_allow(plan: Motion) -> None:
    spared = whole_body(plan, WholeBodyLimits(torque_nm=17.5, steps=0))
    bent = whole_body(plan, WholeBodyLimits(torque_nm=17.5))
    assert spared.share > 1.3
    assert 0.5 < bent.share <= 0.9
    assert check_plan(bent.plan, joints=True).accepted


@pytest.mark.parametrize("torque_nm", [4.0, 8.0, 14.0, 30.0])
def test_what_comes_is_accepted_and_never_worse(climb: Motion, torque_nm: float) -> None:
    limits = WholeBodyLimits(torque_nm=torque_nm, steps=4)
    bent = whole_body(climb, limits)
    solver = Kinematics(climb.problem.robot)
    assert check_plan(bent.plan).accepted
    assert bent.before is None or bent.better(bent.before)
    assert (bent.share, bent.torque_nm) == largest(bent.plan, solver, limits.of(solver))
    _, joints, torque = joint_groups(bent.plan)  # the plan says what it was made within
    assert torque.value == pytest.approx(bent.share)
    assert [joints.verdict, torque.verdict] == [
        "holds",
        "holds" if bent.share <= 1.0 else "violated",
    ]
    if (bent.before or bent).share <= EASY:
        np.testing.assert_array_equal(bent.plan.forces_n, climb.forces_n)


def test_a_result_that_the_verifier_refuses_is_none(
    climb: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = staticmethod(lambda name: Group(name))
    refused = type(
        "Refused", (), {"accepted": False, "contacts": False, "late": False, "group": nothing}
    )()
    asked = list[Motion]()

    def check(plan: Motion, **options: Any) -> Any:
        """Only the plan as it came is accepted."""
        asked.append(plan)
        return refused if asked[1:] else check_plan(plan, **options)

    monkeypatch.setattr("stancekit.planners.projection.whole_body.check_plan", check)
    bent = whole_body(climb, WholeBodyLimits(torque_nm=10.0, steps=2))
    assert len(asked) > 1
    assert (bent.steps, bent.before) == (0, None)
    for name in ("com_m", "rotation_rad", "toes_m", "forces_n"):
        np.testing.assert_array_equal(getattr(bent.plan, name), getattr(climb, name))


def test_it_is_the_same_twice(climb: Motion) -> None:
    first, second = (whole_body(climb, WholeBodyLimits(torque_nm=12.0)) for _ in range(2))
    assert first.steps == second.steps
    for name in ("com_m", "rotation_rad", "toes_m", "forces_n", "joints_rad"):
        np.testing.assert_array_equal(getattr(first.plan, name), getattr(second.plan, name))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"torque_nm": 0.0}, "torque_nm"),
        ({"share": 0.0}, "torque_share"),
        ({"share": 1.5}, "torque_share"),
        ({"steps": -1}, "steps"),
        ({"deepest_m": -0.01}, "deepest_m"),
    ],
)
def test_limits_that_make_no_sense_are_refused(given: dict[str, float], message: str) -> None:
    with refuses(message):
        WholeBodyLimits(**given)  # type: ignore[arg-type]
