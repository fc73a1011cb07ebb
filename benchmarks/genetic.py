"""The genetic algorithm made fast.

    python benchmarks/genetic.py [--problem wall-3] [--population 40] [--generations 45] [--terrains
    100]
                                 [--rows 500] [--held-out 500] [--delta 0.1] [--seed 0] [--json]

Labels two data sets (``rows`` and ``held-out`` of each label). The plain loop, which solves
P1 for every box and problem, then the same run with cached witnesses and certificates: both must
end with the same box. "right" is the share of held-out problems that P1 answers as the expert.
Times are wall clock and processor seconds of one process on one thread, without labelling and
compiling.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from _bench import Options, launch
from numpy.typing import NDArray

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data.labelling import label
from stancekit.learners.selectors.feasibility import (
    CachingOracle,
    FeasibilityOracle,
    VerdictCounts,
)
from stancekit.learners.selectors.genetic import Generation, GeneticSettings, evolve
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import FEASIBLE_MARGIN, Envelope
from stancekit.planners.relaxation.mccormick import McCormick

Problems = tuple[list[Scaled], list[Scaled], Array]
PLAIN, CACHED = "GA, plain loop", "GA, cached"


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which problems, and how long the searches are."""

    problem: str = "wall-3"
    population: int = 40
    generations: int = 45
    terrains: int = 100
    rows: int = 500
    held_out: int = 500
    delta: float = 0.1


class Plain:
    """Solves P1 of every problem over every box."""

    def __init__(self, problems: list[Scaled], programs: Programs) -> None:
        self.counts, self._problems = VerdictCounts(), problems
        self._p1 = programs.get(McCormick, problems[0].layout)

    def is_feasible(self, which: NDArray[np.int_], boxes: Sequence[Envelope]) -> NDArray[np.bool_]:
        """Tell for every box and every problem of these indices, shape (boxes, indices)."""
        asked = [[self._p1.solve(self._problems[k], box).margin for k in which] for box in boxes]
        self.counts = VerdictCounts(solved=self.counts.solved + len(boxes) * len(which))
        return np.array(asked) <= FEASIBLE_MARGIN


def main(arguments: Arguments) -> None:
    """Measure and print."""
    settings = GeneticSettings(
        population=arguments.population,
        generations=arguments.generations,
        terrains=arguments.terrains,
        delta=arguments.delta,
        seed=arguments.seed,
    )
    runs = measure(
        labelled(arguments.problem, arguments.rows, seed=2 * arguments.seed),
        labelled(arguments.problem, arguments.held_out, seed=2 * arguments.seed + 1),
        settings,
    )
    if arguments.json:
        arguments.say({"problem": arguments.problem, "settings": asdict(settings), "runs": runs})
    else:
        show(runs)


def labelled(problem: str, rows: int, seed: int) -> Problems:
    """Feasible and infeasible problems, this many of each, and S."""
    with tempfile.TemporaryDirectory() as folder:
        label(LabelPlan(distribution=problem, feasible=rows, infeasible=rows, seed=seed), folder)
        dataset = Dataset.open(folder)
        feasible, infeasible = (
            [Scaled.of(found) for found in dataset.select(chosen).problems()]
            for chosen in (dataset.feasible, dataset.infeasible)
        )
        return feasible, infeasible, dataset.points


def measure(
    train: Problems, test: Problems, settings: GeneticSettings
) -> dict[str, dict[str, Any]]:
    """Figures of both runs, by name."""
    feasible, infeasible, points = train
    problems = [*feasible, *infeasible]
    programs = Programs()
    held_out = Plain([*test[0], *test[1]], programs)

    def run(oracle: FeasibilityOracle) -> dict[str, Any]:
        begin, cpu = time.perf_counter(), time.process_time()
        result = evolve(feasible, infeasible, points, settings, oracle=oracle)
        spent = {"wall_s": time.perf_counter() - begin, "cpu_s": time.process_time() - cpu}
        admitted = held_out.is_feasible(np.arange(len(test[0]) + len(test[1])), [result.envelope])[
            0
        ]
        return {
            **spent,
            "evaluations": result.counts.total,
            **shares(result.counts),
            "train_a": result.a,
            "train_b": result.b,
            "feasible_right": float(admitted[: len(test[0])].mean()),
            "infeasible_right": float(1.0 - admitted[len(test[0]) :].mean()),
            "box": result.envelope.to_vector().tolist(),
            "thirds": thirds(result.history),
            "mean_fitness": [done.mean for done in result.history],
            "best_fitness": [done.best for done in result.history],
        }

    plain = run(Plain(problems, programs))
    cached = run(CachingOracle(problems, programs))
    compared = {
        "same_box": plain["box"] == cached["box"],
        "speedup_wall": plain["wall_s"] / cached["wall_s"],
        "speedup_cpu": plain["cpu_s"] / cached["cpu_s"],
    }
    return {PLAIN: plain, CACHED: cached | compared}


def shares(counts: VerdictCounts) -> dict[str, float]:
    """Shares of the evaluations that needed no solve, in all and by what answered them."""
    kinds = "cached", "witness", "certificate", "range", "trivial"
    return {name: getattr(counts, name) / max(counts.total, 1) for name in kinds}


def thirds(history: tuple[Generation, ...]) -> list[dict[str, float]]:
    """``shares`` of the first, second and last third of the generations."""
    parts = np.array_split(np.arange(len(history)), 3)
    return [
        shares(
            VerdictCounts(
                **{
                    name: sum(getattr(history[int(k)].counts, name) for k in part)
                    for name in asdict(VerdictCounts())
                }
            )
        )
        for part in parts
    ]


def show(runs: dict[str, dict[str, Any]]) -> None:
    """Print for people."""
    print(
        f"{'':16}{'wall s':>8}{'CPU s':>8}{'evaluations':>13}{'cached':>9}{'a':>7}{'b':>7}{'right: feas.':>14}"
        f"{'infeas.':>9}"
    )
    for name, r in runs.items():
        print(
            f"{name:16}{r['wall_s']:8.1f}{r['cpu_s']:8.1f}{r['evaluations']:13d}{r['cached']:9.1%}{r['train_a']:7.3f}"
            f"{r['train_b']:7.3f}{r['feasible_right']:14.1%}{r['infeasible_right']:9.1%}"
        )
    cached = runs[CACHED]
    print(
        f"same best box: {cached['same_box']}; plain / cached: {cached['speedup_wall']:.2f} wall, "
        f"{cached['speedup_cpu']:.2f} CPU"
    )
    print("GA, cached: share of the evaluations without a solve, by thirds of the generations")
    for kind in ("cached", "witness", "certificate", "range", "trivial"):
        print(f"  {kind:12}" + "".join(f"{third[kind]:9.1%}" for third in cached["thirds"]))


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
