"""Room for learning and learned scores of leaps at the command line: bench room, fit of tries, plan
--policy.
"""

import json
from pathlib import Path

import pytest


def test_bench_room_prints_a_line_per_budget(stancekit):
    given = "bench room --distribution leap-few --scenes 2 --oracle-solves 4 --solves 2 --cpu-s 9 --out room --json"
    lines = [json.loads(line) for line in stancekit(*given.split()).out.splitlines()]
    assert [line["budget"] for line in lines] == ["1 try", "2 solves", "9 CPU-s"]
    assert all(line["scenes"] == 2 and line["room"] >= 0.0 for line in lines)


def test_bench_room_has_a_line_of_another_environment_and_goes_on(stancekit):
    given = "bench room --environment Traverse-v0 --scenes 2 --out room --json"
    (first,) = [json.loads(line) for line in stancekit(*given.split()).out.splitlines()]
    assert (first["scenes"], first["budget"], first["learned"]) == (2, "an episode", None)
    assert first["control"][0] <= first["oracle"][0]
    rows = Path("room/Traverse-v0/rows.jsonl").read_text().splitlines()
    assert len(rows) == 1 + 2 * 5
    more = given.replace("--scenes 2", "--scenes 3")
    assert json.loads(stancekit(*more.split()).out)["scenes"] == 3
    assert Path("room/Traverse-v0/rows.jsonl").read_text().splitlines()[:11] == rows


def test_scores_that_were_fitted_to_tries_plan_a_leap_and_have_a_row(stancekit):
    label = "label leap-base tries --scenes 4 --tries random=2,rule=3 --seed 8 --workers 1"
    stancekit(*label.split())
    Path("few.yaml").write_text("epochs: 2\n")
    said = stancekit(
        *[
            "fit",
            "tries",
            "--method",
            "additive",
            "--config",
            "few.yaml",
            "--out",
            "scores.safetensors",
        ]
    )
    assert "scores for leap-base from" in said.out
    plan = "plan leap-base:1 --policy scores.safetensors --planner rule --json"
    assert json.loads(stancekit(*plan.split()).out)["planner"] == "rule"
    room = "bench room --distribution leap-base --scenes 2 --oracle-solves 4 --solves 4 --out room --json"
    room += " --scorer scores.safetensors"
    first = json.loads(stancekit(*room.split()).out.splitlines()[0])
    assert first["learned_by"] == "scores"
    assert first["learned"] is not None


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("bench room --scenes 0 --out room", "--scenes: expected"),
        ("bench room --distribution leap-none --out room", "--distribution: expected one of"),
        ("bench room --solves 0 --out room", "--solves: expected 1 to 50, got 0"),
        ("bench room --solves 60 --out room", "--solves: expected 1 to 50, got 60"),
        ("bench room --cpu-s 0 --out room", "--cpu-s: expected a number above 0, got 0"),
        ("bench room --oracle-solves 0 --out room", "--oracle-solves: expected 1"),
        ("bench room --environment Cart-v1 --out room", "--environment: expected one of"),
        ("bench room --method greedy --out room", "--method: expected one of"),
        (
            "plan leap-base:0 --policy neural-wall-3",
            "neural-wall-3: expected a file, or one of set-leap-hard, found",
        ),
        (
            "plan walls --frames 2 --policy scores.safetensors",
            "--policy: expected a leap with it, got walls",
        ),
        ("plan leap-base:0 --policy none.safetensors", "none.safetensors"),
        (
            "fit a b --method set --out scores.safetensors",
            "expected one folder of tries with set, got 2",
        ),
    ],
)
def test_bad_input_is_refused_in_one_line(given, line, refusal):
    assert line in refusal(*given.split())
