"""The mixed-integer baseline: its grid leaves no posture out, and its claims are never taken for answers."""

import importlib.util
from collections.abc import Callable
from itertools import combinations_with_replacement

import cvxpy as cp
import numpy as np
import pytest

from stancekit.envs.terrains import DISTRIBUTIONS
from stancekit.planners.contact.exact import ExactPlanner
from stancekit.planners.contact.micp import (
    MicpModel,
    MicpPlanner,
    domain_of,
    meet,
    neighbouring,
    without_cones,
)
from stancekit.planners.contact.project import Point
from stancekit.planners.contact.relax import McCormick
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.contact.terms import friction_cones
from stancekit.planners.outcome import InvalidInput, Outcome, Status
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.scene import PostureProblem
from stancekit.planners.verify import check_posture

Scenes = list[tuple[PostureProblem, Outcome]]


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    """Natural wall-3 scenes with the exact planner's answer, the trivially infeasible ones left out."""
    rng, exact = np.random.default_rng(1), ExactPlanner()
    answered = [(problem, exact.solve(problem)) for problem in (DISTRIBUTIONS["wall-3"].sample(rng) for _ in range(30))]
    return [(problem, outcome) for problem, outcome in answered if not outcome.details["trivial"]]


@pytest.fixture(scope="module")
def feasible(scenes: Scenes) -> Scenes:
    """The first six that have a witness."""
    kept = [(problem, outcome) for problem, outcome in scenes if outcome.status is Status.FEASIBLE][:6]
    assert len(kept) == 6
    return kept


@pytest.fixture(scope="module")
def infeasible(scenes: Scenes) -> Scenes:
    """Those that have a certificate."""
    kept = [(problem, outcome) for problem, outcome in scenes if outcome.status is Status.INFEASIBLE]
    assert len(kept) > 3
    return kept


def coordinates(scaled: ScaledProblem, point: Point) -> np.ndarray:
    """[p, f] of a point, shape (1, N, 6)."""
    return np.hstack([point.toes - point.com, point.forces])[None]


def witness(problem: PostureProblem, outcome: Outcome) -> np.ndarray:
    """[p, f] of a witness, shape (1, N, 6)."""
    assert outcome.posture is not None
    scaled, posture = ScaledProblem.of(problem), outcome.posture
    forces = np.einsum("nji,nj->ni", scaled.frames, posture.forces_n) / scaled.force_n
    return np.hstack([(posture.toes_m - posture.com_m) / scaled.length_m, forces])[None]


def test_the_grid_leaves_no_posture_out(feasible: Scenes) -> None:
    planner = MicpPlanner(intervals=2)
    for problem, _ in feasible:
        outcome = planner.solve(problem)
        assert outcome.claim == "feasible"
        assert outcome.status is Status.FEASIBLE
        assert outcome.posture is not None
        assert check_posture(problem, outcome.posture).accepted


def test_the_domain_holds_every_witness(scenes: Scenes) -> None:
    for problem, outcome in scenes:
        if outcome.status is Status.FEASIBLE:
            assert domain_of(ScaledProblem.of(problem)).contains(witness(problem, outcome), margin=1e-6).all()


def test_a_claim_of_infeasibility_stays_a_claim(infeasible: Scenes) -> None:
    planner = MicpPlanner(intervals=2)
    outcomes = [planner.solve(problem) for problem, _ in infeasible]
    assert {outcome.status for outcome in outcomes} == {Status.UNDECIDED}
    refused = [outcome for outcome in outcomes if outcome.claim == "infeasible"]
    assert len(refused) > 2
    assert {outcome.message for outcome in refused} == {
        "highs says infeasible; neither a certificate nor toes that hold came with it"
    }
    for outcome in outcomes:
        if outcome.claim == "feasible":
            assert outcome.message.startswith("witness refused")
            assert outcome.details["claimed_residual_nm"] > 0.1


def test_one_piece_of_the_domain_is_the_mccormick_relaxation(scenes: Scenes) -> None:
    model, relaxation = MicpModel(3, 3, intervals=1), McCormick(3, 3)
    claims = []
    for problem, _ in scenes:
        scaled = ScaledProblem.of(problem)
        claims.append(model.solve(scaled, domain_of(scaled)).claim)
        if claims[-1] == "infeasible":  # its cones are wider, so what it refuses the relaxation refuses, too
            assert relaxation.solve(scaled, domain_of(scaled)).margin > 0.0
    assert set(claims) == {"feasible", "infeasible"}


def test_a_point_of_the_grid_lies_on_the_surface_up_to_its_cells(feasible: Scenes) -> None:
    problem, _ = feasible[0]
    scaled, gaps = ScaledProblem.of(problem), []
    for intervals in (1, 2, 4):
        model = MicpModel(3, 3, intervals=intervals)
        answer, domain = model.solve(scaled, domain_of(scaled)), domain_of(scaled)
        assert answer.point is not None
        moments = next(v.value for v in model.problem.variables() if v.name() == "moments")
        p, f = coordinates(scaled, answer.point)[0, :, :3], answer.point.forces
        gap = np.abs(moments - (p[:, :, None] * f[:, None, :]).reshape(3, 9))
        (p_low, p_high), (f_low, f_high) = domain.position, domain.force
        cell = ((p_high - p_low)[:, :, None] * (f_high - f_low)[:, None, :]).reshape(3, 9) / intervals**2
        assert np.all(gap <= 0.25 * cell + 1e-6)  # McCormick's largest gap over a cell
        gaps.append(gap.max())
    assert gaps[0] > 1e-4


@pytest.mark.parametrize("grid", ["both", "position"])
def test_both_encodings_make_the_same_claim(scenes: Scenes, grid: str) -> None:
    models = [MicpModel(3, 3, intervals=2, encoding=encoding, grid=grid) for encoding in ("log", "unary")]
    claims = []
    for problem, _ in scenes[:6]:
        scaled = ScaledProblem.of(problem)
        log, unary = (model.solve(scaled, domain_of(scaled)).claim for model in models)
        assert log == unary
        claims.append(log)
    assert set(claims) == {"feasible", "infeasible"}


@pytest.mark.parametrize(("encoding", "count"), [("log", 4), ("log", 8), ("unary", 4), ("unary", 5)])
def test_weight_goes_to_two_neighbours_only(encoding: str, count: int) -> None:
    weights, wanted = cp.Variable((1, count + 1), nonneg=True), cp.Parameter(count + 1)
    most = cp.Problem(
        cp.Maximize(cp.min(weights[0] - wanted)), [cp.sum(weights) == 1, *neighbouring(weights, encoding)]
    )
    for a, b in combinations_with_replacement(range(count + 1), 2):
        wanted.value = 0.5 * (np.eye(count + 1)[a] + np.eye(count + 1)[b])
        most.solve(solver=cp.HIGHS)
        assert (most.value > -1e-6) == (b - a <= 1)


def test_binaries_are_a_variable_and_not_a_cell() -> None:
    figures = {encoding: MicpModel(3, 3, intervals=4, encoding=encoding).figures for encoding in ("log", "unary")}
    assert figures["log"]["binaries"] == 18 * 2
    assert figures["unary"]["binaries"] == 18 * 4
    assert MicpModel(3, 3, intervals=4, grid="position").figures["binaries"] == 9 * 2


def test_tangent_planes_lie_around_the_cones_and_close_to_them() -> None:
    rng = np.random.default_rng(0)
    ball, direction = cp.Variable(3), cp.Parameter(3)
    rows = without_cones(cp.SOC(cp.Constant(2.0), ball))
    reach = cp.Problem(cp.Maximize(direction @ ball), rows)
    force, push = cp.Variable((1, 3)), cp.Parameter(2)
    rows = without_cones(friction_cones(force, np.array([0.5])))
    friction = cp.Problem(cp.Maximize(force[0, 1:] @ push), [*rows, force[0, 0] <= 1.0])
    for _ in range(30):
        direction.value = rng.normal(size=3)
        assert 1.0 - 1e-7 <= reach.solve(solver=cp.HIGHS) / (2.0 * np.linalg.norm(direction.value)) <= 1.041
        push.value = rng.normal(size=2)
        assert 1.0 - 1e-7 <= friction.solve(solver=cp.HIGHS) / (0.5 * np.linalg.norm(push.value)) <= 1.02


def test_other_constraints_stay_as_they_are() -> None:
    row = cp.Variable() <= 1.0
    assert without_cones(row) == [row]


@pytest.mark.parametrize("use", ["rows", "shrink"])
def test_with_an_envelope_the_claimed_point_lies_in_it(feasible: Scenes, use: str) -> None:
    found = 0
    for problem, outcome in feasible[:4]:
        scaled = ScaledProblem.of(problem)
        envelope = Envelope.around(witness(problem, outcome)).widened(0.1)
        model = MicpModel(3, 3, intervals=2, envelope_rows=use == "rows")
        domain = meet(envelope, domain_of(scaled)) if use == "shrink" else domain_of(scaled)
        answer = model.solve(scaled, domain, envelope=envelope)
        assert answer.point is not None
        assert envelope.contains(coordinates(scaled, answer.point), margin=1e-6).all()
        outcome = MicpPlanner(intervals=2, envelope=envelope, envelope_use=use).solve(problem)
        assert outcome.claim == "feasible"
        found += outcome.status is Status.FEASIBLE
    assert found > 2


@pytest.mark.parametrize("use", ["rows", "shrink"])
def test_an_envelope_out_of_reach_has_no_point(feasible: Scenes, use: str) -> None:
    problem, outcome = feasible[0]
    far = Envelope.around(witness(problem, outcome) + 3.0).widened(0.1)
    assert MicpPlanner(intervals=2, envelope=far, envelope_use=use).solve(problem).claim == "infeasible"


def test_an_envelope_of_other_limbs_is_refused(feasible: Scenes) -> None:
    envelope = Envelope(low=-np.ones((5, 6)), high=np.ones((5, 6)))
    with pytest.raises(InvalidInput, match=r"^contacts: expected 5 for this envelope, got 3$"):
        MicpPlanner(envelope=envelope).solve(feasible[0][0])


def test_a_time_limit_leaves_the_problem_undecided(infeasible: Scenes) -> None:
    outcome = MicpPlanner(intervals=8, time_limit_s=0.01).solve(infeasible[2][0])
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "unknown")


def test_numbers_are_loaded_and_the_program_is_not_written_again(scenes: Scenes) -> None:
    model = MicpModel(3, 3, intervals=2, envelope_rows=True)
    assert model.problem.is_dpp()
    first, second = (ScaledProblem.of(problem) for problem, _ in scenes[:2])
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    answers = [model.solve(scaled, domain_of(scaled), envelope=box) for scaled in (first, second, first)]
    assert answers[0].claim == answers[2].claim
    assert answers[0].point is not None
    assert answers[2].point is not None
    np.testing.assert_array_equal(answers[0].point.toes, answers[2].point.toes)


@pytest.mark.skipif(importlib.util.find_spec("pyscipopt") is None, reason="SCIP is an extra")
def test_scip_with_true_cones_agrees_with_highs(scenes: Scenes) -> None:
    scip, highs = (MicpModel(3, 3, intervals=2, solver=solver) for solver in ("scip", "highs"))
    for problem, _ in scenes[:4]:
        scaled = ScaledProblem.of(problem)
        mine, theirs = (model.solve(scaled, domain_of(scaled)).claim for model in (scip, highs))
        assert mine == theirs or (mine, theirs) == ("infeasible", "feasible")  # HiGHS' cones are wider


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MicpPlanner(solver="cplex"), "solver: expected one of highs, scip, gurobi, got 'cplex'"),
        (lambda: MicpPlanner(encoding="hot"), "encoding: expected one of log, unary, got 'hot'"),  # type: ignore[arg-type]
        (lambda: MicpModel(3, 3, grid="force"), "grid: expected one of both, position, got 'force'"),  # type: ignore[arg-type]
        (lambda: MicpPlanner(intervals=3), "intervals: expected 1 or more, and a power of two for 'log', got 3"),
        (lambda: MicpPlanner(envelope_use="cut"), "envelope_use: expected one of rows, shrink, got 'cut'"),  # type: ignore[arg-type]
        (lambda: MicpPlanner(time_limit_s=0.0), "time_limit_s: expected a number above 0, got 0"),
    ],
)
def test_options_that_there_are_not_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        make()
    assert str(caught.value) == message


def test_a_solver_that_is_not_installed_is_named_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InvalidInput) as caught:
        MicpPlanner(solver="scip")
    assert str(caught.value) == "solver: scip is not installed: pip install stancekit[exact]"


def test_it_prints_nothing(feasible: Scenes, capfd: pytest.CaptureFixture[str]) -> None:
    MicpPlanner(intervals=2).solve(feasible[0][0])
    assert capfd.readouterr() == ("", "")
