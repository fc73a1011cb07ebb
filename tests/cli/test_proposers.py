"""`stancekit proposers`, and the commands that ask what it trained."""

import pytest
import torch

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.proposers.proposer import FORMAT, Proposers
from stancekit.learners.selectors.tensors import read_tensors, write_tensors

CONFIG = """architecture: {width: 16, layers: 1, heads: 2, corner_width: 8}
proofs: 40
postures: 5
batch: 128
pool: 512
draws: 2048
held: 128
"""
LABEL = ("--feasible", "4", "--infeasible", "6", "--workers", "1")


@pytest.fixture
def file(stancekit, tmp_path):
    """Proposers for wall-3, trained for a moment."""
    (tmp_path / "small.yaml").write_text(CONFIG)
    ran = stancekit(
        "proposers", "wall-3", "--out", "wall-3.safetensors", "--config", "small.yaml", "--json"
    )
    assert (ran.code, ran.err) == (0, "")
    (record,) = ran.records
    assert list(record) == ["out", "problem_class", "cpu_s", "proofs", "postures"]
    assert record["problem_class"] == "wall-3"
    assert record["proofs"] > 0.0
    return tmp_path / "wall-3.safetensors"


def test_labels_are_those_without_proposers(stancekit, file, tmp_path):
    assert stancekit("label", "wall-3", "with", *LABEL, "--proposers", file.name).code == 0
    assert stancekit("label", "wall-3", "without", *LABEL).code == 0
    asked, plain = (Dataset.open(tmp_path / name) for name in ("with", "without"))
    assert asked.header.plan.proposers == Proposers.load(file).digest
    assert [row.kind for row in asked.rows()] == [row.kind for row in plain.rows()]
    ran = stancekit("label", "wall-3", "with", *LABEL)
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (2, "", 1)


def test_bad_input_is_one_line(stancekit, file, tmp_path):
    header, tensors = read_tensors(file, FORMAT)
    name = sorted(tensors)[0]
    write_tensors(
        tmp_path / "nan.safetensors", FORMAT, header, {**tensors, name: tensors[name] * torch.nan}
    )
    write_tensors(tmp_path / "old.safetensors", "stancekit/proposers/0", header, tensors)
    (tmp_path / "text.safetensors").write_text("proposers")
    (tmp_path / "seed.yaml").write_text("seed: 1\n")
    for words, said in (
        (
            ("label", "ground-3", "d", "--proposers", file.name),
            "expected some for ground-3, got some for wall-3",
        ),
        (("label", "wall-3", "d", "--proposers", "nan.safetensors"), "expected finite numbers"),
        (
            ("label", "wall-3", "d", "--proposers", "old.safetensors"),
            "expected format stancekit/proposers/1, got",
        ),
        (
            ("label", "wall-3", "d", "--proposers", "text.safetensors"),
            "expected a whole file of format",
        ),
        (("label", "wall-3", "d", "--proposers", "none.safetensors"), "found nothing"),
        (("proposers", "wall-9", "--out", "x"), "wall-9"),
        (
            ("proposers", "wall-3", "--out", "x", "--seed", "-1"),
            "--seed: expected 0 or more, got -1",
        ),
        (
            ("proposers", "wall-3", "--out", "x", "--config", "seed.yaml"),
            "seed: expected as an option, --seed",
        ),
    ):
        ran = stancekit(*words)
        assert ran.code == 2, words
        assert len(ran.err.splitlines()) == 1, ran.err
        assert said in ran.err
