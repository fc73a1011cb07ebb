"""Compiled models against closed forms, finite differences and cvxpy's own solve of the same model."""

from __future__ import annotations

from types import SimpleNamespace

import clarabel
import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stancekit.planners.conic import ConicModel, ConicStatus, solver_settings
from stancekit.planners.contact.lift import LiftModel, lift_values
from stancekit.planners.contact.relax import McCormick, p1_values
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.relaxation.envelope import Envelope

SEEDS = st.integers(0, 2**32 - 1)
ROWS, COLUMNS = 7, 3


def parameters(problem):
    return {p.name(): p for p in problem.parameters()}


def put(problem, values):
    """Give cvxpy's own parameters these values."""
    for name, parameter in parameters(problem).items():
        parameter.value = np.asarray(values[name], dtype=float).reshape(parameter.shape)


class LinearProgram:
    """min c·x, A x ≤ b, with data made from its own optimum: COLUMNS active rows, multipliers of 0.5 and more."""

    def __init__(self):
        self.x = cp.Variable(COLUMNS, name="x")
        a, b = cp.Parameter((ROWS, COLUMNS), name="A"), cp.Parameter(ROWS, name="b")
        c = cp.Parameter(COLUMNS, name="c")
        self.rows = a @ self.x <= b
        self.problem = cp.Problem(cp.Minimize(c @ self.x), [self.rows])
        self.model = ConicModel(self.problem, equilibrate=self.data(0)[0], duals={"rows": self.rows})

    @staticmethod
    def data(seed):
        """Return (values, optimum, multipliers)."""
        rng = np.random.default_rng(seed)
        a, optimum = rng.normal(size=(ROWS, COLUMNS)), rng.normal(size=COLUMNS)
        a[:COLUMNS] = np.linalg.qr(a[:COLUMNS])[0]
        slack, multipliers = np.zeros(ROWS), np.zeros(ROWS)
        slack[COLUMNS:] = rng.uniform(0.5, 2.0, ROWS - COLUMNS)
        multipliers[:COLUMNS] = rng.uniform(0.5, 2.0, COLUMNS)
        values = {"A": a, "b": a @ optimum + slack, "c": -a.T @ multipliers}
        return values, optimum, multipliers


class Blend:
    """Every kind of cone at once: a parametrised quadratic program with an equality, bounds and a batch of SOCs."""

    NAMES = ("point", "normal", "level", "low", "centres", "radii", "pull")

    def __init__(self):
        self.x, self.y = cp.Variable((2, 3), name="x"), cp.Variable(name="y")
        shapes = {"point": (2, 3), "normal": (2, 3), "level": (), "low": (2, 3), "centres": (3, 2), "radii": 2}
        p = {name: cp.Parameter(shape, name=name) for name, shape in shapes.items()}
        pull = cp.Parameter(name="pull")
        self.plane = cp.sum(cp.multiply(p["normal"], self.x)) + self.y == p["level"]
        self.floor = self.x >= p["low"]
        self.balls = cp.SOC(p["radii"], self.x.T - p["centres"], axis=0)
        self.roof = self.y + self.x[0, 0] <= 0.3
        cost = 0.5 * cp.sum_squares(self.x) + 0.5 * self.y**2 - cp.sum(cp.multiply(p["point"], self.x)) - pull * self.y
        self.problem = cp.Problem(cp.Minimize(cost), [self.plane, self.floor, self.balls, self.roof])
        self.duals = {"plane": self.plane, "floor": self.floor, "balls": self.balls, "roof": self.roof}
        self.model = ConicModel(self.problem, equilibrate=self.data(0), duals=self.duals)

    @staticmethod
    def data(seed):
        rng = np.random.default_rng(seed)
        centres = rng.uniform(-0.2, 0.2, (3, 2))
        return {
            "point": rng.normal(size=(2, 3)),
            "normal": rng.uniform(0.5, 1.0, (2, 3)),
            "level": rng.uniform(0.5, 1.0),
            "low": centres.T - rng.uniform(0.2, 0.6, (2, 3)),
            "centres": centres,
            "radii": rng.uniform(0.4, 0.9, 2),
            "pull": rng.normal(),
        }


@pytest.fixture(scope="module")
def program():
    return LinearProgram()


@pytest.fixture(scope="module")
def blend():
    return Blend()


@given(seed=SEEDS)
@settings(max_examples=30)
def test_the_lagrangian_is_positive_at_no_point_of_the_program(program, seed):
    values, optimum, multipliers = program.data(seed)
    solution = program.model.solve(values)
    constant, slope = program.model.lagrangian(solution)
    assert constant == pytest.approx(-values["b"] @ multipliers, abs=1e-5)
    np.testing.assert_allclose(slope, -values["c"], atol=1e-6)  # stationary: c + A'z = 0
    np.testing.assert_array_equal(program.model.columns("x"), np.arange(COLUMNS))
    toward = optimum - np.linalg.solve(values["A"][:COLUMNS], np.ones(COLUMNS))  # off all active rows at once
    steps = optimum + np.linspace(0.0, 1.0, 11)[:, None] * (toward - optimum)
    inside = (steps @ values["A"].T <= values["b"] + 1e-9).all(axis=1)
    found = constant + steps @ slope
    assert inside[0]
    assert np.max(found[inside]) <= 1e-5
    assert found[0] == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(found, -np.linspace(0.0, 1.0, 11) * multipliers.sum(), atol=1e-5)


@given(seed=SEEDS)
@settings(max_examples=30)
def test_a_linear_program_is_solved_to_its_closed_form_with_its_gradient_in_all_data(program, seed):
    values, optimum, multipliers = program.data(seed)
    solution = program.model.solve(values)
    assert solution.status is ConicStatus.SOLVED
    np.testing.assert_allclose(program.model.value("x", solution), optimum, atol=1e-6)
    np.testing.assert_allclose(program.model.dual("rows", solution), multipliers, atol=1e-6)
    assert solution.objective == pytest.approx(values["c"] @ optimum, abs=1e-6)
    gradient = program.model.gradient(solution, ("A", "b", "c"))
    np.testing.assert_allclose(gradient["c"], optimum, atol=1e-6)
    np.testing.assert_allclose(gradient["b"], -multipliers, atol=1e-6)
    np.testing.assert_allclose(gradient["A"], np.outer(multipliers, optimum), atol=1e-5)


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.floats(0.1, 3.0)
)  # fmt: skip
@settings(max_examples=30)
def test_the_lowest_point_of_a_ball_is_found_with_its_gradient(cost, centre, radius):
    cost, centre = np.array(cost), np.array(centre)
    length = np.linalg.norm(cost)
    if length < 0.1:
        return
    x = cp.Variable(3, name="x")
    ball = cp.SOC(cp.Parameter(name="radius"), x - cp.Parameter(3, name="centre"))
    problem = cp.Problem(cp.Minimize(cp.Parameter(3, name="cost") @ x), [ball])
    values = {"cost": cost, "centre": centre, "radius": radius}
    model = ConicModel(
        problem, equilibrate={"cost": np.ones(3), "centre": np.zeros(3), "radius": 1.0}, duals={"b": ball}
    )
    solution = model.solve(values)
    down = -cost / length
    np.testing.assert_allclose(model.value("x", solution), centre + radius * down, atol=1e-5)
    gradient = model.gradient(solution, ("cost", "centre", "radius"))
    np.testing.assert_allclose(gradient["cost"], centre + radius * down, atol=1e-5)
    np.testing.assert_allclose(gradient["centre"], cost, atol=1e-5)
    assert gradient["radius"] == pytest.approx(-length, abs=1e-5)
    np.testing.assert_allclose(model.dual("b", solution), [length, *cost], atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_value_point_and_multipliers_of_every_cone_are_those_of_cvxpy(blend, seed):
    values = blend.data(seed)
    solution = blend.model.solve(values)
    put(blend.problem, values)
    optimum = blend.problem.solve(solver=cp.CLARABEL)
    assert solution.objective == pytest.approx(optimum, abs=1e-7)
    np.testing.assert_allclose(blend.model.value("x", solution), blend.x.value, atol=1e-5)
    assert blend.model.value("y", solution) == pytest.approx(blend.y.value, abs=1e-5)
    for name, constraint in blend.duals.items():
        theirs = constraint.dual_value
        theirs = np.concatenate([np.ravel(part) for part in theirs]) if isinstance(theirs, list) else theirs
        mine = blend.model.dual(name, solution)
        assert mine.shape == np.shape(theirs)
        np.testing.assert_allclose(mine, theirs, atol=1e-5, err_msg=name)
    assert np.abs(blend.model.dual("plane", solution)) > 1e-3  # signs are seen only where there is something to see


def test_all_cones_bind_somewhere_among_the_seeds(blend):
    duals = [blend.model.solve(blend.data(seed)) for seed in range(8)]
    for name in blend.duals:
        assert max(np.max(np.abs(blend.model.dual(name, solution))) for solution in duals) > 1e-2


@pytest.mark.parametrize("seed", range(4))
def test_the_gradient_is_that_of_central_differences_in_every_parameter(blend, seed):
    values, step = blend.data(seed), 1e-4
    gradient = blend.model.gradient(blend.model.solve(values), blend.NAMES)
    for name in blend.NAMES:
        base = np.asarray(values[name], dtype=float)
        assert gradient[name].shape == base.shape
        for index in np.ndindex(base.shape):
            ends = []
            for sign in (1.0, -1.0):
                moved = base.copy()
                moved[index] += sign * step
                ends.append(blend.model.solve(values | {name: moved}).objective)
            assert gradient[name][index] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=2e-4), (name, index)


def test_an_answer_does_not_depend_on_what_was_solved_before(blend):
    def bits(solution):
        return solution.status, solution.x.tobytes(), solution.z.tobytes(), solution.objective, solution.iterations

    impossible = blend.data(3) | {"level": 100.0}
    fresh = bits(Blend().model.solve(blend.data(5)))
    for history in ([1], [2, 7, 4], [5, 5], [3, 6]):
        for seed in history:
            blend.model.solve(blend.data(seed))
        assert bits(blend.model.solve(blend.data(5))) == fresh
        assert blend.model.solve(impossible).status is ConicStatus.INFEASIBLE
        assert bits(blend.model.solve(blend.data(5))) == fresh


def test_names_that_a_model_does_not_know_are_passed_over(program):
    values = program.data(1)[0]
    more = values | {"weather": np.ones(5), "rows": 3.0}
    assert program.model.solve(more).x.tobytes() == program.model.solve(values).x.tobytes()
    assert sorted(program.model.parameter_names) == ["A", "b", "c"]
    assert program.model.shape == (ROWS, COLUMNS)


def test_a_missing_parameter_is_an_error(program):
    with pytest.raises(KeyError, match="b"):
        program.model.solve({"A": np.ones((ROWS, COLUMNS)), "c": np.ones(COLUMNS)})


@pytest.mark.parametrize("seed", range(5))
def test_infeasible_data_comes_with_a_farkas_ray(blend, seed):
    """b·z < 0, A'z = 0 and z in the dual cone refute A x + s = b with s in the cone."""
    values = blend.data(seed) | {"low": blend.data(seed)["centres"].T + 1.0}  # all of the floor is outside the balls
    solution = blend.model.solve(values)
    assert solution.status is ConicStatus.INFEASIBLE
    _, _, a, b, _ = blend.model.bare(values)
    ray = solution.z / -(b @ solution.z)
    assert b @ solution.z < 0.0
    assert np.max(np.abs(a.T @ ray)) < 1e-6
    balls = blend.model.dual("balls", solution)
    sizes, sides = balls[:2], balls[2:].reshape(3, 2)
    scale = np.max(np.abs(solution.z))
    assert np.all(np.linalg.norm(sides, axis=0) <= sizes + 1e-8 * scale)
    assert np.all(blend.model.dual("floor", solution) >= -1e-8 * scale)
    assert blend.model.dual("roof", solution) >= -1e-8 * scale


def test_an_unbounded_program_is_neither_solved_nor_infeasible(program):
    no_rows = program.data(2)[0] | {"A": np.zeros((ROWS, COLUMNS)), "b": np.full(ROWS, 5.0)}
    assert program.model.solve(no_rows).status is ConicStatus.FAILED


def same_data(model, problem, values):
    """cvxpy's own matrices for this data, and ours."""
    put(problem, values)
    theirs = problem.get_problem_data(cp.CLARABEL)[0]
    hessian, q, a, b, _ = model.bare(values)
    np.testing.assert_allclose(a.toarray(), theirs["A"].toarray(), rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(b, theirs["b"], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(q, theirs["c"], rtol=1e-14, atol=1e-14)
    if "P" in theirs:
        np.testing.assert_allclose(hessian.toarray(), np.triu(theirs["P"].toarray()), atol=1e-14)


def test_the_tensors_give_the_matrices_of_cvxpy(program, blend):
    for seed in range(3):
        same_data(program.model, program.problem, program.data(seed)[0])
        same_data(blend.model, blend.problem, blend.data(seed))


def test_p1_has_the_matrices_of_cvxpy(drawn):
    box = Envelope(low=np.full((3, 6), -0.7), high=np.linspace(0.1, 0.9, 18).reshape(3, 6))
    compiled = McCormick(3, 3)
    for seed in range(3):
        scaled = ScaledProblem.of(drawn("wall-3", seed))
        same_data(compiled.model, compiled.problem, p1_values(scaled, box))


def test_zeros_in_the_data_keep_their_place_in_the_pattern():
    model = McCormick(3, 3).model
    patterns = []
    for scale in (0.0, 1.0):
        box = Envelope(low=np.full((3, 6), -scale), high=np.full((3, 6), scale))
        a = model.bare(p1_values(ScaledProblem.typical(3, 3), box))[2]
        patterns.append((a.indptr.tolist(), a.indices.tolist()))
    assert patterns[0] == patterns[1]


def test_models_can_share_one_dictionary(drawn):
    scaled = ScaledProblem.of(drawn("wall-3", 4))
    small, whole = LiftModel(3, 3, whole_box=False), LiftModel(3, 3, whole_box=True)
    assert set(lift_values(scaled)) > {"force_min", "force_map", "com_radius"}
    assert small.solve(scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=1e-7)


def test_a_constant_of_the_objective_counts():
    x, level = cp.Variable(name="x"), cp.Parameter(name="level")
    model = ConicModel(cp.Problem(cp.Minimize(x + 3.0 * level + 1.0), [x >= 0.5]), equilibrate={"level": 1.0})
    solution = model.solve({"level": 2.0})
    assert solution.objective == pytest.approx(7.5, abs=1e-6)
    assert model.gradient(solution, ("level",))["level"] == pytest.approx(3.0, abs=1e-6)


class GivesUp:
    """A solver that ends without an answer."""

    def update(self, **data):
        pass

    def solve(self):
        none = [float("nan")]
        return SimpleNamespace(
            status=clarabel.SolverStatus.NumericalError, x=none, z=none, obj_val=0.0, iterations=0, solve_time=0.0
        )


@pytest.mark.parametrize("seed", range(3))
def test_where_the_fast_solver_gives_up_a_careful_one_is_asked(blend, monkeypatch, seed):
    expected = blend.model.solve(blend.data(seed))
    monkeypatch.setattr(blend.model, "_solver", GivesUp())
    solution = blend.model.solve(blend.data(seed))
    assert solution.status is ConicStatus.SOLVED
    assert solution.objective == pytest.approx(expected.objective, abs=1e-7)
    np.testing.assert_allclose(solution.x, expected.x, atol=1e-4)
    assert blend.model.solve(blend.data(seed) | {"level": 100.0}).status is ConicStatus.INFEASIBLE


def test_the_solver_runs_on_one_thread_without_presolve_and_without_a_clock():
    chosen = solver_settings()
    assert (chosen.max_threads, chosen.presolve_enable, chosen.iterative_refinement_enable) == (1, False, False)
    assert chosen.time_limit > 1e9
