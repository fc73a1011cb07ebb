"""The question of a walk is one value, whether it was written with names or as it is."""

from __future__ import annotations

import numpy as np
import pytest

import stancekit
from stancekit import Walk
from tests.refusals import refuses


@pytest.fixture(scope="module")
def level() -> stancekit.HeightField:
    return stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)


def test_a_walk_that_is_handed_over_is_the_one_of_its_arguments(level):
    asked = Walk.over(level, (0.2, 0.0), duration_s=2.0)
    how = {"chart": "decoupled", "total_iterations": 40, "time_limit_s": 1e6}
    answer, same = (
        stancekit.walk(asked, **how),
        stancekit.walk(level, (0.2, 0.0), duration_s=2.0, **how),
    )
    assert answer.problem is asked
    assert isinstance(same.problem, Walk)
    for name in vars(asked).keys() - {"robot"}:
        assert np.array_equal(getattr(same.problem, name), getattr(asked, name)), name
    assert answer.solution.digest == same.solution.digest


def test_nothing_goes_beside_a_walk_that_it_says_itself(level):
    asked = Walk.over(level, (0.2, 0.0), duration_s=2.0)
    for name, value in (
        ("goal_xy_m", (0.3, 0.0)),
        ("start_xy_m", (0.1, 0.0)),
        ("robot", "hexapod"),
        ("gait", "trot"),
        ("duration_s", 3.0),
        ("friction", 0.5),
        ("adhesive", ["LF"]),
    ):
        with refuses(name):
            stancekit.walk(asked, **{name: value})
    with refuses("stancekit.walk", "goal_xy_m", kind=TypeError):
        stancekit.walk(level)
