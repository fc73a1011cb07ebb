"""Methods that learn boxes from a data set's S and S̄, and need no network."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_choice
from stancekit.planners.files.validation import typed
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet

from ..data.executors import Executor
from ..selectors.genetic import BoxDescent, GeneticSettings, descend, fit_genetic, fit_gradient
from ..selectors.mixture import fit_as_printed, fit_improved
from ..selectors.selector import heuristic_envelope, quantile_box
from .fit_settings import FitSettings, Progress

ENVELOPES = ("heuristic", "quantile", "gmm-printed", "gmm", "ga", "gradient")
"""The methods of this file."""
PAPER_ROWS = 500
"""Points of S and of S̄ that the printed Boundary_fit gets: as many as in Lin et al.; its program
grows with each."""


def fit(
    method: str,
    dataset: Dataset,
    settings: FitSettings = FitSettings(),
    progress: Progress | None = None,
    *,
    checkpoint: Path | None = None,
    run: Executor | None = None,
) -> EnvelopeSet:
    """Learn envelopes from the data set's S and S̄.

    Raises InvalidInput where it lacks what the method needs.

    ``progress`` is told steps done and steps in all where a method takes its time.

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
        )
    envelopes, notes = _envelopes(method, dataset, settings, progress)
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


def _envelopes(
    method: str, dataset: Dataset, settings: FitSettings, progress: Progress | None
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
    dataset: Dataset, settings: FitSettings, progress: Progress | None
) -> Callable[[Envelope, NDArray[np.intp]], Envelope]:
    """Boundary_fit by P1's margins over the members' problems and all infeasible ones."""
    feasible = [Scaled.of(problem) for problem in dataset.select(dataset.feasible).problems()]
    infeasible = [Scaled.of(problem) for problem in dataset.select(dataset.infeasible).problems()]
    programs = Programs()
    done = 0

    def on_progress(step: int, loss: float) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, settings.steps * settings.clusters)

    def boundary_fit(start: Envelope, members: NDArray[np.intp]) -> Envelope:
        rng = np.random.default_rng(settings.seed)
        mine = [feasible[i] for i in members]
        return descend(
            start,
            mine,
            infeasible,
            programs,
            rng,
            BoxDescent(steps=settings.steps, batch=settings.batch),
            on_progress,
        )

    return boundary_fit
