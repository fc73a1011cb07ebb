"""MICP over key frames: the grid, cones as planes, squares as tangents, regions as binaries, and claims."""

from __future__ import annotations

from dataclasses import replace
from importlib import util

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.keyframes.methods import METHODS, make_course_planner
from stancekit.planners.keyframes.micp import KNOTS, CourseMicp, MicpCoursePlanner, planes, without_squares
from stancekit.planners.keyframes.products import domain_of
from stancekit.planners.keyframes.scaled import ScaledCourse
from stancekit.planners.keyframes.twostage import CourseModels, TwoStageCoursePlanner
from stancekit.planners.outcome import InvalidInput, Status
from stancekit.planners.relaxation.boxes import boxes_of
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.scene.course_spec import read_course

NEEDS_SCIP = pytest.mark.skipif(util.find_spec("pyscipopt") is None, reason="needs the exact extra")
NEEDS_GUROBI = pytest.mark.skipif(util.find_spec("gurobipy") is None, reason="needs the exact extra")


@pytest.fixture(scope="module")
def models():
    return CourseModels()


@pytest.fixture(scope="module")
def walls():
    return read_course("walls", frames=1)


@pytest.fixture(scope="module")
def learned(walls):
    """A box for the legs of wall-3 such as is learned, written down: the mirror image of the course's own tripod."""
    problem = read_course("walls", frames=3).posture_problem(
        replace(read_course("walls", frames=3).stances[1], limbs=(3, 5, 1)), np.zeros(12, dtype=int)
    )
    assert problem.legs == ("RF", "RR", "LM")
    low = np.array([[0.0, -0.75, -0.25, 0.2, -0.3, 0.0], [-0.5, -0.75, -0.25, 0.2, -0.3, 0.0],
                    [-0.25, 0.55, -0.25, 0.4, -0.3, 0.2]])  # fmt: skip
    high = np.array([[0.5, -0.5, 0.25, 0.9, 0.3, 0.6], [0.0, -0.5, 0.25, 0.9, 0.3, 0.6],
                     [0.25, 0.8, 0.25, 1.0, 0.3, 0.8]])  # fmt: skip
    return EnvelopeSet.for_problems("wall-3", [problem], [Envelope(low=low, high=high)])


def net_moment(course, point):
    """Largest component of Σ (q − c) × C f over stances, contact by contact."""
    worst, row = 0.0, 0
    for stance in course.stances:
        total = np.zeros(3)
        for limb in stance.limbs:
            placement = course.holds[stance.frame, limb]
            world = course.placements[placement].candidates[0].frame @ point.forces[row]
            total += np.cross(point.toes[placement] - point.com[stance.frame], world)
            row += 1
        worst = max(worst, np.abs(total).max())
    return worst


@pytest.mark.parametrize("solver", ["highs", pytest.param("scip", marks=NEEDS_SCIP)])
def test_a_claim_becomes_a_plan_that_the_verifier_accepts(solver, walls, models):
    outcome = MicpCoursePlanner(solver=solver, models=models, time_limit_s=60.0).solve(walls)
    assert (outcome.status, outcome.claim) == (Status.FEASIBLE, "feasible")
    assert outcome.details["binaries"] == 3 * 6 * 2  # 3 limbs carry, 6 components each, log₂ 4 binaries a component


def test_binaries_grow_with_the_limbs_that_carry():
    course = read_course("walls", frames=4)
    scaled = ScaledCourse.of(course)
    program = CourseMicp(scaled, domain_of(scaled, "contact"), axes="contact")
    carrying = sum(len(stance.limbs) for stance in course.stances)
    assert program.figures["binaries"] == 12 * carrying == 252


@pytest.mark.parametrize("use", ["rows", "shrink"])
def test_an_envelope_confines_the_grids_point(use, walls, learned):
    scaled = ScaledCourse.of(walls)
    (box,) = boxes_of(scaled.course, learned)
    answer = MicpCoursePlanner(envelopes=learned, envelope_use=use).program(scaled).solve(60.0)
    assert answer.claim == "feasible"
    frame, limbs = scaled.layout.stances[0]
    p = answer.point.toes[[walls.holds[frame, limb] for limb in limbs]] - answer.point.com[frame]
    point = np.hstack([p, answer.point.forces])
    assert np.all(point >= box.low - 1e-6)
    assert np.all(point <= box.high + 1e-6)
    assert answer.residual == pytest.approx(net_moment(walls, answer.point), abs=1e-6)


def test_a_finer_grid_leaves_less_of_the_moments(walls, learned):
    scaled = ScaledCourse.of(walls)
    (box,) = boxes_of(scaled.course, learned)
    cells = {k: float(np.max(box.high - box.low) / k) for k in (1, 8)}
    for intervals, width in cells.items():
        planner = MicpCoursePlanner(envelopes=learned, envelope_use="shrink", intervals=intervals)
        answer = planner.program(scaled).solve(60.0)
        assert answer.claim == "feasible"
        # |m − p f| ≤ (cell of p)(cell of f)/4, and six such products make a component of the moments of three limbs
        assert answer.residual <= 6.0 * width**2 / 4.0 + 1e-6


def test_an_envelope_out_of_reach_is_a_claim_of_infeasible_that_proves_nothing(walls, learned):
    box = learned.envelopes[0]
    up = np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0])
    away = replace(learned, envelopes=(Envelope(low=box.low + up, high=box.high + up),))
    outcome = MicpCoursePlanner(envelopes=away).solve(walls)
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "infeasible")
    assert "highs says infeasible; neither a certificate" in outcome.message


def test_regions_are_chosen_by_binaries(models):
    course = read_course("icy-walls", frames=1)
    outcome = MicpCoursePlanner(models=models, time_limit_s=60.0).solve(course)
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert outcome.details["binaries"] == 36 + 4 * 6
    carrying = [course.holds[0, limb] for limb in course.stances[0].limbs]
    assert any(len({patch.friction for patch in course.placements[p].candidates}) == 2 for p in carrying)
    assert all(course.patch(p, outcome.plan.choice).friction > 0.0 for p in carrying)  # three limbs, all needed


def test_minimising_the_objective_bounds_it_from_below(walls, models):
    course = replace(walls, goal_m=walls.goal_m + np.array([0.0, 0.0, 0.2]))  # out of the radius about the start
    best = TwoStageCoursePlanner(models=models).solve(course)
    outcome = MicpCoursePlanner(gap=0.05, models=models, time_limit_s=60.0).solve(course)
    assert best.objective == pytest.approx((0.2 - course.com_radius_m[0]) ** 2, rel=1e-3)
    assert outcome.status is Status.FEASIBLE
    assert outcome.objective == pytest.approx(best.objective, rel=0.05, abs=1e-4)


def test_planes_stand_around_or_inside_cones():
    rng = np.random.default_rng(0)
    for size in (2, 3):
        radius, vectors = cp.Variable(40), cp.Variable((size, 40))
        rows = {kind: planes(cp.SOC(radius, vectors, axis=0), kind) for kind in ("outer", "inner")}
        vectors_at = rng.normal(size=(size, 40))
        norm = np.linalg.norm(vectors_at, axis=0)
        for kind, share, inside in (("outer", 1.0, True), ("inner", 1.0 / np.cos(np.pi / 16) ** 2 + 1e-6, True),
                                    ("outer", 0.96, False), ("inner", 0.999, False)):  # fmt: skip
            held = [radius == share * norm, vectors == vectors_at]
            problem = cp.Problem(cp.Minimize(0), [*held, *rows[kind]])
            problem.solve(solver=cp.CLARABEL)
            assert (problem.status == cp.OPTIMAL) == inside, (size, kind, share)


def test_tangents_are_below_squares_and_close():
    rng = np.random.default_rng(1)
    line = cp.Variable((4, 3))
    cost = 2.0 * cp.sum_squares(line) + 0.5 * cp.sum_squares(line[1:] - line[:-1])
    linear, rows = without_squares(cost)
    assert KNOTS[0] == 0.0
    for _ in range(5):
        at = rng.uniform(-0.17, 0.17, (4, 3))  # differences up to .34
        problem = cp.Problem(cp.Minimize(linear), [*rows, line == at])
        problem.solve(solver=cp.HIGHS)
        exact = 2.0 * np.sum(at**2) + 0.5 * np.sum(np.diff(at, axis=0) ** 2)
        assert exact - 0.0025 * (2.0 * 12 + 0.5 * 9) <= problem.value <= exact + 1e-9


@NEEDS_GUROBI
def test_gurobis_free_licence_says_that_the_program_is_too_large(models):
    outcome = MicpCoursePlanner(solver="gurobi", models=models).solve(read_course("walls", frames=4))
    assert outcome.status is not Status.INFEASIBLE
    if outcome.status is Status.UNDECIDED:
        assert "its free licence takes 2000 variables" in outcome.message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"solver": "cplex"}, "solver: expected one of highs, scip, gurobi, got 'cplex'"),
        ({"intervals": 3}, "intervals: expected 1 or more, and a power of two for 'log', got 3"),
        ({"cones": "exact"}, "cones: expected outer, inner, or exact for another solver than highs, got 'exact'"),
        ({"domain": "mine"}, "domain: expected one of course, unit, got 'mine'"),
        ({"gap": -0.1}, "gap: expected a number in"),
        ({"time_limit_s": 0.0}, "time_limit_s: expected a number above 0"),
    ],
)
def test_options_that_there_are_not(options, message):
    with pytest.raises(InvalidInput, match=message.replace("[", r"\[")):
        MicpCoursePlanner(**options)


def test_every_planner_is_made_by_its_name(learned):
    modes = Modes(names=("wall",), boxes=learned)
    assert [make_course_planner(name).name for name in METHODS] == list(METHODS)
    assert make_course_planner("two-stage", envelopes=learned).envelopes is learned
    assert make_course_planner("micp", envelopes=learned).envelopes is learned
    for arguments, message in (
        ({"name": "best"}, "planner: expected one of two-stage, micp"),
        ({"name": "two-stage", "relaxation": "boxes"}, "relaxation: expected one of lift, envelope"),
        ({"name": "two-stage", "relaxation": "envelope"}, "envelopes: expected an envelope or modes"),
        ({"name": "two-stage", "relaxation": "lift", "envelopes": learned}, "envelopes: expected none for the lift"),
        ({"name": "nlp", "relaxation": "lift"}, "relaxation: expected none for nlp"),
        ({"name": "exact", "envelopes": learned}, "envelopes: expected none for exact"),
        ({"name": "micp", "envelopes": modes}, "envelopes: expected one envelope for micp, got modes"),
    ):
        with pytest.raises(InvalidInput, match=message):
            make_course_planner(**arguments)
