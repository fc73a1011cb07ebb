"""Points that selectors learn from: do they follow from their problems alone, and does what is
learned move?

    # rows labelled in other ways
    python benchmarks/label_points.py same
    # one method, many seeds, both data sets
    python benchmarks/label_points.py seeds --benches ../a/bench ../b/bench
    # Table I, cell by cell
    python benchmarks/label_points.py table --benches ../a/bench ../b/bench
    # what both learned, on rows of neither
    python benchmarks/label_points.py fresh --benches ../a/bench ../b/bench

`same`: every problem is labelled in blocks of 512, with Clarabel's equilibration on and on its
careful settings, alone, and in blocks of 7; the farthest apart of any [p, f], how many rows are
more than 1e-5 apart, and whose toes the search had to find. Beside them, what the search alone
would have kept, with and without equilibration. `seeds`, `table`, `fresh`: folders of `stancekit
bench envelopes --quick`, the first of which is the old one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from _bench import Options, launch

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.learners.data.labelling import label
from stancekit.learners.evaluation.bench import Experiment
from stancekit.learners.evaluation.evaluate import evaluate
from stancekit.learners.selectors.selector import load_selector
from stancekit.learners.training.fitting import learn_selector
from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium import rows as conic_rows
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import PostureBatch
from stancekit.planners.search.batch import canonical, relaxed, solve_all, solved
from stancekit.planners.search.exact import Exact

Points = dict[int, Array]
APART = 1e-5
FRESH = 90210
"""Seed of rows that no bench has drawn."""
CONFIG = Path(__file__).resolve().parents[1] / "configs" / "bench-envelopes.yaml"


def without_moments(
    programs: Programs, batch: PostureBatch, *, tolerance: float = 1e-6
) -> dict[int, Plan]:
    """``relaxed``, and where the iteration comes to no end ``solved``."""
    postures = relaxed(batch, tolerance=tolerance)
    rest = np.array([k for k in range(len(batch)) if k not in postures], dtype=np.intp)
    ended = solved(programs, batch.select(rest), tolerance=tolerance)
    return postures | {int(rest[k]): posture for k, posture in ended.items()}


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which study, and how much of it."""

    study: Annotated[Literal["same", "seeds", "table", "fresh"], tyro.conf.Positional] = "same"
    problems: tuple[str, ...] = tuple(DISTRIBUTIONS)
    count: int = 1000
    """Natural samples a class (same), rows of each label (fresh)."""
    seeds: int = 8
    """How many (seeds)."""
    method: Literal["ga", "neural"] = "ga"
    """Which (seeds)."""
    benches: tuple[Path, ...] = ()
    """Folders of `bench envelopes --quick` (seeds, table, fresh)."""


def same(options: Arguments) -> Iterator[str]:
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
    planner = Exact(time_limit_s=math.inf)
    for begin in range(0, len(batch), size):
        index = np.arange(begin, min(begin + size, len(batch)))
        block = batch.select(index)
        answers = solve_all(planner, block)
        postures = {
            k: answer.solution for k, answer in enumerate(answers) if answer.solution is not None
        }
        feasible |= {begin + k: point for k, point in points(block, postures).items()}
        kinds = [
            k
            for k, a in enumerate(answers)
            if a.status is Status.INFEASIBLE and not a.details["trivial"]
        ]
        some = block.select(np.array(kinds, dtype=np.intp))
        infeasible |= {
            begin + kinds[k]: p
            for k, p in points(some, without_moments(planner.programs, some)).items()
        }
    return feasible, infeasible


def alone(batch: PostureBatch) -> Points:
    """[p, f] of the postures that ``Exact`` happens to find."""
    planner = Exact(time_limit_s=math.inf)
    answers = {k: planner.solve(problem).solution for k, problem in enumerate(batch.problems)}
    return points(batch, {k: posture for k, posture in answers.items() if posture is not None})


def points(batch: PostureBatch, postures: dict[int, Plan]) -> Points:
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
    farthest = (
        f"farthest {off.max(initial=0.0):.2g}, {(off > APART).sum()} more than {APART:g} apart"
    )
    return f"{len(both)} rows{only}; {farthest}"


def seeds(options: Arguments) -> Iterator[str]:
    """One method of ``--quick`` with many seeds on each bench's own data: is it the data or the
    seed?
    """
    fit = Experiment.from_yaml(CONFIG, quick=True).fit
    knobs = {"ga": "genetic", "neural": "neural"}[options.method]
    for name in options.problems:
        for bench in options.benches:
            train, calibration, test = (
                Dataset.open(bench / name / part) for part in ("train", "calibration", "test")
            )
            found = []
            for seed in range(options.seeds):
                settings = replace(fit, **{knobs: {**getattr(fit, knobs), "seed": seed}})
                selector = learn_selector(options.method, train, settings, calibration=calibration)
                score = evaluate(
                    options.method,
                    selector,
                    scenes_of(test),
                    problem_class=name,
                    projections=("fix-p",),
                )
                found.append((score.p1_feasible.hits, score.p1_infeasible.hits))
            kept, refused = np.array(found).T
            right = kept + refused
            yield (
                f"{name} {options.method} {bench}: kept {kept.tolist()} median {np.median(kept):g}; refused "
                f"{refused.tolist()} median {np.median(refused):g}; right {right.mean():.1f} ± {right.std(ddof=1):.1f} "
                f"of {len(test)}"
            )


def table(options: Arguments) -> Iterator[str]:
    """Every cell of the other benches beside the interval of the first."""
    tables = [
        {
            (row["problem_class"], row["selector"]): row
            for row in json.loads((bench / "table.json").read_text())
        }
        for bench in options.benches
    ]
    for bench, other in zip(options.benches[1:], tables[1:], strict=True):
        cells = outside = 0
        for (name, selector), row in tables[0].items():
            if name not in options.problems or (name, selector) not in other:
                continue
            for column in [
                key.removesuffix("_interval") for key in row if key.endswith("_interval")
            ]:
                low, high = row[f"{column}_interval"]
                mine, size = other[name, selector][column], row[f"{column}_of"]
                cells += 1
                if not low <= mine <= high:
                    outside += 1
                    counts = f"{row[column] * size:.0f} of {size} before, {mine * size:.0f} now"
                    yield f"{name} {selector} {column}: {counts}, interval {low * size:.1f} to {high * size:.1f}"
        yield f"{bench}: {cells - outside} of {cells} cells within the 95 % intervals of {options.benches[0]}"


def fresh(options: Arguments) -> Iterator[str]:
    """The selectors that the benches learned, on rows that neither has seen: kept, refused,
    projected by fix-p.
    """
    for name in options.problems:
        with TemporaryDirectory() as folder:
            label(
                LabelPlan(
                    distribution=name, feasible=options.count, infeasible=options.count, seed=FRESH
                ),
                folder,
            )
            scenes = scenes_of(Dataset.open(folder))
        for file in sorted(
            {path.name for bench in options.benches for path in (bench / name).glob("*.*")}
        ):
            found = []
            for path in (bench / name / file for bench in options.benches):
                if (
                    path.suffix not in (".json", ".safetensors")
                    or ".row" in file
                    or not path.exists()
                ):
                    continue
                learned = load_selector(path)
                score = evaluate(file, learned, scenes, problem_class=name, projections=("fix-p",))
                shares = (score.p1_feasible, score.p1_infeasible, score.projected["fix-p"])
                found.append("/".join(str(share.hits) for share in shares))
            if found:
                yield f"{name} {file.split('.')[0]}: {', '.join(found)} of {options.count} each"


STUDIES: dict[str, Callable[[Arguments], Iterator[str]]] = {
    "same": same,
    "seeds": seeds,
    "table": table,
    "fresh": fresh,
}


def main(options: Arguments) -> None:
    """Print the study."""
    for line in STUDIES[options.study](options):
        print(line, flush=True)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
