"""P2: every projection keeps what it says it keeps, and its residual is the least there is."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.projection.held import FixToes, Linearised
from stancekit.planners.projection.project import PROJECTIONS, STEPS, SURFACE, cost, project, scp
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.answer import plan_of
from stancekit.planners.verify import check_plan

CLIMBS = (1, 2, 4, 7)
"""Seeds of courses of two frames that have a plan."""


def moment(scaled, point):
    world = np.einsum("nij,nj->ni", scaled.frames, point.forces)
    return np.cross(point.toes - point.com, world).sum(axis=0)


def worst_but_moment(problem, scaled, point):
    report = check_plan(plan_of(problem, scaled, scaled.numbers, point))
    return max(g.worst for g in report.groups if g.name != "moment_balance")


@pytest.mark.parametrize("projection", PROJECTIONS.names())
def test_what_comes_back_meets_all_other_constraints_and_its_residual_is_its_moment(
    programs, starts, projection
):
    finite = 0
    for problem, scaled, start in starts:
        point = project(programs, projection, scaled, start)
        assert point.solves >= 1
        if np.isfinite(point.residual):
            finite += 1
            assert worst_but_moment(problem, scaled, point) < 2e-7
            assert np.max(np.abs(moment(scaled, point))) == pytest.approx(point.residual, abs=2e-7)
    assert finite >= 20


@pytest.mark.parametrize("projection", PROJECTIONS.names())
def test_what_is_on_the_surface_is_verified(programs, starts, projection):
    accepted = 0
    for problem, scaled, start in starts:
        point = project(programs, projection, scaled, start)
        if point.residual <= SURFACE:
            accepted += 1
            assert check_plan(plan_of(problem, scaled, scaled.numbers, point)).accepted
    assert accepted >= 5


def test_each_has_at_most_the_residual_of_what_it_starts_with(programs, starts):
    """Each frees more than nothing: the start itself is among its choices, and fix-toes frees all
    that fix-p does.
    """
    for _, scaled, start in starts:
        here = np.max(np.abs(moment(scaled, start)))
        found = {
            name: project(programs, name, scaled, start).residual for name in PROJECTIONS.names()
        }
        assert found["fix-p"] <= here + 1e-6
        assert found["fix-f"] <= here + 1e-6
        assert found["fix-toes"] <= found["fix-p"] + 1e-6
        assert found["scp"] <= found["fix-toes"]


def test_scp_helps_where_fix_toes_is_not_enough(programs, starts):
    ended = helped = 0
    for _, scaled, start in starts:
        fixed, stepped = (project(programs, name, scaled, start) for name in ("fix-toes", "scp"))
        assert stepped.solves <= 1 + 2 * STEPS
        if fixed.residual <= SURFACE:
            ended += 1
            assert stepped.solves == 1
            np.testing.assert_array_equal(stepped.forces, fixed.forces)
        else:
            helped += stepped.residual < 0.5 * fixed.residual
    assert ended >= 20
    assert helped >= 5


class Misled(Programs):
    """Whose linearised steps go to the same toes, wherever one comes from."""

    def __init__(self, toes):
        super().__init__()
        self.toes = toes

    def get(self, make, *key):
        return self if make is Linearised else super().get(make, *key)

    def solve(self, scaled, about):
        return replace(about, toes=self.toes)


def test_a_step_that_makes_things_worse_is_not_kept(programs, starts):
    worse = 0
    for _, scaled, start in starts:
        fixed = project(programs, "fix-toes", scaled, start)
        if SURFACE < fixed.residual < np.inf:
            corners = np.array([piece[0] for piece in scaled.pieces])
            corner = project(programs, "fix-toes", scaled, replace(start, toes=corners))
            worse += fixed.residual < corner.residual < np.inf
            assert scp(Misled(corners), scaled, start).residual == min(
                corner.residual, fixed.residual
            )
    assert worse >= 3


def test_no_step_is_taken_where_the_first_toes_leave_more_than_it_is_worth(programs, starts):
    spared = 0
    for _, scaled, start in starts:
        fixed = project(programs, "fix-toes", scaled, start)
        if 1e-3 < fixed.residual < np.inf:
            same, more = (
                scp(programs, scaled, start, worth=share * fixed.residual) for share in (0.9, 1.1)
            )
            assert (same.solves, same.residual) == (1, fixed.residual)
            assert more.solves > 1
            spared += 1
    assert spared >= 5


def test_the_first_step_is_not_begun_either_where_the_time_would_end_in_it(
    programs, starts, monkeypatch
):
    now, solve = [0.0], FixToes.solve

    def slow(self, scaled, start):
        now[0] += 1.0
        return solve(self, scaled, start)

    loose = [
        (s, start)
        for _, s, start in starts
        if SURFACE < project(programs, "fix-toes", s, start).residual < 1.0
    ]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(FixToes, "solve", slow)
    for scaled, start in loose[:3]:
        now[0] = 0.0
        assert scp(programs, scaled, start, deadline=2.5).solves == 1
        now[0] = 0.0
        assert scp(programs, scaled, start, deadline=3.5).solves > 1
    assert len(loose) >= 3


def test_an_scp_that_has_stalled_ends_and_one_that_gets_to_the_surface_is_the_same_without(
    programs, starts, monkeypatch
):
    stalled = reached = 0
    for _, scaled, start in starts:
        mine = scp(programs, scaled, start)
        with monkeypatch.context() as patch:
            patch.setattr("stancekit.planners.projection.project.STALLED", np.inf)
            whole = scp(programs, scaled, start)
        assert (mine.residual <= SURFACE) == (whole.residual <= SURFACE)
        if whole.residual <= SURFACE:
            assert (mine.solves, mine.forces.tolist()) == (whole.solves, whole.forces.tolist())
            reached += 1
        else:
            stalled += mine.solves < whole.solves
    assert stalled >= 3
    assert reached >= 5


# -------------------------------------------------------------------------------------------------
# where there is none


@pytest.mark.parametrize("projection", PROJECTIONS.names())
def test_out_of_reach_there_is_no_answer(programs, starts, projection):
    problem, _, start = starts[0]
    short = problem.posture_with(contacts=tuple(replace(c, reach_m=0.01) for c in problem.contacts))
    point = project(programs, projection, Scaled.of(short), start)
    if projection.endswith(
        "fix-p"
    ):  # keeps the body and the toes, and so their distance: it asks for forces only
        assert np.isfinite(point.residual)
    else:
        assert point.residual == np.inf
    assert point.toes.shape == point.forces.shape == (3, 3)


@pytest.mark.parametrize("projection", ["fix-p", "fix-toes", "scp"])
def test_without_friction_on_a_wall_there_is_no_answer(programs, drawn, projection):
    scaled = Scaled.of(drawn("wall-3", 0))
    slippery = replace(
        scaled, friction=np.zeros(3), frames=np.tile([[0, 0, 1], [1, 0, 0], [0, 1, 0]], (3, 1, 1))
    )
    middle, nothing = np.array([piece.mean(axis=0) for piece in scaled.pieces]), np.zeros((1, 3))
    start = Point(com=nothing, rotation=nothing, toes=middle, forces=np.zeros((3, 3)), residual=1.0)
    assert project(programs, projection, slippery, start).residual == np.inf


# -------------------------------------------------------------------------------------------------
# over key frames


@pytest.fixture(scope="module")
def climbs(climb, programs):
    """(course, scaled, the lift's point) of courses that have a plan."""
    found = []
    for seed in CLIMBS:
        scaled = Scaled.of(climb(seed))
        found.append(
            (climb(seed), scaled, solve_lift(programs, scaled, least_moment=False).rounded()[1])
        )
    return found


def plan(course, scaled, point):
    return plan_of(course, scaled, np.zeros(len(course.footholds), dtype=int), point, provenance={})


def test_scp_ends_on_a_plan_that_the_verifier_accepts_whose_objective_is_no_less_than_the_lifts(
    climbs, programs
):
    stepped = 0
    for course, scaled, start in climbs:
        lifted = solve_lift(programs, scaled, least_moment=False)
        stepped += not np.isfinite(project(programs, "fix-toes", scaled, start).residual)
        point = project(programs, "scp", scaled, start)
        assert point.residual <= SURFACE
        assert check_plan(plan(course, scaled, point)).accepted
        assert cost(scaled, point) >= lifted.bound - 1e-7
    assert stepped > 0  # otherwise no linearised step was looked at


def test_on_odd_polygons_with_a_toe_that_stands_and_the_rest_on_ice_it_does_so_too(rough, programs):
    found = 0
    for seed in range(6):
        course = rough(seed, regions=2, ice=0.2)
        scaled = Scaled.of(course)
        lifted = solve_lift(programs, scaled, least_moment=False)
        if not np.isfinite(lifted.bound):
            continue
        choice, start = lifted.rounded()
        point = project(programs, "scp", scaled.chosen(choice), start)
        if point.residual <= SURFACE:
            made = plan_of(course, scaled, choice, point, provenance={})
            np.testing.assert_allclose(made.toes_m[0], course.footholds[0].toe_m, atol=1e-15)
            assert check_plan(made).accepted
            found += 1
    assert found >= 2


def test_fix_p_keeps_toes_and_body_and_solves_for_forces_alone(climbs, programs):
    for course, scaled, start in climbs:
        point = project(programs, "scp", scaled, start)
        again = project(programs, "fix-p", scaled, replace(point, forces=0.0 * point.forces))
        np.testing.assert_array_equal(again.toes, point.toes)
        np.testing.assert_array_equal(again.com, point.com)
        np.testing.assert_array_equal(again.rotation, point.rotation)
        assert again.residual < 1e-7
        assert check_plan(plan(course, scaled, again)).accepted


def test_fix_f_keeps_the_forces_of_a_plan_and_finds_toes_that_balance_them(climbs, programs):
    for course, scaled, start in climbs:
        point = project(programs, "scp", scaled, start)
        again = project(programs, "fix-f", scaled, replace(point, toes=0.0 * point.toes))
        np.testing.assert_array_equal(again.forces, point.forces)
        assert again.residual < 1e-6
        assert check_plan(plan(course, scaled, again)).worst < 2e-6


def test_toes_that_cannot_hold_the_robot_have_no_answer(climbs, programs):
    _, scaled, start = climbs[0]
    below = replace(start, toes=start.toes - [0.0, 0.0, 1.0])
    assert project(programs, "fix-toes", scaled, below).residual == np.inf
