"""`stancekit fit`: envelopes from a data set by every method that needs no network, with where they
come from.
"""

import json

import pytest

from stancekit.planners.formats.question_file import read_envelopes
from tests.refusals import assert_names

QUICK = {
    "heuristic": (),
    "quantile": ("--share", "0.1"),
    "gmm": ("--steps", "2"),
    "gmm-printed": (),
}


@pytest.mark.parametrize("method", sorted(QUICK))
def test_a_method_writes_a_file_that_can_be_used(
    method, stancekit, labelled, write, sampled, tmp_path
):
    ran = stancekit(
        "fit", labelled, "--method", method, *QUICK[method], "--out", "e.json", "--json"
    )
    assert (ran.code, ran.err) == (0, "")
    (record,) = ran.records
    assert (record["out"], record["method"], record["problem_class"]) == (
        "e.json",
        method,
        "wall-3",
    )
    assert (record["envelopes"], len(record["mean_width"])) == (1, 1)
    assert 0.0 < record["mean_width"][0] < 2.0
    envelopes = read_envelopes(tmp_path / "e.json")
    assert (envelopes.problem_class, envelopes.legs) == ("wall-3", ("RF", "RR", "LM"))
    assert envelopes.provenance == record["provenance"]
    solved = stancekit(
        "solve",
        write("p.json", sampled["wall-3"][0]),
        "--method",
        "p1",
        "--envelopes",
        "e.json",
        "--json",
    )
    assert "margin" in solved.records[0]["details"]


def test_people_are_told_in_one_line(stancekit, labelled):
    ran = stancekit("fit", labelled, "--method", "quantile", "--out", "[bold]e.json")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith("[bold]e.json: 1 envelope(s) for wall-3, mean width 0.")
    assert ran.out.count("\n") == 1


def test_the_same_data_and_seed_give_the_same_envelopes(stancekit, labelled, tmp_path):
    for name in ("a.json", "b.json"):
        assert (
            stancekit("fit", labelled, "--steps", "2", "--clusters", "2", "--out", name).code == 0
        )
    first, second = (json.loads((tmp_path / name).read_text()) for name in ("a.json", "b.json"))
    assert len(first["envelopes"]) == 2
    assert first == second


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--share", "0.5"), "share"),
        (("--share", "nan"), "share"),
        (("--clusters", "0"), "clusters"),
        (
            ("--method", "quantile", "--clusters", "3"),
            "--clusters",
        ),
        (
            ("--method", "heuristic", "--share", "0.1"),
            "--share",
        ),
        (("--method", "surrogate", "--boxes", "2"), "--boxes"),
        (("--method", "surrogate", "--workers", "2"), "--workers"),
        (("--method", "set", "--terrain", "wall.npy"), "--terrain"),
        (("--method", "gmm", "--address", "local"), "--address"),
        (("--method", "gmm", "--checkpoint", "c"), "--checkpoint"),
        (("--method", "quantile", "--calibration", "c"), "--calibration"),
        (("--steps", "-1"), "steps"),
        (("--seed", "-1"), "--seed"),
        (("--threshold", "nan"), "--threshold"),
        (("--time-limit-s", "0"), "--time-limit-s"),
        (("--out", "none/e.json"), "none/e.json"),
        (("--out", "."), "."),
    ],
)
def test_bad_options_are_one_line(options, words, refusal, labelled):
    out = () if "--out" in options else ("--out", "e.json")
    assert_names(refusal("fit", labelled, *out, *options), words)


def test_what_is_no_data_set_is_told(refusal, tmp_path, write):
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    write("other/header.json", {"format": "stancekit/posture/1"})
    assert_names(refusal("fit", "none", "--out", "e.json"), "none")
    assert_names(refusal("fit", write("f", "{}"), "--out", "e.json"), "f")
    said = refusal("fit", "empty", "--out", "e.json")
    assert said == "empty/header.json: expected the header of a data set, found nothing"
    said = refusal("fit", "other", "--out", "e.json")
    assert (
        said
        == "other/header.json: format: expected 'stancekit/dataset/1', got 'stancekit/posture/1'"
    )


def test_a_data_set_that_lacks_a_label_is_refused(refusal, stancekit):
    assert (
        stancekit(
            "label", "wall-3", "data", "--feasible", "0", "--infeasible", "2", "--workers", "1"
        ).code
        == 0
    )
    for method in ("quantile", "gmm"):
        said = refusal("fit", "data", "--method", method, "--out", "e.json")
        assert (
            said
            == "data set: expected two or more rows of each label, got 0 feasible and 2 infeasible"
        )


def test_an_unfinished_data_set_is_refused(refusal, stancekit, labelled, tmp_path):
    (tmp_path / "data").mkdir()
    for name in ("header.json", "shard-00000.parquet"):
        (tmp_path / "data" / name).write_bytes((labelled / name).read_bytes())
    said = refusal("fit", "data", "--out", "e.json")
    assert said.startswith("data: shard-00001.parquet and 2 more shards are missing")


def test_the_fitness_of_ga_is_kept(stancekit, labelled, write):
    config = write("ga.yaml", "genetic: {population: 6, generations: 3, terrains: 8}\n")
    options = ("--method", "ga", "--config", config, "--out", "ga.json")
    ran = stancekit("fit", labelled, *options, "--json")
    assert ran.code == 0
    notes = ran.records[0]["provenance"]["notes"]
    assert len(notes["mean"]) == len(notes["variance"]) == len(notes["best"]) == 3
