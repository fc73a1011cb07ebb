"""Points that selectors learn from: do they follow from their problems alone, and does what is learned move?

    python benchmarks/label_points.py same                                     # rows labelled in other ways
    python benchmarks/label_points.py genetic --benches ../a/bench ../b/bench  # one GA, many seeds, two data sets
    python benchmarks/label_points.py table --benches ../a/bench ../b/bench    # Table I, cell by cell

`same`: every problem is labelled in blocks of 512, with Clarabel's equilibration on and on its careful settings, alone,
and in blocks of 7; the farthest apart of any [p, f], how many rows are more than 1e-5 apart, and whose toes the search
had to find. Beside them, what the search alone would have kept, with and without equilibration. `genetic`, `table`:
folders of `stancekit bench envelopes --quick`, the first of which is the old one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from threadpoolctl import threadpool_limits

from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.learners.dataset import Dataset
from stancekit.learners.selectors.genetic import GeneticSettings, fit_genetic
from stancekit.planners.answer.outcome import Posture, Status
from stancekit.planners.equilibrium import rows as conic_rows
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import PostureBatch
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.search.batch import canonical, solve_all, without_moments
from stancekit.planners.search.exact import ExactPlanner

Points = dict[int, Array]
APART = 1e-5


@dataclass(frozen=True, kw_only=True)
class Options:
    """Which study, and how much of it."""

    study: Annotated[Literal["same", "genetic", "table"], tyro.conf.Positional] = "same"
    problems: tuple[str, ...] = tuple(DISTRIBUTIONS)
    count: int = 1000
    """Natural samples a class (same)."""
    seed: int = 0
    seeds: int = 8
    """Of the GA (genetic)."""
    benches: tuple[Path, ...] = ()
    """Folders of `bench envelopes --quick` (genetic, table)."""


def same(options: Options) -> Iterator[str]:
    """Rows labelled in other ways."""
    for name in options.problems:
        batch = distribution(name).batch(np.random.default_rng(options.seed), options.count)
        first = labelled(batch, 512)
        found, searched = set(canonical(batch)), alone(batch)
        kinds = {kind: set(rows) for kind, rows in zip(("S", "S̄"), first, strict=True)}
        late = sorted(kinds["S"] - found)
        sizes = f"{len(kinds['S'])} in S, {len(kinds['S̄'])} in S̄"
        yield f"{name}: {options.count} samples, {sizes}; toes by the search: {late}"
        others: dict[str, tuple[Points, Points]] = {
            "equilibrated": equilibrated(partial(labelled, batch, 512)),
            "careful": equilibrated(partial(labelled, batch, 512), careful=True),
            "one by one": labelled(batch, 1),
            "blocks of 7": labelled(batch, 7),
        }
        for way, other in others.items():
            for kind, mine, theirs in zip(kinds, first, other, strict=True):
                yield f"{name} {way:12} {kind:2}: {apart(mine, theirs)}"
                if kind == "S":
                    early = {k: p for k, p in mine.items() if k in found}
                    yield f"{name} {way:12} S, toes by the iteration: {apart(early, theirs, keys=False)}"
        yield f"{name} the search alone, equilibrated or not: {apart(searched, equilibrated(partial(alone, batch)))}"


def labelled(batch: PostureBatch, size: int) -> tuple[Points, Points]:
    """[p, f] of S and of S̄, labelled in blocks of this size."""
    feasible, infeasible = Points(), Points()
    planner = ExactPlanner(time_limit_s=math.inf)
    for begin in range(0, len(batch), size):
        index = np.arange(begin, min(begin + size, len(batch)))
        block = batch.select(index)
        answers = solve_all(planner, block)
        postures = {k: answer.posture for k, answer in enumerate(answers) if answer.posture is not None}
        feasible |= {begin + k: point for k, point in points(block, postures).items()}
        kinds = [k for k, a in enumerate(answers) if a.status is Status.INFEASIBLE and not a.details["trivial"]]
        some = block.select(np.array(kinds, dtype=np.intp))
        infeasible |= {begin + kinds[k]: p for k, p in points(some, without_moments(planner.programs, some)).items()}
    return feasible, infeasible


def alone(batch: PostureBatch) -> Points:
    """[p, f] of the postures that ``ExactPlanner`` happens to find."""
    planner = ExactPlanner(time_limit_s=math.inf)
    answers = {k: planner.solve(problem).posture for k, problem in enumerate(batch.problems)}
    return points(batch, {k: posture for k, posture in answers.items() if posture is not None})


def points(batch: PostureBatch, postures: dict[int, Posture]) -> Points:
    """[p, f] by index."""
    some = ScaledBatch.of(batch.select(np.array(list(postures), dtype=np.intp)))
    return dict(zip(postures, some.pairs(list(postures.values())), strict=True))


def equilibrated(work: Callable[[], Any], *, careful: bool = False) -> Any:
    """What ``work`` gives with other settings of the solver."""
    settings = conic_rows.solver_settings
    try:
        conic_rows.solver_settings = lambda **given: settings(
            equilibrate=True, careful=careful or given.get("careful", False)
        )
        return work()
    finally:
        conic_rows.solver_settings = settings


def apart(mine: Points, theirs: Points, *, keys: bool = True) -> str:
    """How far apart the same rows are."""
    both = sorted(set(mine) & set(theirs))
    off = np.array([np.abs(mine[k] - theirs[k]).max() for k in both])
    only = f", {len(set(mine) ^ set(theirs))} rows in one alone" if keys else f" of {len(mine)}"
    farthest = f"farthest {off.max(initial=0.0):.2g}, {(off > APART).sum()} more than {APART:g} apart"
    return f"{len(both)} rows{only}; {farthest}"


def genetic(options: Options) -> Iterator[str]:
    """The GA of ``--quick`` with many seeds on each bench's own data: is it the data or the seed?"""
    programs = Programs()
    for name in options.problems:
        for bench in options.benches:
            train, test = (Dataset.open(bench / name / part) for part in ("train", "test"))
            tests = [
                [Scaled.of(problem) for problem in test.select(rows).problems()]
                for rows in (test.feasible, test.infeasible)
            ]
            found = []
            for seed in range(options.seeds):
                settings = GeneticSettings(population=20, generations=15, terrains=60, seed=seed)
                (box,) = fit_genetic(train, settings).envelopes
                admitted = [
                    sum(programs.get(McCormick, s.layout).solve(s, box).feasible for s in some) for some in tests
                ]
                found.append((admitted[0], len(tests[1]) - admitted[1]))
            kept, refused = np.array(found).T
            of = f"of {len(tests[0])} + {len(tests[1])}"
            yield (
                f"{name} {bench}: kept {kept.tolist()} median {np.median(kept):g}; refused {refused.tolist()} median "
                f"{np.median(refused):g}; right {(kept + refused).mean():.1f} ± {(kept + refused).std(ddof=1):.1f} {of}"
            )


def table(options: Options) -> Iterator[str]:
    """Every cell of the other benches beside the interval of the first."""
    tables = [
        {(row["problem_class"], row["selector"]): row for row in json.loads((bench / "table.json").read_text())}
        for bench in options.benches
    ]
    for bench, other in zip(options.benches[1:], tables[1:], strict=True):
        cells = outside = 0
        for (name, selector), row in tables[0].items():
            if name not in options.problems or (name, selector) not in other:
                continue
            for column in [key.removesuffix("_interval") for key in row if key.endswith("_interval")]:
                low, high = row[f"{column}_interval"]
                mine, size = other[name, selector][column], row[f"{column}_of"]
                cells += 1
                if not low <= mine <= high:
                    outside += 1
                    counts = f"{row[column] * size:.0f} of {size} before, {mine * size:.0f} now"
                    yield f"{name} {selector} {column}: {counts}, interval {low * size:.1f} to {high * size:.1f}"
        yield f"{bench}: {cells - outside} of {cells} cells within the 95 % intervals of {options.benches[0]}"


STUDIES: dict[str, Callable[[Options], Iterator[str]]] = {"same": same, "genetic": genetic, "table": table}


def main(options: Options) -> None:
    """Print the study."""
    with threadpool_limits(1):
        for line in STUDIES[options.study](options):
            print(line, flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
