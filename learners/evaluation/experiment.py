"""Definition of an experiment: which problems, how much data, which methods. ``bench`` runs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from pydantic import ConfigDict

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_yaml
from stancekit.planners.files.validation import shown, validated
from stancekit.planners.projection.project import PROJECTIONS, Projection

from ..data.labelling import Quota
from ..training.fit_settings import FitSettings
from ..training.fitting import METHODS


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Definition of an experiment: its problems, amount of data and methods.

    The seeds of ``train``, ``calibration`` and ``test`` differ.

    Arguments:
        robot, terrain: files that the problems are of, where not the default hexapod and no
            terrain's.
        calibration: rows that methods may calibrate on; without it they keep a part of ``train``
            for that.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    problems: tuple[str, ...]
    train: Quota
    test: Quota
    calibration: Quota | None = None
    methods: tuple[str, ...]
    projections: tuple[Projection, ...]
    fit: FitSettings = field(default_factory=FitSettings)
    robot: str | None = None
    terrain: str | None = None

    def __post_init__(self) -> None:
        if self.train.seed == self.test.seed:
            raise InvalidInput(
                f"test.seed: expected another seed than train.seed, got {self.test.seed} for both"
            )
        if self.calibration is not None and self.calibration.seed in (
            self.train.seed,
            self.test.seed,
        ):
            got = self.calibration.seed
            raise InvalidInput(
                f"calibration.seed: expected another seed than train.seed and test.seed, got {got}"
            )
        for name in self.problems:
            distribution(name, robot=self.robot, terrain=self.terrain)
        for index, method in enumerate(self.methods):
            known = [name for name in METHODS.names() if name != "modes"]
            if method not in known and ".py:" not in method:
                raise InvalidInput(
                    f"methods[{index}]: expected one of {', '.join(known)}, got {method!r}"
                )
            if ".py:" in method:
                METHODS.get(method)  # what is no method is said before anything is labelled
            self.fit.check(method)
        for name in ("problems", "methods", "projections"):
            if not getattr(self, name):
                raise InvalidInput(f"{name}: expected one or more, got none")
        for name in self.projections:
            PROJECTIONS.get(name)

    @classmethod
    def from_yaml(
        cls, path: str | Path, *, quick: bool = False, overrides: Mapping[str, Any] | None = None
    ) -> Experiment:
        """Read an experiment file.

        Raises InvalidInput with every key that is wrong.

        Arguments:
            quick: with the keys of its section ``quick`` in place of the main ones.
            overrides: in place of either.
        """
        data = read_yaml(path)
        short = data.pop("quick", {})
        if quick and not (isinstance(short, dict) and short):
            raise InvalidInput(f"{path}: quick: expected keys of an experiment, got {shown(short)}")
        return validated(cls, (data | short if quick else data) | dict(overrides or {}), str(path))
