"""The nonlinear program: its rows and derivatives, and what it projects to."""

from __future__ import annotations

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.projection.nlp import NlpProgram, parameters, point_of, vector, written
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.answer import plan_of
from stancekit.planners.search.micp import starting_points
from stancekit.planners.verify import check_plan
from tests.refusals import refuses


def walked(walk):
    """A walk whose forces are known in closed form, as a point on its own patches."""
    plan = walk(frames=3)
    scaled = Scaled.of(plan.problem).chosen(plan.choice)
    stance, limb, _ = scaled.layout.contacts
    world = plan.forces_n[stance, limb] / scaled.force_n
    point = replace(
        starting_points(scaled, 1, seed=0)[0],
        com=plan.com_m / scaled.length_m,
        rotation=plan.rotation_rad,
        toes=plan.toes_m / scaled.length_m,
        forces=np.einsum("bji,bj->bi", scaled.contact_frames, world),
    )
    return scaled, point


def test_the_rows_vanish_at_a_walk_in_closed_form_and_say_how_far_off_another_point_is(walk):
    scaled, point = walked(walk)
    assert scaled.weights is not None
    scaled = replace(
        scaled,
        weights=replace(scaled.weights, com_path=0.3),
        com=scaled.com + np.array([0.0, 0.01, 0.0]),
    )
    program, equal = written(scaled.layout, False)
    rows = cs.Function("rows", [program["x"], program["p"]], [program["f"], program["g"]])
    x = vector(scaled, point)
    f, g = (np.asarray(part).ravel() for part in rows(x, parameters(scaled, x)))
    assert np.abs(g[:equal]).max() < 1e-9
    assert g[equal:].max() < 1e-9
    steps = np.sum(np.diff(point.com, axis=0) ** 2)
    moved = np.sum(np.diff(point.toes[scaled.layout.moves], axis=1) ** 2)
    aim = scaled.aim
    expected = (
        aim.goal * np.sum((point.com[-1] - scaled.goal) ** 2)
        + aim.com_step * steps
        + aim.toe_step * moved
    )
    expected += aim.com_path * np.sum((point.com - scaled.com) ** 2)
    assert f[0] == pytest.approx(expected, rel=1e-9)
    off = replace(point, com=point.com + np.array([0.1, 0.0, 0.0]))
    _, g = (np.asarray(part).ravel() for part in rows(vector(scaled, off), parameters(scaled, x)))
    footholds, stances = scaled.layout.footholds, len(scaled.layout.stances)
    moments = g[footholds + 3 * stances : equal].reshape(stances, 3)
    np.testing.assert_allclose(
        moments, np.tile([0.0, scaled.weight * 0.1, 0.0], (stances, 1)), atol=1e-9
    )  # −Δc × w e_z


@pytest.mark.parametrize("which", ["posture", "course"])
def test_derivatives_match_finite_differences_and_the_objectives_gradient_is_dense(
    mixed, ragged, which
):
    if which == "posture":
        scaled = Scaled.of(mixed(0, (3, 4)))
    else:
        scaled = Scaled.of(ragged(1))
        scaled = scaled.chosen(np.zeros(scaled.layout.footholds, dtype=int))
    program, _ = written(scaled.layout, scaled.weights is None)
    x, p = program["x"], program["p"]
    both = cs.vertcat(program["f"], program["g"])
    value, slope = (
        cs.Function("v", [x, p], [both]),
        cs.Function("s", [x, p], [cs.jacobian(both, x)]),
    )
    start = vector(scaled, starting_points(scaled, 1, seed=0)[0])
    at, data = (
        start + 0.1 * np.random.default_rng(0).normal(size=len(start)),
        parameters(scaled, start),
    )
    steps = 1e-6 * np.eye(x.numel())
    measured = np.column_stack(
        [np.asarray(value(at + h, data) - value(at - h, data)).ravel() / 2e-6 for h in steps]
    )
    np.testing.assert_allclose(np.asarray(slope(at, data)), measured, atol=1e-7)
    assert cs.gradient(program["f"], x).nnz() == x.numel()


def test_x_and_its_point_are_the_same_point(walk):
    scaled, point = walked(walk)
    back = point_of(scaled, vector(scaled, point), converged=True)
    np.testing.assert_allclose(back.toes, point.toes, atol=1e-9)
    np.testing.assert_allclose(back.forces, point.forces, atol=1e-12)
    assert back.residual < 1e-9
    assert point_of(scaled, vector(scaled, point), converged=False).residual == np.inf


def test_as_a_projection_it_lands_on_the_bilinear_surface_where_scp_does(programs, drawn):
    landed = 0
    for seed in range(12):
        scaled = Scaled.of(drawn("wall-3", seed))
        lifted = solve_lift(programs, scaled, least_moment=True)
        if not np.isfinite(lifted.bound):
            continue
        start = lifted.rounded()[1]
        scp, nlp = (project(programs, name, scaled, start) for name in ("scp", "nlp"))
        if lifted.bound > 1e-4:
            assert nlp.residual > 1e-5
        if scp.residual < 1e-7:
            assert nlp.residual < 1e-6
            landed += 1
    assert landed > 4


def test_a_point_on_the_surface_keeps_every_other_constraint_too(programs, drawn):
    # A limb that hardly pushes: (μ f_n)² forgives 1e-4 of shear for a tolerance of 1e-8, so a point
    # is polished.
    looked_at = 0
    for seed in range(9):
        problem = drawn("wall-5", seed)
        scaled = Scaled.of(problem)
        for start in starting_points(scaled, 2, seed=0):
            point = project(programs, "nlp", scaled, start)
            if np.isfinite(point.residual):
                worst = check_plan(plan_of(problem, scaled, scaled.numbers, point)).worst
                assert worst < 1e-6 or worst < 2.0 * point.residual
                looked_at += 1
    assert looked_at > 8


def test_a_solve_does_not_depend_on_the_solves_before_it(programs, drawn):
    scaled = [Scaled.of(drawn("wall-3", seed)) for seed in (1, 2, 1)]
    one, _, again = (
        project(programs, "nlp", some, starting_points(some, 1, seed=0)[0]) for some in scaled
    )
    np.testing.assert_array_equal(one.toes, again.toes)
    np.testing.assert_array_equal(one.forces, again.forces)


def test_iterations_and_time_end_a_solve(programs, drawn):
    scaled = Scaled.of(drawn("wall-3", 1))
    start = starting_points(scaled, 1, seed=0)[0]
    for limits, status in (
        ((1, 5.0), "Maximum_Iterations_Exceeded"),
        ((200, 1e-6), "Maximum_WallTime_Exceeded"),
    ):
        point, said = NlpProgram(scaled.layout, True, *limits).attempt(programs, scaled, start)
        assert (point.residual, said) == (np.inf, status)


def test_another_projection_is_named(programs, drawn):
    from stancekit.planners.search.micp import Micp

    with refuses("projection"):
        Micp(projection="up")
