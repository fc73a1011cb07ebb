"""The bench of scenes: cells are kept, rows say what the verifier says, and the page has every
row.
"""

from __future__ import annotations

import importlib
import json
import sys

import pytest
import yaml

from benchmarks.published.scene import FOLDER
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.plan_file import read_plan
from stancekit.planners.problem.course_file import course_difference, read_course
from stancekit.planners.verify import check_plan


@pytest.fixture(scope="module")
def scenes():
    sys.path.insert(0, str(FOLDER.parent))
    yield importlib.import_module("scenes")
    sys.path.remove(str(FOLDER.parent))


def test_a_row_says_what_came_of_every_planner_and_is_not_measured_again(
    scenes, tmp_path, monkeypatch
):
    methods = ("mip-highs", "two-stage", "decoupled")
    asked = scenes.Arguments(scene=("anymal-complex",), method=methods, out=tmp_path)
    rows = {row["method"]: row for row in scenes.run(asked)}
    assert rows["two-stage"]["status"] == "infeasible"
    assert "reach" in rows["two-stage"]["message"]
    assert rows["mip-highs"]["status"] == "undecided"
    assert rows["mip-highs"]["claim"] == "infeasible"
    assert not any(row["success"] for row in rows.values())
    monkeypatch.setattr(scenes, "measure", lambda *_: pytest.fail("measured again"))
    assert {row["method"]: row for row in scenes.run(asked)} == rows


def test_a_scene_with_a_plan_has_its_files_and_a_line_on_the_page(scenes, tmp_path):
    keys = yaml.safe_load((FOLDER / "scenes" / "anymal-trot.yaml").read_text())
    scene = tmp_path / "pace.yaml"
    ours = {**keys["ours"], "path_m": [[-2.0, 0.0, 0.47], [-1.7, 0.0, 0.47]]}
    scene.write_text(yaml.safe_dump({**keys, "phases": keys["phases"][:3], "ours": ours}))
    asked = scenes.Arguments(scene=(str(scene),), method=("two-stage", "l1"), out=tmp_path)
    rows = list(scenes.run(asked))
    assert [row["verified"] for row in rows] == [True, True]
    assert rows[0]["steps"] == 6
    assert rows[1]["as_planned"] is False
    plan, _ = read_plan(tmp_path / "pace-two-stage.plan.json")
    assert check_plan(plan).accepted
    assert course_difference(read_course(tmp_path / "pace.course.json"), plan.problem) == ""
    page = scenes.page(rows, asked)
    assert "| pace | 6 | two-stage | yes |" in page
    assert "| pace | 6 | l1 | yes | no | yes | feasible |" in page
    assert "| l1 | 1 | 1 | 0 | 1 | 0 |" in page
    json.dumps(rows, allow_nan=False)


def test_scenes_and_methods_that_there_are_not_are_refused(scenes, tmp_path):
    with pytest.raises(InvalidInput, match=r"^method: expected one of l1, .*, got 'mip'$"):
        next(scenes.run(scenes.Arguments(method=("mip",), out=tmp_path)))
    with pytest.raises(InvalidInput, match=r"^scene: expected one of anymal-complex, .*"):
        next(scenes.run(scenes.Arguments(scene=("nowhere",), out=tmp_path)))
