"""The middle of what held toes leave: on the balances, inside, stationary, the same from anywhere
and as cvxpy's.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.scaled import skew
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.course_keys import STRIDES
from stancekit.planners.projection.centre import _without, at_clear_places, centred
from stancekit.planners.robot.inverse_kinematics import descend
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.witness import witnesses
from stancekit.planners.terrain.polygon import surface_patch
from stancekit.planners.verify import check_plan
from tests.planners.robot.small_urdfs import quadruped

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


def test_at_the_places_that_are_left_of_candidates_no_leg_crosses_a_wall(tmp_path: Path) -> None:
    high, near, far = 0.15, 0.5, 0.6
    levels = [(-1.5, near, 0.0), (near, far, high), (far, 2.5, 0.0)]
    quads = [[(a, -2, z), (b, -2, z), (b, 2, z), (a, 2, z)] for a, b, z in levels]
    quads.append([(near, -2, 0.0), (near, -2, high), (near, 2, high), (near, 2, 0.0)])
    quads.append([(far, -2, 0.0), (far, 2, 0.0), (far, 2, high), (far, -2, high)])
    lines = ["v {} {} {}\n".format(*corner) for quad in quads for corner in quad]
    lines += [f"f {k} {k + 1} {k + 2} {k + 3}\n" for k in range(1, 4 * len(quads), 4)]
    (tmp_path / "wall.obj").write_text("".join(lines))
    (tmp_path / "dog.urdf").write_text(quadruped())
    question = laid_between(
        tmp_path / "wall.obj", (0.0, 0.0), (1.2, 0.0), robot=str(tmp_path / "dog.urdf")
    )
    course = question("inner", STRIDES[0])
    com_m, solver = course.com_nominal_m, Kinematics(course.robot)
    clear = at_clear_places(course, com_m, np.zeros_like(com_m), 0.0)
    toes_m = np.array(course.standing_m)[0]
    standing = solver.solve(np.zeros(3), np.zeros(3), toes_m)[0]

    def crossing(of: Problem) -> int:
        count = 0
        for p, foothold in enumerate(of.footholds):
            limb = of.robot.limb_names.index(foothold.limb)
            frames = np.flatnonzero(np.asarray(of.holds)[:, limb] == p)
            leg, joints = solver.model.legs[limb], solver.joints_of(limb)
            for patch, k in itertools.product(foothold.candidates, frames[[0, -1]]):
                origin, ends_m = com_m[k] - of.robot.origin_m, patch.vertices_m
                for x in np.linspace(ends_m[:, 0].min(), ends_m[:, 0].max(), 3):
                    place = [x, com_m[k, 1] + toes_m[limb, 1], ends_m[0, 2] + 0.02]
                    angles = standing.copy()
                    found, missed = descend(leg, [place - origin], standing[None, joints])
                    angles[joints] = found[0]
                    ends = origin + solver.chains(angles)[limb]  # by pinocchio
                    count += missed[0] < 5e-3 and any(
                        (a[0] - face) * (b[0] - face) < 0.0
                        and a[2] + (face - a[0]) / (b[0] - a[0]) * (b[2] - a[2]) < high
                        for a, b in itertools.pairwise(ends)
                        for face in (near, far)
                    )
        return count

    assert crossing(course) > 0
    assert crossing(clear) == 0
