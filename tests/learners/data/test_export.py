"""Export: the expert's episodes are those of the environment, and Minari reads them back without
Stancekit's help.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.scenes import ListedScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.learners.data.export import Exported, expert_action, export, load_exported
from tests.refusals import refuses

LOAD = """
import minari, numpy as np
data = minari.load_dataset("stancekit/wall-3/expert-v0")
print(data.total_episodes, data.total_steps, [float(episode.rewards[0]) for episode in data.iterate_episodes()])
env = data.recover_environment()
env.reset(seed=0)
assert env.observation_space == data.observation_space and env.action_space == data.action_space
"""


@pytest.fixture(scope="module")
def dataset(labelled: Callable[..., Dataset]) -> Dataset:
    return labelled(6, 6, 7, shard_size=6)


@pytest.fixture(scope="module")
def written(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Exported, Any]:
    done = export(dataset, tmp_path_factory.mktemp("minari") / "out")
    return done, load_exported(done.root)


def test_every_row_is_an_episode_of_one_step_with_the_environments_own_numbers(
    dataset: Dataset, written: tuple[Exported, Any]
) -> None:
    done, data = written
    assert data.total_episodes == data.total_steps == done.episodes == len(dataset) == 12
    env = EnvelopeSelectionEnv("wall-3", scenes=ListedScenes(scenes_of(dataset)))
    for row, episode in zip(dataset.rows(), data.iterate_episodes(), strict=True):
        observation, before = env.reset()
        action = expert_action(row, 0.02)
        _, reward, _, _, info = env.step(action)
        np.testing.assert_array_equal(episode.actions, action[None])
        assert episode.rewards.tolist() == [reward]
        assert (episode.terminations.tolist(), episode.truncations.tolist()) == ([True], [False])
        for name, values in observation.items():
            assert episode.observations[name].dtype == np.float32
            np.testing.assert_array_equal(episode.observations[name], [values, values])
        for name, values in episode.infos.items():
            assert values.tolist() == [[before[name]], [info[name]]]
        assert data.action_space.contains(episode.actions[0])


def test_the_experts_box_holds_the_witness_and_p1_over_it_says_what_the_label_says(
    dataset: Dataset, written: tuple[Exported, Any]
) -> None:
    done, _ = written
    assert done.agreement == 1.0
    for row in dataset.rows():
        assert row.point is not None
        low, high = expert_action(row, 0.02).reshape(2, 3, 6)
        assert np.all(low <= row.point)
        assert np.all(row.point <= high)
        assert np.all(high - low <= 0.04 + 1e-6)


def test_minari_itself_loads_it_in_another_process(written: tuple[Exported, Any]) -> None:
    done, data = written
    environment = os.environ | {"MINARI_DATASETS_PATH": str(done.root)}
    run = subprocess.run(
        [sys.executable, "-c", LOAD], capture_output=True, text=True, env=environment, check=False
    )
    assert run.returncode == 0, run.stderr
    rewards = [float(episode.rewards[0]) for episode in data.iterate_episodes()]
    assert run.stdout.strip() == f"12 12 {rewards}"


def test_nothing_is_written_elsewhere(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("MINARI_DATASETS_PATH", raising=False)
    export(dataset.select([0, 1]), tmp_path / "new" / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["out"]
    assert "MINARI_DATASETS_PATH" not in os.environ


def test_bad_input_is_refused_and_leaves_nothing(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    (tmp_path / "file").touch()
    for name, rows, out, how in (
        ("full", dataset, "full", {}),
        ("file", dataset, "file", {}),
        ("file", dataset, "file/where", {}),
        ("room", dataset, "out", {"room": 0.0}),
        ("data set", dataset.select([]), "out", {}),
    ):
        with refuses(name):
            export(rows, tmp_path / out, **how)
    with refuses("full"):
        load_exported(tmp_path / "full")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "full"]


def test_a_damaged_export_is_refused(written: tuple[Exported, Any], tmp_path: Path) -> None:
    done, _ = written
    data = tmp_path / "stancekit" / "wall-3" / "expert-v0" / "data"
    data.mkdir(parents=True)
    for path in (done.root / data.relative_to(tmp_path)).iterdir():
        (data / path.name).write_bytes(path.read_bytes()[:50])
    with refuses():
        load_exported(tmp_path)


def test_that_minari_is_missing_is_said(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with refuses("[data]"):
        export(dataset, tmp_path / "out")
