"""`stancekit label`: a data set that nothing can spoil, neither a second run nor a hard stop."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.learners.data import labelling
from stancekit.planners.errors import StancekitError
from stancekit.planners.problem import Problem
from tests.refusals import assert_names

SAME = (
    "--feasible",
    "8",
    "--infeasible",
    "8",
    "--shard-size",
    "4",
    "--seed",
    "2",
    "--workers",
    "1",
)
COMMAND = [sys.executable, "-m", "stancekit.cli.main", "label", "wall-3"]


def shards(folder: Path) -> dict[str, bytes]:
    """What the rows of a data set are kept in."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.parquet"))}


def begun_with(folder: Path, count: int) -> bool:
    """Whether a data set has been begun, and has so many shards."""
    return (folder / "header.json").exists() and len(shards(folder)) >= count


@pytest.fixture
def started(labelled, tmp_path):
    """A data set with two of its four shards."""
    folder = Path(shutil.copytree(labelled, tmp_path / "data"))
    for path in sorted(folder.glob("*-0000[23].*")):
        path.unlink()
    return folder


def test_the_summary_counts_what_was_kept_and_drawn(stancekit, labelled, tmp_path):
    ran = stancekit("label", "wall-3", "data", *SAME, "--json")
    assert (ran.code, ran.err) == (0, "")
    (summary,) = ran.records
    assert (" ".join(summary), summary["doubts"]) == (
        "rows drawn cpu_s_per_1000 solve_ms_median solve_ms_p99 doubts",
        [],
    )
    assert summary["rows"] == {"feasible": 8, "infeasible": 8, "trivial": 0, "undecided": 0}
    assert all(summary["drawn"][kind] >= count for kind, count in summary["rows"].items())
    assert shards(tmp_path / "data") == shards(labelled)


def test_people_are_told_the_same_in_words(stancekit, started):
    ran = stancekit("label", "wall-3", "data", *SAME)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.splitlines()[:2] == ["data", "  rows            8 feasible, 8 infeasible"]


def test_a_run_goes_on_where_it_was_stopped(stancekit, started, labelled):
    before = {path: path.stat().st_mtime_ns for path in started.glob("*.parquet")}
    assert len(before) == 2
    (started / ".shard-00002.parquet.999999999.tmp").write_bytes(b"half a shard")
    assert stancekit("label", "wall-3", "data", *SAME).code == 0
    assert shards(started) == shards(labelled)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert not list(started.glob(".*"))


def test_killed_at_any_moment_nothing_is_lost_and_nothing_double(stancekit, labelled, tmp_path):
    folder, counts = tmp_path / "data", []
    for stop_at in (0, 1, 3):
        run = subprocess.Popen(
            [*COMMAND, str(folder), *SAME], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        while not (begun := begun_with(folder, stop_at)) and run.poll() is None:
            time.sleep(0.005)
        assert begun or begun_with(folder, stop_at)
        run.send_signal(signal.SIGKILL)
        run.wait()
        counts.append(len(shards(folder)))
    assert counts == sorted(counts)
    assert counts[-1] >= 3
    assert stancekit("label", "wall-3", "data", *SAME).code == 0
    assert shards(folder) == shards(labelled)
    rows = [(row.shard, row.row) for row in Dataset.open(folder).rows()]
    assert len(rows) == len(set(rows)) == 16


def test_two_runs_in_one_folder_make_one_data_set(labelled, tmp_path):
    runs = [
        subprocess.Popen(
            [*COMMAND, str(tmp_path / "data"), *SAME],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        for _ in range(2)
    ]
    for run in runs:
        said = run.communicate()[1].decode()
        assert run.returncode == 0
        assert re.fullmatch(
            r"(label wall-3, rows written: .*, \d+ s\n)*", said
        )  # long work says how far it is
    assert shards(tmp_path / "data") == shards(labelled)


def test_a_finished_data_set_is_summed_up_again(stancekit, labelled):
    again = stancekit("label", "wall-3", labelled, *SAME, "--json")
    assert again == stancekit("label", "wall-3", labelled, *SAME, "--json")
    assert again.records[0]["rows"]["feasible"] == 8


def test_ctrl_c_is_one_line(stancekit, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(labelling, "label", interrupt)
    ran = stancekit("label", "wall-3", "data")
    assert (ran.code, ran.out, ran.err) == (130, "", "stancekit: interrupted\n")


def test_a_distribution_that_lacks_a_label_fails(stancekit, monkeypatch):
    def give_up(*_, **__):
        raise StancekitError("wall-3: shard 0 lacks 8 infeasible rows after 9 draws")

    monkeypatch.setattr(labelling, "label", give_up)
    ran = stancekit("label", "wall-3", "data")
    assert (ran.code, ran.out) == (1, "")
    assert ran.err == "stancekit: failed: wall-3: shard 0 lacks 8 infeasible rows after 9 draws\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("ice-3", "data"),
            "distribution",
        ),
        (
            ("wall-3", "data", "--feasible", "-1"),
            "--feasible",
        ),
        (("wall-3", "data", "--seed", "-1"), "--seed"),
        (
            ("wall-3", "data", "--shard-size", "0"),
            "--shard-size",
        ),
        (("wall-3", "data", "--workers", "0"), "--workers"),
        (("wall-3", "data", "--workers", "9" * 30), "--workers"),
        (
            ("wall-3", "data", "--feasible", "0", "--infeasible", "0"),
            "infeasible",
        ),
    ],
)
def test_bad_input_is_one_line_and_makes_nothing(arguments, message, refusal, tmp_path):
    assert_names(refusal("label", *arguments), message)


def test_a_file_is_no_folder(refusal, write):
    assert_names(refusal("label", "wall-3", write("data", "{}")), "data")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--seed", "3"), "seed"),
        (("--feasible", "9"), "feasible"),
        (("--natural",), "natural"),
    ],
)
def test_the_folder_of_another_plan_is_left_alone(change, message, refusal, started):
    before, at = shards(started), SAME.index(change[0]) if change[0] in SAME else len(SAME)
    others = SAME[:at] + SAME[at + 2 :]
    assert_names(refusal("label", "wall-3", "data", *others, *change), "data/header.json", message)
    assert shards(started) == before


def test_a_damaged_shard_is_named(refusal, started):
    (started / "shard-00001.parquet").write_bytes(b"PAR1")
    assert_names(refusal("label", "wall-3", "data", *SAME), "data/shard-00001.parquet")
    header = json.loads((started / "header.json").read_text())
    (started / "header.json").write_text(json.dumps(header | {"format": "stancekit/dataset/9"}))
    said = refusal("label", "wall-3", "data", *SAME)
    assert (
        said
        == "data/header.json: format: expected 'stancekit/dataset/1', got 'stancekit/dataset/9'"
    )


FEW = ("--scenes", "2", "--tries", "random=3,finder=1", "--shard-size", "4", "--workers", "1")


def test_leaps_are_labelled_verified_and_counted(stancekit, tmp_path):
    ran = stancekit("label", "leap-few", "tries", *FEW, "--json")
    assert (ran.code, ran.err) == (0, "")
    (summary,) = ran.records
    assert list(summary) == ["scenes", "solved", "refuted", "unsolved", "tries_per_cpu_s"]
    assert summary["scenes"] == 2
    assert summary["solved"] + summary["refuted"] + summary["unsolved"] == 8
    before = shards(tmp_path / "tries")
    assert len(before) == 2
    (tmp_path / "tries" / "shard-00000.parquet").unlink()
    ran = stancekit("label", "leap-few", "tries", *FEW)
    assert (ran.code, ran.err, shards(tmp_path / "tries")) == (0, "", before)
    first = [line.split(":")[0].strip() for line in ran.out.splitlines()[:4]]
    assert first == ["tries", "solved", "refuted", "unsolved"]
    ran = stancekit("verify", "tries", "--json")
    assert ran.code == 0
    assert ran.records[0]["certificates"] == summary["refuted"]


def test_a_damaged_shard_of_tries_is_one_line(stancekit, tmp_path):
    assert stancekit("label", "leap-few", "tries", *FEW).code == 0
    path = tmp_path / "tries" / "shard-00001.parquet"
    path.write_bytes(path.read_bytes()[:-20])
    for command in (("verify", "tries"), ("label", "leap-few", "tries", *FEW)):
        ran = stancekit(*command)
        assert ran.code == 2
        assert ran.err.startswith(
            "stancekit: error: tries/shard-00001.parquet: expected a whole Parquet file, got "
        )
        assert len(ran.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("leap-far",), "distribution: expected one of leap"),
        (("leap-hard", "--scenes", "0"), "--scenes: expected an integer of at least 1, got 0"),
        (
            ("leap-hard", "--feasible", "500"),
            "--feasible: expected none with leaps of leap-hard, got 500",
        ),
        (
            ("leap-hard", "--infeasible", "0"),
            "--infeasible: expected none with leaps of leap-hard, got 0",
        ),
        (
            ("leap-hard", "--robot", "anymal"),
            "--robot: expected none with leaps of leap-hard, got anymal",
        ),
        (("leap-hard", "--natural"), "--natural: expected none with leaps of leap-hard, got True"),
        (
            ("leap-hard", "--tries", "random"),
            "--tries: expected counts by planner, as random=8,finder=4, got 'random'",
        ),
        (
            ("leap-hard", "--tries", "luck=2"),
            "--tries: expected a count for some of random, rule, farkas, finder, noise",
        ),
        (("wall-3", "--scenes", "3"), "--scenes: expected none with postures, got 3"),
        (("wall-3", "--tries", "random=3"), "--tries: expected none with postures, got random=3"),
    ],
)
def test_what_leaps_or_postures_have_no_use_for_is_refused_by_name(
    stancekit, tmp_path, command, message
):
    name, *options = command
    ran = stancekit("label", name, "tries", *options, "--workers", "1")
    assert ran.code == 2
    assert ran.err.startswith(f"stancekit: error: {message}")
    assert len(ran.err.splitlines()) == 1
    assert not (tmp_path / "tries").exists()


@pytest.mark.parametrize("name", sorted(DISTRIBUTIONS))
def test_every_line_is_a_problem(name, stancekit, sampled):
    ran = stancekit("sample", name, "--count", 12, "--seed", 1)
    assert (ran.code, ran.err) == (0, "")
    assert ran.records == sampled[name]
    for record in ran.records:
        assert Problem.from_json(record).to_json() == record


def test_equal_seeds_give_equal_problems_and_others_give_others(stancekit):
    first = stancekit("sample", "wall-3", "--count", 2)
    assert stancekit("sample", "wall-3", "--count", 2, "--seed", 0) == first
    assert not set(stancekit("sample", "wall-3", "--count", 2, "--seed", 1).out.splitlines()) & set(
        first.out.splitlines()
    )


def test_a_file_holds_what_would_have_been_printed(stancekit, tmp_path):
    printed = stancekit("sample", "wall-5", "--count", 3)
    ran = stancekit("sample", "wall-5", "--count", 3, "--out", "a.jsonl")
    assert (ran.code, ran.out, ran.err) == (0, "a.jsonl: 3 problem(s) of wall-5\n", "")
    assert (tmp_path / "a.jsonl").read_text() == printed.out
    ran = stancekit("sample", "wall-5", "--count", 3, "--out", "b.jsonl", "--json")
    assert ran.records == [{"out": "b.jsonl", "problem_class": "wall-5", "problems": 3}]
    assert (tmp_path / "b.jsonl").read_text() == printed.out
    assert sorted(os.listdir(tmp_path)) == ["a.jsonl", "b.jsonl"]


def test_what_it_prints_is_what_solve_reads(stancekit):
    drawn = stancekit("sample", "ground-3", "--count", 2).out
    assert [
        record["status"]
        for record in stancekit("solve", "-", "--json", stdin=drawn.encode()).records
    ] == ["feasible", "feasible"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("ice-3",),
            "distribution",
        ),
        (("wall-3", "--count", "0"), "--count"),
        (("wall-3", "--count", "-7"), "--count"),
        (("wall-3", "--seed", "-1"), "--seed"),
        (("wall-3", "--out", "none/a.json"), "none/a.json"),
        (("wall-3", "--out", "."), "."),
        (
            ("wall-3", "--count", "1e3"),
            "--count",
        ),
    ],
)
def test_bad_input_is_one_line(arguments, message, refusal):
    assert_names(refusal("sample", *arguments), message)


def test_a_device_is_written_to_and_stays_a_device(stancekit):
    assert stancekit("sample", "wall-3", "--out", os.devnull).code == 0
    assert not os.path.isfile(os.devnull)


def test_a_seed_may_be_as_long_as_one_likes(stancekit):
    (record,) = stancekit("sample", "wall-3", "--seed", "9" * 40).records
    assert json.dumps(record)
