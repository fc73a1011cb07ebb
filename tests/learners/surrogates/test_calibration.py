"""Limits of a score hold a stated error in each class, whatever the scores are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from stancekit.learners.surrogates.calibration import (
    ALARM,
    BINS,
    FEWEST,
    Likeness,
    allowed,
    checked_error,
    threshold,
    thresholds,
)
from tests.refusals import refuses

KINDS = ("feasible", "infeasible", "trivial")


def rows(rng: np.random.Generator, kind: str, count: int) -> np.ndarray:
    """Eleven numbers whose means differ between the classes."""
    mean = {"feasible": 0.0, "infeasible": 0.7, "trivial": 2.0}[kind]
    return rng.normal(mean, 1.0, size=(count, 11)) * np.linspace(0.1, 3.0, 11)


@pytest.fixture(scope="module")
def likeness() -> Likeness:
    rng = np.random.default_rng(0)
    sizes = {"feasible": 2000, "infeasible": 800, "trivial": 400}
    return Likeness.of({kind: rows(rng, kind, count) for kind, count in sizes.items()})


def drawn(rng: np.random.Generator, count: int) -> np.ndarray:
    shares = rng.dirichlet([1, 1, 1])
    return np.concatenate(
        [
            rows(rng, kind, int(size))
            for kind, size in zip(KINDS, rng.multinomial(count, shares), strict=True)
        ]
    )


def test_any_mixture_of_the_classes_is_alike(likeness: Likeness) -> None:
    rng = np.random.default_rng(1)
    p = np.array([likeness.unlike(drawn(rng, int(rng.integers(64, 3000))))[0] for _ in range(400)])
    assert p.min() > ALARM
    assert (p < 0.05).mean() < 0.08


@pytest.mark.parametrize(
    ("shift", "share"),
    [
        (0.8, 0.9),  # 1,152 of 1,200 were told from the classes: a mixture may make up for a part
        (1.2, 1.0),  # 600 of 600
    ],
)
def test_another_distribution_is_not(likeness: Likeness, shift: float, share: float) -> None:
    rng = np.random.default_rng(2)
    p, worst = [], []
    for _ in range(40):
        batch = drawn(rng, 400)
        batch[:, 4] += shift
        probability, column = likeness.unlike(batch)
        p.append(probability)
        worst.append(column)
    assert np.mean(np.array(p) < ALARM) >= share
    assert set(worst) == {4}


def test_a_number_that_never_changes_is_not(likeness: Likeness) -> None:
    rng = np.random.default_rng(2)
    narrow = drawn(rng, 400)
    narrow[:, 7] = 0.0
    assert likeness.unlike(narrow)[0] < ALARM


def test_few_problems_and_a_stranger_among_many_are_no_alarm(likeness: Likeness) -> None:
    rng = np.random.default_rng(3)
    assert likeness.unlike(np.full((FEWEST - 1, 11), 9.0)) == (1.0, 0)
    batch = drawn(rng, 300)
    batch[0] = 100.0
    assert likeness.unlike(batch)[0] > ALARM


def test_without_rows_nothing_is_told() -> None:
    nothing = Likeness.of(
        {kind: np.zeros((0, 3)) for kind in ("feasible", "infeasible", "trivial")}
    )
    assert nothing.counts.shape == (3, 3, BINS)
    assert nothing.unlike(np.zeros((500, 3))) == (1.0, 0)


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
