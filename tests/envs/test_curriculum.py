"""The curriculum: levels follow success by the rule that is documented, equal for equal seeds."""

from __future__ import annotations

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from stancekit.envs.curriculum import Curriculum
from stancekit.envs.traverse import TraverseEnv
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.search.two_stage import TwoStagePlanner
from tests.refusals import refuses

PROGRAMS = Programs()


def env(families, **options):
    planners = [TwoStagePlanner(programs=PROGRAMS, time_limit_s=10.0)]
    return Curriculum(families, planners=planners, programs=PROGRAMS, horizon=3, **options)


def episodes(curriculum, count, seed):
    """Whether each arrived, and the level that it was at."""
    found = []
    for episode in range(count):
        observation, info = curriculum.reset(seed=seed if episode == 0 else None)
        assert curriculum.observation_space.contains(observation)
        over = False
        while not over:
            _, _, terminated, truncated, info = curriculum.step(np.int64(0))
            over = terminated or truncated
        found.append((info["arrived"], info["level"]))
    return found


def test_levels_rise_by_success_and_fall_by_failure_as_documented():
    curriculum = env(["gaps"], target=0.6, step=0.3, level=0.4)
    found = episodes(curriculum, 8, seed=1)
    assert {arrived for arrived, _ in found} == {0, 1}
    for (arrived, level), (_, after) in pairwise(found):
        falls = (
            [min(level + 0.12, 1.0)] if arrived else [max(level - 0.18 * k, 0.0) for k in (1, 2, 3)]
        )
        assert (
            min(abs(after - each) for each in falls) < 1e-12
        )  # or none of 50 first frames held, and it fell again


def test_equal_seeds_give_equal_levels_and_a_seed_begins_anew():
    curriculum = env(["slopes", "walls"], level=0.5, step=0.4)
    first = episodes(curriculum, 5, seed=3)
    levels = dict(curriculum.levels)
    assert levels != {"slopes": 0.5, "walls": 0.5}
    assert episodes(curriculum, 5, seed=3) == first
    assert curriculum.levels == levels


def test_a_level_without_any_footing_falls_until_there_is_some():
    curriculum = env(["gaps"], level=1.0, step=1.0, target=0.6)
    _, info = curriculum.reset(seed=0)
    assert info["level"] == pytest.approx(0.4)


def test_a_family_is_a_course_of_traverse_by_its_name():
    plain = TraverseEnv(["stairs:0.6", "stones:0.3"], frames=3, corners=8, programs=PROGRAMS)
    first, _ = plain.reset(seed=0)
    again, _ = plain.reset(seed=0)
    other, _ = plain.reset(seed=1)
    assert plain.observation_space.contains(first)
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert any(not np.array_equal(first[name], other[name]) for name in first)
    assert isinstance(curriculum_of_all().unwrapped, TraverseEnv)


def curriculum_of_all() -> gym.Env:
    return env(["stairs", "stones", "gaps", "beams", "rubble", "slopes", "walls"])


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"families": ["lava"]}, "family"),
        ({"families": "stairs"}, "families"),
        ({"families": []}, "families"),
        ({"families": ["gaps"], "target": 1.0}, "target"),
        ({"families": ["gaps"], "step": 0.0}, "step"),
        ({"families": ["gaps"], "level": 1.2}, "level"),
    ],
)
def test_what_makes_no_curriculum_is_refused(options, name):
    with refuses(name):
        Curriculum(**options)
