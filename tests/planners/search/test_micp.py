"""The mixed-integer baseline: its grid leaves nothing out, and its claims are never taken for
answers.
"""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import replace
from functools import cache

import cvxpy as cp
import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.problem import StepLimits
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import domain_of
from stancekit.planners.relaxation.micp import MicpGrid, MicpProgram, cell_error, of_layout
from stancekit.planners.relaxation.papers import Breaks, p1
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Decoupled, Micp, Positions
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from tests.planners.oracle import solve
from tests.refusals import assert_names, refuses


@pytest.fixture(scope="module")
def planner(programs):
    return Decoupled(programs=programs)


def test_on_level_ground_it_plans_as_the_two_stage_planner_does(planner, programs):
    course = read_course("stairs", frames=2)
    outcome = planner.solve(course)
    assert outcome.status is Status.FEASIBLE
    assert check_plan(outcome.solution).accepted
    assert outcome.objective == pytest.approx(
        TwoStage(programs=programs).solve(course).objective, rel=1e-4
    )
    assert outcome.details["on_ice"] == 0.0


def test_on_walls_half_of_ice_it_fails_and_says_why_where_the_two_stage_planner_has_a_plan(
    planner, programs
):
    failed = on_ice = 0
    coupled = TwoStage(programs=programs)
    for seed in range(8):
        course = walls_of_ice(seed)
        ours, theirs = coupled.solve(course), planner.solve(course)
        if ours.status is not Status.FEASIBLE:
            assert theirs.status is not Status.FEASIBLE
            continue
        if theirs.status is Status.UNDECIDED and theirs.details.get("on_ice", 0.0) > 0.0:
            assert theirs.solution is None
            assert_names(theirs.message, "forces", "frame")
            failed += 1
            on_ice += theirs.details["on_ice"]
    assert failed > 3
    assert 0.2 < on_ice / failed < 0.8


def walls_of_ice(seed):
    """The built-in walls with two candidates a toe, one of which grips: the nearer or the farther,
    by chance.
    """
    rng, course = np.random.default_rng(seed), read_course("icy-walls", frames=2)
    footholds = []
    for put in course.footholds:
        grips = int(rng.integers(2))
        pair = [
            replace(patch, friction=float(r == grips)) for r, patch in enumerate(put.candidates[:2])
        ]
        footholds.append(replace(put, candidates=tuple(pair)))
    terrain = tuple(patch for put in footholds for patch in put.candidates)
    return replace(course, terrain=terrain, footholds=tuple(footholds))


def test_the_positions_know_nothing_of_friction(climb):
    course = climb(1, regions=2)
    icy = replace(
        course,
        footholds=tuple(
            replace(put, candidates=tuple(replace(patch, friction=0.0) for patch in put.candidates))
            for put in course.footholds
        ),
    )
    scaled = Scaled.of(course)
    positions = Positions(scaled.layout)
    first, second = positions.solve(scaled), positions.solve(Scaled.of(icy))
    np.testing.assert_array_equal(first[2].toes, second[2].toes)


def test_the_positions_bound_the_objective_of_the_lift_from_below(climb, written_course):
    looked_at = 0
    for seed in (1, 2):
        course = climb(seed)
        scaled = Scaled.of(course)
        if looked_at == 0:
            positions = Positions(scaled.layout)
        solution, _, _ = positions.solve(scaled)
        problem, _ = written_course(course)
        problem.solve(cp.CLARABEL)
        assert solution.status is ConicStatus.SOLVED
        assert solution.objective * course.length_scale_m**2 <= problem.value + 1e-7
        looked_at += 1
    assert looked_at == 2


def test_steps_too_short_to_get_anywhere_are_refuted_with_a_certificate_without_forces(
    climb, planner
):
    course = climb(1)
    near = replace(course, steps=StepLimits(com_m=0.2, toe_m=1e-3, progress_m=0.01))
    outcome = planner.solve(near)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(near)).accepted
    forces = outcome.certificate.multipliers[0, : 6 * len(near.stances)]
    np.testing.assert_array_equal(forces, 0.0)
    assert not check_certificate(outcome.certificate.of(course)).accepted


NEEDS_SCIP = pytest.mark.skipif(
    importlib.util.find_spec("pyscipopt") is None, reason="needs the exact extra"
)
NEEDS_GUROBI = pytest.mark.skipif(
    importlib.util.find_spec("gurobipy") is None, reason="needs the exact extra"
)
TWO = MicpGrid(intervals=2)


@pytest.fixture(scope="module")
def scenes():
    """Natural wall-3 scenes with the exact planner's answer, the trivially infeasible ones left
    out.
    """
    rng, exact = np.random.default_rng(1), Exact()
    answered = [
        (problem, exact.solve(problem))
        for problem in (DISTRIBUTIONS["wall-3"].sample(rng) for _ in range(30))
    ]
    return [(problem, outcome) for problem, outcome in answered if not outcome.details["trivial"]]


@pytest.fixture(scope="module")
def feasible(scenes):
    """The first six that have a witness."""
    kept = [(problem, outcome) for problem, outcome in scenes if outcome.status is Status.FEASIBLE][
        :6
    ]
    assert len(kept) == 6
    return kept


@pytest.fixture(scope="module")
def infeasible(scenes):
    """Those that have a certificate."""
    kept = [
        (problem, outcome) for problem, outcome in scenes if outcome.status is Status.INFEASIBLE
    ]
    assert len(kept) > 3
    return kept


@pytest.fixture(scope="module")
def walls():
    return read_course("walls", frames=1)


@pytest.fixture(scope="module")
def learned():
    """A box for the legs of wall-3 such as is learned, written down: the mirror image of the
    course's own tripod.
    """
    course = read_course("walls", frames=3)
    problem = course.posture_problem(
        replace(course.stances[1], limbs=(3, 5, 1)), np.zeros(12, dtype=int)
    )
    assert problem.legs == ("RF", "RR", "LM")
    low = np.array(
        [
            [0.0, -0.75, -0.25, 0.2, -0.3, 0.0],
            [-0.5, -0.75, -0.25, 0.2, -0.3, 0.0],
            [-0.25, 0.55, -0.25, 0.4, -0.3, 0.2],
        ]
    )
    high = np.array(
        [
            [0.5, -0.5, 0.25, 0.9, 0.3, 0.6],
            [0.0, -0.5, 0.25, 0.9, 0.3, 0.6],
            [0.25, 0.8, 0.25, 1.0, 0.3, 0.8],
        ]
    )
    return EnvelopeSet.for_problems("wall-3", [problem], [Envelope(low=low, high=high)])


shared = cache(of_layout)


def asked(problem, grid=TWO, solver="highs"):
    """The program of a posture's layout over the domain that it implies, and that domain."""
    scaled = Scaled.of(problem)
    domain = domain_of(scaled, "contact")
    symbols, program = shared(scaled.layout, grid, solver)
    symbols.load(scaled, Breaks.of(domain, grid.intervals))
    return program, domain


def coordinates(point):
    """[p, f] of a posture's point, shape (1, N, 6)."""
    return np.hstack([point.toes - point.com, point.forces])[None]


def witness(problem, outcome):
    """[p, f] of a witness, shape (1, N, 6)."""
    return Scaled.of(problem).point(outcome.solution)[None]


def net_moment(course, point):
    """Largest component of Σ (q − c) × C f over stances, contact by contact."""
    worst, row = 0.0, 0
    for stance in course.stances:
        total = np.zeros(3)
        for limb in stance.limbs:
            foothold = course.holds[stance.frame, limb]
            world = course.footholds[foothold].candidates[0].frame @ point.forces[row]
            total += np.cross(point.toes[foothold] - point.com[stance.frame], world)
            row += 1
        worst = max(worst, np.abs(total).max())
    return worst


def test_the_grid_leaves_no_posture_out(feasible):
    planner = Micp(intervals=2)
    for problem, _ in feasible:
        outcome = planner.solve(problem)
        assert outcome.claim == "feasible"
        assert outcome.status is Status.FEASIBLE
        assert check_plan(outcome.solution).accepted


def test_the_domain_holds_every_witness(scenes):
    for problem, outcome in scenes:
        if outcome.status is Status.FEASIBLE:
            domain = domain_of(Scaled.of(problem), "contact")
            assert domain.contains(witness(problem, outcome), margin=1e-6).all()


def test_a_claim_of_infeasibility_stays_a_claim(infeasible):
    planner = Micp(intervals=2)
    outcomes = [planner.solve(problem) for problem, _ in infeasible]
    assert {outcome.status for outcome in outcomes} == {Status.UNDECIDED}
    refused = [outcome for outcome in outcomes if outcome.claim == "infeasible"]
    assert len(refused) > 2
    for outcome in refused:
        assert_names(outcome.message, "highs", "certificate")
    for outcome in outcomes:
        if outcome.claim == "feasible":
            assert_names(outcome.message, "witness")
            assert outcome.details["claimed_residual_nm"] > 0.1


def test_one_piece_of_the_domain_is_the_mccormick_relaxation(scenes):
    claims = []
    for problem, _ in scenes:
        program, domain = asked(problem, MicpGrid(intervals=1))
        claims.append(program.solve(Scaled.of(problem), 60.0).claim)
        if (
            claims[-1] == "infeasible"
        ):  # its cones are wider, so what it refuses the relaxation refuses, too
            answer = solve(p1(Scaled.of(problem), domain, soft=True))
            assert answer.status is ConicStatus.INFEASIBLE or answer.objective > 0.0
    assert set(claims) == {"feasible", "infeasible"}


def test_a_point_of_the_grid_lies_on_the_surface_up_to_its_cells(feasible):
    problem, _ = feasible[0]
    gaps = []
    for intervals in (1, 2, 4):
        program, domain = asked(problem, MicpGrid(intervals=intervals))
        answer = program.solve(Scaled.of(problem), 60.0)
        p, f = coordinates(answer.point)[0, :, :3], answer.point.forces
        gap = np.abs(
            program.model.products.moments.value - (p[:, :, None] * f[:, None, :]).reshape(3, 9)
        )
        (p_low, p_high), (f_low, f_high) = domain.position, domain.force
        cell = ((p_high - p_low)[:, :, None] * (f_high - f_low)[:, None, :]).reshape(
            3, 9
        ) / intervals**2
        assert np.all(gap <= 0.25 * cell + 1e-6)  # McCormick's largest gap over a cell
        assert gap.max() <= cell_error(domain, intervals) + 1e-6
        gaps.append(gap.max())
    assert gaps[0] > 1e-4


def test_binaries_are_a_variable_and_not_a_cell(scenes):
    assert asked(scenes[0][0], MicpGrid())[0].figures["binaries"] == 18 * 2


def test_binaries_grow_with_the_limbs_that_carry():
    course = read_course("walls", frames=4)
    scaled = Scaled.of(course)
    program = MicpProgram(scaled, Breaks.of(domain_of(scaled, "contact"), MicpGrid().intervals))
    carrying = sum(len(stance.limbs) for stance in course.stances)
    assert program.figures["binaries"] == 12 * carrying == 252


@pytest.mark.parametrize("use", ["rows", "shrink"])
def test_with_an_envelope_the_claimed_point_of_a_posture_lies_in_it(feasible, use):
    found = 0
    for problem, outcome in feasible[:4]:
        envelope = Envelope.around(witness(problem, outcome)).widened(0.1)
        planner = Micp(intervals=2, envelope_use=use, envelopes=envelope)
        answer = planner.program(problem).solve(Scaled.of(problem), 60.0)
        assert envelope.contains(coordinates(answer.point), margin=1e-6).all()
        outcome = planner.solve(problem)
        assert outcome.claim == "feasible"
        found += outcome.status is Status.FEASIBLE
    assert found > 2


@pytest.mark.parametrize("use", ["rows", "shrink"])
def test_an_envelope_confines_the_point_of_a_course(use, walls, learned):
    scaled = Scaled.of(walls)
    planner = Micp(envelopes=learned, envelope_use=use)
    box = planner.box(walls)
    answer = planner.program(walls).solve(Scaled.of(walls), 60.0)
    assert answer.claim == "feasible"
    frame, limbs = scaled.layout.stances[0]
    p = answer.point.toes[[walls.holds[frame, limb] for limb in limbs]] - answer.point.com[frame]
    assert box.contains(np.hstack([p, answer.point.forces])[None], margin=1e-6).all()
    assert np.abs(answer.moments).max() == pytest.approx(net_moment(walls, answer.point), abs=1e-6)


def test_a_finer_grid_leaves_less_of_the_moments(walls, learned):
    for intervals in (1, 8):
        planner = Micp(envelopes=learned, envelope_use="shrink", intervals=intervals)
        box, answer = planner.box(walls), planner.program(walls).solve(Scaled.of(walls), 60.0)
        width = float(np.max(box.high - box.low) / intervals)
        assert answer.claim == "feasible"
        # |m − p f| ≤ (cell of p)(cell of f)/4, and six such products make a component of the
        # moments of three limbs
        assert np.abs(answer.moments).max() <= 6.0 * width**2 / 4.0 + 1e-6


@pytest.mark.parametrize("use", ["rows", "shrink"])
def test_an_envelope_out_of_reach_of_a_posture_has_no_point(feasible, use):
    problem, outcome = feasible[0]
    far = Envelope.around(witness(problem, outcome) + 3.0).widened(0.1)
    assert Micp(intervals=2, envelope_use=use, envelopes=far).solve(problem).claim == "infeasible"


def test_an_envelope_out_of_reach_is_a_claim_of_infeasible_that_proves_nothing(walls, learned):
    box, up = learned.envelopes[0], np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0])
    away = replace(learned, envelopes=(Envelope(low=box.low + up, high=box.high + up),))
    outcome = Micp(envelopes=away).solve(walls)
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "infeasible")
    assert outcome.certificate is None
    assert_names(outcome.message, "highs")


@pytest.mark.parametrize("solver", ["highs", pytest.param("scip", marks=NEEDS_SCIP)])
def test_a_claim_becomes_a_plan_that_the_verifier_accepts(solver, walls):
    outcome = Micp(solver=solver).solve(walls)
    assert (outcome.status, outcome.claim) == (Status.FEASIBLE, "feasible")
    assert (
        outcome.details["binaries"] == 3 * 6 * 2
    )  # 3 limbs carry, 6 components each, log₂ 4 binaries a component
    assert check_plan(outcome.solution).accepted


def test_patches_are_chosen_by_binaries():
    course = read_course("icy-walls", frames=1)
    outcome = Micp().solve(course)
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert outcome.details["binaries"] == 36 + 4 * 6
    carrying = [course.holds[0, limb] for limb in course.stances[0].limbs]
    assert any(
        len({patch.friction for patch in course.footholds[p].candidates}) == 2 for p in carrying
    )
    frictions = [course.patch(p, outcome.solution.choice).friction for p in carrying]
    assert np.count_nonzero(frictions) >= 2  # ice may push, and cannot hold
    assert check_plan(outcome.solution).accepted


def test_candidates_of_several_frames_share_the_axes_of_the_world(ragged):
    course = ragged(2, frames=1, ice=0.0)
    outcome = Micp(intervals=2, time_limit_s=600.0).solve(course)
    assert outcome.claim == "feasible", outcome.message
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert len(set(outcome.solution.choice.tolist())) > 1


def test_minimising_the_objective_bounds_it_from_below(walls):
    course = replace(
        walls, goal_m=walls.goal_m + np.array([0.0, 0.0, 0.2])
    )  # out of the radius about the start
    best = (0.2 - course.com_radius_m[0]) ** 2
    outcome = Micp(gap=0.05).solve(course)
    assert outcome.status is Status.FEASIBLE
    assert outcome.objective == pytest.approx(best, rel=0.05, abs=1e-4)


def test_an_envelope_of_other_limbs_or_over_several_frames_is_refused(feasible, ragged):
    envelope = Envelope(low=-np.ones((5, 6)), high=np.ones((5, 6)))
    with refuses("contacts"):
        Micp(envelopes=envelope).solve(feasible[0][0])
    with refuses("frame 0", "limb LR"):
        Micp(envelopes=envelope).solve(ragged(2, frames=1))


def test_a_time_limit_leaves_the_problem_undecided(infeasible):
    outcome = Micp(intervals=8, time_limit_s=0.01).solve(infeasible[2][0])
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "unknown")


def test_an_answer_does_not_depend_on_the_ones_before_it(feasible):
    planner = Micp(intervals=2)
    (first, _), (second, _) = feasible[:2]
    one, _, again = (planner.solve(problem) for problem in (first, second, first))
    np.testing.assert_array_equal(one.solution.toes_m, again.solution.toes_m)
    np.testing.assert_array_equal(one.solution.forces_n, again.solution.forces_n)


def test_the_program_that_postures_share_is_the_one_written_for_each_of_them(scenes):
    planner = Micp(intervals=2)
    for problem, _ in scenes[:4]:
        scaled, ours = Scaled.of(problem), planner.program(problem)
        own = MicpProgram(scaled, Breaks.of(domain_of(scaled, "contact"), TWO.intervals))
        assert ours is planner.program(problem)
        assert ours.figures == own.figures
        with warnings.catch_warnings(
            action="ignore", category=UserWarning
        ):  # cvxpy's, on arrays of three dimensions
            ours, theirs = (
                each.problem.get_problem_data(cp.HIGHS, solver_opts={})[0] for each in (ours, own)
            )
        assert ours.keys() == theirs.keys()
        np.testing.assert_allclose(ours["A"].toarray(), theirs["A"].toarray(), atol=1e-14)
        for name in ("b", "c"):
            np.testing.assert_allclose(ours[name], theirs[name], atol=1e-14)
        assert ours["bool_vars_idx"] == theirs["bool_vars_idx"]


@NEEDS_SCIP
def test_scip_with_true_cones_agrees_with_highs(scenes):
    for problem, _ in scenes[:4]:
        programs = [asked(problem, solver=solver)[0] for solver in ("scip", "highs")]
        mine, theirs = (program.solve(Scaled.of(problem), 60.0).claim for program in programs)
        assert mine == theirs or (mine, theirs) == (
            "infeasible",
            "feasible",
        )  # HiGHS' cones are wider


@NEEDS_GUROBI
def test_gurobis_free_licence_says_that_the_program_is_too_large():
    outcome = Micp(solver="gurobi").solve(read_course("walls", frames=4))
    assert outcome.status is not Status.INFEASIBLE
    if outcome.status is Status.UNDECIDED:
        assert_names(outcome.message, "licence", "2000")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Micp(solver="cplex"),
            "solver",
        ),
        (
            lambda: MicpGrid(intervals=3),
            "intervals",
        ),
        (
            lambda: MicpGrid(envelope_use="cut"),
            "envelope_use",
        ),
        (lambda: MicpGrid(domain="mine"), "domain"),
        (lambda: Micp(gap=-0.1), "gap"),
        (lambda: Micp(time_limit_s=-1.0), "time_limit_s"),
        (
            lambda: Micp(projection="up"),
            "projection",
        ),
    ],
)
def test_options_that_there_are_not_are_refused(make, message):
    with refuses(message):
        make()


def test_a_set_of_several_envelopes_is_refused(learned):
    two = replace(learned, envelopes=learned.envelopes * 2)
    with refuses("envelopes"):
        Micp(envelopes=two)


def test_a_solver_that_is_not_installed_is_named_with_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with refuses("solver", "[exact]"):
        Micp(solver="scip")


def test_it_prints_nothing(feasible, capfd):
    Micp(intervals=2).solve(feasible[0][0])
    assert capfd.readouterr() == ("", "")
