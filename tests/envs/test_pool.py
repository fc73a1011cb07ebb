"""Environments on a pool of labelled scenes: the rows of a folder, its two parts, and what is no
pool for them.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset, ScenePool, scenes_of
from stancekit.envs.data.ledger import LabelPlan, folder_of, pools
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import ListedScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.learners.data.labelling import check_unseen, label
from stancekit.planners.errors import InvalidInput
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses

SELECTION = "stancekit.envs:stancekit/EnvelopeSelection-v0"


@pytest.mark.parametrize("name", ["pool-ground-3", "pool-wall-3", "pool-wall-4", "pool-wall-5"])
def test_a_pool_is_half_feasible_and_its_proofs_hold(name: str) -> None:
    data = Dataset.open(name)
    assert data.problem_class == name.removeprefix("pool-")
    assert (len(data.feasible), len(data.infeasible), len(data)) == (250, 250, 500)
    for row in data.select(np.concatenate([data.feasible[:3], data.infeasible[:3]])).rows():
        if row.posture is not None:
            assert check_plan(row.posture).accepted
        else:
            assert row.certificate is not None
            assert check_certificate(row.certificate).accepted


def test_an_environment_draws_from_a_pool_by_its_name() -> None:
    env = gymnasium.make(SELECTION, problem="wall-3", scenes="pool-wall-3")
    first, _ = env.reset(seed=0)
    again, _ = env.reset(seed=0)
    for name, seen in first.items():
        np.testing.assert_array_equal(seen, again[name])
    with refuses("pool-wall-5"):
        gymnasium.make(SELECTION, problem="wall-3", scenes="pool-wall-5")


def test_a_folder_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert folder_of("pool-wall-3") == pools()["pool-wall-3"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pool-wall-3").mkdir()
    assert folder_of("pool-wall-3") == Path("pool-wall-3")
    assert folder_of("wall-3") == Path("wall-3")


PLAN = LabelPlan(distribution="wall-3", feasible=20, infeasible=20, shard_size=20, seed=5)
LEGS = ("RF", "RR", "LM")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pool") / "set"
    label(PLAN, path)
    return path


@pytest.fixture(scope="module")
def natural(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Samples as they come, those of one node undecided."""
    path = tmp_path_factory.mktemp("pool") / "natural"
    label(
        LabelPlan(
            distribution="wall-3", feasible=0, infeasible=60, natural=True, seed=4, max_nodes=1
        ),
        path,
    )
    return path


def keys(problems) -> set[str]:
    return {json.dumps(problem.to_json()) for problem in problems}


def test_the_parts_share_no_row_and_miss_none(folder):
    dataset = Dataset.open(folder)
    train, test = dataset.only("train"), dataset.only("test")
    assert len(train) > len(test) > 0
    assert sorted([*train.chosen, *test.chosen]) == list(range(len(dataset)))
    assert dataset.only("all") is dataset
    picked = dataset.select(np.arange(10)).only("test")
    assert set(picked.chosen) == {k for k in test.chosen if k < 10}


def test_a_row_is_of_the_same_part_in_whatever_folder_it_is(folder, tmp_path):
    label(
        LabelPlan(distribution="wall-3", feasible=10, infeasible=10, shard_size=20, seed=5),
        tmp_path / "fewer",
    )
    fewer, more = (Dataset.open(path) for path in (tmp_path / "fewer", folder))
    assert fewer.header.digest != more.header.digest
    shared = keys(fewer.problems()) & keys(more.problems())
    assert shared
    for part in ("train", "test"):
        assert shared & keys(fewer.only(part).problems()) == shared & keys(
            more.only(part).problems()
        )


def test_a_folder_gives_the_scenes_of_its_part_train(folder):
    env = gymnasium.make(
        "stancekit.envs:stancekit/EnvelopeSelection-v0", scenes=str(folder)
    ).unwrapped
    train = Dataset.open(folder).only("train")
    expected = {
        scene.observation["vertices"].tobytes(): scene.feasible for scene in scenes_of(train)
    }
    seen = Counter()
    for k in range(400):
        observation, _ = env.reset(seed=k if k == 0 else None)
        seen[observation["vertices"].tobytes()] += 1
    assert set(seen) == set(expected)  # 400 draws of some 30 rows
    labels = Counter(expected[name] for name in seen.elements())
    assert 140 < labels[True] < 260


def test_rewards_and_info_are_those_of_the_same_scenes_listed(folder):
    scenes = scenes_of(Dataset.open(folder).only("train"))
    place = {scene.observation["vertices"].tobytes(): scene for scene in scenes}
    env, rng = EnvelopeSelectionEnv(scenes=folder), np.random.default_rng(0)
    for k in range(6):
        observation, _ = env.reset(seed=k)
        listed = EnvelopeSelectionEnv(
            scenes=ListedScenes([place[observation["vertices"].tobytes()]])
        )
        listed.reset()
        middle = rng.uniform(-0.3, 0.3, 18)
        action = np.concatenate([middle - 0.5, middle + 0.5]).astype(np.float32)
        (_, mine, *_, said), (_, theirs, *_, heard) = env.step(action), listed.step(action)
        assert mine == theirs
        assert said.keys() == heard.keys()
        for name, value in said.items():
            np.testing.assert_array_equal(value, heard[name])


def test_a_batch_lives_through_what_single_environments_do_on_the_pool(folder):
    batch, single = (
        EnvelopeSelectionVectorEnv(3, scenes=folder),
        EnvelopeSelectionEnv(scenes=folder),
    )
    seen, _ = batch.reset(seed=8)
    for k in range(3):
        np.testing.assert_array_equal(seen["vertices"][k], single.reset(seed=8 + k)[0]["vertices"])


def test_refinement_takes_a_folder_too(folder):
    assert EnvelopeRefinementEnv(scenes=folder).reset(seed=0)[0]["vertices"].shape == (27,)


def test_unbalanced_draws_have_trivial_rows_too(natural):
    decided = Dataset.open(natural)
    decided = decided.select(np.flatnonzero(decided.labels != "undecided"))
    rng = np.random.default_rng(0)
    assert len(decided.trivial)
    some = ScenePool(decided, balanced=False)
    assert len(some) == len(decided)
    drawn = keys(some.draw(rng).problem for _ in range(400))
    assert drawn & keys(decided.select(decided.trivial).problems())
    balanced = ScenePool(decided)
    drawn = keys(balanced.draw(rng).problem for _ in range(400))
    assert not drawn & keys(decided.select(decided.trivial).problems())


def test_what_is_no_pool_is_refused_in_one_line(folder, natural, tmp_path):
    undecided = int((Dataset.open(natural).only("train").labels == "undecided").sum())
    kept = len(Dataset.open(natural).only("train"))
    assert undecided
    other = Path(shutil.copytree(folder, tmp_path / "other"))
    header, named = json.loads((other / "header.json").read_text()), other / "header.json"
    named.write_text(json.dumps(header | {"format": "stancekit/dataset/2"}))
    legs = "expected scenes of ground-3 on the legs RF, RR, LM, got some of wall-3 on the legs RF, RR, LM"
    cases = {
        f"{natural}: part train: expected labelled rows, got {undecided} undecided of {kept}": {
            "scenes": natural
        },
        f"{folder}: {legs}": {"scenes": folder, "problem": "ground-3"},
        f"{tmp_path}/none: expected the folder of a data set, found nothing": {
            "scenes": tmp_path / "none"
        },
        f"{named}: format: expected 'stancekit/dataset/1', got 'stancekit/dataset/2'": {
            "scenes": other
        },
    }
    for message, given in cases.items():
        with pytest.raises(InvalidInput) as told:
            EnvelopeSelectionEnv(**given)
        assert str(told.value) == message
    dataset = Dataset.open(folder)
    with refuses("set", "infeasible"):
        ScenePool(dataset.select(dataset.feasible))
    with refuses("part"):
        dataset.only("both")


def test_rows_that_were_learned_from_are_refused(folder):
    dataset = Dataset.open(folder)
    train, test = dataset.only("train"), dataset.only("test")
    for seen, asked in ((dataset, dataset), (dataset, test), (train, dataset), (train, train)):
        with refuses("me"):
            check_unseen(asked, seen.origin, "me")
    check_unseen(test, train.origin, "me")
    check_unseen(train, test.origin, "me")
    check_unseen(dataset, {}, "me")
    with refuses("me", "set"):
        check_unseen(dataset, {**dataset.origin, "dataset": "another size of the same"}, "me")
    with refuses("me", "set"):
        check_unseen(test, {**train.origin, "calibration": test.origin}, "me")
    with refuses("me", "set"):
        check_unseen(
            test, {"dataset": dataset.header.digest}, "me"
        )  # files from before there were parts
