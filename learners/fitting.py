"""Learn envelopes from a data set by a method's name: one list for the command line, the demo and the bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from stancekit.planners.contact.envelope import Envelope, EnvelopeSet
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.contact.stages import Stages
from stancekit.planners.outcome import InvalidInput

from .dataset import Dataset
from .selectors.gradient import Descent, descend
from .selectors.heuristic import heuristic_envelope
from .selectors.mixture import fit_as_printed, fit_improved
from .selectors.quantile import quantile_box

Method = Literal["heuristic", "quantile", "gmm-printed", "gmm"]
METHODS: tuple[Method, ...] = get_args(Method)
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Knobs of the fitting methods; each method uses those that concern it.

    share: of the solutions that a quantile box leaves out on each side. clusters: n of Algorithm 2. threshold: p_th of
    its line 6. time_limit_s: of the printed Boundary_fit, per cluster. steps, batch: of the margin descent.
    """

    share: float = 0.05
    clusters: int = 1
    threshold: float = 0.05
    time_limit_s: float = 12.0
    steps: int = 80
    batch: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.share < 0.5:
            raise InvalidInput(f"share: expected a number in [0, 0.5), got {self.share!r}")
        for name in ("clusters", "steps", "batch"):
            if getattr(self, name) < 1:
                raise InvalidInput(f"{name}: expected 1 or more, got {getattr(self, name)!r}")


def fit(
    method: Method, dataset: Dataset, settings: FitSettings = FitSettings(), progress: Progress | None = None
) -> EnvelopeSet:
    """Learn envelopes from the data set's S and S̄. Raises InvalidInput where it lacks what the method needs.

    ``progress`` is told steps done and steps in all where a method takes its time.
    """
    if method not in METHODS:
        raise InvalidInput(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if len(dataset.feasible) < 2 or (method.startswith("gmm") and len(dataset.infeasible) < 2):
        raise InvalidInput(
            f"data set: expected two or more rows of each label, got {len(dataset.feasible)} feasible and "
            f"{len(dataset.infeasible)} infeasible"
        )
    if method == "heuristic":
        return heuristic_envelope(dataset.problem_class, list(dataset.problems()))
    found, notes = _envelopes(method, dataset, settings, progress)
    provenance = {
        "method": method,
        "settings": asdict(settings),
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
            points,
            dataset.infeasible_points,
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
    feasible = [ScaledProblem.of(problem) for problem in dataset.select(dataset.feasible).problems()]
    infeasible = [ScaledProblem.of(problem) for problem in dataset.select(dataset.infeasible).problems()]
    model = Stages().box(feasible[0])
    done = 0

    def told(step: int, loss: float) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, settings.steps * settings.clusters)

    def boundary_fit(start: Envelope, members: NDArray[np.intp]) -> Envelope:
        rng = np.random.default_rng(settings.seed)
        mine = [feasible[i] for i in members]
        return descend(start, mine, infeasible, model, rng, Descent(steps=settings.steps, batch=settings.batch), told)

    return boundary_fit
