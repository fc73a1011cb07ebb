"""Other evolutionary searches on the genetic algorithm's own fitness and budget, as baselines
(extra ``evo``).

CMA-ES (package ``cma``) maximises the same fitness; NSGA-II (package ``pymoo``) minimises a and b
as two objectives. Both are asked for as many boxes a generation as the genetic algorithm breeds,
tested on problems drawn anew in the same way, and end with as many finalists.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import not_installed
from stancekit.planners.files.arrays import Array

from .convergence import Generation
from .feasibility import FeasibilityOracle
from .genetic import (
    DOMAIN,
    GeneticResult,
    GeneticSettings,
    OnProgress,
    Trials,
    finish,
    first_generation,
    fitness,
    generation,
)
from .genetic import ranking as ranked

Ask = Callable[[], Array]
"""Gives the boxes to be tested next, shape (P, 2, N, 6)."""
Tell = Callable[[Array, Array], None]
"""Is told their a and b, each of shape (P,)."""
STEP = 0.5
"""CMA-ES's first step, in units of the solutions' standard deviations."""


def evolve_cma(
    problems_feasible: Sequence[Scaled],
    problems_infeasible: Sequence[Scaled],
    points: Array,
    settings: GeneticSettings = GeneticSettings(),
    *,
    oracle: FeasibilityOracle | None = None,
    progress: OnProgress | None = None,
) -> GeneticResult:
    """CMA-ES on the bounds, from the mean of the genetic algorithm's first generation; arguments as
    of ``evolve``.

    Of the settings, those of mutation, elites and tournament do not concern it. Its finalists are
    the mean of its distribution and the best boxes of the last generation. Raises InvalidInput,
    also without the extra ``evo``.
    """
    package, rng = extra("cma"), np.random.default_rng(settings.seed)
    trials = Trials.of(problems_feasible, problems_infeasible, settings, oracle)
    middle = first_generation(points, settings.population, rng).mean(axis=0)
    unit = np.broadcast_to(np.maximum(points.std(axis=0), 1e-3), middle.shape)
    options = {
        "popsize": settings.population,
        "seed": float("nan"),
        "verbose": -9,
        "randn": lambda *n: rng.standard_normal(n),
        "maxiter": settings.generations,
        "tolfun": 0,
        "tolflatfitness": settings.generations + 1,
    }
    search = package.CMAEvolutionStrategy(np.zeros(middle.size), STEP, options)
    candidates: list[Array] = []

    def box(genome: Array) -> Array:
        return np.asarray(
            np.sort(np.clip(middle + unit * genome.reshape(middle.shape), -DOMAIN, DOMAIN), axis=0)
        )

    def ask() -> Array:
        candidates[:] = search.ask()
        return np.stack([box(genome) for genome in candidates])

    def tell(a: Array, b: Array) -> None:
        search.tell(candidates, list(-fitness(a, b, settings)))

    last, history = _run(ask, tell, trials, settings, rng, progress)
    finalists = np.concatenate([box(np.asarray(search.mean))[None], last])[: settings.finalists]
    return finish(finalists, trials, settings, history)


def evolve_nsga2(
    problems_feasible: Sequence[Scaled],
    problems_infeasible: Sequence[Scaled],
    points: Array,
    settings: GeneticSettings = GeneticSettings(),
    *,
    oracle: FeasibilityOracle | None = None,
    progress: OnProgress | None = None,
) -> GeneticResult:
    """NSGA-II of pymoo on (a, b), from the genetic algorithm's first generation; arguments as of
    ``evolve``.

    Its operators are pymoo's own; survivors keep the a and b that they were tested with. Its
    finalists are the fittest survivors. Raises InvalidInput, also without the extra ``evo``.
    """
    problem_class = extra("pymoo.core.problem").Problem
    algorithm = extra("pymoo.algorithms.moo.nsga2").NSGA2
    rng = np.random.default_rng(settings.seed)
    trials = Trials.of(problems_feasible, problems_infeasible, settings, oracle)
    start = first_generation(points, settings.population, rng)
    shape = start.shape[1:]
    size = int(np.prod(shape))
    problem = problem_class(
        n_var=size, n_obj=2, xl=np.full(size, -DOMAIN), xu=np.full(size, DOMAIN)
    )
    search = algorithm(
        pop_size=settings.population,
        sampling=start.reshape(len(start), -1),
        eliminate_duplicates=False,
    )
    endless = extra("pymoo.core.termination").NoTermination()
    search.setup(problem, termination=endless, seed=settings.seed, verbose=False)
    candidates: list[Any] = []

    def boxes(population: Any) -> Array:
        return np.asarray(
            np.sort(population.get("X").astype(np.float64).reshape(-1, *shape), axis=1)
        )

    def ask() -> Array:
        candidates[:] = [search.ask()]
        return boxes(candidates[0])

    def tell(a: Array, b: Array) -> None:
        candidates[0].set("F", np.column_stack([a, b]))
        for individual in candidates[0]:
            individual.evaluated.update({"F", "G", "H"})
        search.tell(infills=candidates[0])

    _, history = _run(ask, tell, trials, settings, rng, progress)
    a, b = search.pop.get("F").T
    best = ranked(a, b, settings)[: settings.finalists]
    return finish(boxes(search.pop)[best], trials, settings, history)


def extra(module: str) -> Any:
    """Import what the extra ``evo`` installs.

    Raises InvalidInput without it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise not_installed("method", package, "evolution", "evo") from None


def _run(
    ask: Ask,
    tell: Tell,
    trials: Trials,
    settings: GeneticSettings,
    rng: np.random.Generator,
    progress: OnProgress | None,
) -> tuple[Array, list[Generation]]:
    """All generations; returns the boxes of the last one from best to worst, and the history."""
    history: list[Generation] = []
    while True:
        before, boxes = trials.counts, ask()
        a, b = trials.shares(boxes, trials.draw(rng))
        tell(a, b)
        history.append(
            generation(len(history), a, b, settings, float("nan"), trials.counts - before)
        )
        if progress is not None:
            progress(history[-1])
        if len(history) == settings.generations:
            return boxes[ranked(a, b, settings)], history
