"""`stancekit plan` and `stancekit verify` over files of leaps."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.formats.motion_file import read_motion, write_motion
from stancekit.planners.problem.leap_classes import leap_from_keys, leap_to_json
from stancekit.planners.verify.leaps import check_leap
from tests.refusals import assert_names

ORDERS = "random, rule, noise, farkas, finder"


@pytest.fixture
def drawn(tmp_path):
    """A file of a leap that is drawn."""

    def write(distribution, seed):
        path = tmp_path / f"{distribution}-{seed}.yaml"
        path.write_text(f"distribution: {distribution}\nseed: {seed}\n")
        return path

    return write


def test_a_leap_is_planned_written_and_verified(stancekit, drawn):
    ran = stancekit("plan", drawn("leap-given", 0), "--out", "leap.json", "--json")
    assert (ran.code, ran.records[0]["status"], ran.records[0]["verdict"]["accepted"]) == (
        0,
        "feasible",
        True,
    )
    again = stancekit("verify", "leap.json")
    assert (again.code, "accepted" in again.out) == (0, True)
    leap, _ = read_motion("leap.json")
    forged = replace(leap, toes_m=leap.toes_m + np.array([0.0, 0.0, 0.01]))
    write_motion("forged.json", forged, check_leap(forged))
    refused = stancekit("verify", "forged.json", "--json")
    assert (refused.code, refused.records[0]["verdict"]) == (1, "refused")


def test_a_proof_says_what_would_have_to_give(stancekit, drawn):
    ran = next(
        ran
        for seed in range(20)
        if (
            ran := stancekit("plan", drawn("leap-few", seed), "--proof", "none.json", "--json")
        ).records[0]["status"]
        == "infeasible"
    )
    assert ran.code == 1
    assert "needed" in ran.records[0]["message"]
    again = stancekit("verify", "none.json", "--explain")
    assert (again.code, "refuted at all leaves" in again.out, "needed" in again.out) == (
        0,
        True,
        True,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "3"], "--frames: expected none with a leap, got 3"),
        (["--start=0,0", "--goal", "1,0"], "--start: expected none with a leap, got 0,0"),
        (["--friction", "nan"], "--friction: expected none with a leap, got nan"),
        (["--up", "y"], "--up: expected none with a leap, got y"),
        (["--solver", "scip"], "--solver: expected none with a leap, got scip"),
        (["--max-solves", "3"], "--max-solves: expected none with a leap, got 3"),
        (["--method", "exact"], f"--method: expected one of {ORDERS} with a leap, got exact"),
        (["--out", "leap.npz"], "leap.npz: expected a name that ends in .json, got .npz"),
    ],
)
def test_options_without_a_use_are_refused(stancekit, drawn, arguments, message):
    ran = stancekit("plan", drawn("leap-given", 0), *arguments)
    assert (ran.code, ran.err) == (2, f"stancekit: error: {message}\n")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"timings_s": [[0.3]]},
            "leap leap-hard-0: timings_s[0]: expected 3 durations, one per phase, got 1",
        ),
        (
            {"duration_s": 2.0},
            "timings_s[0]: expected durations that add up to duration_s, 2 s, got 0.96 s",
        ),
        ({"robot": None}, "bad.json: robot: expected a name, a file, or a robot's keys, got None"),
        (
            {"robot": {"name": "a", "mass_kg": "x", "limbs": []}},
            "bad.json: robot.mass_kg: expected a valid number, got 'x'",
        ),
        (
            {"footholds": []},
            "leap leap-hard-0: footholds: expected one of LF in phase 0, where it begins to stand",
        ),
        (
            {"distribution": "none"},
            "distribution: expected one of leap-base, leap-hard, leap-long, leap-few, leap-given",
        ),
    ],
)
def test_a_bad_leap_is_one_line_and_exit_code_2(stancekit, tmp_path, change, message):
    keys = leap_to_json(leap_from_keys({"distribution": "leap-hard", "seed": 0}, "x"))
    content = change if "distribution" in change else {**keys, **change}
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    ran = stancekit("plan", path)
    assert ran.code == 2
    assert message in " ".join(ran.err.split())
    assert ran.err.count("\n") == 1


def test_a_question_alone_is_nothing_to_verify(stancekit, drawn):
    ran = stancekit("verify", drawn("leap-hard", 0))
    assert (ran.code, ran.err.count("\n")) == (2, 1)
    assert_names(ran.err, "motion", "proof")


def test_a_leap_is_drawn_by_its_name(stancekit):
    ran = stancekit(
        "plan", "leap-given:0", "--picture", "leap.png", "--html", "leap.html", "--json"
    )
    assert (ran.code, ran.records[0]["course"], ran.records[0]["status"]) == (
        0,
        "leap-given-0",
        "feasible",
    )
    with open("leap.png", "rb") as file:
        assert file.read(4) == b"\x89PNG"
    wrong = stancekit("plan", "leap-given:x")
    assert (wrong.code, "expected CLASS:SEED as leap-given:7" in " ".join(wrong.err.split())) == (
        2,
        True,
    )


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
    plan = "plan leap-base:1 --policy scores.safetensors --method rule --json"
    assert json.loads(stancekit(*plan.split()).out)["method"] == "rule"
    room = "bench room --distribution leap-base --scenes 2 --oracle-solves 4 --solves 4 --out room --json"
    room += " --scorer scores.safetensors"
    first = json.loads(stancekit(*room.split()).out.splitlines()[0])
    assert first["learned_by"] == "scores"
    assert first["learned"] is not None


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("bench room --scenes 0 --out room", "--scenes: expected"),
        ("bench room --environment --out room", "--environment: expected one or more, got none"),
        (
            "bench room --method --out room",
            "--method: expected a control among them, got none",
        ),
        (
            "bench room --scorer neural-wall-3 --out room",
            "--scorer: expected a file of leaps' scores, or one of set-leap-hard, got neural-wall-3",
        ),
        (
            "plan leap-base:1 --method random --policy set-leap-hard",
            "--policy: expected none with --method random",
        ),
        ("plan leap-base:1 --policy neural-wall-3", "expected a file, or one of set-leap-hard"),
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
            "--policy: expected none with the course walls, got scores.safetensors",
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
