"""Learn by a method's name: one list for the command line, the demo, the bench and the library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.errors import InvalidInput
from stancekit.planners.plugins import Registry, takes
from stancekit.planners.relaxation.modes import Modes

from ..data.executors import Executor
from ..selectors.modes import modes_of
from ..selectors.selector import Learned, fitted
from .envelope_methods import ENVELOPES, fit
from .fit_settings import KNOBS, FitRequest, FitSettings, Progress, missing

_BOXES, _NETWORKS = (
    "stancekit.learners.training.fitting",
    "stancekit.learners.training.network_methods",
)
METHODS: Registry[Callable[[FitRequest], Any]] = Registry(
    "method",
    "stancekit.methods",
    {
        **{name: f"{_BOXES}:{name.replace('-', '_')}" for name in ENVELOPES},
        "modes": f"{_BOXES}:modes",
        "chooser": f"{_NETWORKS}:chooser",
        "neural": f"{_NETWORKS}:neural",
        "joint": f"{_NETWORKS}:joint",
        "rl": f"{_NETWORKS}:reinforcement",
    },
    expected="a function of a FitRequest that returns a selector",
    accepts=lambda it: takes(it, 1),
)
"""A method is called with a ``FitRequest`` and returns what it learned: an ``EnvelopeSet``,
``Modes``, or a selector with ``predict`` and ``save(path)``."""


def learn(
    method: str,
    dataset: Dataset | Sequence[Dataset],
    settings: FitSettings = FitSettings(),
    progress: Progress | None = None,
    *,
    calibration: Dataset | None = None,
    checkpoint: Path | None = None,
    run: Executor | None = None,
) -> Learned | Modes:
    """Learn by any method: one of ``METHODS``, or "FILE.py:NAME".

    The arguments are those of ``FitRequest``. Raises InvalidInput where the data set lacks what the
    method needs.
    """
    datasets = (dataset,) if isinstance(dataset, Dataset) else tuple(dataset)
    request = FitRequest(
        datasets=datasets,
        settings=settings,
        progress=progress,
        calibration=calibration,
        checkpoint=checkpoint,
        run=run,
    )
    learned = _method(method)(request)
    return (
        learned
        if isinstance(learned, Modes)
        else fitted(learned, method, datasets[0].problem_class)
    )


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
