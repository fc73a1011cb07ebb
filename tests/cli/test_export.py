"""``stancekit export``: writes below the folder that is given, reads back, and says what is wrong
in one line.
"""

import json
from pathlib import Path

import pytest

from stancekit.cli.main import main
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data.labelling import label


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["export", *map(str, arguments)])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_an_export_is_read_back_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    label(
        LabelPlan(distribution="wall-3", feasible=2, infeasible=2, shard_size=4), tmp_path / "set"
    )
    assert run(tmp_path / "set", "--out", tmp_path / "out", "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["episodes"], record["read_back"], record["agreement"]) == (4, 4, 1.0)
    assert (record["dataset_id"], record["root"]) == (
        "stancekit/wall-3/expert-v0",
        str(tmp_path / "out"),
    )
    assert run(tmp_path / "set", "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err == (
        f"stancekit: error: {tmp_path}/out: expected a new or empty folder, found files in it\n"
    )
    assert run(tmp_path / "set", "--out", tmp_path / "text", "--to", "minari") == 0
    assert "4 episodes of stancekit/wall-3/expert-v0" in capsys.readouterr().out


def test_a_folder_without_a_data_set_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "none", "--to", "minari", "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err == (
        f"stancekit: error: {tmp_path}/none: expected the folder of a data set, found nothing\n"
    )
