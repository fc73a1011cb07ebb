"""Contract of every planner: its status speaks of the posture problem, and carries what can be
checked.
"""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.answer.answer import Status
from stancekit.planners.relaxation.boxes import Modes
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.methods import COURSE_METHODS, METHODS, make_planner
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses


def test_every_planner_is_made_by_its_name(drawn):
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    learned = EnvelopeSet.for_problems("wall-3", [drawn("wall-3", 0)], [box])
    modes = Modes(names=("wall",), boxes=learned)
    assert [make_planner(name, of="courses").name for name in COURSE_METHODS] == list(
        COURSE_METHODS
    )
    assert make_planner("two-stage", envelopes=learned, of="courses").envelopes is learned
    assert make_planner("micp", envelopes=learned, of="courses").envelopes is learned
    for arguments, named in (
        ({"name": "best"}, "method"),
        ({"name": "two-stage", "relaxation": "boxes"}, "relaxation"),
        ({"name": "two-stage", "relaxation": "p1"}, "envelopes"),
        ({"name": "two-stage", "relaxation": "lift", "envelopes": learned}, "envelopes"),
        ({"name": "nlp", "relaxation": "lift"}, "relaxation"),
        ({"name": "exact", "envelopes": learned}, "envelopes"),
        ({"name": "micp", "envelopes": modes}, "envelopes"),
    ):
        with refuses(named):
            make_planner(arguments.pop("name"), **arguments, of="courses")


@pytest.fixture(scope="module")
def problems():
    rng = np.random.default_rng(11)
    return [DISTRIBUTIONS["wall-3"].sample(rng) for _ in range(8)]


@pytest.fixture(scope="module")
def whole(problems):
    """One box that holds everything: p and f lie in [−1, 1]."""
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    return EnvelopeSet.for_problems("wall-3", problems, [box])


@pytest.mark.parametrize("method", METHODS)
def test_every_method_answers_with_evidence_and_never_against_the_exact_one(
    method, problems, whole
):
    options = (
        {"envelopes": whole}
        if method in ("p1", "two-stage")
        else {"intervals": 2}
        if method == "micp"
        else {}
    )
    planner = make_planner(method, **options)
    truth = [Exact().solve(problem).status for problem in problems]
    assert {Status.FEASIBLE, Status.INFEASIBLE} <= set(truth)
    for problem, status in zip(problems, truth, strict=True):
        outcome = planner.solve(problem)
        assert outcome.status in (status, Status.UNDECIDED)
        assert (outcome.solution is not None) == (outcome.status is Status.FEASIBLE)
        assert (outcome.certificate is not None) == (outcome.status is Status.INFEASIBLE)
        assert outcome.solution is None or check_plan(outcome.solution).accepted
        assert (
            outcome.certificate is None
            or check_certificate(outcome.certificate.of(problem)).accepted
        )
        assert outcome.effort.seconds > 0.0
