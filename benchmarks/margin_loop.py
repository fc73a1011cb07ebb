"""The training loop of docs/learning.md, on the rows of a class: what P1's margin as a layer of
torch reaches.

    python benchmarks/margin_loop.py [--problem wall-3] [--rows 2000] [--steps 800] [--folder
    out/margin-loop]

The loop is read from the page and run as it stands there. Its network is calibrated as the neural
selector of the same rows is, and rolled out beside it (`stancekit fit --method neural`) and the
quantile box, on rows that none has seen.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from _bench import ROOT, Options, launch
from neural import Arguments as Neural, cell, data

from stancekit.envs.data.dataset import scenes_of
from stancekit.learners.evaluation.evaluate import Score, evaluate
from stancekit.learners.selectors.neural import (
    NeuralSelector,
    NeuralSettings,
    TrainingRows,
    calibrated_room,
    fit_neural,
)
from stancekit.learners.selectors.selector import FixedSelector, Learned
from stancekit.learners.training.fitting import fit
from stancekit.planners.equilibrium.programs import Programs

BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which rows, and how many steps."""

    problem: str = "wall-3"
    rows: int = 2000
    """Training rows of each label."""
    held: int = 500
    """Calibration rows of each label."""
    test: int = 600
    """Test rows of each label."""
    steps: int = 800
    folder: Path = Path("out/margin-loop")


def main(given: Arguments) -> None:
    """Train, calibrate, roll out."""
    options = Neural(folder=given.folder)
    train, held, test = (
        data(given.problem, part, rows, rows, given.seed + offset, options)
        for part, rows, offset in (
            ("train", given.rows, 1003),
            ("held", given.held, 1002),
            ("test", given.test, 1001),
        )
    )
    scenes, settings = scenes_of(test), NeuralSettings(seed=given.seed)

    def say(name: str, selector: Any, begin: float) -> None:
        seconds = time.process_time() - begin
        learned = Learned.of(selector, name, given.problem)
        score = evaluate(name, learned, scenes, problem_class=given.problem, projections=("fix-p",))
        given.say(row(score, seconds))

    begin = time.process_time()
    say("quantile", FixedSelector("quantile", fit("quantile", train)), begin)
    begin = time.process_time()
    say("neural", fit_neural(train, settings, calibration=held), begin)
    begin = time.process_time()
    torch.manual_seed(given.seed)
    torch.set_num_threads(1)
    feasible, infeasible = (TrainingRows.of(train, label) for label in ("feasible", "infeasible"))
    network = loop()(feasible, infeasible, given.steps).eval()
    room = calibrated_room(network, TrainingRows.of(held, "feasible"), Programs(), settings)
    like = feasible.problems[0]
    say(
        "the page's loop",
        NeuralSelector(
            network,
            problem_class=given.problem,
            legs=train.header.legs,
            force_scale_n=like.force_n,
            length_scale_m=like.length_m,
            room=room,
        ),
        begin,
    )


def loop() -> Callable[[TrainingRows, TrainingRows, int], Any]:
    """``learned`` of the page."""
    (code,) = (
        text
        for text in BLOCK.findall((ROOT / "docs" / "learning.md").read_text())
        if "def learned" in text
    )
    names: dict[str, Any] = {}
    exec(compile(code.partition("# try it")[0], "docs/learning.md", "exec"), names)
    found: Callable[[TrainingRows, TrainingRows, int], Any] = names["learned"]
    return found


def row(score: Score, seconds: float) -> dict[str, Any]:
    """Shares in per cent with their intervals, and CPU time."""
    shares = (score.p1_feasible, score.p1_infeasible, score.projected["fix-p"])
    names = ("P1 feasible", "P1 infeasible", "fix-p")
    return {
        "selector": score.selector,
        **dict(zip(names, map(cell, shares), strict=True)),
        "CPU-s": round(seconds, 1),
    }


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
