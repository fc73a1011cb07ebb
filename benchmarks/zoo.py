"""The trained selectors that ship: made, or made again and compared with those that are here, bit
for bit.

    python benchmarks/zoo.py --write [--out out/zoo]     # into learners/zoo, with their cards
    python benchmarks/zoo.py [--out out/zoo]             # makes them, and says which bits differ
    python benchmarks/zoo.py --cards selectors           # a table of docs/cards.md, from the cards;
    --cards scorers: that of the scorers of leaps

They are the selectors of configs/zoo.yaml, `stancekit bench envelopes --config configs/zoo.yaml
--out out/zoo`, with their weights rounded to half precision, in which they are evaluated, too. A
run that was stopped goes on. Bits are the same with the versions that the cards name, on one kind
of CPU.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from _bench import ROOT, Options, launch, markdown
from torch import __version__ as torch_version

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import software
from stancekit.learners.data.executors import executor
from stancekit.learners.evaluation.evaluate import ClassResult, Experiment, Score, evaluate, run
from stancekit.learners.selectors.neural import NeuralSelector
from stancekit.learners.selectors.selector import Card, Figure, card, load_selector
from stancekit.learners.zoo import card_of, shipped
from stancekit.planners.files.writing import write_bytes, write_text

ZOO = ROOT / "learners" / "zoo"
LIMITS = (
    "Draws of one law of the default hexapod: one triangle a foot, friction of its class; refused for other classes.",
    "P1 over its boxes loses some feasible scenes and lets some infeasible ones through: projections are verified.",
    "Where the lift can be solved it finds what this finds, and more (docs/learning.md).",
)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What to do with them."""

    out: Path = Path("out/zoo")
    write: bool = False
    """Put them, with their cards, into learners/zoo."""
    problems: tuple[str, ...] = ()
    """Some classes alone."""
    cards: Literal["", "selectors", "scorers"] = ""
    """Print the table of these cards, and make nothing."""


def main(given: Arguments) -> None:
    """Make them; keep or compare."""
    if given.cards:
        print("\n".join(table() if given.cards == "selectors" else scorers()))
        return
    some = {"problems": list(given.problems)} if given.problems else {}
    experiment, differ = Experiment.from_yaml(ROOT / "configs" / "zoo.yaml", overrides=some), 0
    for result in run(experiment, given.out, executor=executor("processes", workers=1)):
        for method in experiment.methods:
            name = f"{method}-{result.problem_class}"
            path = given.out / result.problem_class / f"{name}.safetensors"
            rounded(given.out / result.problem_class / f"{method}.safetensors", path)
            content = path.read_bytes()
            if given.write:
                score = scored(path, result.test, experiment)
                known = described(method, content, result, experiment, score)
                write_bytes(ZOO / f"{name}.safetensors", content)
                write_text(ZOO / f"{name}.json", known.model_dump_json(indent=1) + "\n")
            same = (
                name in shipped("selectors") and shipped("selectors")[name].read_bytes() == content
            )
            differ += not same
            given.say({"selector": name, "bytes": len(content), "the same": same})
    sys.exit(int(differ > 0))


def rounded(path: Path, to: Path) -> None:
    """Write a selector with its weights in half precision."""
    NeuralSelector.load(path).save(to, half=True)


def scored(path: Path, test: Dataset, experiment: Experiment) -> Score:
    """What the file is good for, on the test rows."""
    scenes, projections = scenes_of(test), experiment.projections
    return evaluate(
        path.stem,
        load_selector(path),
        scenes,
        problem_class=test.problem_class,
        projections=projections,
    )


def described(
    method: str, content: bytes, result: ClassResult, experiment: Experiment, score: Score
) -> Card:
    """The card of a selector that was made."""
    calibration = experiment.calibration
    assert calibration is not None
    lift = next(each for each in result.scores if each.selector == "lift")
    return Card(
        method=method,
        problem_class=result.problem_class,
        legs=list(result.test.header.legs),
        sha256=hashlib.sha256(content).hexdigest(),
        seed=experiment.fit.seed,
        train=experiment.train,
        calibration=calibration,
        test=experiment.test,
        figures=figures(score),
        lift=figures(lift),
        limits=list(LIMITS),
        software=software() | {"torch": torch_version},
    )


def figures(score: Score) -> dict[str, Figure]:
    """Shares of a row with their intervals."""
    shares = {"p1_feasible": score.p1_feasible, "p1_infeasible": score.p1_infeasible}
    shares |= {f"project_{way.replace('-', '_')}": share for way, share in score.projected.items()}
    return {
        name: Figure(share=share.value, low=share.interval[0], high=share.interval[1])
        for name, share in shares.items()
    }


def table() -> Iterator[str]:
    """Markdown: a row a selector; % of the test rows with 95 % intervals, and the lift's in
    brackets.
    """
    yield "| name | rows to learn from | P1 feasible | P1 infeasible | fix-p | kB |"
    yield "|---|---|---|---|---|---|"
    for name, path in shipped("selectors").items():
        known = card(name)
        shown = [
            f"{100 * each.share:.1f} ± {50 * (each.high - each.low):.1f} (lift {100 * known.lift[key].share:.1f})"
            for key, each in known.figures.items()
        ]
        rows = f"{known.train.feasible} + {known.train.infeasible}"
        yield f"| `{name}` | {rows} | {' | '.join(shown)} | {path.stat().st_size // 1000} |"


def scorers() -> Iterator[str]:
    """Markdown: a row a scorer of leaps and budget; % of the test scenes, and what it gains [points]."""
    rows = [
        (
            f"`{name}`",
            figure["budget"],
            *(f"{100 * p:.1f} [{100 * low:.1f}, {100 * high:.1f}]" for p, low, high in shares),
            "{:+.1f} [{:+.1f}, {:+.1f}]".format(*figure["gain"]),
        )
        for name, path in shipped("scorers").items()
        for figure in card_of(path)["figures"]
        for shares in ((figure["learned"], figure["control"]),)
    ]
    return markdown(("name", "budget", "solved", "control", "difference"), rows)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
