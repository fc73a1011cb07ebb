"""Methods that choose a leap's contacts: their rows are those of planners, and a run goes on where it
was.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit.learners.evaluation.room import (
    ROWS,
    LeapBenchSettings,
    run,
    share,
)
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.problem.leap_classes import leap_class
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


def test_a_bench_that_was_cut_off_goes_on(whole, tmp_path):
    folder, rows = whole
    lines = (folder / ROWS).read_text().splitlines(keepends=True)
    (tmp_path / ROWS).write_text("".join(lines[:3]) + lines[3][:20])
    assert counted(run(SMALL, tmp_path)) == counted(rows)
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


@pytest.mark.parametrize("name", ["leap-stones", "leap-gaps", "leap-rubble", "leap-stairs"])
def test_leaps_over_a_family_stand_on_its_surfaces(name):
    leap = leap_class(name).draw(np.random.default_rng(3))
    again = leap_class(name).draw(np.random.default_rng(3))
    for one, other in zip(leap.footholds, again.footholds, strict=True):
        assert 1 <= len(one.candidates) <= 8
        for patch, same in zip(one.candidates, other.candidates, strict=True):
            np.testing.assert_array_equal(patch.vertices_m, same.vertices_m)
    assert leap.goal.com_m[0] > leap.start.com_m[0]


def test_shares_have_wilsons_interval():
    low, high = share(30, 100)[1:]
    assert (round(low, 3), round(high, 3)) == (0.219, 0.396)
    assert share(0, 0) is None
