"""No forged walk is accepted: every kind, one size each; ``benchmarks/forgeries.py`` has all of
them.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.verify import check_certificate, check_plan
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY
from tests.forgeries import judge_walks, links, stances
from tests.forgeries.crawl import crawl
from tests.forgeries.walks import KINDS


@cache
def honest() -> Motion:
    return crawl()


def test_the_honest_walk_is_accepted_by_the_verifier_and_by_the_judge() -> None:
    report = check_trajectory(honest())
    assert report.accepted, report.message
    assert report.unchecked == WHOLE_BODY  # its robot is but boxes
    assert judge_walks.inexecutable(honest()) == ""


@pytest.mark.parametrize("name", KINDS)
def test_a_forged_walk_is_refused_and_the_judge_says_why_nobody_walks_it(name: str) -> None:
    forged = KINDS[name](honest(), 2.0, np.random.default_rng(2))
    assert judge_walks.inexecutable(forged)
    assert not check_trajectory(forged).accepted


plan, posture, proofs = (
    cache(stances.honest_plan),
    cache(stances.honest_posture),
    cache(stances.proof_kinds),
)


def test_the_honest_plan_and_posture_are_accepted_by_both() -> None:
    assert check_plan(plan()).accepted
    assert stances.plan_fault(plan()) == ""
    assert check_plan(posture()).accepted
    assert stances.posture_fault(posture()) == ""


@pytest.mark.parametrize("name", stances.PLANS)
def test_a_forged_plan_is_refused(name: str) -> None:
    forged = stances.PLANS[name](plan(), 3.0, np.random.default_rng(3))
    assert stances.plan_fault(forged)
    assert not check_plan(forged).accepted


@pytest.mark.parametrize("name", links.KINDS)
def test_links_inside_each_other_are_refused_in_plans_and_walks_at_moments_and_between(
    name: str,
) -> None:
    for size in (2.0, 10.0):
        forged = links.KINDS[name](size, np.random.default_rng(3))
        assert links.fault(forged)
        accepted, group = links.verdict(forged)
        assert not accepted
        assert group in ("bodies", "motion")
    honest_one = links.KINDS[name](-2.0, np.random.default_rng(3))  # as much apart
    assert links.fault(honest_one) == ""
    assert links.verdict(honest_one)[0]


@pytest.mark.parametrize("name", stances.POSTURES)
def test_a_forged_posture_is_refused(name: str) -> None:
    forged = stances.POSTURES[name](posture(), 3.0, np.random.default_rng(3))
    assert stances.posture_fault(forged)
    assert not check_plan(forged).accepted


def test_no_proof_is_one_of_a_problem_that_has_a_posture() -> None:
    assert stances.has_witness(posture().problem)
    for name, forge in proofs().items():
        problem, forged = forge(3.0, np.random.default_rng(3))
        assert not check_certificate(forged.of(problem)).accepted, name
