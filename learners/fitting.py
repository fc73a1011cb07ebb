"""Learn envelopes from a data set by a method's name: one list for the command line, the demo and the bench."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet

from .dataset import Dataset
from .selectors.genetic import GeneticSettings, fit_genetic
from .selectors.gradient import Descent, descend, fit_gradient
from .selectors.heuristic import heuristic_envelope
from .selectors.mixture import fit_as_printed, fit_improved
from .selectors.quantile import quantile_box
from .selectors.selector import Learned
from .settings import typed

if TYPE_CHECKING:
    from .train_config import TrainConfig

Method = Literal["heuristic", "quantile", "gmm-printed", "gmm", "ga", "gradient", "chooser", "neural", "rl"]
METHODS: tuple[Method, ...] = get_args(Method)
ENVELOPES: tuple[Method, ...] = ("heuristic", "quantile", "gmm-printed", "gmm", "ga", "gradient")
"""The methods that learn envelopes; the others learn networks, and need torch."""
KNOBS: Mapping[Method, tuple[str, ...]] = {
    "heuristic": (),
    "quantile": ("share",),
    "gmm-printed": ("clusters", "threshold", "time_limit_s", "seed"),
    "gmm": ("share", "clusters", "steps", "batch", "seed"),
    "gradient": ("share", "boxes", "steps", "batch", "seed"),
    "ga": ("genetic",),
    "chooser": ("share", "boxes", "steps", "batch", "seed", "chooser"),
    "neural": ("neural",),
    "rl": ("rl",),
}
"""Which settings concern which method."""
PAPER_ROWS = 500
"""Points of S and of S̄ that the printed Boundary_fit gets: as many as in paper E; its program grows with each."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Knobs of the fitting methods; each method uses those that concern it (``KNOBS``).

    share: of the solutions that a quantile box leaves out on each side. clusters: n of Algorithm E2. threshold: p_th of
    its line 6. time_limit_s: of the printed Boundary_fit, per cluster. boxes: of gradient and chooser. steps, batch: of
    the margin descent. genetic, neural, chooser: keys of ``GeneticSettings``, ``NeuralSettings``, ``ChooserSettings``;
    rl: of ``TrainConfig``, but for environment, problem and scenes.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    share: float = 0.05
    clusters: int = 1
    threshold: float = 0.05
    time_limit_s: float = 12.0
    boxes: int = 1
    steps: int = 80
    batch: int = 100
    seed: int = 0
    genetic: Mapping[str, Any] = field(default_factory=dict)
    neural: Mapping[str, Any] = field(default_factory=dict)
    chooser: Mapping[str, Any] = field(default_factory=dict)
    rl: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 <= self.share < 0.5:
            raise InvalidInput(f"share: expected a number in [0, 0.5), got {self.share!r}")
        for name in ("clusters", "boxes", "steps", "batch"):
            if getattr(self, name) < 1:
                raise InvalidInput(f"{name}: expected 1 or more, got {getattr(self, name)!r}")
        if not 0.0 <= self.threshold < 1.0:
            raise InvalidInput(f"threshold: expected a number in [0, 1), got {self.threshold!r}")
        if not 0.0 < self.time_limit_s < float("inf"):
            raise InvalidInput(f"time_limit_s: expected a number above 0, got {self.time_limit_s!r}")
        if self.seed < 0:
            raise InvalidInput(f"seed: expected 0 or more, got {self.seed!r}")

    def concerning(self, method: Method) -> dict[str, Any]:
        """The settings that this method uses, JSON-ready."""
        values = {name: getattr(self, name) for name in KNOBS[method]}
        return {name: dict(value) if isinstance(value, Mapping) else value for name, value in values.items()}

    def check(self, method: Method) -> None:
        """Raise InvalidInput where the keys of a method with settings of its own are wrong, or torch is missing."""
        try:
            self._check(method)
        except ImportError as error:
            raise _missing(method, error) from None

    def _check(self, method: Method) -> None:
        if method == "ga":
            typed(GeneticSettings, self.genetic, "genetic")
        elif method == "neural":
            from .selectors.training import NeuralSettings

            typed(NeuralSettings, self.neural, "neural")
        elif method == "chooser":
            from .selectors.chooser import ChooserSettings

            typed(ChooserSettings, self.chooser, "chooser")
        elif method == "rl":
            _training("wall-3", self, {"feasible": 1, "infeasible": 1, "seed": 0})


def learn(
    method: Method,
    dataset: Dataset,
    settings: FitSettings = FitSettings(),
    progress: Progress | None = None,
    *,
    calibration: Dataset | None = None,
    checkpoint: Path | None = None,
) -> Learned:
    """Learn a selector by any method. Raises InvalidInput where the data set lacks what the method needs.

    calibration: rows to calibrate a neural selector on, a part of ``dataset`` where None; never those of a test.
    checkpoint: file by which methods that take long (ga, neural) go on where they were stopped.
    """
    if method in ENVELOPES:
        return Learned.fixed(method, fit(method, dataset, settings, progress, checkpoint=checkpoint))
    try:
        return _learn_network(method, dataset, settings, progress, calibration, checkpoint)
    except ImportError as error:
        raise _missing(method, error) from None


def _missing(method: Method, error: ImportError) -> InvalidInput:
    return InvalidInput(f"method: {method!r} needs {error.name}, got none: pip install 'stancekit[rl]'")


def _learn_network(
    method: Method,
    dataset: Dataset,
    settings: FitSettings,
    progress: Progress | None,
    calibration: Dataset | None,
    checkpoint: Path | None,
) -> Learned:
    if method == "neural":
        from .selectors.neural import fit_neural
        from .selectors.training import NeuralSettings

        knobs = typed(NeuralSettings, settings.neural, "neural")
        neural = fit_neural(dataset, knobs, progress, calibration=calibration, checkpoint=checkpoint)
        return Learned(selector=neural, problem_class=dataset.problem_class, write=neural.save)
    if method == "chooser":
        from .selectors.chooser import ChooserSettings, fit_chooser

        envelopes = fit("gradient", dataset, settings, progress)
        chooser = fit_chooser(dataset, envelopes, typed(ChooserSettings, settings.chooser, "chooser"), progress)
        return Learned(selector=chooser, problem_class=dataset.problem_class, write=chooser.save)
    if method == "rl":
        return _reinforce(dataset, settings, progress, calibration, checkpoint)
    raise InvalidInput(f"method: expected one of {', '.join(METHODS)}, got {method!r}")


def _reinforce(
    dataset: Dataset, settings: FitSettings, progress: Progress | None, calibration: Dataset | None, folder: Path | None
) -> Learned:
    """Train a policy on the data set's scenes; its learning curve is drawn on the calibration rows."""
    from .evaluate import scenes_of
    from .policy_file import bounds_of
    from .reinforce import TrainingScenes, train

    learned, held_out = (dataset, calibration) if calibration is not None else dataset.split((0.85, 0.15))
    count = {"feasible": len(learned.feasible), "infeasible": len(learned.infeasible), "seed": learned.header.plan.seed}
    config = _training(dataset.problem_class, settings, count)
    base = bounds_of(fit(config.base, dataset, settings).envelopes[0])
    scenes = TrainingScenes(train=scenes_of(learned), held_out=scenes_of(held_out), base=base)
    with tempfile.TemporaryDirectory() as spare:
        where = folder or Path(spare)
        where.mkdir(parents=True, exist_ok=True)
        resume = (where / "checkpoint.safetensors").exists()
        policy = train(config, where, resume=resume, scenes=scenes, progress=progress).policy
    return Learned(selector=policy, problem_class=dataset.problem_class, write=policy.save)


def _training(problem: str, settings: FitSettings, count: Mapping[str, int]) -> TrainConfig:
    """The training run that the settings describe. Raises InvalidInput."""
    from .train_config import TrainConfig

    fixed = {
        "environment": "stancekit/EnvelopeSelection-v0",
        "problem": problem,
        "train": dict(count),
        "held_out": {**count, "seed": count["seed"] + 1},
    }
    for name in fixed:
        if name in settings.rl:
            raise InvalidInput(f"rl.{name}: expected nothing, it follows from the data set, got {settings.rl[name]!r}")
    return typed(TrainConfig, {**settings.rl, **fixed}, "rl")


def fit(
    method: Method,
    dataset: Dataset,
    settings: FitSettings = FitSettings(),
    progress: Progress | None = None,
    *,
    checkpoint: Path | None = None,
) -> EnvelopeSet:
    """Learn envelopes from the data set's S and S̄. Raises InvalidInput where it lacks what the method needs.

    ``progress`` is told steps done and steps in all where a method takes its time.
    """
    if method not in ENVELOPES:
        raise InvalidInput(f"method: expected one of {', '.join(ENVELOPES)}, got {method!r}")
    if len(dataset.feasible) < 2 or (method.startswith("gmm") and len(dataset.infeasible) < 2):
        raise InvalidInput(
            f"data set: expected two or more rows of each label, got {len(dataset.feasible)} feasible and "
            f"{len(dataset.infeasible)} infeasible"
        )
    if method == "heuristic":
        return heuristic_envelope(dataset.problem_class, list(dataset.problems()))
    if method == "ga":
        knobs = typed(GeneticSettings, settings.genetic, "genetic")
        return fit_genetic(dataset, knobs, progress, checkpoint=checkpoint)
    if method == "gradient":
        return fit_gradient(
            dataset, boxes=settings.boxes, steps=settings.steps, batch=settings.batch, share=settings.share,
            seed=settings.seed, progress=progress,
        )  # fmt: skip
    found, notes = _envelopes(method, dataset, settings, progress)
    provenance = {
        "method": method,
        "settings": settings.concerning(method),
        "rows": len(dataset),
        "dataset": dataset.header.digest,
        "notes": notes,
    }
    return EnvelopeSet.for_problems(dataset.problem_class, list(dataset.problems()), found, provenance)


def _envelopes(
    method: Method, dataset: Dataset, settings: FitSettings, progress: Progress | None
) -> tuple[tuple[Envelope, ...], dict[str, Any]]:
    points = dataset.points
    if method == "quantile":
        return (quantile_box(points, share=settings.share),), {}
    if method == "gmm-printed":
        made = fit_as_printed(
            points[:PAPER_ROWS],
            dataset.infeasible_points[:PAPER_ROWS],
            clusters=settings.clusters,
            threshold=settings.threshold,
            seed=settings.seed,
            time_limit_s=settings.time_limit_s,
        )
    else:
        made = fit_improved(
            points, _margin_fit(dataset, settings, progress), clusters=settings.clusters, seed=settings.seed,
            share=settings.share,
        )  # fmt: skip
    return made.envelopes, {"kept": list(made.kept), "gaps": [float(np.minimum(gap, 1e6)) for gap in made.gaps]}


def _margin_fit(
    dataset: Dataset, settings: FitSettings, progress: Progress | None
) -> Callable[[Envelope, NDArray[np.intp]], Envelope]:
    """Boundary_fit by P1's margins over the members' problems and all infeasible ones."""
    feasible = [Scaled.of(problem) for problem in dataset.select(dataset.feasible).problems()]
    infeasible = [Scaled.of(problem) for problem in dataset.select(dataset.infeasible).problems()]
    programs = Programs()
    done = 0

    def told(step: int, loss: float) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, settings.steps * settings.clusters)

    def boundary_fit(start: Envelope, members: NDArray[np.intp]) -> Envelope:
        rng = np.random.default_rng(settings.seed)
        mine = [feasible[i] for i in members]
        return descend(
            start, mine, infeasible, programs, rng, Descent(steps=settings.steps, batch=settings.batch), told
        )

    return boundary_fit
