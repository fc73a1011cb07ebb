"""Sources of an environment's scenes: labelled posture problems, drawn at random or listed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.cached import cached_property
from stancekit.planners.equilibrium.features import observe
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem

from .margins import margin_info


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledScene:
    """One problem with the expert's answer.

    Arguments:
        feasible: the label.
        posture: the expert's witness, None where infeasible.
        lower_bound: bound that the expert's certificate proves, if infeasible.
        expert_seconds: 0 where the label was read from a data set.
    """

    problem: Problem
    feasible: bool
    posture: Plan | None
    lower_bound: float = 0.0
    expert_seconds: float = 0.0

    @cached_property
    def scaled(self) -> Scaled:
        """The numbers of the problem."""
        return Scaled.of(self.problem)

    @cached_property
    def observation(self) -> dict[str, NDArray[np.float32]]:
        """Observation of the scene (``features.observe``); not to be written to."""
        return observe(self.scaled)

    @cached_property
    def point(self) -> Array:
        """[p, f] of the witness (``Scaled.point``), zeros where there is none, shape (N, 6)."""
        if self.posture is None:
            return np.zeros((len(self.problem.contacts), 6))
        return self.scaled.point(self.posture)

    @cached_property
    def margins(self) -> dict[str, float]:
        """Margins of the witness (``margin_info``), under the keys of ``info``; measured when first
        asked for.
        """
        return margin_info(self.posture, "expert_")

    @classmethod
    def of(cls, problem: Problem, outcome: Answer[Plan]) -> LabelledScene:
        """A problem that the expert decided."""
        return cls(
            problem=problem,
            feasible=outcome.status is Status.FEASIBLE,
            posture=outcome.solution,
            lower_bound=outcome.bound,
            expert_seconds=outcome.effort.seconds,
        )


def seen(scene: LabelledScene) -> dict[str, NDArray[np.float32]]:
    """The observation of a scene, in arrays of its own."""
    return {name: values.copy() for name, values in scene.observation.items()}


def all_seen(scenes: Sequence[LabelledScene]) -> dict[str, NDArray[np.float32]]:
    """The observations of scenes of one size, a row each."""
    return {
        name: np.stack([scene.observation[name] for scene in scenes])
        for name in scenes[0].observation
    }


@dataclass(frozen=True, kw_only=True)
class SceneKind:
    """Class of scenes that come from elsewhere, such as a data set: their class by name, and their
    limbs.
    """

    name: str
    legs: tuple[str, ...]


class SceneSource(Protocol):
    """Anything that hands out scenes."""

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return the next scene."""
        ...


class ListedScenes:
    """Given scenes in their order, over and over; for evaluation."""

    def __init__(self, scenes: Sequence[LabelledScene]) -> None:
        self.deal(scenes)

    def deal(self, scenes: Sequence[LabelledScene]) -> None:
        """Hand out these from now on.

        Raises InvalidInput where there are none.
        """
        if not scenes:
            raise InvalidInput("scenes: expected one or more, got none")
        self._scenes = tuple(scenes)
        self._next = 0

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return the next scene of the list; ``rng`` is not used."""
        scene = self._scenes[self._next % len(self._scenes)]
        self._next += 1
        return scene


class PooledScenes:
    """Given scenes, drawn at random, each as likely at every draw."""

    def __init__(self, scenes: Sequence[LabelledScene]) -> None:
        if not scenes:
            raise InvalidInput("scenes: expected one or more, got none")
        self._scenes = tuple(scenes)

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return a scene."""
        return self._scenes[int(rng.integers(len(self._scenes)))]
