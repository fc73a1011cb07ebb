"""Scenes that are drawn ahead, in blocks, are those that are drawn one by one, to the last bit."""

import copy

import numpy as np
import pytest

from stancekit.envs import scenes
from stancekit.envs.distributions.postures import OwnDistribution, Repeatable, distribution
from stancekit.envs.scenes import MOST_AHEAD, OneByOne, SampledScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.verify import check_certificates, check_postures
from tests.refusals import refuses

WALL = distribution("wall-3")


def told(scene):
    """All that an environment tells of a scene, as bytes and text."""
    arrays = [
        *scene.observation.values(),
        scene.point,
        np.array([scene.feasible, scene.lower_bound]),
    ]
    return b"".join(values.tobytes() for values in arrays), scene.problem.to_json()


def drawn(source, count, rng):
    """Scenes, and the generator's state after each."""
    found = []
    for _ in range(count):
        found.append((told(source.draw(rng)), rng.bit_generator.state))
    return found


@pytest.mark.parametrize(
    ("law", "balanced", "count"),
    [
        ("wall-3", True, 70),
        ("ground-3", True, 16),
        ("wall-5", True, 10),
        ("wall-3", False, 12),
        ("wall-4", True, 8),
    ],
)
def test_blocks_change_nothing(law, balanced, count):
    law = distribution(law)
    ahead = drawn(SampledScenes(law, balanced=balanced), count, np.random.default_rng(3))
    assert ahead == drawn(OneByOne(law, balanced=balanced), count, np.random.default_rng(3))
    assert len({text for (text, _), _ in ahead}) == count
    assert len({bytes_[-16:-8] for (bytes_, _), _ in ahead}) == 2  # both labels


def test_scenes_are_drawn_in_ever_larger_blocks_and_verified_together(monkeypatch):
    sizes = []

    def check(postures):
        sizes.append(len(postures))
        return check_postures(postures)

    monkeypatch.setattr(scenes, "check_postures", check)
    drawn(
        SampledScenes(WALL, balanced=False),
        1 + 2 + 4 + 8 + 16 + 2 * MOST_AHEAD,
        np.random.default_rng(0),
    )
    assert len(sizes) == 7
    assert sizes[0] <= 1
    assert MOST_AHEAD // 4 < sizes[-1] <= MOST_AHEAD


def test_who_draws_from_the_generator_meanwhile_or_seeds_it_anew_changes_what_comes():
    source, one_by_one = SampledScenes(WALL), OneByOne(WALL)
    rng, other = np.random.default_rng(5), np.random.default_rng(5)
    for extra in (0, 0, 0, 1, 0, 3):
        assert rng.random(extra).tolist() == other.random(extra).tolist()
        assert told(source.draw(rng)) == told(one_by_one.draw(other))
    again = np.random.default_rng(5)
    assert told(source.draw(again)) == told(one_by_one.draw(np.random.default_rng(5)))
    assert told(source.draw(rng)) == told(one_by_one.draw(other))


def test_a_copy_keeps_its_own_scenes_and_shares_the_compiled_models():
    source, rng = SampledScenes(WALL), np.random.default_rng(5)
    drawn(source, 4, rng)
    other = copy.copy(source)
    assert other._expert.programs is source._expert.programs
    assert not other._ahead
    assert drawn(other, 3, np.random.default_rng(9)) == drawn(
        OneByOne(WALL), 3, np.random.default_rng(9)
    )
    assert source._ahead


def test_other_generators_are_drawn_from_one_by_one():
    twister = [np.random.Generator(np.random.MT19937(4)) for _ in range(2)]
    found, expected = (
        [told(source.draw(rng)) for _ in range(3)]
        for source, rng in zip((SampledScenes(WALL), OneByOne(WALL)), twister, strict=True)
    )
    assert found == expected


def test_draws_that_cannot_be_repeated_are_drawn_when_they_are_asked_for():
    class Counting:
        count = 0

        def sample(self, rng):
            self.count += 1
            return WALL.sample(rng)

    thing = Counting()
    own = OwnDistribution(thing, "counting")
    assert isinstance(WALL, Repeatable)
    assert not isinstance(own, Repeatable)
    thing.count = 0
    SampledScenes(own, balanced=False).draw(np.random.default_rng(1))
    assert thing.count == 1


@pytest.mark.parametrize("check", [check_certificates, check_postures])
def test_a_claim_that_the_verifier_refuses_is_decided_again_by_itself(check, monkeypatch):
    refused = []

    def refuse(given):
        refused.extend(given)
        return np.full(len(given), np.inf if check is check_postures else 0.0)

    expected = drawn(OneByOne(WALL), 12, np.random.default_rng(3))
    monkeypatch.setattr(scenes, check.__name__, refuse)
    assert drawn(SampledScenes(WALL), 12, np.random.default_rng(3)) == expected
    assert len(refused) > 3


class Failing:
    """A distribution some of whose draws fail."""

    name, terrain, legs, skip = "failing", "wall", WALL.legs, staticmethod(WALL.skip)

    def sample(self, rng):
        return self.batch(rng, 1).problem(0)

    def batch(self, rng, count):
        batch = WALL.batch(rng, count)
        if np.any(batch.friction[:, 0] > 1.15):
            raise InvalidInput("no footing")
        return batch


def test_a_draw_that_fails_is_told_when_its_turn_comes():
    found = {}
    for kind in (SampledScenes, OneByOne):
        source, rng, scenes = kind(Failing()), np.random.default_rng(6), []

        def draw_all(source=source, rng=rng, scenes=scenes):
            for _ in range(100):
                scenes.append(told(source.draw(rng)))

        with refuses():
            draw_all()
        found[kind] = scenes
    assert isinstance(Failing(), Repeatable)
    assert found[SampledScenes] == found[OneByOne]
    assert 3 <= len(found[OneByOne]) < 100


def test_a_label_that_never_comes_up_is_told(monkeypatch):
    monkeypatch.setattr(scenes, "MAX_DRAWS", 0)
    for kind in (SampledScenes, OneByOne):
        with refuses("wall-3", kind=PlanningFailed):
            kind(WALL).draw(np.random.default_rng(0))


def test_what_an_environment_shows_can_be_written_to():
    env = EnvelopeSelectionEnv()
    first, _ = env.reset(seed=0)
    kept = {name: values.copy() for name, values in first.items()}
    for values in first.values():
        values[:] = 0.0
    second, _, _, _, info = env.step(np.ones(36, np.float32))
    assert all(np.array_equal(second[name], kept[name]) for name in kept)
    info["expert_point"][:] = 7.0
    assert not np.any(env.step(np.ones(36, np.float32))[4]["expert_point"] == 7.0)
