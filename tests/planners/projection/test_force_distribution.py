"""Forces distributed with a reserve of friction: balance, cones, and the least of all, by a model
written again.
"""

from collections.abc import Callable
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.projection.force_distribution import (
    LEAST,
    RESERVES,
    ForceDistribution,
    distribute_forces,
)
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.verify import check_plan


@pytest.fixture(scope="module")
def climb(course_plan: Callable[[str, int], Motion]) -> Motion:
    return course_plan("walls", 3)


def test_distributed_forces_balance_and_stay_within_the_cones_with_a_reserve(climb: Motion) -> None:
    course, forces = climb.problem, distribute_forces(climb)
    assert forces.shape == climb.forces_n.shape
    for stance, of in zip(forces, course.stances, strict=True):
        arms = climb.toes_at(of.frame) - climb.com_m[of.frame]
        np.testing.assert_allclose(stance.sum(axis=0), [0.0, 0.0, course.weight_n], atol=1e-4)
        np.testing.assert_allclose(np.cross(arms, stance).sum(axis=0), 0.0, atol=1e-4)
        for limb in range(6):
            if limb not in of.limbs:
                assert not stance[limb].any()
                continue
            patch = course.patch(int(course.holds[of.frame, limb]), climb.choice)
            normal = float(stance[limb] @ patch.normal)
            assert normal >= LEAST * course.weight_n - 1e-4
            assert (
                np.linalg.norm(stance[limb] - normal * patch.normal)
                <= RESERVES[-1] * patch.friction * normal + 1e-4
            )


def test_the_plan_with_distributed_forces_is_one_that_the_verifier_accepts(climb: Motion) -> None:
    assert check_plan(replace(climb, forces_n=distribute_forces(climb))).accepted


def test_they_are_the_least_for_their_reserve(climb: Motion) -> None:
    course, stance = climb.problem, 0
    of = course.stances[stance]
    found = ForceDistribution(6).solve(climb, stance)
    assert found is not None
    forces = cp.Variable((len(of.limbs), 3))
    arms = climb.toes_at(of.frame)[list(of.limbs)] - climb.com_m[of.frame]
    rows = [cp.sum(forces, axis=0) == [0.0, 0.0, course.weight_n]]
    moment = sum(np.cross(np.eye(3), arm) @ forces[i] for i, arm in enumerate(arms))
    rows.append(moment == 0)
    for i, limb in enumerate(of.limbs):
        patch = course.patch(int(course.holds[of.frame, limb]), climb.choice)
        n = patch.normal
        rows.append(
            cp.norm((np.eye(3) - np.outer(n, n)) @ forces[i])
            <= RESERVES[0] * patch.friction * (n @ forces[i])
        )
        rows += [n @ forces[i] >= LEAST * course.weight_n, n @ forces[i] <= course.weight_n]
    best = cp.Problem(cp.Minimize(cp.sum_squares(forces)), rows).solve(solver=cp.CLARABEL)
    assert float(np.sum(found**2)) == pytest.approx(float(best), rel=1e-5)


def test_where_the_cones_leave_no_room_there_is_none_and_the_plan_keeps_its_own(
    climb: Motion,
) -> None:
    icy = replace(climb, problem=slippery(climb.problem, 0.01))
    assert ForceDistribution(6).solve(icy, 0) is None
    np.testing.assert_array_equal(distribute_forces(icy), climb.forces_n)


def test_forces_of_any_limbs_that_bear_balance_within_the_reserve(climb: Motion) -> None:
    course, frame = climb.problem, 1
    patches = [course.patch(int(p), climb.choice) for p in course.holds[frame]]
    arms = climb.toes_at(frame) - climb.com_m[frame]
    bears = np.array([True, True, True, True, True, False])
    forces = ForceDistribution(6).forces(course, arms, patches, bears)
    assert forces is not None
    assert not forces[5].any()
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, course.weight_n], atol=1e-4)
    np.testing.assert_allclose(np.cross(arms, forces).sum(axis=0), 0.0, atol=1e-4)
    for force, patch in zip(forces[:5], patches, strict=False):
        normal = float(force @ patch.normal)
        assert (
            np.linalg.norm(force - normal * patch.normal)
            <= RESERVES[0] * patch.friction * normal + 1e-4
        )
