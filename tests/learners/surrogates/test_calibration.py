"""Limits of a score hold a stated error in each class, whatever the scores are."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from stancekit.learners.surrogates.calibration import (
    allowed,
    checked_error,
    threshold,
    thresholds,
)
from tests.refusals import refuses


@pytest.mark.parametrize("count", [1, 50, 600, 737, 738, 2000, 30_000])
@pytest.mark.parametrize("error", [0.002, 0.005, 0.05, 0.4])
def test_so_many_may_lie_beyond_and_no_more(count: int, error: float) -> None:
    beyond = allowed(count, error, 0.025)
    if beyond < 0:
        assert binom.cdf(0, count, error) > 0.025
    else:
        assert binom.cdf(beyond, count, error) <= 0.025 < binom.cdf(beyond + 1, count, error)


def test_the_error_is_held_as_often_as_is_said_and_not_much_more() -> None:
    rng, broken, times = np.random.default_rng(0), 0, 4000
    for _ in range(times):
        limit = threshold(rng.uniform(size=400), 0.05, 0.1)
        broken += 1.0 - limit > 0.05  # a new uniform score lies beyond so often
    assert 0.06 < broken / times < 0.115


def test_too_few_rows_hold_nothing() -> None:
    assert threshold(np.zeros(10), 0.005, 0.05) == math.inf
    assert thresholds({"feasible": np.zeros(10)}, 0.005) == (-math.inf, math.inf)


def test_trivial_rows_are_a_class_of_their_own() -> None:
    scores = {"feasible": np.arange(200.0), "infeasible": -np.arange(200.0)}
    low, high = thresholds(scores, 0.05)
    assert (scores["feasible"] < low).mean() <= 0.05
    assert (scores["infeasible"] > high).mean() <= 0.05
    assert thresholds({**scores, "trivial": np.full(200, 50.0)}, 0.05)[1] == 50.0


@pytest.mark.parametrize("error", [0, 1, -0.1, 1.5, math.nan, "0.1"])
def test_an_error_lies_between_0_and_1(error: object) -> None:
    with refuses("error"):
        checked_error(error)  # type: ignore[arg-type]
