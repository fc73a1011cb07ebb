"""The bench of planners of leaps: its rows are those of planners, it goes on where it was, and its
shares add up.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit.learners.evaluation.leap_bench import (
    ROWS,
    LeapBenchSettings,
    proofs,
    run,
    share,
    table,
)
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.leap.nlp import LeapNlp
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import attempt, plan_from
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap
from tests.refusals import refuses

SMALL = LeapBenchSettings(
    distribution="leap-few", scenes=3, seed=5, methods=("rule-tuned", "finder"), solves=12
)


def counted(rows):
    """Rows without the time that they took."""
    return [{name: value for name, value in row.items() if name != "cpu_s"} for row in rows]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    return folder, run(SMALL, folder)


def test_rows_are_what_planners_answer(whole):
    _, rows = whole
    for row in rows:
        leap = SMALL.scene(row["scene"])
        if row["method"] == "finder":
            answer = find_leap(leap, LeapFinder(solves=12, proof=0))
            assert row["found"] == (answer.solution is not None and answer.effort.solves <= 12)
        if row["method"] == "proof":
            assert not any(one["found"] for one in rows if one["scene"] == row["scene"])


def test_a_bench_that_was_cut_off_goes_on(whole, tmp_path):
    folder, rows = whole
    lines = (folder / ROWS).read_text().splitlines(keepends=True)
    (tmp_path / ROWS).write_text("".join(lines[:3]) + lines[3][:20])
    again = run(SMALL, tmp_path)
    assert counted(again) == counted(rows)
    assert [json.loads(line) for line in lines[1:3]] == [
        json.loads(x) for x in (tmp_path / ROWS).open()
    ][1:3]


def test_rows_of_other_settings_are_not_gone_on_with(whole):
    folder, _ = whole
    with refuses():
        run(replace(SMALL, seed=6), folder)
    with refuses("distribution"):
        replace(SMALL, distribution="leap-none")
    with refuses("scenes"):
        replace(SMALL, scenes=0)


def test_a_damaged_row_is_one_line(whole, tmp_path):
    folder, _ = whole
    lines = (folder / ROWS).read_text().splitlines(keepends=True)
    (tmp_path / ROWS).write_text(lines[0] + "{nothing}\n" + lines[2])
    with refuses("line 2"):
        run(SMALL, tmp_path)


def test_shares_count_scenes_that_nobody_solves_as_failures():
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
    rule, finder = table(rows, "leap-hard")
    assert (rule["first_try"], rule["within_25_solves"]) == (share(1, 3), share(1, 3))
    assert (finder["first_try"], finder["within_25_solves"]) == (share(0, 3), share(1, 3))
    assert finder["solved"] == share(2, 3)
    assert rule["solved_by_any"] == finder["solved_by_any"] == share(2, 3)
    assert rule["cpu_s"] is None  # the median of a time and of infinity
    assert finder["cpu_s"] == pytest.approx(0.2)
    assert proofs(rows) == {"unsolved": 1, "proved": 1, "share": share(1, 1)}
    low, high = share(30, 100)[1:]
    assert (round(low, 3), round(high, 3)) == (0.219, 0.396)  # Wilson's, as tables have it


def test_ipopt_and_convex_steps_agree_on_the_same_contacts():
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
        nlp = nlp or LeapNlp(leap, reserve=True)
        point = nlp.solve(leap, choice, nlp.nominal(leap, choice, numbers))
        assert point.solved
        assert check_leap(
            plan_from(numbers, choice, point.toes_m, point.forces_n, "ipopt")
        ).accepted
    assert solved > 0


@pytest.mark.parametrize("name", ["leap-stones", "leap-gaps", "leap-rubble", "leap-stairs"])
def test_leaps_over_a_family_stand_on_its_surfaces(name):
    leap = leap_class(name).draw(np.random.default_rng(3))
    again = leap_class(name).draw(np.random.default_rng(3))
    for one, other in zip(leap.footholds, again.footholds, strict=True):
        assert 1 <= len(one.candidates) <= 8
        for patch, same in zip(one.candidates, other.candidates, strict=True):
            np.testing.assert_array_equal(patch.vertices_m, same.vertices_m)
    assert leap.goal.com_m[0] > leap.start.com_m[0]
