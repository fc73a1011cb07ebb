"""A chooser gives each terrain one box of a set; its costs are counted mistakes, and its file is
not trusted.
"""

import itertools
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.episodes import Observation
from stancekit.envs.scenes import ListedScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.learners.data.labelling import label
from stancekit.learners.evaluation.evaluate import rollout
from stancekit.learners.selectors.chooser import Chooser, ChooserSettings, costs, fit_chooser
from stancekit.learners.selectors.genetic import clustered_boxes
from stancekit.learners.selectors.network import Architecture
from stancekit.learners.selectors.selector import FixedSelector
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import EnvelopeSet
from tests.refusals import refuses

SMALL = Architecture(width=32, layers=1, heads=2, corner_width=8)
QUICK = ChooserSettings(architecture=SMALL, epochs=40, batch=32, rate=3e-3)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path = tmp_path_factory.mktemp("data") / "set"
    label(LabelPlan(distribution="wall-3", feasible=70, infeasible=70, seed=41), path)
    return Dataset.open(path)


@pytest.fixture(scope="module")
def envelopes(dataset: Dataset) -> EnvelopeSet:
    """Three clusters' quantile boxes."""
    boxes = clustered_boxes(dataset.points, 3, share=0.05, seed=0)
    return EnvelopeSet.for_problems("wall-3", list(dataset.problems()), boxes)


@pytest.fixture(scope="module")
def chooser(dataset: Dataset, envelopes: EnvelopeSet) -> Chooser:
    return fit_chooser(dataset, envelopes, QUICK)


def played(dataset: Dataset, selector: Chooser | FixedSelector) -> np.ndarray:
    """What a selector's one box costs in the environment, by scene, as ``costs`` counts it."""
    scenes = scenes_of(dataset)
    infos = rollout(
        selector, EnvelopeSelectionEnv("wall-3", scenes=ListedScenes(scenes)), len(scenes)
    )
    return np.array(
        [
            1.0
            if info["reward_agreement"] == 0.0
            else 0.5 * (info["label"] and not info["project_fix_p"])
            for info in infos
        ]
    )


@pytest.fixture(scope="module")
def alone(dataset: Dataset, envelopes: EnvelopeSet) -> list[np.ndarray]:
    """The same of every box by itself."""
    boxes = (replace(envelopes, envelopes=(envelope,)) for envelope in envelopes.envelopes)
    return [played(dataset, FixedSelector("one", box)) for box in boxes]


def observations(dataset: Dataset) -> Observation:
    env = EnvelopeSelectionEnv("wall-3", scenes=ListedScenes(scenes_of(dataset)))
    seen = [env.reset(seed=0)[0] for _ in range(len(dataset))]
    return {name: np.stack([one[name] for one in seen]) for name in seen[0]}


def test_costs_are_what_the_environment_counts(
    dataset: Dataset, envelopes: EnvelopeSet, alone: list[np.ndarray]
) -> None:
    scenes = scenes_of(dataset)
    problems = [Scaled.of(scene.problem) for scene in scenes]
    feasible = np.array([scene.feasible for scene in scenes])
    cost = costs(problems, feasible, envelopes.envelopes, Programs())
    np.testing.assert_array_equal(cost, np.column_stack(alone))
    assert set(np.unique(cost)) == {0.0, 0.5, 1.0}


def test_the_choice_costs_less_than_any_one_box(
    dataset: Dataset, chooser: Chooser, alone: list[np.ndarray]
) -> None:
    assert played(dataset, chooser).mean() < 0.9 * min(cost.mean() for cost in alone)
    assert len(np.unique(chooser.choose(observations(dataset)))) > 1


def test_the_choice_is_an_action_of_either_environment_whatever_the_order_of_contacts(
    dataset: Dataset, envelopes: EnvelopeSet, chooser: Chooser
) -> None:
    seen = observations(dataset)
    choice, (bounds, _) = chooser.choose(seen), chooser.predict(seen)
    for index, row in zip(choice, bounds, strict=True):
        np.testing.assert_array_equal(
            row, envelopes.envelopes[index].to_vector().astype(np.float32)
        )
    single, _ = chooser.predict({name: values[0] for name, values in seen.items()})
    np.testing.assert_array_equal(single, bounds[0])
    env = EnvelopeSelectionEnv("wall-3", library=envelopes, scenes=ListedScenes(scenes_of(dataset)))
    env.reset(seed=0)
    assert env.action_space.contains(choice[0])
    for order in itertools.permutations(range(3)):
        moved = {
            k: v.reshape(len(v), 3, -1)[:, list(order)].reshape(len(v), -1) for k, v in seen.items()
        }
        assert (chooser.choose(moved) == choice).mean() > 0.99


def test_a_chooser_repeats_to_the_last_bit_and_comes_back_from_its_file(
    dataset: Dataset, envelopes: EnvelopeSet, chooser: Chooser, tmp_path: Path
) -> None:
    fit_chooser(dataset, envelopes, QUICK).save(tmp_path / "again")
    chooser.save(tmp_path / "first")
    assert (tmp_path / "first").read_bytes() == (tmp_path / "again").read_bytes()
    back = Chooser.load(tmp_path / "first", problem_class="wall-3")
    seen = observations(dataset)
    np.testing.assert_array_equal(back.predict(seen)[0], chooser.predict(seen)[0])
    assert back.envelopes.to_json() == envelopes.to_json()


def test_what_does_not_fit_is_refused_in_one_line(
    dataset: Dataset, envelopes: EnvelopeSet, chooser: Chooser, tmp_path: Path
) -> None:
    good, path = tmp_path / "good", tmp_path / "odd"
    chooser.save(good)
    for content in (good.read_bytes()[:-9], pickle.dumps([1])):
        path.write_bytes(content)
        with refuses("odd"):
            Chooser.load(path)
    with refuses("good"):
        Chooser.load(good, problem_class="wall-5")
    with refuses("envelopes"):
        fit_chooser(dataset, replace(envelopes, problem_class="wall-5"))
    with refuses("data set"):
        fit_chooser(dataset.select(dataset.feasible), envelopes)
    with refuses("epochs"):
        ChooserSettings(epochs=0)
