"""Programs written as rows, against closed forms, optimality conditions and cvxpy's solve of the
same program.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import clarabel
import cvxpy as cp
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings, strategies as st

from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.rows import Rows, solver_settings
from stancekit.planners.equilibrium.scaled import Point, Scaled, skew
from stancekit.planners.relaxation.papers import Model
from stancekit.planners.search.answer import plan_of
from tests.planners.oracle import solve, solve_as, with_choice

SEEDS = st.integers(0, 2**32 - 1)
ROWS, COLUMNS = 7, 3


class LinearProgram:
    """min c·x, A x ≤ b, with data made from its own optimum: COLUMNS active rows, multipliers of
    0.5 and more.
    """

    def __init__(self, keep=True):
        self.rows = rows = Rows[dict](keep=keep)
        x, below = rows.variable("x", COLUMNS), rows.at_most("below", ROWS)
        rows.put(below[:, None], x, lambda d: d["A"])
        rows.right(below, lambda d: d["b"])
        rows.linear(x, lambda d: d["c"])

    @staticmethod
    def data(seed):
        """Return (values, optimum, multipliers)."""
        rng = np.random.default_rng(seed)
        a, optimum = rng.normal(size=(ROWS, COLUMNS)), rng.normal(size=COLUMNS)
        a[:COLUMNS] = np.linalg.qr(a[:COLUMNS])[0]
        slack, multipliers = np.zeros(ROWS), np.zeros(ROWS)
        slack[COLUMNS:] = rng.uniform(0.5, 2.0, ROWS - COLUMNS)
        multipliers[:COLUMNS] = rng.uniform(0.5, 2.0, COLUMNS)
        return {"A": a, "b": a @ optimum + slack, "c": -a.T @ multipliers}, optimum, multipliers


class Blend:
    """Every kind of group at once: an equality, bounds, a batch of cones, squares alone and of
    differences.
    """

    def __init__(self, keep=True):
        self.rows = rows = Rows[dict](keep=keep)
        x, y = rows.variable("x", 2, 3), rows.variable("y", 1)
        plane = rows.equal("plane", 1)
        rows.put(plane, x, lambda d: d["normal"])
        rows.put(plane, y, 1.0)
        rows.right(plane, lambda d: d["level"])
        floor = rows.at_most("floor", 2, 3)
        rows.put(floor, x, -1.0)
        rows.right(floor, lambda d: -d["low"])
        balls = rows.cones("balls", 2, 4)
        rows.put(balls[:, 1:], x, -1.0)
        rows.right(balls[:, 0], lambda d: d["radii"])
        rows.right(balls[:, 1:], lambda d: -d["centres"])
        roof = rows.at_most("roof", 1)
        rows.put(roof, y, 1.0)
        rows.put(roof, x[0, :1], 1.0)
        rows.right(roof, 0.3)
        rows.square(x, None, lambda d: d["stiff"])
        rows.square(x[1], x[0], lambda d: 0.25)
        rows.square(y, None, lambda d: 0.5)
        rows.linear(x, lambda d: -d["point"])
        rows.linear(y, lambda d: -d["pull"], lambda d: 3.0 * d["pull"])

    @staticmethod
    def model(d):
        """The same, as one would say it."""
        x, y = cp.Variable((2, 3), name="x"), cp.Variable(1, name="y")
        cost = d["stiff"] * cp.sum_squares(x) + 0.25 * cp.sum_squares(x[1] - x[0]) + 0.5 * y[0] ** 2
        return Model(
            cost=cost - cp.sum(cp.multiply(d["point"], x)) - d["pull"] * y[0] + 3.0 * d["pull"],
            terms={
                "plane": cp.sum(cp.multiply(d["normal"], x)) + y == d["level"],
                "floor": x >= d["low"],
                "balls": cp.SOC(d["radii"], x - d["centres"], axis=1),
                "roof": y + x[0, 0] <= 0.3,
            },
            plan=None,
        )

    @staticmethod
    def data(seed):
        rng = np.random.default_rng(seed)
        centres = rng.uniform(-0.2, 0.2, (2, 3))
        return {
            "point": rng.normal(size=(2, 3)),
            "normal": rng.uniform(0.5, 1.0, (2, 3)),
            "level": rng.uniform(0.5, 1.0),
            "low": centres - rng.uniform(0.2, 0.6, (2, 3)),
            "centres": centres,
            "radii": rng.uniform(0.4, 0.9, 2),
            "pull": rng.normal(),
            "stiff": rng.uniform(0.3, 0.7),
        }


KEPT = pytest.mark.parametrize("keep", [True, False], ids=["kept", "anew"])


@given(seed=SEEDS, keep=st.booleans())
@settings(max_examples=30)
def test_a_linear_program_is_solved_to_its_closed_form(seed, keep):
    program, (values, optimum, multipliers) = LinearProgram(keep), LinearProgram.data(seed)
    solution = program.rows.solve(values)
    assert solution.solved
    np.testing.assert_allclose(solution.value("x"), optimum, atol=1e-6)
    np.testing.assert_allclose(solution.dual("below"), multipliers, atol=1e-6)
    assert solution.objective == pytest.approx(values["c"] @ optimum, abs=1e-6)
    assert solution.bound == pytest.approx(solution.objective, abs=1e-6)
    assert solution.bound <= solution.objective


@given(seed=SEEDS)
@settings(max_examples=20)
def test_the_lagrangian_is_positive_at_no_point_of_the_program(seed):
    program, (values, optimum, multipliers) = LinearProgram(), LinearProgram.data(seed)
    constant, slope = program.rows.lagrangian(values, program.rows.solve(values))
    assert constant == pytest.approx(-values["b"] @ multipliers, abs=1e-5)
    np.testing.assert_allclose(slope, -values["c"], atol=1e-6)  # stationary: c + A'z = 0
    toward = optimum - np.linalg.solve(
        values["A"][:COLUMNS], np.ones(COLUMNS)
    )  # off all active rows at once
    steps = optimum + np.linspace(0.0, 1.0, 11)[:, None] * (toward - optimum)
    inside = (steps @ values["A"].T <= values["b"] + 1e-9).all(axis=1)
    found = constant + steps @ slope
    assert inside[0]
    assert np.max(found[inside]) <= 1e-5
    np.testing.assert_allclose(found, -np.linspace(0.0, 1.0, 11) * multipliers.sum(), atol=1e-5)


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.floats(0.1, 3.0),
)
@settings(max_examples=30)
def test_the_lowest_point_of_a_ball_is_found(cost, centre, radius):
    cost, centre = np.array(cost), np.array(centre)
    length = np.linalg.norm(cost)
    if length < 0.1:
        return
    rows = Rows[None](keep=True)
    x, ball = rows.variable("x", 3), rows.cones("ball", 1, 4)
    rows.put(ball[0, 1:], x, -1.0)
    rows.right(ball[0, 0], radius)
    rows.right(ball[0, 1:], lambda _: -centre)
    rows.linear(x, lambda _: cost)
    solution = rows.solve(None)
    np.testing.assert_allclose(solution.value("x"), centre - radius * cost / length, atol=1e-5)
    np.testing.assert_allclose(solution.dual("ball"), [[length, *cost]], atol=1e-5)


@KEPT
@pytest.mark.parametrize("seed", range(8))
def test_value_point_and_multipliers_of_every_group_are_those_of_cvxpy(seed, keep):
    solution, theirs = (
        Blend(keep).rows.solve(Blend.data(seed)),
        solve(Blend.model(Blend.data(seed))),
    )
    assert solution.objective == pytest.approx(theirs.objective, abs=1e-7)
    assert solution.bound == pytest.approx(theirs.bound, abs=1e-7)
    for name in ("x", "y"):
        np.testing.assert_allclose(
            solution.value(name), theirs.value(name), atol=1e-4
        )  # scaled otherwise, a flat cost
    for name in ("plane", "floor", "balls", "roof"):
        np.testing.assert_allclose(solution.dual(name), theirs.dual(name), atol=1e-4, err_msg=name)
    assert (
        np.abs(solution.dual("plane")) > 1e-3
    )  # signs are seen only where there is something to see


def test_all_groups_bind_somewhere_among_the_seeds():
    solutions = [Blend().rows.solve(Blend.data(seed)) for seed in range(8)]
    for name in ("plane", "floor", "balls", "roof"):
        assert max(np.max(np.abs(solution.dual(name))) for solution in solutions) > 1e-2


@pytest.mark.parametrize("seed", range(4))
def test_cvxpys_own_answer_is_the_models(seed):
    model = Blend.model(Blend.data(seed))
    optimum = model.problem.solve(solver=cp.CLARABEL)
    assert solve(model).objective == pytest.approx(optimum, abs=1e-8)


@KEPT
def test_an_answer_does_not_depend_on_what_was_solved_before(keep):
    def bits(solution):
        return (
            solution.status,
            solution.x.tobytes(),
            solution.z.tobytes(),
            solution.objective,
            solution.iterations,
        )

    program, impossible = Blend(keep), Blend.data(3) | {"level": 100.0}
    fresh = bits(Blend(keep).rows.solve(Blend.data(5)))
    for history in ([1], [2, 7, 4], [5, 5], [3, 6]):
        for seed in history:
            program.rows.solve(Blend.data(seed))
        assert bits(program.rows.solve(Blend.data(5))) == fresh
        assert program.rows.solve(impossible).status is ConicStatus.INFEASIBLE
        assert bits(program.rows.solve(Blend.data(5))) == fresh


@KEPT
@pytest.mark.parametrize("seed", range(5))
def test_infeasible_data_comes_with_a_farkas_ray_from_either(seed, keep):
    """b·z < 0, A'z = 0 and z in the dual cone refute A x + s = b with s in the cone."""
    data = Blend.data(seed)
    data |= {"low": data["centres"] + 1.0}  # all of the floor is outside the balls
    program = Blend(keep)
    _, _, matrix, b = program.rows.load(data)
    a = sp.csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)
    for solution in (
        program.rows.solve(data),
        solve_as(Blend.model(data), program.rows.columns, program.rows.groups),
    ):
        assert solution.status is ConicStatus.INFEASIBLE
        ray = solution.z / -(b @ solution.z)
        assert b @ solution.z < 0.0
        assert np.max(np.abs(a.T @ ray)) < 1e-6
        balls, scale = solution.dual("balls"), np.max(np.abs(solution.z))
        assert np.all(np.linalg.norm(balls[:, 1:], axis=1) <= balls[:, 0] + 1e-8 * scale)
        assert np.all(solution.dual("floor") >= -1e-8 * scale)
        assert np.all(solution.dual("roof") >= -1e-8 * scale)


def test_an_unbounded_program_is_neither_solved_nor_infeasible():
    no_rows = LinearProgram.data(2)[0] | {"A": np.zeros((ROWS, COLUMNS)), "b": np.full(ROWS, 5.0)}
    assert LinearProgram().rows.solve(no_rows).status is ConicStatus.FAILED


@KEPT
def test_zeros_in_the_data_keep_their_place_in_the_pattern(keep):
    program, patterns = Blend(keep), []
    for scale in (0.0, 1.0):
        a = program.rows.load(Blend.data(0) | {"normal": np.full((2, 3), scale)})[2]
        patterns.append((a.indptr.tolist(), a.indices.tolist()))
    assert patterns[0] == patterns[1]


class GivesUp:
    """A solver that ends without an answer."""

    def update(self, **data):
        pass

    def solve(self):
        none = [float("nan")]
        return SimpleNamespace(
            status=clarabel.SolverStatus.NumericalError,
            x=none,
            z=none,
            obj_val=0.0,
            obj_val_dual=0.0,
            iterations=0,
        )


@pytest.mark.parametrize("seed", range(3))
def test_where_the_fast_solver_gives_up_a_careful_one_is_asked(monkeypatch, seed):
    program = Blend()
    expected = program.rows.solve(Blend.data(seed))
    monkeypatch.setattr(program.rows, "_solver", GivesUp())
    solution = program.rows.solve(Blend.data(seed))
    assert solution.status is ConicStatus.SOLVED
    assert solution.objective == pytest.approx(expected.objective, abs=1e-7)
    np.testing.assert_allclose(solution.x, expected.x, atol=1e-4)
    assert program.rows.solve(Blend.data(seed) | {"level": 100.0}).status is ConicStatus.INFEASIBLE


def test_the_solver_runs_on_one_thread_without_presolve_and_without_a_clock():
    chosen = solver_settings(equilibrate=True)
    assert (chosen.max_threads, chosen.presolve_enable, chosen.iterative_refinement_enable) == (
        1,
        False,
        False,
    )
    assert chosen.time_limit > 1e9


def same(one, other):
    """Number for number."""
    assert one.layout == other.layout
    for name in (
        "vertices",
        "frames",
        "friction",
        "shoulders",
        "reach",
        "force_min",
        "force_max",
        "com",
        "progress",
    ):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def without(course, opened):
    """The course with these candidates alone."""
    footholds = tuple(
        replace(
            put,
            candidates=tuple(
                patch for patch, on in zip(put.candidates, row, strict=False) if on > 0.0
            ),
        )
        for put, row in zip(course.footholds, opened, strict=True)
    )
    return replace(course, footholds=footholds)


@given(SEEDS)
@settings(max_examples=40)
def test_a_part_of_the_candidates_is_the_problem_made_without_the_others(rough, seed):
    rng = np.random.default_rng(seed)
    course = rough(int(rng.integers(8)), frames=int(rng.integers(1, 4)), regions=3)
    scaled = Scaled.of(course)
    opened = scaled.opened() * (rng.random(scaled.opened().shape) < 0.6)
    for p in np.flatnonzero(opened.sum(axis=1) == 0.0):
        opened[p, rng.choice(np.flatnonzero(scaled.opened()[p]))] = 1.0
    part = scaled.only(opened)
    same(part, Scaled.of(without(course, opened)))
    np.testing.assert_array_equal(part.opened(), opened)
    assert part.which == tuple(tuple(int(r) for r in np.flatnonzero(row)) for row in opened)
    fewer = opened * np.eye(scaled.options)[opened.argmax(axis=1)]
    same(part.only(fewer), scaled.only(fewer))  # parts of parts
    same(scaled.chosen(opened.argmax(axis=1)), scaled.only(fewer))
    same(part.chosen(opened.argmax(axis=1)), Scaled.of(with_choice(course, opened.argmax(axis=1))))


def test_all_of_them_are_the_problem_itself(rough):
    scaled = Scaled.of(rough(0, regions=3))
    assert scaled.only(scaled.opened()) is scaled
    assert scaled.only(np.ones_like(scaled.opened())) is scaled


def test_values_of_candidates_stand_where_their_numbers_say_in_parts_too(rough):
    course = rough(0, regions=3)
    scaled = Scaled.of(course)
    friction = scaled.by_candidate(scaled.friction, -1.0)
    for p, put in enumerate(course.footholds):
        for r in range(scaled.options):
            assert friction[p, r] == (
                put.candidates[r].friction if r < len(put.candidates) else -1.0
            )
    last = np.array([len(put.candidates) - 1 for put in course.footholds])
    assert last.max() == 2
    part = scaled.chosen(last)
    table = part.by_candidate(part.friction, -1.0)
    for p, put in enumerate(course.footholds):
        assert table[p, last[p]] == put.candidates[last[p]].friction
        assert (np.delete(table[p], last[p]) == -1.0).all()


def test_a_piece_takes_the_place_of_its_candidate_and_of_no_other(rough):
    scaled = Scaled.of(rough(3, regions=3))
    for candidate in range(1, len(scaled.pieces)):
        border = scaled.pieces[candidate][:3] * 0.5
        part = scaled.with_piece(candidate, border)
        for k, (mine, theirs) in enumerate(zip(part.pieces, scaled.pieces, strict=True)):
            np.testing.assert_array_equal(mine, border if k == candidate else theirs)
        assert part.which == scaled.which
        np.testing.assert_array_equal(part.friction, scaled.friction)
    kept = scaled.with_piece(1, 0.5 * scaled.pieces[1])
    assert kept.layout is scaled.layout  # the program of the layout is the same


def test_force_boxes_are_those_that_are_given_and_nothing_else_changes(rough):
    scaled = Scaled.of(rough(1, regions=2))
    low, high = scaled.force_min + 0.1, scaled.force_max - 0.1
    part = scaled.with_force_box(low, high)
    np.testing.assert_array_equal(part.force_min, low)
    np.testing.assert_array_equal(part.force_max, high)
    same(part.with_force_box(scaled.force_min, scaled.force_max), scaled)


def test_what_is_worked_out_once_is_worked_out_anew_for_a_part(rough):
    """Arms, pieces and whether the box is implied are kept on a problem, and must not be handed on
    to its parts.
    """
    scaled = Scaled.of(rough(0, regions=2))
    whole = (scaled.arms, scaled.pieces, scaled.patches, scaled.box_implied)
    part = scaled.with_piece(1, scaled.pieces[1] + 0.01).with_force_box(
        scaled.force_min + 0.01, scaled.force_max
    )
    assert not part.box_implied
    assert whole[3]
    vertex = part.layout.contact_vertices[1]
    for row, v in enumerate(vertex):
        expected = np.cross(part.vertices[v], part.frames[part.layout.vertex_candidates[v]].T).T
        np.testing.assert_allclose(part.arms[row], expected, atol=1e-15)
    np.testing.assert_array_equal(
        part.patches[1, 0], part.vertices[part.layout.vertex_candidates == 1][0]
    )


def test_a_toe_that_stands_is_a_patch_of_one_point(rough):
    course = rough(1)
    scaled = Scaled.of(course)
    assert scaled.layout.corners[0] == (1,)
    np.testing.assert_array_equal(
        scaled.pieces[0], course.footholds[0].toe_m[None] / course.length_scale_m
    )


def test_the_layout_says_who_stands_on_what_and_who_carries(rough):
    course = rough(2, frames=3, regions=2)
    layout = Scaled.of(course).layout
    rows = [
        (s, i, course.holds[stance.frame, i])
        for s, stance in enumerate(course.stances)
        for i in stance.limbs
    ]
    np.testing.assert_array_equal(np.array(layout.contacts).T, rows)
    np.testing.assert_array_equal(layout.stance_frames, [stance.frame for stance in course.stances])
    moved = [
        (course.holds[k - 1, i], course.holds[k, i])
        for k in range(1, 3)
        for i in range(4)
        if course.holds[k - 1, i] != course.holds[k, i]
    ]
    np.testing.assert_array_equal(layout.moves, moved)
    under, vertices = layout.under(np.array([3, 0, 3]))
    starts = np.cumsum([0, *(sum(counts) for counts in layout.corners)])
    expected = [(at, v) for at, p in enumerate((3, 0, 3)) for v in range(starts[p], starts[p + 1])]
    np.testing.assert_array_equal(np.column_stack([under, vertices]), expected)


@pytest.mark.parametrize("seed", range(3))
def test_units_come_off_and_on_again(mixed, seed):
    problem = replace(mixed(seed, (3, 4, 5)), force_scale_n=37.0, length_scale_m=0.41)
    scaled, rng = Scaled.of(problem), np.random.default_rng(seed)
    com, toes, forces = rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    point = Point(com=com[None], rotation=np.zeros((1, 3)), toes=toes, forces=forces, residual=0.0)
    posture = plan_of(problem, scaled, scaled.numbers, point)
    np.testing.assert_allclose(posture.com_m, 0.41 * com[None])
    for contact, mine, force in zip(problem.contacts, posture.forces_n[0], forces, strict=True):
        n, y, z = contact.patch.frame.T
        np.testing.assert_allclose(
            mine, 37.0 * (force[0] * n + force[1] * y + force[2] * z), atol=1e-12
        )
    np.testing.assert_allclose(scaled.point(posture), np.hstack([toes - com, forces]), atol=1e-12)
    assert scaled.weight == pytest.approx(98.1 / 37.0)
    v, w = rng.normal(size=(2, 4, 3))
    np.testing.assert_allclose(np.einsum("kij,kj->ki", skew(v), w), np.cross(v, w), atol=1e-14)
