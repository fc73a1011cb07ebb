"""Planners of leaps side by side: IPOPT agrees with convex steps, a run goes on where it was, and
shares add up.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import attempt, plan_from
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def leaps():
    sys.path.insert(0, str(BENCHMARKS))
    yield importlib.import_module("leaps")
    sys.path.remove(str(BENCHMARKS))


def test_every_method_has_a_row_and_a_run_goes_on_with_what_is_missing(
    leaps, tmp_path, monkeypatch
):
    few = {"distribution": "leap-few", "scenes": 2, "seed": 5, "solves": 8, "proof": 20}
    asked = leaps.Arguments(**few, method=("finder", "rule"), ipopt_s=0.5, out=tmp_path)
    rows = leaps.measured(asked)
    assert {(row["scene"], row["method"]) for row in rows} >= {
        (scene, method) for scene in (0, 1) for method in ("finder", "rule")
    }
    solved = {row["scene"] for row in rows if row["found"]}
    proofs = {row["scene"] for row in rows if row["method"] == "proof"}
    assert proofs == {0, 1} - solved
    monkeypatch.setattr(leaps, "by_finder", lambda *_: pytest.fail("measured again"))
    wider = leaps.Arguments(**few, method=("finder", "rule", "ipopt"), ipopt_s=0.5, out=tmp_path)
    again = [row for row in leaps.measured(wider) if row["method"] == "ipopt"]
    assert [row["scene"] for row in again] == [0, 1]


def test_shares_count_scenes_that_nobody_solves_as_failures(leaps):
    def row(scene, method, found, tries=2, solves=20, cpu_s=0.1):
        return {
            "scene": scene,
            "method": method,
            "found": found,
            "tries": tries,
            "solves": solves,
            "cpu_s": cpu_s,
            "refused": 0,
        }

    rows = [
        row(0, "rule", True, tries=1, solves=3),
        row(1, "rule", False),
        row(2, "rule", False),
        row(0, "finder", True),
        row(1, "finder", True, solves=40, cpu_s=0.3),
        row(2, "finder", False),
        {**row(2, "proof", False), "proved": True},
    ]
    rule, finder = leaps.table(rows, "leap-hard")
    assert (rule["first_try"], rule["within_25_solves"]) == (leaps.share(1, 3), leaps.share(1, 3))
    assert (finder["first_try"], finder["within_25_solves"]) == (
        leaps.share(0, 3),
        leaps.share(1, 3),
    )
    assert finder["solved"] == leaps.share(2, 3)
    assert rule["solved_by_any"] == finder["solved_by_any"] == leaps.share(2, 3)
    assert rule["cpu_s"] is None  # the median of a time and of infinity
    assert finder["cpu_s"] == pytest.approx(0.2)
    assert leaps.proofs(rows) == {"unsolved": 1, "proved": 1, "share": leaps.share(1, 1)}


def test_ipopt_and_convex_steps_agree_on_the_same_contacts(leaps):
    """Two programs of one leap: what SCP solves IPOPT solves, and the verifier accepts both."""
    programs, nlp, solved = Programs(), None, 0
    for index in range(3):
        leap = leap_class("leap-base").draw(np.random.default_rng([11, index]))
        numbers = LeapNumbers.of(leap)
        found = find_leap(leap, LeapFinder(order="rule", solves=12, proof=0), programs=programs)
        if found.solution is None:
            continue
        solved += 1
        choice = found.solution.choice
        assert attempt(programs, numbers, choice).solved
        nlp = nlp or leaps.LeapNlp(leap, reserve=True)
        point = nlp.solve(leap, choice, nlp.nominal(leap, choice, numbers))
        assert point.solved
        assert check_leap(
            plan_from(numbers, choice, point.toes_m, point.forces_n, "ipopt")
        ).accepted
    assert solved > 0
