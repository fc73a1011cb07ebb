"""P1 → P2: what the two programs may claim, and of which problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.projection.project import PROJECTIONS
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.lift import LiftProgram
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.search import two_stage
from stancekit.planners.search.answer import Acceptance, Clock
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.methods import METHODS, PlannerOptions, make_planner, settings_of
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names

SEEDS = range(60)
NO_PROOF = "the relaxation is infeasible; over a learned box that is no proof"


@pytest.fixture(scope="module")
def truth(programs, drawn):
    """Wall-3 problems with the exact planner's answer."""
    planner = Exact(programs=programs)
    return [(drawn("wall-3", seed), planner.solve(drawn("wall-3", seed))) for seed in SEEDS]


@pytest.fixture(scope="module")
def learned(truth):
    """Quantile boxes of the first witnesses, two of them."""
    points = np.array(
        [Scaled.of(p).point(o.solution) for p, o in truth if o.status is Status.FEASIBLE]
    )
    boxes = [
        Envelope(low=np.quantile(points, q, axis=0), high=np.quantile(points, 1 - q, axis=0))
        for q in (0.2, 0.05)
    ]
    return EnvelopeSet.for_problems("wall-3", [problem for problem, _ in truth], boxes)


def boxed(learned, *boxes):
    return replace(learned, envelopes=tuple(boxes))


def point_box(value):
    return Envelope(low=np.full((3, 6), value), high=np.full((3, 6), value))


@pytest.mark.parametrize("projection", [*PROJECTIONS.names(), None])
@pytest.mark.parametrize("with_box", [True, False])
def test_a_status_is_always_one_of_the_whole_problem(
    programs, truth, learned, projection, with_box
):
    planner = TwoStage(
        envelopes=learned if with_box else None, projection=projection, programs=programs
    )
    seen = dict.fromkeys(Status, 0)
    for problem, exact in truth[:40]:
        outcome = planner.solve(problem)
        seen[outcome.status] += 1
        assert outcome.method == planner.posture_name
        if outcome.status is Status.FEASIBLE:
            assert exact.status is Status.FEASIBLE
            assert check_plan(outcome.solution).accepted
            assert outcome.claim == "feasible"
        elif outcome.status is Status.INFEASIBLE:
            assert exact.status is Status.INFEASIBLE
            assert check_certificate(outcome.certificate.of(problem)).accepted
            assert outcome.claim == "infeasible"
            assert outcome.message == ""
        else:
            assert outcome.solution is outcome.certificate is None
            assert outcome.message
    assert seen[Status.INFEASIBLE] >= (6 if with_box else 14)  # with a box only what is trivial
    if projection is not None:
        assert seen[Status.FEASIBLE] >= 5


def test_scp_from_the_lift_decides_nearly_all(programs, truth):
    planner = TwoStage(programs=programs)
    outcomes = [planner.solve(problem) for problem, _ in truth]
    agreed = [mine.status is exact.status for mine, (_, exact) in zip(outcomes, truth, strict=True)]
    assert sum(agreed) == len(truth)


@pytest.mark.parametrize("method", ["p1", "two-stage"])
def test_a_box_that_refuses_a_problem_proves_nothing(programs, truth, learned, method):
    planner = make_planner(
        method, PlannerOptions(programs=programs), envelopes=boxed(learned, point_box(0.0))
    )
    refused = 0
    for problem, exact in truth[:30]:
        outcome = planner.solve(problem)
        assert outcome.claim == "infeasible"
        if np.isinf(outcome.details["margin"]):
            assert exact.details["trivial"] == 1.0
            continue
        refused += 1
        assert outcome.status is Status.UNDECIDED
        assert outcome.message == NO_PROOF
        assert outcome.bound == 0.0
        assert outcome.details["margin"] > 0.1
    assert refused >= 15


def test_what_no_box_can_help_comes_with_the_lifts_certificate(programs, truth, learned):
    planner = make_planner("p1", PlannerOptions(programs=programs), envelopes=learned)
    trivial = 0
    for problem, exact in truth:
        if exact.details["trivial"]:
            trivial += 1
            outcome = planner.solve(problem)
            assert outcome.status is Status.INFEASIBLE
            assert outcome.bound == outcome.details["margin"] == np.inf
            assert (
                check_certificate(outcome.certificate.of(problem)).figures["lower_bound"] == np.inf
            )
    assert trivial >= 8


def test_the_numbers_of_p1_are_those_of_its_programs(programs, truth, learned):
    planner = TwoStage(envelopes=learned, projection="fix-toes", programs=programs)
    for problem, _ in truth[:20]:
        scaled = Scaled.of(problem)
        answer = programs.get(McCormick, scaled.layout).solve_any(scaled, learned.envelopes)
        details = planner.solve(problem).details
        assert details == pytest.approx(
            {"margin": answer.margin, "gap": answer.gap, "chosen": answer.chosen}, nan_ok=True
        )


def test_p1_alone_is_feasible_only_where_its_own_point_is_a_posture(programs, truth, learned):
    """In a box without size about a witness, the relaxation is the problem itself."""
    problem, exact = next((p, o) for p, o in truth if o.status is Status.FEASIBLE)
    point = Scaled.of(problem).point(exact.solution)
    small, large = Envelope(low=point, high=point), Envelope(low=point - 0.5, high=point + 0.1)
    tight = make_planner("p1", PlannerOptions(programs=programs), envelopes=boxed(learned, small))
    wide = make_planner("p1", PlannerOptions(programs=programs), envelopes=boxed(learned, large))
    outcome = tight.solve(problem)
    assert outcome.status is Status.FEASIBLE
    assert outcome.residual < 1e-6
    loose = wide.solve(problem)
    assert (loose.status, loose.claim) == (Status.UNDECIDED, "feasible")
    assert_names(loose.message, "moment_balance")
    assert loose.residual > 1e-3


def test_a_projection_without_answer_is_told(truth, programs, monkeypatch):
    project = two_stage.project
    monkeypatch.setattr(
        two_stage, "project", lambda *given: replace(project(*given), residual=float("inf"))
    )
    problem = next(p for p, o in truth if o.status is Status.FEASIBLE)
    outcome = TwoStage(projection="fix-f", programs=programs).solve(problem)
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "fix-f")


@pytest.mark.parametrize("with_box", [True, False])
def test_a_relaxation_that_was_not_solved_is_told(truth, learned, programs, monkeypatch, with_box):
    problem = truth[0][0]
    lift, any_of = LiftProgram.solve, McCormick.solve_any_of_each

    def gave_up(program, scaled):
        return replace(lift(program, scaled), status=ConicStatus.FAILED, bound=0.0)

    def unknown(program, scaled, envelopes):
        return [replace(each, margin=float("nan")) for each in any_of(program, scaled, envelopes)]

    monkeypatch.setattr(LiftProgram, "solve", gave_up)
    monkeypatch.setattr(McCormick, "solve_any_of_each", unknown)
    outcome = TwoStage(envelopes=learned if with_box else None, programs=programs).solve(problem)
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "relaxation")
    assert outcome.claim == ""


def test_every_convex_solve_is_counted(programs, truth, learned):
    boxes = boxed(learned, *learned.envelopes, point_box(0.0))
    planner = make_planner("p1", PlannerOptions(programs=programs), envelopes=boxes)
    assert planner.solve(truth[0][0]).effort.solves == 3
    trivial = next(problem for problem, exact in truth if exact.details["trivial"])
    assert planner.solve(trivial).effort.solves == 4  # and the lift, for its certificate


def test_no_claim_is_believed(truth):
    """Witness and certificate of other problems are refused, whoever brings them."""
    infeasible = [(p, o) for p, o in truth if 1e-3 < o.bound < 1.0]
    (one, right), (_, wrong) = infeasible[:2]
    accept = Acceptance().answer
    refused = accept(
        one,
        certificate=wrong.certificate,
        word="infeasible",
        method="liar",
        clock=Clock.start(),
    )
    assert refused.status is Status.UNDECIDED
    assert refused.certificate is None
    assert_names(refused.message, "certificate", "leaf 0")
    witness = next(o.solution for _, o in truth if o.status is Status.FEASIBLE)
    both = accept(
        one, plan=witness, certificate=right.certificate, method="liar", clock=Clock.start()
    )
    assert both.status is Status.INFEASIBLE
    assert both.solution is None
    assert both.residual > 1e-3


# -------------------------------------------------------------------------------------------------------------
# input


def refusal(call, *values, **named):
    with pytest.raises(InvalidInput) as error:
        call(*values, **named)
    return str(error.value)


def test_an_envelope_of_another_class_is_refused(programs, drawn, learned):
    planner = TwoStage(envelopes=learned, programs=programs)
    assert_names(refusal(planner.solve, drawn("wall-5", 0)), "contacts")
    assert_names(
        refusal(planner.solve, replace(drawn("wall-3", 0), force_scale_n=50.0)), "force_scale_n"
    )
    assert_names(
        refusal(planner.solve, replace(drawn("wall-3", 0), length_scale_m=0.5)), "length_scale_m"
    )
    up = replace(
        learned, normals=np.tile([0.0, 1.0, 0.0], (3, 1)), tilt_rad=np.full(3, np.deg2rad(30.0))
    )
    assert_names(
        refusal(TwoStage(envelopes=up, programs=programs).solve, drawn("ground-3", 0)),
        "contacts[0].normal",
    )


def test_an_unknown_projection_is_refused():
    assert_names(refusal(TwoStage, projection="fix-toe"), "projection")


def test_names_say_what_runs(learned):
    assert TwoStage(envelopes=learned).posture_name == "two-stage"
    assert TwoStage(envelopes=learned, projection=None).posture_name == "p1"
    assert TwoStage().posture_name == "lift+scp"
    assert TwoStage(projection="fix-p").posture_name == "lift+fix-p"
    assert TwoStage(projection=None).posture_name == "lift"


def test_planners_are_made_by_name(learned):
    names = {}
    for method in METHODS:
        some = boxed(learned, learned.envelopes[0]) if "envelopes" in settings_of(method) else None
        planner = make_planner(method, envelopes=some, of="postures")
        names[method] = getattr(planner, "posture_name", planner.name)
    assert set(names) == {"exact", "p1", "lift", "two-stage", "nlp", "micp"}
    for method in ("exact", "p1", "lift", "two-stage", "nlp"):
        assert names[method] == method
    assert make_planner("two-stage", projection="fix-f", of="postures").posture_name == "lift+fix-f"
    assert_names(refusal(make_planner, "magic", of="postures"), "method")
    assert_names(refusal(make_planner, "p1"), "envelopes")
    assert (
        make_planner("exact", PlannerOptions(of="postures", time_limit_s=0.5)).time_limit_s == 0.5
    )
    assert_names(refusal(make_planner, "micp", envelopes=learned, of="postures"), "envelopes")


def test_a_looser_gap_lets_the_lift_hand_on_to_the_projection(programs, truth):
    """Where a residual is bounded away from 0 but below the gap, nothing is refused and nothing
    found.
    """
    problem, exact = next((p, o) for p, o in truth if 1e-3 < o.bound < 1.0)
    planner = TwoStage(acceptance=Acceptance(gap=2.0), programs=programs)
    outcome = planner.solve(problem)
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "feasible")
    assert outcome.residual >= exact.bound
