"""The programs that plan are those of the papers and their kin in cvxpy: every row is an equation of
them, and so are optima and rays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
import scipy.sparse as sp

from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.programs import ConicSolution, ConicStatus, Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.equilibrium.terms import Given
from stancekit.planners.problem import Problem
from stancekit.planners.projection.held import FixForces, FixToes, Linearised
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.lift import JointRelaxation, LeastGap, LiftProgram, near_nominal
from stancekit.planners.relaxation.mccormick import Boxed, McCormick, WithoutMoment, domain_of
from stancekit.planners.relaxation.micp import axes_of
from stancekit.planners.verify import check_certificate
from tests.planners.oracle import MODELS, OraclePrograms, solve_as

POSTURES = [("wall-3", 5), ("ground-3", 86), ("wall-5", 19)]
RAGGED = [(0, (3, 4, 5)), (2, (6, 3, 4, 3))]
COURSES = [(1, 1), (2, 2), (7, 2), (3, 3)]  # seed, frames
BOUNDED = [
    ("bounded", ("wall-3", 5)),
    ("bounded", (2, (6, 3, 4, 3))),
    ("bounded", (4, 1)),
    ("bounded", (3, 3)),
]
SOLED = [
    ("soled", ("wall-3", 5)),
    ("soled", (4, 1)),
    ("soled", (3, 3)),
    ("soled", ("bounded", (6, 2))),
]
PAIRED = [("paired", (3, 3)), ("paired", ("bounded", (6, 2)))]
PUSHED = [("pushed", (4, 1)), ("pushed", (3, 3)), ("pushed", ("soled", (3, 3)))]
LOADED = [
    ("loaded", w)
    for w in (("wall-3", 5), (2, (6, 3, 4, 3)), (4, 1), (3, 3), ("soled", (3, 3)), PUSHED[1])
]
PROBLEMS = [*POSTURES, *RAGGED, *COURSES, *BOUNDED, *SOLED, *PAIRED, *PUSHED, *LOADED]
SOLVED = [("ground-3", 86), BOUNDED[1], BOUNDED[3], SOLED[0], PAIRED[0], LOADED[0]]
Programme = tuple[Callable[..., object], tuple[object, ...]]


@pytest.fixture(scope="module")
def scaled(drawn, mixed, ragged, bounded, soled, paired) -> Callable[[tuple[object, ...]], Scaled]:
    """The problem of an entry of ``PROBLEMS``."""

    def find(which):
        if which[0] == "bounded":
            return bounded(find(which[1]), 7)
        if which[0] == "pushed":
            return pushed(find(which[1]))
        if which[0] == "loaded":
            return loaded_with_wrench(find(which[1]))
        if which[0] == "paired":
            return paired(find(which[1]), 9)
        if which[0] == "soled":
            return soled(find(which[1]), 8)
        if isinstance(which[0], str):
            return drawn(*which)
        return mixed(*which) if isinstance(which[1], tuple) else ragged(which[0], frames=which[1])

    return lambda which: Scaled.of(find(which))


def pushed(course: Problem) -> Problem:
    """The same with a push of a tenth of the weight in every stance, and toes drawn to where they
    are as it stands.
    """
    shoulders = np.array([limb.shoulder_m for limb in course.robot.limbs])
    standing = np.tile(shoulders + np.array([0.02, 0.01, -0.2]), (course.frames, 1, 1))
    weights = replace(course.weights, stance=0.3)
    return replace(course, push_n=0.1 * course.weight_n, weights=weights, standing_m=standing)


def loaded_with_wrench(problem: Problem) -> Problem:
    """The same with another force and moment on the body at every frame, up to a third of the
    weight.
    """
    unit = problem.weight_n * np.array([1.0, 1.0, 1.0, *(problem.length_scale_m,) * 3])
    wrench = np.random.default_rng(5).uniform(-0.3, 0.3, (problem.frames, 6)) * unit
    return (
        problem.posture_with(wrench=wrench[0])
        if problem.is_posture
        else replace(problem, wrench=wrench)
    )


@dataclass(frozen=True, eq=False)
class Answered:
    """A program, what it was loaded with, and what rows and oracle say."""

    where: str
    program: Any
    given: Given
    solutions: dict[str, ConicSolution]


def programs_of(
    scaled: Scaled, near: Callable[[Scaled, int], Point]
) -> Iterator[tuple[str, Programme, Given]]:
    """Every convex program for a problem, how to make it, and what it is loaded with."""
    one = scaled.chosen(np.array([numbers[-1] for numbers in scaled.which]))
    held = Given(one, near(one, 3))
    for least in [True] if scaled.weights is None else [True, False]:
        yield "lift", (LiftProgram, (scaled.layout, False, least)), Given(scaled)
        yield "fix-toes", (FixToes, (one.layout, False, least)), held
        yield "scp", (Linearised, (one.layout, least)), held
    yield "least gap", (LeastGap, (one.layout,)), held
    yield "fix-p", (FixToes, (one.layout, True, True)), held
    yield "fix-f", (FixForces, (one.layout,)), held
    if not scaled.layout.pushes:  # which envelopes do not know
        yield from p1_of(scaled)


def boxed(scaled: Scaled, axes: str, share: float) -> Envelope:
    """The middle part of what a problem implies: ``share`` of every side."""
    domain = domain_of(scaled, axes)
    middle, half = 0.5 * (domain.low + domain.high), 0.5 * share * (domain.high - domain.low)
    return Envelope(low=middle - half, high=middle + half)


def p1_of(scaled: Scaled) -> Iterator[tuple[str, Programme, Given]]:
    """P̄ and every form of P1 for a problem."""
    yield "p̄", (WithoutMoment, (scaled.layout,)), Given(scaled)
    yield "p̄ inner", (WithoutMoment, (scaled.layout, True)), Given(scaled)
    if scaled.layout.points:
        return
    one = scaled.chosen(np.array([numbers[-1] for numbers in scaled.which]))
    box = boxed(one, "contact", 0.4)
    for signed in (False, True):
        about = near_nominal(one, 0.5 * (box.low + box.high))
        yield (
            f"joint {signed}",
            (JointRelaxation, (one.layout, signed)),
            Boxed(one, about, boxes=(box,)),
        )
    allowed = np.ones((len(scaled.layout.stances), 2))
    allowed[0, 1] = 0.0
    for axes in ("contact", "world"):
        if axes == "contact" and axes_of(scaled) == "world":
            continue
        large, small = boxed(scaled, axes, 0.9), boxed(scaled, axes, 0.4)
        yield (
            f"p1 {axes}",
            (McCormick, (scaled.layout, axes, True, 1)),
            Boxed(scaled, boxes=(small,)),
        )
        if scaled.weights is not None:
            yield (
                f"hard {axes}",
                (McCormick, (scaled.layout, axes, False, 1)),
                Boxed(scaled, boxes=(large,)),
            )
            modes = Boxed(scaled, boxes=(small, large), allowed=allowed)
            yield f"modes {axes}", (McCormick, (scaled.layout, axes, False, 2)), modes


def left_over(term: cp.Constraint) -> np.ndarray:
    """A x − b of a group of rows, from the expressions of its equation."""
    if isinstance(term, cp.SOC):
        return -np.column_stack([part.value for part in term.args])
    return np.asarray(term.expr.value)


def at_random(program, model, given, seed: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """One point as the program has it, x, and as the model has it, with toes where their weights
    put them.
    """
    rng, columns = np.random.default_rng(seed), program.rows.columns
    x = rng.normal(size=program.rows.shape[1])
    for term in model.terms.values():
        for variable in term.variables():
            variable.value = x[columns[variable.name()]]
    if "toes" in columns:
        toes = np.zeros((given.scaled.layout.footholds, 3))
        weights = x[columns["weights"]]
        np.add.at(
            toes, given.scaled.layout.vertex_footholds, weights[:, None] * given.scaled.vertices
        )
        x[columns["toes"]] = toes
    return x, {name: left_over(term) for name, term in model.terms.items()}


@pytest.mark.parametrize("which", PROBLEMS, ids=str)
def test_every_row_is_an_equation_of_the_model(scaled, near, which):
    seen = set()
    for name, (make, key), given in programs_of(scaled(which), near):
        program = make(*key)
        model, groups = MODELS[make](given, *key[1:]), program.rows.groups
        x, expected = at_random(
            program, model, given, 0
        )  # rows are affine: two that agree at one such point agree
        hessian, q, matrix, b = loaded(program, given)
        found = matrix @ x - b
        assert set(groups) - {"toe"} == set(expected), name
        for group, rows in groups.items():
            against = expected.get(group, np.zeros(rows.shape))  # a toe is where its weights put it
            np.testing.assert_allclose(
                found[rows], against.reshape(rows.shape), atol=1e-12, err_msg=f"{name}: {group}"
            )
            seen.add(group)
        constant = sum(float(np.sum(fill(given))) for fill in program.rows._constants)
        assert 0.5 * x @ symmetric(hessian) @ x + q @ x + constant == pytest.approx(
            float(model.cost.value), abs=1e-11
        )
    assert ("bounded" in str(which)) == ("reach_rows" in seen)
    assert ("paired" in str(which)) == ("relative_reach" in seen)
    assert seen > {
        "balance",
        "reach",
        "cone",
        "most",
        "least",
        "ball",
        "above",
        "below",
        "one",
        "positive",
    }


def same(first: ConicSolution, second: ConicSolution, where: str) -> None:
    """Status, optimum, and bound."""
    assert first.status is second.status, where
    if first.status is ConicStatus.SOLVED:
        assert first.objective == pytest.approx(second.objective, abs=2e-7), where
        assert first.bound == pytest.approx(second.bound, abs=2e-7), where


@pytest.fixture(scope="module")
def answers(scaled, near) -> list[Answered]:
    """Every program of some problems, solved as rows and as cvxpy has it."""
    found = []
    for which in SOLVED:
        for name, (make, key), given in programs_of(scaled(which), near):
            program = make(*key)
            rows = program.rows
            theirs = solve_as(MODELS[make](given, *key[1:]), rows.columns, rows.groups)
            solutions = {"rows": rows.solve(given), "oracle": theirs}
            found.append(Answered(f"{name} {which}", program, given, solutions))
    return found


def test_rows_come_to_the_optima_of_the_models_and_refuse_the_same(answers):
    for answer in answers:
        same(*answer.solutions.values(), answer.where)
    statuses = [answer.solutions["rows"].status for answer in answers]
    assert statuses.count(ConicStatus.INFEASIBLE) > 5
    assert statuses.count(ConicStatus.SOLVED) > 30


def test_the_small_form_of_the_lift_is_the_whole_one(drawn):
    small = 0
    for seed in range(9):
        scaled = Scaled.of(drawn("wall-3", seed))
        if scaled.box_implied:
            given = Given(scaled)
            small += 1
            same(
                LiftProgram(scaled.layout, True, True).rows.solve(given),
                OraclePrograms().get(LiftProgram, scaled.layout, True, True).rows.solve(given),
                f"wall-3 {seed}",
            )
    assert small > 3


def in_rows(program, given, solution) -> tuple[np.ndarray, np.ndarray]:
    """x and z of a solution in the order of the rows; toes, where they are columns, and their rows'
    multipliers.
    """
    hessian, q, matrix, b = loaded(program, given)
    x, z = np.zeros(len(q)), np.zeros(len(b))
    for rows, values in ((program.rows.columns, x), (program.rows.groups, z)):
        for name in set(rows) - {"toes", "toe"}:
            values[rows[name]] = solution.value(name) if values is x else solution.dual(name)
    if "toes" in program.rows.columns:
        toes, toe = program.rows.columns["toes"], program.rows.groups["toe"]
        x[toes] = -(matrix @ x - b)[toe]
        objective = 0.0 if solution.status is ConicStatus.INFEASIBLE else q + symmetric(hessian) @ x
        z[toe] = -(objective + matrix.T @ z)[toes]
    return x, z


def loaded(program, given):
    """(P, q, A, b), the matrices as scipy has them."""
    hessian, q, matrix, b = program.rows.load(given)
    return as_scipy(hessian), q, as_scipy(matrix), b


def as_scipy(matrix):
    return sp.csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)


def symmetric(upper):
    """The whole of a matrix whose upper half is given."""
    whole = upper + upper.T
    whole.setdiag(upper.diagonal())
    return whole


@pytest.mark.parametrize("whose", ["rows", "oracle"])
def test_multipliers_are_optimal_whoever_found_them(answers, whose):
    """In the rows' own matrices: A'z + P x + q = 0 and z'(b − A x) = 0; or a ray, A'z = 0 and b'z <
    0.
    """
    for answer in answers:
        solution = answer.solutions[whose]
        hessian, q, matrix, b = loaded(answer.program, answer.given)
        x, z = in_rows(answer.program, answer.given, solution)
        if solution.status is ConicStatus.INFEASIBLE:
            assert b @ z < 0.0
            assert np.abs(matrix.T @ z).max() < 1e-6 * -(b @ z), answer.where
        else:
            slope = q + symmetric(hessian) @ x + matrix.T @ z
            assert np.abs(slope).max() < 1e-5, answer.where
            assert abs(z @ (b - matrix @ x)) < 1e-5, answer.where


def test_multipliers_of_rows_and_oracle_prove_the_same(drawn):
    proved = 0
    for name, seeds in {
        "wall-3": (0, 3, 12, 20, 225),
        "ground-3": (37, 86, 115),
        "wall-5": (7, 19, 45),
    }.items():
        for seed in seeds:
            problem = drawn(name, seed)
            scaled = Scaled.of(problem)
            ours, theirs = (
                programs.get(LiftProgram, scaled.layout, False, True).solve(scaled)
                for programs in (Programs(), OraclePrograms())
            )
            bounds = [
                check_certificate(
                    Certificate(tree=np.zeros((1, 5)), multipliers=answer.multipliers[None]).of(
                        problem
                    )
                )
                for answer in (ours, theirs)
            ]
            assert bounds[0].accepted == bounds[1].accepted == (ours.bound > 1e-4)
            assert bounds[0].figures["lower_bound"] == pytest.approx(
                bounds[1].figures["lower_bound"], abs=1e-6
            )
            proved += bounds[0].accepted
    assert proved > 3


def test_rays_of_rows_and_oracle_refute_a_course(ragged):
    refuted = 0
    for seed in range(8):
        course = ragged(seed, frames=2)
        scaled = Scaled.of(course)
        for programs in (Programs(), OraclePrograms()):
            answer = programs.get(LiftProgram, scaled.layout, False, False).solve(scaled)
            if answer.status is ConicStatus.INFEASIBLE:
                proof = Certificate(tree=np.zeros((1, 5)), multipliers=answer.multipliers[None])
                assert check_certificate(proof.of(course)).accepted, f"{programs} {seed}"
                refuted += 1
    assert refuted >= 4
    assert refuted % 2 == 0


@pytest.mark.parametrize("projection", ["fix-p", "fix-f", "fix-toes", "scp", "lift-fix-p"])
def test_a_projection_ends_on_the_residual_of_the_oracle(scaled, near, projection):
    rows, oracle = Programs(), OraclePrograms()
    for which in [("wall-3", 5), ("ground-3", 1), (2, 2)]:
        problem = scaled(which)
        one = problem.chosen(np.array([numbers[0] for numbers in problem.which]))
        start = near(one, 1)
        ours, theirs = (
            project(programs, projection, one, start, steps=1) for programs in (rows, oracle)
        )
        assert ours.solves == theirs.solves
        if np.isfinite(ours.residual):
            assert ours.residual == pytest.approx(theirs.residual, abs=2e-6)
        else:
            assert np.isinf(theirs.residual)
