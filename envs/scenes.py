"""Where an environment's scenes come from: labelled posture problems, drawn at random or listed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from stancekit.planners.answer.outcome import Outcome, Posture, Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem import PostureProblem
from stancekit.planners.search.exact import ExactPlanner

from .distributions.postures import Distribution, distribution

MAX_DRAWS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """One problem with the expert's answer.

    feasible: the label. posture: the expert's witness, None where infeasible. lower_bound: what the expert's
    certificate proves where infeasible. expert_seconds: 0 where the label was read from a data set.
    """

    problem: PostureProblem
    feasible: bool
    posture: Posture | None
    lower_bound: float = 0.0
    expert_seconds: float = 0.0

    @classmethod
    def of(cls, problem: PostureProblem, outcome: Outcome) -> Scene:
        """A problem that the expert decided."""
        return cls(
            problem=problem,
            feasible=outcome.status is Status.FEASIBLE,
            posture=outcome.posture,
            lower_bound=outcome.lower_bound,
            expert_seconds=outcome.seconds,
        )


@dataclass(frozen=True, kw_only=True)
class SceneKind:
    """What scenes are of that come from elsewhere, from a data set for one: their class by name, and their limbs."""

    name: str
    legs: tuple[str, ...]


class SceneSource(Protocol):
    """Anything that hands out scenes."""

    def draw(self, rng: np.random.Generator) -> Scene:
        """Return the next scene."""
        ...


class SampledScenes:
    """Scenes sampled from a distribution and labelled on the spot by the exact planner.

    balanced: toss a coin for the label and draw until it comes, leaving out what is infeasible even without its moment
    balance; else scenes come at their natural rates. Undecided problems are drawn again.
    """

    def __init__(
        self, distribution: Distribution, *, balanced: bool = True, programs: Programs | None = None
    ) -> None:
        self._distribution = distribution
        self._balanced = balanced
        self._expert = ExactPlanner(programs=programs)

    def draw(self, rng: np.random.Generator) -> Scene:
        """Draw a scene. Raises PlanningFailed where a label does not come up in MAX_DRAWS draws."""
        wanted = bool(rng.integers(2))
        for _ in range(MAX_DRAWS):
            problem = self._distribution.sample(rng)
            outcome = self._expert.solve(problem)
            if outcome.status is Status.UNDECIDED:
                continue
            scene = Scene.of(problem, outcome)
            if not self._balanced or (scene.feasible == wanted and not outcome.details["trivial"]):
                return scene
        raise PlanningFailed(f"{self._distribution.name}: no scene of the wanted label in {MAX_DRAWS} draws")


def kind_of(
    problem: str | Distribution | SceneKind, robot: str | Path | None, terrain: str | Path | None
) -> Distribution | SceneKind:
    """A distribution, or what is known of one; by name as ``distribution`` has it. Raises InvalidInput."""
    if not isinstance(problem, SceneKind | Distribution):
        return distribution(problem, robot=robot, terrain=terrain)
    if robot is not None or terrain is not None:
        raise InvalidInput(f"robot, terrain: expected none beside {problem.name}, which has its own")
    return problem


def scenes_of_kind(kind: Distribution | SceneKind, *, balanced: bool, programs: Programs) -> SceneSource:
    """Scenes of a distribution. Raises InvalidInput where they were to come from elsewhere."""
    if isinstance(kind, SceneKind):
        raise InvalidInput(f"scenes: expected some of {kind.name}, got none")
    return SampledScenes(kind, balanced=balanced, programs=programs)


class ListedScenes:
    """Given scenes in their order, over and over; for evaluation."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        if not scenes:
            raise InvalidInput("scenes: expected one or more, got none")
        self._scenes = tuple(scenes)
        self._next = 0

    def draw(self, rng: np.random.Generator) -> Scene:
        """Return the next scene of the list; ``rng`` is not used."""
        scene = self._scenes[self._next % len(self._scenes)]
        self._next += 1
        return scene
