"""The programs that hold a part of a point: each is the one written again from the problem, and
what it says it is.
"""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, strategies as st

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.projection.held import FixToes, Linearised
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.lift import solve_lift

SEEDS = st.integers(0, 2**32 - 1)


def moment(scaled, point):
    world = np.einsum("nij,nj->ni", scaled.frames, point.forces)
    return np.cross(point.toes - point.com, world).sum(axis=0)


def least(model, toes, rows):
    slack = cp.Variable()
    program = cp.Problem(cp.Minimize(slack), [*rows, cp.abs(model.moment_of(toes)) <= slack])
    return float(program.solve(solver=cp.CLARABEL))


@pytest.mark.parametrize("index", range(0, 60, 7))
def test_fix_toes_and_fix_p_are_the_programs_written_again(programs, starts, written, index):
    problem, scaled, start = starts[index % len(starts)]
    model = written(problem)
    held = [model.toes == start.toes, model.balance, *model.in_cones]
    free = least(model, start.toes, [*held, *model.body, *model.in_reach])
    assert project(programs, "fix-toes", scaled, start).residual == pytest.approx(free, abs=2e-7)
    fixed = least(model, start.toes, [*held, model.com == start.com[0]])
    assert project(programs, "fix-p", scaled, start).residual == pytest.approx(fixed, abs=2e-7)


@pytest.mark.parametrize("index", range(0, 60, 7))
def test_fix_f_is_the_program_written_again(programs, starts, written, index):
    problem, scaled, start = starts[index % len(starts)]
    model, slack = written(problem), cp.Variable()
    world = np.einsum("nij,nj->ni", scaled.frames, start.forces)
    arms = sum(
        -np.cross(force, np.eye(3)).T @ (model.toes[i] - model.com) for i, force in enumerate(world)
    )
    rows = [*model.body, *model.on_patches, *model.in_reach, cp.abs(arms) <= slack]
    residual = cp.Problem(cp.Minimize(slack), rows).solve(solver=cp.CLARABEL)
    assert project(programs, "fix-f", scaled, start).residual == pytest.approx(residual, abs=3e-7)


@given(SEEDS)
def test_the_linear_model_of_scp_is_the_tangent_of_the_moment(programs, starts, seed):
    """About a posture on the surface the step's residual is 0, and its linearisation is exact in
    each factor.
    """
    rng = np.random.default_rng(seed)
    _, scaled, start = starts[int(rng.integers(len(starts)))]
    step = programs.get(Linearised, scaled.layout, True).solve(scaled, start)
    if not np.isfinite(step.residual):
        return
    world, about = (np.einsum("nij,nj->ni", scaled.frames, p.forces) for p in (step, start))
    tangent = np.cross(start.toes, world) + np.cross(step.toes - start.toes, about)
    linear = tangent.sum(axis=0) - np.cross(step.com[0], [0.0, 0.0, scaled.weight])
    assert np.max(np.abs(linear)) == pytest.approx(step.residual, abs=1e-6)
    second = np.cross(step.toes - start.toes, world - about).sum(
        axis=0
    )  # what the tangent leaves out
    np.testing.assert_allclose(moment(scaled, step) - linear, second, atol=1e-6)


def test_three_feet_on_level_ground_share_the_weight_by_the_lever_rule(drawn):
    """A closed form: vertical forces f_i with Σ f_i = w and Σ f_i (q_i − c) = 0 are the barycentric
    shares of c.
    """
    toes = np.array([[0.5, 0.0, -0.3], [-0.2, 0.4, -0.3], [-0.3, -0.5, -0.3]])
    com, upright = (
        np.array([[0.05, -0.02, 0.0]]),
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    )
    scaled = replace(
        Scaled.of(drawn("ground-3", 0)),
        friction=np.zeros(3),
        com=com,
        com_radius=np.zeros(1),
        reach=np.full(3, 2.0),
        frames=np.tile(upright, (3, 1, 1)),
        shoulders=np.zeros((3, 3)),
        force_max=np.ones((3, 3)),
    )
    held = Point(com=0.0 * com, rotation=0.0 * com, toes=toes, forces=0.0 * toes, residual=np.inf)
    point = FixToes(scaled.layout, False, True).solve(scaled, held)
    shares = np.linalg.solve(np.vstack([toes[:, :2].T, np.ones(3)]), [*com[0, :2], 1.0])
    np.testing.assert_allclose(point.forces[:, 0], shares, atol=1e-6)
    assert point.residual < 1e-7


# -------------------------------------------------------------------------------------------------
# over key frames


def standing(course, toes):
    """The course with every toe where it is."""
    footholds = tuple(
        replace(put, toe_m=toe) for put, toe in zip(course.footholds, toes, strict=True)
    )
    again = object.__new__(
        type(course)
    )  # toes that stand are for the first frame alone, which nobody checks here
    again.__dict__.update(course.__dict__ | {"footholds": footholds})
    return again


def test_a_linearised_step_that_leaves_no_moment_and_does_not_move_the_toes_is_a_point_of_fix_toes(
    climb, programs
):
    seen = 0
    for seed in (1, 2, 4):
        scaled = Scaled.of(climb(seed))
        start = solve_lift(programs, scaled, least_moment=False).rounded()[1]
        point = project(programs, "scp", scaled, start)
        step = programs.get(Linearised, scaled.layout, True).solve(scaled, point)
        assert step.residual < 1e-6  # the point itself is one of its answers
        layout, world = scaled.layout, scaled.in_world(step.forces)
        foothold, stance = layout.contacts[2], layout.contacts[0]
        about = scaled.in_world(point.forces)
        tangent = np.cross(point.toes[foothold], world) + np.cross(
            (step.toes - point.toes)[foothold], about
        )
        left = np.zeros((len(layout.stances), 3))
        np.add.at(left, stance, tangent)
        left -= np.cross(step.com[layout.stance_frames], [0.0, 0.0, scaled.weight])
        assert np.max(np.abs(left)) == pytest.approx(step.residual, abs=1e-6)
        seen += 1
    assert seen == 3


def test_one_frame_keeps_its_solver_and_answers_as_a_new_one_does_whatever_it_solved_before(climb):
    kept = Programs()
    for seed in (2, 0, 3, 2, 1, 2):
        course = climb(seed, frames=1)
        for shape in (
            {},
            {"length_scale_m": 0.4},
            {"weights": replace(course.weights, goal=0.1, tilt=2.0)},
        ):
            scaled = Scaled.of(replace(course, **shape))
            ours, theirs = (
                solve_lift(some, scaled, least_moment=False) for some in (kept, Programs())
            )
            assert ours.status is theirs.status
            if np.isfinite(ours.bound):
                assert ours.bound == theirs.bound
                np.testing.assert_array_equal(ours.com, theirs.com)
                start = ours.rounded()[1]
                mine, other = (project(some, "scp", scaled, start) for some in (kept, Programs()))
                assert mine.residual == other.residual
                np.testing.assert_array_equal(mine.forces, other.forces)
