"""Room for learning and learned scores of leaps at the command line: bench room, fit of tries, plan --policy."""

import json
from pathlib import Path

import pytest


def test_bench_room_prints_a_line_per_budget(stancekit):
    given = "bench room --distribution leap-few --scenes 2 --oracle-solves 4 --solves 2 --out room --json"
    lines = [json.loads(line) for line in stancekit(*given.split()).out.splitlines()]
    assert [line["budget"] for line in lines] == ["1 tries", "2 solves"]
    assert all(line["scenes"] == 2 and line["room"] >= 0.0 for line in lines)


def test_scores_that_were_fitted_to_tries_plan_a_leap_and_have_a_row(stancekit):
    label = "label leap-base tries --scenes 4 --tries random=2,rule=3 --seed 8 --workers 1"
    stancekit(*label.split())
    Path("few.yaml").write_text("epochs: 2\n")
    said = stancekit(*["fit", "tries", "--method", "additive", "--config", "few.yaml", "--out", "scores.safetensors"])
    assert "scores for leap-base from" in said.out
    plan = "plan leap-base:1 --policy scores.safetensors --planner rule --json"
    assert json.loads(stancekit(*plan.split()).out)["planner"] == "rule"
    room = "bench room --distribution leap-base --scenes 2 --oracle-solves 4 --out room --json"
    room += " --scorer scores.safetensors"
    first = json.loads(stancekit(*room.split()).out.splitlines()[0])
    assert first["learned_by"] == "scores"
    assert first["learned"] is not None


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("bench room --scenes 0 --out room", "--scenes: expected"),
        ("bench room --distribution leap-none --out room", "--distribution: expected one of"),
        ("plan walls --frames 2 --policy scores.safetensors", "--policy: expected a leap with it, got walls"),
        ("plan leap-base:0 --policy none.safetensors", "none.safetensors"),
        ("fit a b --method set --out scores.safetensors", "expected one whole folder of tries with set"),
    ],
)
def test_bad_input_is_refused_in_one_line(given, line, refusal):
    assert line in refusal(*given.split())
