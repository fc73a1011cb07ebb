"""Long work in Python says how far it is in the log, and ends at limits that do not ask the
clock.
"""

import logging

import numpy as np
import pytest

import stancekit
from tests.refusals import assert_names, refuses


@pytest.fixture
def level():
    return stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)


def test_plans_walks_and_labels_say_how_far_they_are(caplog, level, tmp_path):
    caplog.set_level(logging.INFO, logger="stancekit")
    stancekit.plan("walls", frames=2)
    stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    stancekit.label("wall-3", tmp_path / "rows", rows=4)
    said = [record.getMessage() for record in caplog.records]
    beginnings = (
        "plan: contacts with 80 % of the friction: feasible",
        "plan: accepted",
        "walk: decoupled, feasible: ",
    )
    for beginning in (*beginnings, "label: 1 of 1 shards, 4 rows of "):
        assert any(line.startswith(beginning) for line in said), said


def test_a_walk_of_so_many_iterations_is_the_same_again(level):
    asked = {"duration_s": 2.0, "chart": "decoupled", "time_limit_s": 1e6}
    walks = [
        stancekit.walk(level, (0.4, 0.0), total_iterations=most, **asked) for most in (2, 2, 60)
    ]
    counts = [walk.details["iterations"] for walk in walks]
    assert counts[0] == counts[1] < counts[2] <= 60 + 1
    again = stancekit.walk(level, (0.4, 0.0), total_iterations=60, **asked)
    assert again.solution.digest == walks[2].solution.digest
    with refuses("total_iterations"):
        stancekit.walk(level, (0.4, 0.0), total_iterations=0)


def test_limits_of_solves_are_settings_of_methods():
    problem = stancekit.sample("wall-3", rng=8)[0]
    assert (
        stancekit.solve(problem, stancekit.Exact(max_solves=50)).status
        is stancekit.Status.INFEASIBLE
    )
    outcome = stancekit.plan(
        "tube", stancekit.Exact(gap=1e-6, max_solves=2), frames=4, time_limit_s=1e6
    )
    assert_names(outcome.message, "limit", "2 solves")
    assert stancekit.plan("walls", stancekit.TwoStage(max_solves=40), frames=3).report.accepted
    with refuses("max_solves"):
        stancekit.Exact(max_solves=-1)
    with refuses("max_solves"):
        stancekit.solve(problem, stancekit.TwoStage(max_solves=4))
