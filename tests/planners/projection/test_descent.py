"""Descent over plans: it ends on better plans, never on worse ones, and where it ends there is no
way down.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.projection.held import FixToes
from stancekit.planners.projection.project import SURFACE, cost, improved, project
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.answer import Clock, objective_of, plan_of
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan


@pytest.fixture(scope="module")
def points(climb, programs):
    """(course, scaled, point on the surface) of courses that have a plan."""
    found = []
    for seed in (1, 2, 4, 7):
        scaled = Scaled.of(climb(seed))
        start = solve_lift(programs, scaled, least_moment=False).rounded()[1]
        found.append((climb(seed), scaled, project(programs, "scp", scaled, start)))
    return found


def plan(course, scaled, point):
    return plan_of(course, scaled, np.zeros(len(course.footholds), dtype=int), point, provenance={})


def test_descent_ends_on_a_better_plan_and_never_on_a_worse_one(points, programs):
    gains = []
    for course, scaled, point in points:
        clock = Clock.start()
        better = improved(programs, scaled, point, clock.count)
        assert clock.solves >= 2
        assert better.residual <= SURFACE
        assert check_plan(plan(course, scaled, better)).accepted
        gains.append(1.0 - cost(scaled, better) / cost(scaled, point))
    assert min(gains) >= 0.0
    assert max(gains) > 0.01


def test_of_more_steps_none_is_worse_and_from_its_end_no_step_to_other_toes_nearby_is_better(
    points, programs
):
    rng, looked_at = np.random.default_rng(0), 0
    for _, scaled, point in points:
        costs = [
            cost(scaled, improved(programs, scaled, point, Clock.start().count, steps=steps))
            for steps in (0, 1, 4, 40)
        ]
        assert costs[0] == cost(scaled, point)
        assert (np.diff(costs) <= 0.0).all()
        end = improved(programs, scaled, point, Clock.start().count, steps=40)
        for _ in range(10):
            corner = np.array([piece[rng.integers(len(piece))] for piece in scaled.pieces])
            moved = replace(end, toes=end.toes + 1e-3 * (corner - end.toes))
            found = programs.get(FixToes, scaled.layout, False, False).solve(scaled, moved)
            if np.isfinite(found.residual):
                looked_at += 1
                assert cost(scaled, found) >= cost(scaled, end) - 1e-5
    assert looked_at >= 5


def test_cost_is_the_objective_of_the_finished_plan(climb, programs):
    planner = TwoStage(programs=programs)
    for course in (climb(1), climb(4, regions=2, ice=0.4), climb(2, frames=1)):
        outcome = planner.solve(course)
        found, length = outcome.solution, course.length_scale_m
        point = Point(
            com=found.com_m / length,
            rotation=found.rotation_rad,
            toes=found.toes_m / length,
            forces=np.zeros((1, 3)),
            residual=0.0,
        )
        assert cost(Scaled.of(course), point) * length**2 == pytest.approx(
            outcome.objective, rel=1e-12
        )
        assert objective_of(found) == outcome.objective
