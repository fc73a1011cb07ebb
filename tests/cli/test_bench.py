"""``stancekit bench``: one table and one picture a class, JSON lines, and one clear line for what
is wrong.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
import yaml

from stancekit.planners.plugins import FILE

PLAN = {
    "problems": ["wall-3"],
    "train": {"feasible": 10, "infeasible": 10, "seed": 0},
    "test": {"feasible": 6, "infeasible": 6, "seed": 1},
    "methods": ["heuristic", "quantile"],
    "projections": ["fix-p", "scp"],
    "quick": {"methods": ["quantile"]},
}


@pytest.fixture
def bench(stancekit):
    return lambda *arguments: stancekit("bench", "envelopes", *arguments)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "plan.yaml"
    path.write_text(yaml.safe_dump(PLAN))
    return path


def test_a_run_writes_table_and_picture_and_prints_rows(config: Path, bench) -> None:
    out = config.parent / "out"
    rows = bench("--config", config, "--out", out, "--workers", 1, "--json").records
    assert [row["selector"] for row in rows] == ["heuristic", "quantile", "lift"]
    assert rows == json.loads((out / "table.json").read_text())
    assert rows[0]["paper"]["p1_feasible"] == 0.7872
    assert "paper" not in rows[1]
    for row in rows:
        low, high = row["p1_feasible_interval"]
        assert low <= row["p1_feasible"] <= high
        assert row["p1_feasible_of"] == row["p1_infeasible_of"] == row["project_scp_of"] == 6
    assert (out / "wall-3.png").read_bytes()[:4] == b"\x89PNG"
    page = (out / "table.md").read_text()
    assert "|  | paper: GA | 77.8 | 97.7 | 67.1 | – | – |" in page
    ranks = {
        cells[2].strip(): int(cells[1])
        for cells in (line.split("|") for line in page.splitlines())
        if len(cells) > 3 and cells[1].strip().isdigit()
    }
    best = sorted(rows, key=lambda row: -row["balanced"])
    assert [name for name, _ in sorted(ranks.items(), key=lambda item: item[1])] == [
        row["selector"] for row in best
    ]
    printed = bench("--config", config, "--out", out, "--workers", 1, "--quick").out
    assert "quantile" in printed
    assert "paper: GA" in printed
    assert max(len(line) for line in printed.splitlines() if "out" not in line) <= 80


SUBMISSION = """
import numpy as np
import stancekit

def around(request):
    rows = request.dataset
    box = stancekit.Envelope.around(rows.points)
    return stancekit.EnvelopeSet.for_problems(rows.problem_class, list(rows.problems()), [box], {"method": "around"})

class Middle:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.repeat([-HALF, HALF], 6 * observation["friction"].shape[-1]).astype(np.float32), state

def middle(request):
    return Middle()
"""


def test_methods_of_a_file_stand_beside_ours_and_are_judged_anew_when_it_changes(
    monkeypatch: pytest.MonkeyPatch, bench
) -> None:
    methods = ["quantile", "mine.py:around", "mine.py:middle"]
    Path("plan.yaml").write_text(yaml.safe_dump(PLAN | {"methods": methods}))
    found = []
    for half in ("1.0", "0.05"):
        Path("mine.py").write_text(SUBMISSION.replace("HALF", half))
        for name in [name for name in sys.modules if name.startswith(FILE)]:
            monkeypatch.delitem(sys.modules, name)  # as in another process
        ran = bench("--config", "plan.yaml", "--out", "out", "--workers", 1, "--json")
        found.append(ran.records)
    wide, narrow = ({row["selector"]: row for row in rows} for rows in found)
    assert list(wide) == [*methods, "lift"]
    assert wide["mine.py:around"]["file"] == "mine-around.json"
    assert Path("out/wall-3/mine-around.json").is_file()
    assert wide["mine.py:middle"]["p1_feasible"] == 1.0
    assert narrow["mine.py:middle"]["p1_feasible"] == 0.0
    assert "| mine.py:middle | wall-3 | none kept |" in Path("out/table.md").read_text()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("problems: [", "expected YAML"),
        ("methods: 3", "methods: "),
        (yaml.safe_dump(PLAN | {"metods": []}), "metods: unknown key"),
        ("", "the file is empty"),
    ],
)
def test_a_bad_plan_is_one_line_and_exit_code_2(
    tmp_path: Path, refusal, content: str, message: str
) -> None:
    (tmp_path / "plan.yaml").write_text(content)
    said = refusal("bench", "envelopes", "--config", "plan.yaml", "--out", "out")
    assert said.startswith("plan.yaml: ")
    assert message in said


def test_a_folder_that_cannot_be_made_and_an_address_without_a_cluster_are_refused(
    config: Path, tmp_path: Path, refusal
) -> None:
    (tmp_path / "file").touch()
    asked = ("bench", "envelopes", "--config", config, "--out")
    assert "expected a folder or room for one" in refusal(*asked, "file/out")
    said = refusal(*asked, "out", "--address", "10.0.0.1:6379")
    assert "address: expected none for processes" in said
