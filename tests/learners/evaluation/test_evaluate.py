"""Rollouts: one function for every selector, the same figures anywhere, and the environment's own
rewards.
"""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.scenes import LabelledScene, ListedScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.learners.data.executors import processes
from stancekit.learners.evaluation import evaluate as module
from stancekit.learners.evaluation.evaluate import (
    Share,
    evaluate,
    evaluate_lift,
    rollout,
)
from stancekit.learners.selectors.selector import FixedSelector, Learned
from stancekit.learners.training.fitting import fit
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick
from tests.refusals import refuses


@pytest.fixture(scope="module")
def dataset(labelled: Callable[..., Dataset]) -> Dataset:
    return labelled(14, 10, 3, shard_size=12)


@pytest.fixture(scope="module")
def scenes(dataset: Dataset) -> list[LabelledScene]:
    return scenes_of(dataset)


@pytest.fixture(scope="module")
def envelopes(dataset: Dataset) -> EnvelopeSet:
    return fit("quantile", dataset)


@pytest.mark.parametrize("wider", [0.0, 0.6])
def test_the_shares_are_what_p1_and_p2_say_when_asked_directly(
    scenes: list[LabelledScene], envelopes: EnvelopeSet, programs: Programs, wider: float
) -> None:
    box = Envelope.from_vector(  # widened, it is wider than an action may be
        envelopes.envelopes[0].widened(wider).to_vector().astype(np.float32)
    )
    score = evaluate(
        "quantile",
        Learned.fixed("quantile", replace(envelopes, envelopes=(box,))),
        scenes,
        problem_class="wall-3",
        projections=("fix-toes",),
    )
    right = {True: 0, False: 0}
    for scene in scenes:
        scaled = Scaled.of(scene.problem)
        right[scene.feasible] += (
            programs.get(McCormick, scaled.layout).solve(scaled, box).feasible == scene.feasible
        )
    assert (score.p1_feasible, score.p1_infeasible) == (
        Share(hits=right[True], of=14),
        Share(hits=right[False], of=10),
    )
    assert 0 < score.projected["fix-toes"].hits <= right[True]
    assert score.balanced == pytest.approx((right[True] / 14 + right[False] / 10) / 2.0)


@pytest.mark.filterwarnings("error")
def test_a_score_of_no_scenes_has_no_time(envelopes: EnvelopeSet) -> None:
    assert np.isnan(
        evaluate(
            "quantile",
            Learned.fixed("quantile", envelopes),
            [],
            problem_class="wall-3",
            projections=("fix-p",),
        ).p1_ms
    )


def test_any_number_of_processes_gives_the_same_shares(
    scenes: list[LabelledScene], envelopes: EnvelopeSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CHUNK", 7)
    selector = Learned.fixed("quantile", envelopes)
    message: list[tuple[int, int]] = []
    one, two = (
        evaluate(
            "quantile",
            selector,
            scenes,
            problem_class="wall-3",
            projections=("fix-p", "scp"),
            run=processes(workers),
            progress=lambda done, total: message.append((done, total)),
        )
        for workers in (1, 2)
    )
    assert (one.p1_feasible, one.p1_infeasible, one.projected, one.gap) == (
        two.p1_feasible,
        two.p1_infeasible,
        two.projected,
        two.gap,
    )
    assert message == [(7, 24), (14, 24), (21, 24), (24, 24)] * 2


def test_stable_baselines3_comes_to_the_same_mean_reward(
    scenes: list[LabelledScene], envelopes: EnvelopeSet
) -> None:
    import stable_baselines3.common.evaluation as evaluation
    import stable_baselines3.common.monitor as monitor

    selector = FixedSelector("quantile", envelopes)
    infos = rollout(
        selector, EnvelopeSelectionEnv("wall-3", scenes=ListedScenes(scenes)), len(scenes)
    )
    env = monitor.Monitor(EnvelopeSelectionEnv("wall-3", scenes=ListedScenes(scenes)))
    mean, _ = evaluation.evaluate_policy(selector, env, n_eval_episodes=len(scenes))
    assert mean == pytest.approx(np.mean([info["reward"] for info in infos]), rel=1e-5)
    for info in infos:
        assert info["reward"] == pytest.approx(
            sum(v for k, v in info.items() if k.startswith("reward_"))
        )


def test_the_lift_admits_every_feasible_posture(scenes: list[LabelledScene]) -> None:
    score = evaluate_lift(scenes, projections=("scp",))
    assert score.p1_feasible == Share(hits=14, of=14)
    assert score.projected["scp"] == Share(hits=14, of=14)
    record = json.loads(json.dumps(score.to_json(), allow_nan=False))
    assert (record["selector"], record["gap"], record["project_scp"]) == ("lift", None, 1.0)


def test_wilson_intervals_are_those_of_the_literature() -> None:
    # Newcombe, Statistics in Medicine 17 (1998), p. 861, method 3: 81/263, 15/148, 0/20, 1/29
    for hits, of, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
    ):
        assert Share(hits=hits, of=of).interval == pytest.approx((low, high), abs=1e-4)
    assert np.isnan(Share(hits=0, of=0).interval).all()
    ends = [Share(hits=hits, of=of).interval for of in range(1, 60) for hits in (0, of)]
    assert min(low for low, _ in ends) == 0.0
    assert max(high for _, high in ends) == 1.0


def test_selectors_by_name_are_one_table_and_one_picture(
    dataset: Dataset, labelled: Callable[..., Dataset]
) -> None:
    fresh = labelled(5, 6, 8, shard_size=4)
    named = {"learned": stancekit.fit(dataset, "quantile"), "lift": "lift"}
    compared = stancekit.evaluate(named, fresh, projections=("fix-p",))
    assert [row["selector"] for row in compared.to_json()] == [*named]
    assert "| learned |" in compared.markdown()
    assert len(compared.picture().axes[0].patches) > 6
    with refuses("learned", "trained"):
        stancekit.evaluate(named, dataset)
    with refuses("selector"):
        stancekit.evaluate({}, fresh)
    with refuses("nothing", "None"):
        stancekit.evaluate({"nothing": None}, fresh)
