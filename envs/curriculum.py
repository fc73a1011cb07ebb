"""A curriculum of terrain families for ``Traverse-v0``: the level follows success by a weighted
up–down rule.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import checked
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_keys import MOST_EVERYWHERE
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.family_scene import family_keys
from stancekit.planners.search.course_features import Features
from stancekit.planners.terrain.families import SMOOTH, TERRAIN_FAMILIES, terrain_family

from .traverse import TraverseEnv

POLYGONAL = tuple(name for name in TERRAIN_FAMILIES.names() if name not in SMOOTH)
"""All families but the smooth ones of the package."""
CORNERS = 8
"""Most corners of a rectangle that is clipped to a square."""


class Curriculum(gym.Wrapper[Features, np.int64, Features, np.int64]):
    """Traverse-v0 over scenes of several families of terrain; each family has a level of difficulty
    that rises with success.

    Each episode draws a family, and then one of its scenes at the family's level. If the walk
    reaches the last frame, the level of the family rises by step · (1 − target); otherwise it falls
    by step · target. It stays in [0, 1]. The expected change is zero if the share of successful
    episodes is ``target``, so the level settles there. If the robot cannot stand in the first key
    frame of a scene, another scene is drawn; if no scene of the level has such a frame, the level
    falls. A reset with a seed sets all levels back to ``level``: equal seeds and equal actions give
    equal levels.

    ``info`` has two more entries than that of Traverse-v0: ``level``, the level of the episode, and
    ``arrived``, 1 in the last step of an episode whose walk reaches the last frame, else 0.

    Arguments:
        families: names in ``terrain.families.TERRAIN_FAMILIES``, or FILE.py:NAME; by default all
            families but the smooth ones.
        target: share of successful episodes at which a level stays, in (0, 1).
        step: size of the changes of a level, in (0, 1].
        level: level of every family at the beginning, in [0, 1].
        options: arguments of ``TraverseEnv`` (horizon, planners, weights, …).

    Raises:
        InvalidInput: for an unknown family, and for numbers outside of these ranges.
    Source:
        Kaernbach, Simple adaptive testing with the weighted up-down method, 1991.

    Example:
        >>> env = Curriculum(["stairs", "gaps"], level=0.3)
        >>> observation, info = env.reset(seed=0)
        >>> info["level"], env.levels
        (0.3, {'stairs': 0.3, 'gaps': 0.3})
    """

    def __init__(
        self,
        families: Sequence[str] = POLYGONAL,
        *,
        target: float = 0.7,
        step: float = 0.1,
        level: float = 0.0,
        **options: Any,
    ) -> None:
        if isinstance(families, str):
            known = ", ".join(TERRAIN_FAMILIES.names())
            raise InvalidInput(f"families: expected a list of some of {known}, got {families!r}")
        for family in families:
            terrain_family(family)
        if not families:
            raise InvalidInput("families: expected one or more, got none")
        self._target = checked(target, "target", above=0.0, most=1.0 - 1e-6)
        self._step = checked(step, "step", above=0.0, most=1.0)
        self._first = checked(level, "level", least=0.0, most=1.0)
        self.levels = dict.fromkeys(families, self._first)
        self._family, self._level, self._last = families[0], self._first, 0
        super().__init__(
            TraverseEnv(self._draw, **{"regions": MOST_EVERYWHERE, "corners": CORNERS, **options})
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Features, dict[str, Any]]:
        """Begin an episode; with a seed, the curriculum.

        Raises PlanningFailed where level 0 has nothing that holds.
        """
        if seed is not None:
            self.levels = dict.fromkeys(self.levels, self._first)
        while True:
            try:
                observation, info = self.env.reset(seed=seed, options=options)
            except PlanningFailed:
                if self.levels[self._family] == 0.0:
                    raise
                self._learn(arrived=False)
                seed = None
            else:
                return observation, self._told(info, arrived=False)

    def step(self, action: np.int64) -> tuple[Features, float, bool, bool, dict[str, Any]]:
        """Go on; at the end of an episode the level of its family changes."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        arrived = bool(info["is_success"])
        info = self._told(info, arrived)
        if terminated or truncated:
            self._learn(arrived)
        return observation, float(reward), terminated, truncated, info

    def _draw(self, rng: np.random.Generator) -> Problem:
        names = tuple(self.levels)
        self._family = names[int(rng.integers(len(names)))]
        self._level = self.levels[self._family]
        keys = family_keys(f"{self._family}:{self._level!r}:{int(rng.integers(2**62))}")
        course = build_course(spec_from(keys))
        self._last = course.frames - 1
        return course

    def _learn(self, arrived: bool) -> None:
        change = self._step * (1.0 - self._target if arrived else -self._target)
        self.levels[self._family] = min(max(self.levels[self._family] + change, 0.0), 1.0)

    def _told(self, info: dict[str, Any], arrived: bool) -> dict[str, Any]:
        return {**info, "level": self._level, "arrived": int(arrived)}
