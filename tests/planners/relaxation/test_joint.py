"""P1 joined with the lift: it keeps every solution, cuts off what either lets through, and starts
projections well.
"""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.lift import JointRelaxation, LeastGap, near_nominal, solve_lift
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.relaxation.table import RELAXATIONS
from stancekit.planners.search.exact import ExactPlanner

STEP = 1e-4


@pytest.fixture(scope="module")
def problems(programs, drawn):
    """Problems of wall-3 with the point [p, f] of a witness, None where there is none."""
    found = []
    for seed in range(40):
        outcome, scaled = (
            ExactPlanner(programs=programs).solve(drawn("wall-3", seed)),
            Scaled.of(drawn("wall-3", seed)),
        )
        found.append(
            (scaled, scaled.point(outcome.solution) if outcome.status is Status.FEASIBLE else None)
        )
    return found


@pytest.fixture(scope="module")
def box(problems):
    """Quantiles over witnesses."""
    points = np.array([point for _, point in problems if point is not None])
    return Envelope(low=np.quantile(points, 0.1, axis=0), high=np.quantile(points, 0.9, axis=0))


def test_a_box_that_holds_a_witness_admits_the_problem_by_either_objective(programs, problems):
    looked_at = 0
    for scaled, point in problems:
        if point is None:
            continue
        around = Envelope(low=point - 0.02, high=point + 0.03)
        assert JointRelaxation.margin(programs, scaled, around).margin < 0.0
        answer = programs.get(JointRelaxation, scaled.layout).solve(scaled, around, point)
        assert answer.feasible
        assert answer.margin >= -1e-9
        looked_at += 1
    assert looked_at >= 15


def test_no_margin_is_below_that_of_the_box_alone_and_what_the_lift_refutes_is_refuted(
    programs, problems, box
):
    tighter = refuted = 0
    for scaled, _ in problems:
        joint, alone = (
            RELAXATIONS.get(name).margin(programs, scaled, box).margin for name in ("joint", "p1")
        )
        assert joint >= alone - 1e-6
        tighter += joint > alone + 1e-3
        if not solve_lift(programs, scaled, least_moment=True).bound <= 1e-6:
            assert joint == np.inf
            refuted += McCormick.margin(programs, scaled, box.widened(0.3)).margin <= 0.0
    assert tighter >= 10
    assert refuted >= 1


def test_the_answer_is_priced_out_of_a_margin_wherever_there_is_none(programs, problems, box):
    signs = set()
    for scaled, _ in problems:
        answer = programs.get(JointRelaxation, scaled.layout).solve(scaled, box)
        signed = JointRelaxation.margin(programs, scaled, box)
        assert answer.feasible == signed.feasible
        assert answer.margin >= max(signed.margin, 0.0) - 1e-6
        signs.add(answer.feasible)
    assert signs == {True, False}


def test_the_gradient_is_that_of_central_differences_in_every_bound(programs, problems, box):
    scaled, bounds = (
        next(problem for problem, point in problems if point is not None),
        box.to_vector(),
    )
    answer = JointRelaxation.margin(programs, scaled, box, gradient=True)
    gradient = np.concatenate([part.ravel() for part in answer.gradient])

    def margin(at):
        return JointRelaxation.margin(programs, scaled, Envelope.from_vector(at)).margin

    slopes = [
        (margin(bounds + e) - margin(bounds - e)) / (2 * STEP) for e in STEP * np.eye(len(bounds))
    ]
    np.testing.assert_allclose(gradient, slopes, atol=1e-5)
    assert np.max(np.abs(gradient)) > 0.02


def test_about_a_witness_there_is_no_gap_and_fix_p_ends_on_the_surface(programs, problems):
    looked_at = 0
    for scaled, point in problems:
        if point is None:
            continue
        near = near_nominal(scaled, point)
        found = programs.get(LeastGap, scaled.layout).solve(scaled, near)
        assert found.residual == 0.0
        assert project(programs, "lift-fix-p", scaled, near).residual <= 1e-6
        looked_at += 1
    assert looked_at >= 15


def test_the_lift_twice_projects_what_fix_p_loses(programs, problems):
    lost = saved = 0
    for scaled, point in problems:
        if point is None:
            continue
        start = solve_lift(programs, scaled, least_moment=True).rounded()[1]
        once, twice = (
            project(programs, name, scaled, start).residual <= 1e-6
            for name in ("fix-p", "lift-fix-p")
        )
        lost += not once
        saved += twice and not once
    assert lost >= 2
    assert saved == lost


def test_where_the_lift_has_no_point_the_projection_goes_on_from_where_it_was(programs, problems):
    scaled = next(
        s for s, _ in problems if 1e-3 < solve_lift(programs, s, least_moment=True).bound < np.inf
    )
    start = near_nominal(scaled, np.tile([0.1, 0.0, -0.1, 0.3, 0.0, 0.1], (3, 1)))
    assert programs.get(LeastGap, scaled.layout).solve(scaled, start).residual == np.inf
    assert project(programs, "lift-fix-p", scaled, start).residual == pytest.approx(
        project(programs, "fix-p", scaled, start).residual, abs=1e-7
    )
