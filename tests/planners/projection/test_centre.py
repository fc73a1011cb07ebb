"""The middle of what held toes leave: on the balances, inside, stationary, the same from anywhere
and as cvxpy's.
"""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.scaled import skew
from stancekit.planners.projection.centre import _without, centred
from stancekit.planners.search.witness import witnesses
from stancekit.planners.terrain.polygon import surface_patch
from stancekit.planners.verify import check_plan

NAMES = pytest.mark.parametrize("name", list(DISTRIBUTIONS))


def drawn(name, count=60, *, moments=True):
    """Problems, points on the balances and inside, and the problems' batch."""
    batch = distribution(name).batch(np.random.default_rng(5), count)
    scaled = ScaledBatch.of(batch)
    index, points = witnesses(scaled, 320, moments=moments)
    return batch.select(index), scaled.select(index), points


def as_in_the_docstring(scaled, k, points, *, moments):
    """The program in cvxpy, a problem at a time."""
    like, toes, count = scaled.like, points.toes[k], points.toes.shape[1]
    com, turn, forces, rest = (
        cp.Variable(3),
        cp.Variable(3),
        cp.Variable((count, 3)),
        cp.Variable(count),
    )
    rows: list[cp.Constraint] = []
    legs = [
        toes[i] - com - like.shoulders[i] + skew(like.shoulders[i]) @ turn for i in range(count)
    ]
    room = cp.Variable(count + 1)
    rows += [cp.sum_squares(legs[i]) <= like.reach[i] ** 2 - room[i] for i in range(count)]
    rows += [cp.sum_squares(com - like.com[0]) <= float(like.com_radius[0]) ** 2 - room[count]]
    logs = [cp.log(room)]
    logs += [cp.log(like.tilt - turn[i]) + cp.log(like.tilt + turn[i]) for i in range(3)]
    for i in range(count):
        grip, shear = float(scaled.friction[k, i]) * forces[i, 0], forces[i, 1:]
        rows += [
            cp.quad_over_lin(shear, grip) <= grip - rest[i]
        ]  # log(g² − ‖s‖²) = log g + log(g − ‖s‖²/g)
        logs += [cp.log(grip) + cp.log(rest[i])]
        logs += [
            cp.sum(cp.log(forces[i] - like.force_min[i]) + cp.log(like.force_max[i] - forces[i]))
        ]
    world = [scaled.frames[k, i] @ forces[i] for i in range(count)]
    rows += [sum(world) == np.array([0.0, 0.0, like.weight])]
    if moments:
        net = sum(skew(toes[i]) @ world[i] for i in range(count))
        rows += [
            net
            == like.weight * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) @ com
        ]
    problem = cp.Problem(cp.Maximize(sum(cp.sum(log) for log in logs)), rows)
    problem.solve(solver=cp.CLARABEL)
    return com.value, turn.value, forces.value


@NAMES
@pytest.mark.parametrize("moments", [True, False])
def test_it_is_the_optimum_that_another_solver_finds(name, moments):
    _, scaled, points = drawn(name, 12, moments=moments)
    found = centred(scaled, points, moments=moments)
    assert len(points) >= 4
    for k in range(4):
        com, turn, forces = as_in_the_docstring(scaled, k, points, moments=moments)
        np.testing.assert_allclose(found.com[k], com, atol=2e-4)
        np.testing.assert_allclose(found.rotation[k], turn, atol=2e-4)
        np.testing.assert_allclose(found.forces[k], forces, atol=2e-4)


@NAMES
def test_it_does_not_depend_on_where_it_is_sought_from(name):
    _, scaled, points = drawn(name)
    found = centred(scaled, points)
    for share in (0.5, 0.98):
        parts = {
            part: share * getattr(points, part) + (1.0 - share) * getattr(found, part)
            for part in ("com", "rotation", "forces")
        }
        again = centred(scaled, replace(points, **parts))
        for part in parts:
            np.testing.assert_allclose(getattr(again, part), getattr(found, part), atol=1e-9)


@NAMES
def test_it_is_a_posture_on_the_same_toes(name):
    batch, scaled, points = drawn(name)
    found = centred(scaled, points)
    np.testing.assert_array_equal(found.toes, points.toes)
    for posture in scaled.plans(found, batch.problems):
        assert check_plan(posture).worst < 1e-10


@NAMES
def test_it_does_not_depend_on_who_else_is_asked(name):
    _, scaled, points = drawn(name, 20)
    together = centred(scaled, points)
    for k in range(len(points)):
        alone = centred(scaled.select(np.array([k])), points.select(np.array([k])))
        for part in ("com", "rotation", "forces"):
            np.testing.assert_array_equal(getattr(alone, part)[0], getattr(together, part)[k])


def test_a_toe_is_moved_out_of_a_wall_as_far_as_its_patch_goes_or_to_another_patch() -> None:
    corners = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.2, 0.0], [0.0, 0.2, 0.0]]
    one = surface_patch(np.array(corners), 0.7, towards_m=np.array([0.1, 0.1, 1.0]))
    beside, toe = one.vertices_m + np.array([0.5, 0.0, 0.0]), np.array([0.05, 0.1, 0.0])
    for far, alone, both in ((0.1, 0.15, 0.15), (0.4, 0.29, 0.5)):
        for candidates, least in (((one,), alone), ((one, one.with_vertices(beside)), both)):
            left = _without(candidates, one, toe, np.array([[far, 0.0, 0.0]]))
            assert min(each.vertices_m[:, 0].min() for each in left) == pytest.approx(least)
