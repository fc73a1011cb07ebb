"""Request to a method of fitting: a data set, and the settings that concern it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import ConfigDict, Field, NonNegativeInt, PositiveInt

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.validation import check_fields, shown, typed

from ..data.executors import Executor
from ..selectors.genetic import GeneticSettings

if TYPE_CHECKING:
    from .train_config import TrainConfig

SPREAD = ("ga",)
"""Methods that use an executor."""
KNOBS: Mapping[str, tuple[str, ...]] = {
    "heuristic": (),
    "quantile": ("share",),
    "gmm-printed": ("clusters", "threshold", "time_limit_s", "seed"),
    "gmm": ("share", "clusters", "steps", "batch", "seed"),
    "gradient": ("share", "boxes", "steps", "batch", "seed"),
    "ga": ("genetic",),
    "modes": ("share",),
    "chooser": ("share", "boxes", "steps", "batch", "seed", "chooser"),
    "neural": ("neural",),
    "joint": ("neural",),
    "rl": ("rl",),
}
"""Settings by the method that they concern."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Knobs of the fitting methods; each method uses those that concern it (``KNOBS``).

    Arguments:
        share: of the solutions that a quantile box leaves out on each side.
        clusters: n of Algorithm E2.
        threshold: p_th of its line 6.
        time_limit_s: of the printed Boundary_fit, per cluster.
        boxes: of gradient and chooser.
        steps, batch: of the margin descent.
        genetic, neural, chooser: keys of ``GeneticSettings``, ``NeuralSettings``,
            ``ChooserSettings``.
        rl: of ``TrainConfig``, but for environment, problem and scenes.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    share: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.05
    clusters: PositiveInt = 1
    threshold: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.05
    time_limit_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 12.0
    boxes: PositiveInt = 1
    steps: PositiveInt = 80
    batch: PositiveInt = 100
    seed: NonNegativeInt = 0
    genetic: Mapping[str, Any] = field(default_factory=dict)
    neural: Mapping[str, Any] = field(default_factory=dict)
    chooser: Mapping[str, Any] = field(default_factory=dict)
    rl: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)

    def concerning(self, method: str) -> dict[str, Any]:
        """The settings that this method uses, JSON-ready; of a method from elsewhere all."""
        values = {
            name: getattr(self, name)
            for name in KNOBS.get(method, [each.name for each in fields(self)])
        }
        return {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in values.items()
        }

    def check_used(self, method: str) -> None:
        """Raise InvalidInput for a setting that was given and does not concern the method; any seed
        is right for one that draws nothing. A bench, whose settings are for all of its methods,
        does not ask.
        """
        concerns, usual = self.concerning(method), FitSettings()
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name not in (*concerns, "seed") and value != getattr(usual, name):
                came = shown(value) if isinstance(value, int | float) else f"{len(value)} keys"
                raise InvalidInput(
                    f"{name}: expected none for {method}, which has no use for it, got {came}"
                )

    def check(self, method: str) -> None:
        """Raise InvalidInput where the keys of a method with settings of its own are wrong, or
        torch is missing.
        """
        try:
            self._check(method)
        except ImportError as error:
            raise missing(method, error) from None

    def _check(self, method: str) -> None:
        if method == "ga":
            typed(GeneticSettings, self.genetic, "genetic")
        elif method in ("neural", "joint"):
            from ..selectors.neural import NeuralSettings

            typed(NeuralSettings, self.neural, "neural")
        elif method == "chooser":
            from ..selectors.chooser import ChooserSettings

            typed(ChooserSettings, self.chooser, "chooser")
        elif method == "rl":
            self.training("wall-3", None, {"feasible": 1, "infeasible": 1, "seed": 0})

    def training(
        self, problem: str, legs: Sequence[str] | None, count: Mapping[str, int]
    ) -> TrainConfig:
        """The reinforcement that these settings describe.

        Raises InvalidInput.

        Arguments:
            legs: see ``TrainConfig``.
        """
        from .train_config import TrainConfig

        fixed = {
            "environment": "stancekit/EnvelopeSelection-v0",
            "problem": problem,
            "legs": legs,
            "train": dict(count),
            "held_out": {**count, "seed": count["seed"] + 1},
        }
        for name in fixed:
            if name in self.rl:
                raise InvalidInput(
                    f"rl.{name}: expected no value, since the data set gives it, got "
                    f"{self.rl[name]!r}"
                )
        return typed(TrainConfig, {**self.rl, **fixed}, "rl")


@dataclass(frozen=True, kw_only=True, eq=False)
class FitRequest:
    """Argument of a method of fitting: it is called with this alone, and returns what it learned.

    Arguments:
        datasets: rows to learn from; all but "modes" want one, ``dataset``.
        progress: told steps done and in all, where a method takes its time.
        calibration: rows to calibrate on, never those of a test; a part of the data set where None.
        checkpoint: file or folder by which a method that takes long goes on where it was stopped.
        run: executor of a method that spreads its work ("ga"); this process where None.
    """

    datasets: tuple[Dataset, ...]
    settings: FitSettings = FitSettings()
    progress: Progress | None = None
    calibration: Dataset | None = None
    checkpoint: Path | None = None
    run: Executor | None = None

    @property
    def dataset(self) -> Dataset:
        """The one data set.

        Raises InvalidInput where there are several.
        """
        if len(self.datasets) != 1:
            raise InvalidInput(f"data sets: expected one, got {len(self.datasets)}")
        return self.datasets[0]


def missing(method: str, error: ImportError) -> InvalidInput:
    """Refusal of a method that needs a package which is not installed."""
    return not_installed("method", error.name, repr(method), "rl")
