"""Cutting boxes ends in proofs: covers that lose nothing, verdicts that the exact planner
shares.
"""

import gymnasium
import numpy as np
import pytest

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.episodes import MemorylessPolicy, any_dimension, largest_gap, noisy_gap, widest
from stancekit.envs.refinement import EnvelopeRefinementEnv, gap_by_dimension
from stancekit.envs.scenes import ListedScenes, SampledScenes
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import domain_of
from stancekit.planners.search.exact import BoxSearch, propagate
from tests.refusals import refuses

NAME = "stancekit.envs:stancekit/EnvelopeRefinement-v0"


@pytest.fixture(scope="module")
def scenes():
    """Labelled scenes of every class, half of them feasible."""
    rng = np.random.default_rng(3)
    sources = {name: SampledScenes(distribution(name)) for name in ("wall-3", "ground-3", "wall-5")}
    return {name: [source.draw(rng) for _ in range(12)] for name, source in sources.items()}


@pytest.fixture(scope="module")
def env():
    return EnvelopeRefinementEnv(budget=60)


def witnesses(scenes):
    for listed in scenes.values():
        for scene in listed:
            if scene.posture is not None:
                scaled = Scaled.of(scene.problem)
                yield scaled, scaled.point(scene.posture)


def test_the_first_box_holds_every_posture(scenes):
    found = list(witnesses(scenes))
    assert len(found) > 10
    for scaled, point in found:
        assert domain_of(scaled, reach=False).contains(point[None], margin=1e-6).all()


def test_propagation_keeps_every_posture_and_does_narrow(scenes):
    rng, narrowed = np.random.default_rng(0), 0
    for scaled, point in witnesses(scenes):
        whole = domain_of(scaled, reach=False)
        for _ in range(20):  # boxes that hold the posture, cut at random
            low = point - rng.uniform(size=point.shape) * np.maximum(point - whole.low, 0.0) - 1e-6
            high = (
                point + rng.uniform(size=point.shape) * np.maximum(whole.high - point, 0.0) + 1e-6
            )
            tight = propagate(scaled, Envelope(low=low, high=high))
            assert tight.contains(point[None], margin=2e-6).all()
            assert np.all(tight.low >= low)
            assert np.all(tight.high <= np.maximum(high, tight.low))
            narrowed += int(np.any(tight.low > low + 1e-3) or np.any(tight.high < high - 1e-3))
    assert narrowed > 20


def test_propagation_refutes_forces_that_cannot_balance(scenes):
    scaled = Scaled.of(scenes["ground-3"][0].problem)
    whole = domain_of(scaled, reach=False)
    high = whole.high.copy()
    high[:, 3:] = np.minimum(high[:, 3:], 0.05)  # three feet of a twentieth of the weight each
    assert propagate(scaled, Envelope(low=np.minimum(whole.low, high), high=high)) is None


@pytest.mark.parametrize(
    "rule",
    [
        MemorylessPolicy(largest_gap),
        MemorylessPolicy(widest),
        any_dimension(np.random.default_rng(0)),
    ],
)
def test_verdicts_are_those_of_the_exact_planner(rule, scenes):
    programs, counts = Programs(), {Status.FEASIBLE: 0, Status.INFEASIBLE: 0, Status.UNDECIDED: 0}
    for listed in scenes.values():
        for scene in listed:
            scaled = Scaled.of(scene.problem)
            search = BoxSearch(scene.problem, scaled, programs)
            for _ in range(15):
                if search.verdict is not Status.UNDECIDED:
                    break
                box = search.current.box
                seen = {"low": box.low.ravel(), "high": box.high.ravel()}
                seen["gap"] = gap_by_dimension(search.current.gaps).ravel()
                search.cut(int(rule.predict(seen)[0]))
            counts[search.verdict] += 1
            expected = Status.FEASIBLE if scene.feasible else Status.INFEASIBLE
            assert search.verdict in (expected, Status.UNDECIDED)
    assert counts[Status.FEASIBLE] > 10
    assert counts[Status.INFEASIBLE] > 1


def test_the_halves_cover_the_box(env):
    env.reset(seed=1)
    search = env._episode.search
    box = search.current.box
    seen = []
    search._visit = lambda half, *, depth: seen.append(half)
    search.cut(9)
    assert len(seen) == 2
    first, second = sorted(seen, key=lambda half: half.low[1, 3])
    assert first.high[1, 3] == second.low[1, 3] == 0.5 * (box.low[1, 3] + box.high[1, 3])
    np.testing.assert_array_equal(np.minimum(first.low, second.low), box.low)
    np.testing.assert_array_equal(np.maximum(first.high, second.high), box.high)


def test_episodes_end_with_the_experts_verdict_or_at_the_budget(env):
    observation, info = env.reset(seed=0)
    ends = []
    for _ in range(8):
        total, before = 0.0, info["solves"]
        while True:
            assert info["verdict"] == -1
            observation, reward, ended, cut_off, info = env.step(
                MemorylessPolicy(largest_gap).predict(observation)[0]
            )
            total += reward
            assert env.observation_space.contains(observation)
            if ended or cut_off:
                break
        assert ended == (info["verdict"] >= 0)
        assert not ended or info["verdict"] == info["label"]
        assert cut_off == (not ended and info["solves"] >= 60)
        assert total == pytest.approx(ended - (info["solves"] - before) / 60)
        with refuses(kind=gymnasium.error.ResetNeeded):
            env.step(np.int64(0))
        ends.append(ended)
        observation, info = env.reset()
    assert any(ends)


def test_margins_of_the_posture_that_ends_an_episode_are_told_when_asked_for():
    env, found = EnvelopeRefinementEnv(projection="fix-p", budget=60, margins=True), 0
    for seed in range(6):
        seen, info = env.reset(seed=seed)
        ended = False
        while not ended:
            assert (info["push_n"], info["support_m"], info["friction_left"]) == (0.0, 0.0, 0.0)
            seen, _, over, cut_off, info = env.step(
                np.int64(MemorylessPolicy(largest_gap).predict(seen)[0])
            )
            ended = over or cut_off
        feasible = info["verdict"] == 1
        assert (info["push_n"] > 0.0) == (info["support_m"] > 0.0) == feasible
        assert 0.0 <= info["friction_left"] < 1.0
        found += feasible
    assert found


def test_gaps_by_dimension_name_the_worst_product():
    gaps = np.zeros((2, 3, 3))
    gaps[1, 2, 0] = 0.5  # p_z f_n of the second contact
    expected = np.zeros((2, 6))
    expected[1, [2, 3]] = 0.5
    np.testing.assert_array_equal(gap_by_dimension(gaps), expected)


def test_rules_answer_batches():
    one = {"low": np.zeros(12), "high": np.arange(12.0), "gap": np.zeros(12)}
    one["gap"][[2, 5]] = 0.3
    two = {**one, "high": np.arange(12.0)[::-1]}
    batch = {name: np.stack([one[name], two[name]]) for name in one}
    np.testing.assert_array_equal(MemorylessPolicy(largest_gap).predict(batch)[0], [5, 2])
    np.testing.assert_array_equal(MemorylessPolicy(widest).predict(batch)[0], [11, 0])
    np.testing.assert_array_equal(
        noisy_gap(np.random.default_rng(0), spread=0.0).predict(batch)[0], [5, 2]
    )
    noisy = noisy_gap(np.random.default_rng(0), spread=30.0)
    assert len({tuple(noisy.predict(batch)[0]) for _ in range(20)}) > 5
    drawn = np.array(
        [any_dimension(np.random.default_rng(k)).predict(batch)[0] for k in range(200)]
    )
    assert drawn.shape == (200, 2)
    assert set(drawn.ravel()) == set(range(12))


def test_misuse_is_told(scenes):
    with refuses("scene"):
        EnvelopeRefinementEnv(scenes=ListedScenes(scenes["wall-5"])).reset(seed=0)
