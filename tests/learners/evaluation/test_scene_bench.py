"""The bench of scenes: cells are kept, rows say what the verifier says, and the page has every
row.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import pytest
import yaml

from stancekit.learners.evaluation import scene_bench
from stancekit.learners.evaluation.scene_bench import SceneBenchSettings
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.plan_file import read_plan
from stancekit.planners.verify import check_plan

SETTINGS = SceneBenchSettings(
    scenes=("anymal-complex",), methods=("mip-highs", "two-stage", "decoupled")
)


def test_a_row_says_what_came_of_every_planner_and_is_not_measured_again(tmp_path, monkeypatch):
    rows = {row["method"]: row for row in scene_bench.run(SETTINGS, tmp_path)}
    assert rows["two-stage"]["status"] == "infeasible"
    assert "reach" in rows["two-stage"]["message"]
    assert rows["mip-highs"]["status"] == "undecided"
    assert rows["mip-highs"]["claim"] == "infeasible"
    assert not any(row["success"] for row in rows.values())
    monkeypatch.setattr(scene_bench, "measure", lambda *_: pytest.fail("measured again"))
    assert {row["method"]: row for row in scene_bench.run(SETTINGS, tmp_path)} == rows


def test_a_scene_with_a_plan_has_its_file_and_a_line_on_the_page(tmp_path):
    keys = yaml.safe_load(
        (Path(str(resources.files("stancekit.configs.scenes"))) / "anymal-trot.yaml").read_text()
    )
    scene = tmp_path / "pace.yaml"
    ours = {**keys["ours"], "path_m": [[-2.0, 0.0, 0.47], [-1.7, 0.0, 0.47]]}
    scene.write_text(yaml.safe_dump({**keys, "phases": keys["phases"][:3], "ours": ours}))
    settings = SceneBenchSettings(scenes=(str(scene),), methods=("two-stage", "l1"))
    rows = list(scene_bench.run(settings, tmp_path))
    assert [row["verified"] for row in rows] == [True, True]
    assert rows[0]["steps"] == 6
    assert rows[1]["as_planned"] is False
    plan, _ = read_plan(tmp_path / "pace-two-stage.plan.json")
    assert check_plan(plan).accepted
    page = scene_bench.page(rows, settings)
    assert "| pace | 6 | two-stage | yes |" in page
    assert "| pace | 6 | l1 | yes | no | yes | feasible |" in page
    sums = {each["method"]: each for each in scene_bench.shares(rows)}
    assert (sums["l1"]["success"], sums["l1"]["as_planned"], sums["l1"]["verified"]) == (1, 0, 1)
    json.dumps(rows, allow_nan=False)


def test_settings_that_make_no_bench_are_refused(tmp_path):
    with pytest.raises(InvalidInput, match=r"^method: expected some of l1, .*, got 'mip'$"):
        SceneBenchSettings(methods=("mip",))
    with pytest.raises(InvalidInput, match=r"^time_limit_s: expected a number above 0, got 0$"):
        SceneBenchSettings(time_limit_s=0.0)
    with pytest.raises(InvalidInput, match=r"^course: expected one of"):
        next(scene_bench.run(SceneBenchSettings(scenes=("nowhere",)), tmp_path))
