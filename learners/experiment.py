"""An experiment from terrain to table: sample, label exactly, learn envelopes, compare them on held-out terrains."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError
from stancekit.planners.contact.envelope import EnvelopeSet
from stancekit.planners.contact.stages import Projection
from stancekit.planners.files import read_text, write_envelopes
from stancekit.planners.outcome import InvalidInput
from stancekit.planners.scene.posture import pydantic_lines

from .dataset import Dataset
from .evaluate import Score, evaluate, evaluate_lift, scenes_of
from .fitting import FitSettings, Method, fit
from .labelling import LabelPlan, label
from .selectors.selector import FixedSelector

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Quota:
    """How many rows of each label, from which seed."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    feasible: int
    infeasible: int
    seed: int


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Which problems, how much data, which methods. ``train`` and ``test`` need different seeds."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    problems: tuple[str, ...]
    train: Quota
    test: Quota
    methods: tuple[Method, ...]
    projections: tuple[Projection, ...]
    fit: FitSettings = field(default_factory=FitSettings)

    def __post_init__(self) -> None:
        if self.train.seed == self.test.seed:
            raise InvalidInput(f"test.seed: expected another seed than train.seed, got {self.test.seed} for both")
        for name in ("problems", "methods", "projections"):
            if not getattr(self, name):
                raise InvalidInput(f"{name}: expected one or more, got none")

    @classmethod
    def from_yaml(cls, path: str | Path) -> Experiment:
        """Read an experiment file. Raises InvalidInput with every key that is wrong."""
        try:
            data = yaml.safe_load(read_text(path))
        except yaml.YAMLError as error:
            raise InvalidInput(f"{path}: expected YAML: {' '.join(str(error).split())}") from None
        return cls.from_mapping(data, str(path))

    @classmethod
    def from_mapping(cls, data: Any, where: str) -> Experiment:
        """Check the keys and values of a mapping. Raises InvalidInput."""
        try:
            return TypeAdapter(cls).validate_python(data)
        except ValidationError as error:
            raise InvalidInput(f"{where}: " + "; ".join(pydantic_lines(error))) from None
        except InvalidInput as error:
            raise InvalidInput(f"{where}: {error}") from None


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassResult:
    """What an experiment found for one class of problems. sets: the learned envelopes by method."""

    problem_class: str
    labelling: Mapping[str, Any]
    scores: tuple[Score, ...]
    sets: Mapping[str, EnvelopeSet]
    test: Dataset

    @property
    def best(self) -> Score:
        """The envelopes with the best balanced P1 share."""
        return max((score for score in self.scores if score.selector in self.sets), key=lambda score: score.balanced)


def run_experiment(
    experiment: Experiment, folder: Path, *, workers: int, progress: Progress | None = None
) -> Iterator[ClassResult]:
    """Yield the result of every class as it comes; data sets and envelopes are kept in ``folder``.

    Labelling resumes where an earlier run of the same experiment stopped. Fits and rollouts are done again.
    """
    for name in experiment.problems:

        def told(stage: str, name: str = name) -> Callable[[int, int], None]:
            return lambda done, total: None if progress is None else progress(f"{name}: {stage}", done, total)

        train, labelling = _label(name, experiment.train, folder / name / "train", workers, told("label train"))
        test, _ = _label(name, experiment.test, folder / name / "test", workers, told("label test"))
        scenes = scenes_of(test)
        sets: dict[str, EnvelopeSet] = {}
        scores = []
        for method in experiment.methods:
            sets[method] = fit(method, train, experiment.fit, told(f"fit {method}"))
            write_envelopes(folder / name / f"{method}.json", sets[method])
            scores.append(
                evaluate(
                    method,
                    FixedSelector(method, sets[method]),
                    scenes,
                    problem_class=name,
                    projections=experiment.projections,
                    boxes=len(sets[method].envelopes),
                    progress=told(f"evaluate {method}"),
                )
            )
        scores.append(evaluate_lift(scenes, projections=experiment.projections, progress=told("evaluate lift")))
        yield ClassResult(problem_class=name, labelling=labelling, scores=tuple(scores), sets=sets, test=test)


def _label(
    name: str, quota: Quota, folder: Path, workers: int, told: Callable[[int, int], None]
) -> tuple[Dataset, Mapping[str, Any]]:
    plan = LabelPlan(
        distribution=name, feasible=quota.feasible, infeasible=quota.infeasible, seed=quota.seed, shard_size=125
    )
    summary = label(plan, folder, workers=workers, progress=lambda state: told(state.rows, plan.rows))
    return Dataset.open(folder), summary.to_json()
