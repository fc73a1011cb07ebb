"""Do learned boxes for each terrain beat one box for all? Neural selectors, and sets of boxes.

python benchmarks/neural.py --problems wall-3 --rows 10000 --json
python benchmarks/neural.py --quick

Three data sets a class, from three seeds: one to train on, one to calibrate on, one to test on,
which nothing has seen before. Every selector is rolled out by ``learners.evaluation.evaluate``;
shares come with Wilson 95 % intervals. quantile, gradient-K: one or K boxes for all terrains, P1
taking the best of K. neural-quantile: the network's own box for each terrain, after its first stage
alone. neural: after both. With ``--quick`` everything is small, and so are the figures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from _bench import Options, launch
from rich.console import Console
from rich.table import Table

from stancekit.cli.console import progress
from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.scenes import LabelledScene
from stancekit.learners.data.labelling import label
from stancekit.learners.evaluation.evaluate import TABLE_I, Score, Share, evaluate, evaluate_lift
from stancekit.learners.selectors.genetic import fit_gradient
from stancekit.learners.selectors.neural import NeuralSettings, fit_neural
from stancekit.learners.selectors.selector import Learned
from stancekit.learners.training.fitting import fit
from stancekit.planners.projection.project import Projection
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.runner.control.envelope_choice import Predictor

PROJECTIONS: tuple[Projection, ...] = ("fix-p", "fix-toes", "scp")


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How much data, and which selectors."""

    problems: tuple[str, ...] = ("wall-3", "wall-5", "ground-3")
    """Distributions."""
    rows: int = 10_000
    """Feasible training rows; three tenths as many infeasible ones."""
    held: int = 1000
    """Calibration rows of each label."""
    test: int = 600
    """Test rows of each label."""
    epochs: int = 20
    """Of quantile regression."""
    margin_epochs: int = 4
    """Through P1's margins."""
    boxes: tuple[int, ...] = (1, 3)
    """Sizes of the sets of boxes; none leaves them out."""
    box_rows: int = 1000
    """Training rows of each label that sets of boxes use."""
    steps: int = 80
    """Of the boxes' descent."""
    ablate: bool = True
    """Train a network without the second stage, too."""
    lift: bool = True
    """Compare with the lift."""
    seed: int = 0
    """Of the training; the data sets to test, calibrate and train on have the seeds 1001, 1002 and
    1003 above it."""
    workers: int = 1
    """Processes that label."""
    folder: Path = Path("out/neural")
    """Where data sets, checkpoints and selectors are kept; what is there is gone on from."""
    quick: bool = False
    """A few hundred rows and epochs: does it run?"""


def small(options: Arguments) -> Arguments:
    """The same in a minute or so."""
    return replace(
        options, rows=600, held=150, test=150, epochs=15, margin_epochs=2, box_rows=150, steps=20
    )


def main(options: Arguments) -> None:
    """Train and evaluate everything on every class."""
    options = small(options) if options.quick else options
    console = Console(soft_wrap=True)
    console.width = max(console.width, 130)
    for problem in options.problems:
        scores = []
        for score in compare(problem, options):
            scores.append(score)
            if options.json:
                options.say({"problem": problem, **score.to_json()})
        if not options.json:
            console.print(table_of(problem, scores))


def compare(problem: str, options: Arguments) -> Iterator[Score]:
    """Score every selector on one class."""
    train = data(
        problem, "train", options.rows, (3 * options.rows) // 10, options.seed + 1003, options
    )
    held = data(problem, "calibration", options.held, options.held, options.seed + 1002, options)
    scenes = scenes_of(
        data(problem, "test", options.test, options.test, options.seed + 1001, options)
    )
    rows = options.box_rows
    few = train.select([*train.feasible[:rows], *train.infeasible[:rows]])

    def scored(name: str, begin: float, selector: Predictor | EnvelopeSet) -> Score:
        seconds = time.perf_counter() - begin
        return judged(name, Learned.of(selector, name, problem), scenes, problem, seconds)

    begin = time.perf_counter()
    yield scored("quantile", begin, fit("quantile", few))
    for count in options.boxes:
        begin = time.perf_counter()
        with progress(f"{problem} gradient-{count}") as bar:
            found = fit_gradient(
                few, boxes=count, steps=options.steps, seed=options.seed, progress=bar
            )
        yield scored(f"gradient-{count}", begin, found)
    ways: dict[str, tuple[int, str]] = {
        "neural-quantile": (0, "p1"),
        "neural": (options.margin_epochs, "p1"),
        "joint": (options.margin_epochs, "joint"),
    }
    for name, (margin_epochs, relaxation) in list(ways.items())[0 if options.ablate else 1 :]:
        begin = time.perf_counter()
        settings = NeuralSettings(
            epochs=options.epochs,
            margin_epochs=margin_epochs,
            relaxation=relaxation,
            seed=options.seed,
        )
        with progress(f"{problem} {name}") as bar:
            selector = fit_neural(train, settings, bar, calibration=held)
        selector.save(options.folder / f"{problem}-{name}.safetensors")
        yield scored(name, begin, selector)
    if options.lift:
        yield replace(evaluate_lift(scenes, projections=PROJECTIONS), notes={"train_seconds": 0.0})


def table_of(problem: str, scores: list[Score]) -> Table:
    """Shares in per cent with their intervals, and the paper's below."""
    table = Table(
        "selector",
        "P1 feasible",
        "P1 infeasible",
        *PROJECTIONS,
        "trained [s]",
        title=f"{problem} [%]",
    )
    for score in scores:
        shares = (
            score.p1_feasible,
            score.p1_infeasible,
            *(score.projected[way] for way in PROJECTIONS),
        )
        table.add_row(score.selector, *map(cell, shares), f"{score.notes['train_seconds']:.0f}")
    for name, (feasible, infeasible, fix_p, _) in TABLE_I.get(problem, {}).items():
        table.add_row(
            f"paper: {name}", *(f"{100.0 * share:.1f}" for share in (feasible, infeasible, fix_p))
        )
    return table


def cell(share: Share) -> str:
    """A share with its interval."""
    low, high = share.interval
    return f"{100.0 * share.value:.1f} ({100.0 * low:.1f}–{100.0 * high:.1f})"


def judged(
    name: str, learned: Learned, scenes: list[LabelledScene], problem: str, seconds: float
) -> Score:
    """Roll a selector out."""
    with progress(f"{problem} evaluate {name}") as bar:
        score = evaluate(
            name, learned, scenes, problem_class=problem, projections=PROJECTIONS, progress=bar
        )
    return replace(score, notes={"train_seconds": seconds})


def data(
    problem: str, part: str, feasible: int, infeasible: int, seed: int, options: Arguments
) -> Dataset:
    """Label a data set, or what is missing of it."""
    folder = options.folder / f"{problem}-{part}-{feasible}-{infeasible}-{seed}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    plan = LabelPlan(
        distribution=problem, feasible=feasible, infeasible=infeasible, seed=seed, shard_size=500
    )
    with progress(f"{problem} {part}") as bar:
        label(plan, folder, workers=options.workers, progress=counted(bar, plan.rows))
    return Dataset.open(folder)


def counted(bar: Callable[[int, int], None], rows: int) -> Callable[..., None]:
    """Labelling's progress on a bar."""
    return lambda state: bar(state.rows, rows)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
