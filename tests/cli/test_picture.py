"""`stancekit picture`: a picture of any problem of a file, answered or not."""

import os

import pytest

from tests.refusals import assert_names

MAGIC = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}


@pytest.fixture
def file(sampled, write):
    return write("p.jsonl", *sampled["wall-3"][:2], sampled["wall-3"][0] | {"mass_kg": -1.0})


@pytest.mark.parametrize("suffix", sorted(MAGIC))
def test_every_format_is_written(suffix, file, stancekit, tmp_path):
    ran = stancekit("picture", file, "--out", f"a{suffix}", "--json")
    assert (ran.code, ran.err) == (0, "")
    assert ran.records == [
        {"where": "p.jsonl line 1", "out": f"a{suffix}", "method": "exact", "status": "feasible"}
    ]
    assert (tmp_path / f"a{suffix}").read_bytes().startswith(MAGIC[suffix])
    assert sorted(os.listdir(tmp_path)) == sorted([f"a{suffix}", file])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--index", "1"), "exact: infeasible, "),
        (("--method", "none"), "the scene alone"),
        (("--method", "nlp"), "nlp: feasible, "),
        (("--method", "two-stage"), "lift+scp: feasible, "),
    ],
)
def test_people_are_told_what_was_drawn(options, words, file, stancekit):
    ran = stancekit("picture", file, "--out", "a.png", *options)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith(f"a.png: {words}")
    assert ran.out.count("\n") == 1


def test_an_envelope_changes_the_picture(file, envelopes, stancekit, tmp_path):
    stancekit("picture", file, "--out", "a.png", "--method", "none")
    ran = stancekit(
        "picture", file, "--out", "b.png", "--method", "none", "--envelope", envelopes, "--json"
    )
    assert ran.records[0]["status"] is None
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()


def test_the_problem_may_come_from_standard_input(file, stancekit, tmp_path):
    ran = stancekit(
        "picture", "-", "--out", "a.png", "--json", stdin=(tmp_path / file).read_bytes()
    )
    assert (ran.code, ran.records[0]["where"]) == (0, "- line 1")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--out", "a.jpg"), "a.jpg"),
        (("--out", "a"), "a"),
        (("--out", "none/a.png"), "none/a.png"),
        (("--out", "folder.png"), "folder.png"),
        (("--out", "a.png", "--index", "99"), "--index"),
        (("--out", "a.png", "--index", "-1"), "--index"),
        (
            ("--out", "a.png", "--index", "2"),
            "mass_kg",
        ),
        (("--out", "a.png", "--envelope", "none"), "none"),
    ],
)
def test_bad_input_is_one_line(options, message, file, refusal, tmp_path):
    (tmp_path / "folder.png").mkdir()
    assert_names(refusal("picture", file, *options), message)
    assert sorted(os.listdir(tmp_path)) == ["folder.png", file]


def test_a_file_that_is_none_is_told(refusal):
    assert_names(refusal("picture", "none", "--out", "a.png"), "none")


def test_an_envelope_of_another_class_is_refused(sampled, write, envelopes, refusal):
    said = refusal(
        "picture",
        write("g.json", sampled["ground-3"][0]),
        "--out",
        "a.png",
        "--envelope",
        envelopes,
    )
    assert said.startswith("g.json: contacts[0].normal: expected one within ")
    assert "learned for wall-3" in said
