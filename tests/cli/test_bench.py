"""``stancekit bench``: one table and one picture a class, JSON lines, and one clear line for what is wrong."""

import json
from pathlib import Path

import pytest
import yaml

from stancekit.cli.main import main

PLAN = {
    "problems": ["wall-3"],
    "train": {"feasible": 10, "infeasible": 10, "seed": 0},
    "test": {"feasible": 6, "infeasible": 6, "seed": 1},
    "methods": ["heuristic", "quantile"],
    "projections": ["fix-p", "scp"],
    "quick": {"methods": ["quantile"]},
}


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["bench", "envelopes", *map(str, arguments)])
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "plan.yaml"
    path.write_text(yaml.safe_dump(PLAN))
    return path


def test_a_run_writes_table_and_picture_and_prints_rows(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = config.parent / "out"
    assert run("--config", config, "--out", out, "--workers", 1, "--json") == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["selector"] for row in rows] == ["heuristic", "quantile", "lift"]
    assert rows == json.loads((out / "table.json").read_text())
    assert rows[0]["paper"]["p1_feasible"] == 0.7872
    assert "paper" not in rows[1]
    for row in rows:
        low, high = row["p1_feasible_interval"]
        assert low <= row["p1_feasible"] <= high
        assert row["p1_feasible_of"] == row["p1_infeasible_of"] == row["project_scp_of"] == 6
    assert (out / "wall-3.png").read_bytes()[:4] == b"\x89PNG"
    assert run("--config", config, "--out", out, "--workers", 1, "--quick") == 0
    printed = capsys.readouterr().out
    assert "quantile" in printed
    assert "paper: GA" in printed
    assert max(len(line) for line in printed.splitlines() if "out" not in line) <= 80


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
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, message: str
) -> None:
    (tmp_path / "plan.yaml").write_text(content)
    assert run("--config", tmp_path / "plan.yaml", "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"stancekit: error: {tmp_path}/plan.yaml: ")
    assert message in said
    assert "\n" not in said
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made_and_an_address_without_a_cluster_are_refused(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert run("--config", config, "--out", tmp_path / "file" / "out") == 2
    assert "expected a folder or room for one" in capsys.readouterr().err
    assert run("--config", config, "--out", tmp_path / "out", "--address", "10.0.0.1:6379") == 2
    assert "address: expected none for processes" in capsys.readouterr().err
