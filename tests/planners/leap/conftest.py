"""Leaps that several tests share."""

import numpy as np
import pytest

from stancekit import Answer, Motion
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import LeapAttempt, attempt
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class


@pytest.fixture(scope="session")
def leap() -> Leap:
    """A scene that has leaps."""
    return leap_class("leap-given").draw(np.random.default_rng(0))


@pytest.fixture(scope="session")
def found(leap: Leap) -> Answer[Motion]:
    """The finder's answer to it."""
    return find_leap(leap)


@pytest.fixture(scope="session")
def failed(leap: Leap) -> LeapAttempt:
    """An attempt at it whose first step is feasible with slack that costs."""
    numbers, programs, rng = LeapNumbers.of(leap), Programs(), np.random.default_rng(0)
    for _ in range(60):
        choice = np.array([rng.integers(len(which)) for which in numbers.scaled.which])
        found = attempt(programs, numbers, choice, share=1.0, steps=1)
        if 1e-3 < found.first < np.inf:
            return found
    raise AssertionError("none of these choices costs")


@pytest.fixture(scope="session")
def refuted() -> Answer[Motion]:
    """An answer with a proof that there is no leap."""
    for seed in range(20):
        drawn = leap_class("leap-few").draw(np.random.default_rng(seed))
        outcome = find_leap(drawn, LeapFinder(solves=4))
        if outcome.certificate is not None:
            return outcome
    raise AssertionError("none of these scenes is refuted")
