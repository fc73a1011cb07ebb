"""No forged walk is accepted: every kind, one size each; ``benchmarks/forgeries.py`` has all of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.verify.trajectories import check_trajectory
from tests.forgeries import judge_walks
from tests.forgeries.crawl import crawl
from tests.forgeries.walks import KINDS


@cache
def honest() -> Trajectory:
    return crawl()


def test_the_honest_walk_is_accepted_by_the_verifier_and_by_the_judge() -> None:
    report = check_trajectory(honest())
    assert report.accepted, report.message
    assert not report.unchecked
    assert judge_walks.inexecutable(honest()) == ""


@pytest.mark.parametrize("name", KINDS)
def test_a_forged_walk_is_refused_and_the_judge_says_why_nobody_walks_it(name: str) -> None:
    forged = KINDS[name](honest(), 2.0, np.random.default_rng(2))
    assert judge_walks.inexecutable(forged)
    assert not check_trajectory(forged).accepted
