"""`stancekit train`: the files that come with the project are read, a run runs, and bad input is
one line.
"""

import json
from pathlib import Path

import pytest

from stancekit.cli.main import run
from stancekit.cli.train import Train
from stancekit.learners.training.train_config import TrainConfig

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("train-*.yaml"))

SMALL = """
environment: stancekit/EnvelopeSelection-v0
problem: wall-3
steps: 16
envs: 2
evaluate_every: 16
base: heuristic
train: {feasible: 3, infeasible: 3, seed: 0}
held_out: {feasible: 2, infeasible: 2, seed: 1}
ppo: {rollout: 8, batch: 8, epochs: 1, hidden: [8]}
"""


def test_the_projects_own_configs_are_right():
    assert {path.stem for path in CONFIGS} == {"train-selection", "train-refinement"}
    for path in CONFIGS:
        assert TrainConfig.from_yaml(path).problem == "wall-3"


def test_a_run_prints_its_curve_and_goes_on(tmp_path, capsys):
    path = tmp_path / "train.yaml"
    path.write_text(SMALL)
    assert run(Train(config=path, out=tmp_path / "run", json=True)) == 0
    assert [json.loads(line)["steps"] for line in capsys.readouterr().out.splitlines()] == [0, 16]
    assert (tmp_path / "run" / "policy.safetensors").is_file()
    assert run(Train(config=path, out=tmp_path / "run", json=True, resume=True, steps=32)) == 0
    assert [json.loads(line)["steps"] for line in capsys.readouterr().out.splitlines()] == [
        0,
        16,
        32,
    ]
    assert run(Train(config=path, out=tmp_path / "run")) == 2
    assert "holds a run already" in capsys.readouterr().err


def test_a_run_says_what_it_is_at(tmp_path, capsys):
    (tmp_path / "train.yaml").write_text(SMALL)
    assert run(Train(config=tmp_path / "train.yaml", out=tmp_path / "run")) == 0
    said = capsys.readouterr().err.splitlines()
    assert said == ["label train: 6 rows", "label held-out: 4 rows", "learn: 16 steps"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SMALL + "speed: 3\n", "speed: unknown key"),
        (SMALL.replace("steps: 16", "steps: many"), "steps: "),
        (SMALL.replace("EnvelopeSelection", "EnvelopeGuessing"), "environment: "),
        ("steps: [", "expected YAML"),
    ],
)
def test_bad_configs_are_one_line_and_exit_code_two(text, words, tmp_path, capsys):
    path = tmp_path / "train.yaml"
    path.write_text(text)
    assert run(Train(config=path, out=tmp_path / "run")) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "run").exists()
