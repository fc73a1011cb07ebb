"""Learn by a method's name: one list for the command line, the demo, the bench and the library."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt, PositiveInt

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.arrays import checked_choice
from stancekit.planners.files.documents import Strict, check_fields, shown, typed
from stancekit.planners.plugins import Registry, code_of, takes
from stancekit.planners.relaxation.boxes import Modes
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet

from ..data.executors import Executor
from ..data.labelling import check_unseen
from ..leaps.kinds import KINDS
from ..selectors.genetic import (
    BoxDescent,
    BoxFit,
    GeneticSettings,
    fit_genetic,
    fit_gradient,
    scaled_by_label,
)
from ..selectors.mixture import fit_as_printed, fit_improved, modes_of
from ..selectors.selector import Learned, fitted, heuristic_envelope, quantile_box
from .loop import StepsDone, run

KNOBS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "heuristic": (),
        "quantile": ("share",),
        "gmm-printed": ("clusters", "threshold", "time_limit_s", "seed"),
        "gmm": ("share", "clusters", "steps", "batch", "seed"),
        "gradient": ("share", "boxes", "steps", "batch", "seed"),
        "ga": ("genetic",),
        "modes": ("share",),
        "neural": ("neural",),
        "joint": ("neural",),
        **dict.fromkeys(("surrogate", *KINDS), ()),
    }
)
"""Settings by the method that they concern; some methods have others of their own."""
FURTHER: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "calibration": ("neural", "joint", "surrogate"),
        "checkpoint": ("ga", "gradient", "neural", "joint", "surrogate", *KINDS),
        "workers": ("ga",),
    }
)
"""Arguments of ``fit`` that not every method uses, and the methods that do."""


@dataclass(frozen=True, kw_only=True)
class FitSettings(Strict):
    """Knobs of the fitting methods; each method uses those that concern it (``KNOBS``).

    Arguments:
        share: share of the solutions outside a quantile box, on each side.
        clusters: n of Algorithm E2.
        threshold: p_th of its line 6.
        time_limit_s: limit of its printed Boundary_fit, per cluster.
        boxes: number of boxes that gradient learns.
        steps: steps of the margin descent.
        batch: rows per step.
        genetic: keys of ``GeneticSettings``.
        neural: keys of ``NeuralSettings``.
    """

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
                    f"{name}: expected none for {method}, which does not use it, got {came}"
                )

    def check(self, method: str) -> None:
        """Raise InvalidInput where the keys of a method with settings of its own are wrong, or
        torch is missing.
        """
        if method == "ga":
            typed(GeneticSettings, self.genetic, "genetic")
        elif method in ("neural", "joint"):
            try:
                from ..selectors.neural import NeuralSettings
            except ImportError as error:
                raise missing(method, error) from None
            typed(NeuralSettings, self.neural, "neural")


@dataclass(frozen=True, kw_only=True, eq=False)
class FitRequest:
    """Argument of a method of fitting: it is called with this alone, and returns what it learned.

    Arguments:
        datasets: rows to learn from; all but "modes" want one, ``dataset``.
        progress: gets steps done and in all, where a method takes its time.
        calibration: rows to calibrate on, never those of a test; a part of the data set where None.
        checkpoint: file by which a method that takes long goes on where it was stopped.
        run: executor of a method that spreads its work ("ga"); this process where None.
    """

    datasets: tuple[Dataset, ...]
    settings: FitSettings = FitSettings()
    progress: StepsDone | None = None
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


ENVELOPES = ("heuristic", "quantile", "gmm-printed", "gmm", "ga", "gradient")
"""The methods of this file."""
PAPER_ROWS = 500
"""Points of S and of S̄ that the printed Boundary_fit gets: as many as in Lin et al.; its program
grows with each."""


def fit(
    method: str,
    dataset: Dataset,
    settings: FitSettings = FitSettings(),
    progress: StepsDone | None = None,
    *,
    checkpoint: Path | None = None,
    run: Executor | None = None,
) -> EnvelopeSet:
    """Learn envelopes from the data set's S and S̄.

    Raises InvalidInput where it lacks what the method needs.

    ``progress`` gets steps done and steps in all where a method takes its time.

    Arguments:
        run: the executor of "ga".
    """
    checked_choice(method, "method", ENVELOPES)
    if len(dataset.feasible) < 2 or (method.startswith("gmm") and len(dataset.infeasible) < 2):
        raise InvalidInput(
            f"data set: expected two or more rows of each label, got {len(dataset.feasible)} "
            "feasible and "
            f"{len(dataset.infeasible)} infeasible"
        )
    if method == "heuristic":
        return heuristic_envelope(dataset.problem_class, list(dataset.problems()))
    if method == "ga":
        knobs = typed(GeneticSettings, settings.genetic, "genetic")
        return fit_genetic(dataset, knobs, progress, checkpoint=checkpoint, run=run)
    if method == "gradient":
        return fit_gradient(
            dataset,
            boxes=settings.boxes,
            steps=settings.steps,
            batch=settings.batch,
            share=settings.share,
            seed=settings.seed,
            progress=progress,
            checkpoint=checkpoint,
        )
    envelopes, notes = _envelope_rows(method, dataset, settings, progress)
    provenance = {
        "method": method,
        "settings": settings.concerning(method),
        "rows": len(dataset),
        **dataset.origin,
        "notes": notes,
    }
    return EnvelopeSet.for_problems(
        dataset.problem_class, list(dataset.problems()), envelopes, provenance
    )


def _envelope_rows(
    method: str, dataset: Dataset, settings: FitSettings, progress: StepsDone | None
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
            points,
            _margin_fit(dataset, settings, progress),
            clusters=settings.clusters,
            seed=settings.seed,
            share=settings.share,
        )
    return made.envelopes, {
        "kept": list(made.shares),
        "gaps": [float(np.minimum(gap, 1e6)) for gap in made.gaps],
    }


def _margin_fit(
    dataset: Dataset, settings: FitSettings, progress: StepsDone | None
) -> Callable[[Envelope, NDArray[np.intp]], Envelope]:
    """Boundary_fit by P1's margins over the members' problems and all infeasible ones."""
    feasible, infeasible = scaled_by_label(dataset)
    programs, done = Programs(), 0

    def count(*_: int) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, settings.steps * settings.clusters)

    def boundary_fit(start: Envelope, members: NDArray[np.intp]) -> Envelope:
        rng, mine = np.random.default_rng(settings.seed), [feasible[i] for i in members]
        knobs = BoxDescent(steps=settings.steps, batch=settings.batch)
        box = BoxFit((start,), mine, infeasible, programs, rng, knobs)
        run(box, count)
        return box.envelopes[0]

    return boundary_fit


_BOXES, _NETWORKS = (
    "stancekit.learners.training.fitting",
    "stancekit.learners.selectors.neural",
)
METHODS: Registry[Callable[[FitRequest], Any]] = Registry(
    "method",
    "stancekit.methods",
    {
        **{name: f"{_BOXES}:{name.replace('-', '_')}" for name in ENVELOPES},
        "modes": f"{_BOXES}:modes",
        "neural": f"{_NETWORKS}:neural",
        "joint": f"{_NETWORKS}:joint",
    },
    expected="a function of a FitRequest that returns a selector",
    accepts=lambda it: takes(it, 1),
    further=("surrogate", *KINDS),
)
"""A method is called with a ``FitRequest`` and returns what it learned: an ``EnvelopeSet``,
``Modes``, or a selector with ``predict`` and ``save(path)``."""


def learn(
    method: str,
    dataset: Dataset | Sequence[Dataset],
    settings: FitSettings = FitSettings(),
    progress: StepsDone | None = None,
    *,
    calibration: Dataset | None = None,
    checkpoint: Path | None = None,
    run: Executor | None = None,
) -> Learned | Modes:
    """Learn by any method: one of ``METHODS``, or "FILE.py:NAME".

    The arguments are those of ``FitRequest``. Raises InvalidInput where the data set lacks what the
    method needs, and for a calibration on rows of it. What a method from elsewhere learns has seen
    the data set, too.
    """
    datasets = (dataset,) if isinstance(dataset, Dataset) else tuple(dataset)
    if calibration is not None:
        for each in datasets:
            check_unseen(calibration, each.origin, "calibration")
    request = FitRequest(
        datasets=datasets,
        settings=settings,
        progress=progress,
        calibration=calibration,
        checkpoint=checkpoint,
        run=run,
    )
    learned = _method(method)(request)
    if isinstance(learned, Modes):
        return learned
    origin: dict[str, Any] = {} if method in KNOBS else datasets[0].origin
    if isinstance(learned, EnvelopeSet):
        further = {"code": code} if (code := code_of(method)) else {}
        learned = replace(learned, provenance={**origin, **learned.provenance, **further})
    return fitted(learned, method, datasets[0].problem_class, origin)


def learn_selector(method: str, dataset: Dataset, *arguments: Any, **options: Any) -> Learned:
    """``learn`` for whoever rolls out what comes.

    Raises InvalidInput for modes, which are no selector of a scene.
    """
    learned = learn(method, dataset, *arguments, **options)
    if isinstance(learned, Modes):
        raise InvalidInput(
            f"method: expected one that learns a selector, got {method!r}, which learns modes"
        )
    return learned


def _method(name: str) -> Callable[[FitRequest], Any]:
    try:
        return METHODS.get(name)
    except InvalidInput as error:
        if name in KNOBS and isinstance(error.__cause__, ImportError):
            raise missing(name, error.__cause__) from None
        raise


def modes(request: FitRequest) -> Modes:
    """A box a data set, the forces in world axes, for planners that switch between them."""
    return modes_of(request.datasets, share=request.settings.share)


def _envelopes(method: str, request: FitRequest) -> Any:
    return fit(
        method,
        request.dataset,
        request.settings,
        request.progress,
        checkpoint=request.checkpoint,
        run=request.run,
    )


heuristic, quantile, gmm_printed, gmm, ga, gradient = (
    partial(_envelopes, name) for name in ENVELOPES
)
