"""`stancekit sample`: problems that other programs can read, the same ones from the same seed."""

import json
import os

import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.problem import Problem
from tests.refusals import assert_names


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
def test_bad_input_is_one_line(arguments, message, refusal, tmp_path):
    assert_names(refusal("sample", *arguments), message)
    assert os.listdir(tmp_path) == []


def test_a_device_is_written_to_and_stays_a_device(stancekit):
    assert stancekit("sample", "wall-3", "--out", os.devnull).code == 0
    assert not os.path.isfile(os.devnull)


def test_a_seed_may_be_as_long_as_one_likes(stancekit):
    (record,) = stancekit("sample", "wall-3", "--seed", "9" * 40).records
    assert json.dumps(record)
