"""Forged files by somebody who had not read the verifier: how many of them does `stancekit verify`
accept?

python benchmarks/forgeries_outside.py                              # robots without files python
benchmarks/forgeries_outside.py --robot go1.urdf --json      # and one of a URDF: torques, legs,
masses

Honest files come from the commands that write them. A kind changes one in some way, 20 sizes from
gross to barely more than what a judge of its own calls impossible, and computes every digest anew.
The judge (numpy and pinocchio) says why a robot cannot do it before the verifier is asked; where it
has nothing to say the file does not count. Accepted is an exit code of 0.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import Options, launch
from _outside_answers import ANSWERS, Pairs
from _outside_files import NoForgery, opened, ran
from _outside_plans import CLIMBS, STEPS
from _outside_walks import LEGGED, WALKS

STEP = """
name: step
frames: 4
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.1, 0.0, 0.36]
stride_m: 0.04
stance: {outward_m: 0.0, down_m: 0.0}
terrain: {kind: flat, friction: 0.8}
"""
Forge = Callable[[np.random.Generator, float, Path], tuple[tuple[Path, ...], str]]


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How many, and of which robot."""

    count: int = 20
    """Sizes a kind."""
    robot: Path | None = None
    """A URDF with legs whose calves bend as Go1's do; without it kinds that need one are left
    out."""
    only: str = ""
    """Kinds whose name holds this."""


def kinds(options: Arguments, folder: Path) -> Iterator[tuple[str, Forge]]:
    """Every kind by its name, and what forges a file of it."""
    climb, ripple = folder / "climb.json", folder / "walk.json"
    _written("plan", "walls", "--out", climb)
    _written("gait", "ripple", "--goal", "2,0", "--out", ripple)
    sources = [("climb", climb, CLIMBS), ("walk", ripple, WALKS)]
    if options.robot is not None:
        course, step, legged = folder / "step.yaml", folder / "step.json", folder / "legged.json"
        course.write_text(STEP)
        _written("plan", course, "--robot", options.robot, "--out", step)
        _written("gait", "ripple", "--goal", "1,0", "--robot", options.robot, "--out", legged)
        sources += [("step", step, STEPS), ("legged walk", legged, LEGGED)]
    for of, source, those in sources:
        for kind in those:
            yield (
                f"{of}: {kind.__name__}",
                lambda rng, size, at, kind=kind, source=source: _one(  # type: ignore[misc]
                    kind, source, rng, size, at
                ),
            )
    pairs = _pairs(folder)
    for kind in ANSWERS:
        yield (
            f"answer: {kind.__name__}",
            lambda rng, size, at, kind=kind: _two(kind, pairs, rng, size, at),
        )  # type: ignore[misc]


def main(options: Arguments) -> None:
    """Forge, ask, count."""
    total = accepted = shown = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, forge in kinds(options, folder):
            if options.only not in kind:
                continue
            rng, said, taken, made = np.random.default_rng(options.seed), "", 0, 0
            for size in np.geomspace(1.0, 1e-3, options.count):
                try:
                    paths, why = forge(rng, float(size), folder)
                except NoForgery:
                    continue
                code, text = ran("verify", *paths)
                made, taken = made + 1, taken + (code == 0)
                said = (
                    said or f"{why}  |  {text.splitlines()[0].replace(str(folder) + '/', '')[:160]}"
                )
                if code not in (0, 1, 2):
                    said = f"exit code {code}: {text[:160]}"
            total, accepted, shown = total + made, accepted + taken, shown + (made > 0)
            options.say({"kind": kind, "files": made, "accepted": taken, "first": said}, _line)
    options.say({"kinds": shown, "files": total, "accepted": accepted})


def _line(row: dict[str, object]) -> str:
    return (
        f"{row['kind']:24} {row['files']:>3} files  {row['accepted']:>3} accepted  {row['first']}"
    )


def _one(kind, source, rng, size, folder):  # type: ignore[no-untyped-def]
    forged = opened(source)
    why = kind(forged, size, rng)
    path = folder / "forged.json"
    path.write_text(forged.sealed())
    return (path,), why


def _two(kind, pairs, rng, size, folder):  # type: ignore[no-untyped-def]
    problem, answer, why = kind(pairs[int(rng.integers(len(pairs)))], size, rng)
    paths = folder / "problem.jsonl", folder / "answer.jsonl"
    for path, text in zip(paths, (problem, answer), strict=True):
        path.write_text(text + "\n")
    return paths, why


def _pairs(folder: Path) -> list[Pairs]:
    """Feasible and infeasible problems in turns, with their answers."""
    problems, answers = folder / "problems.jsonl", folder / "answers.jsonl"
    _written("sample", "wall-3", "--count", "120", "--seed", "5", "--out", problems)
    _written("solve", problems, "--certificate", "--out", answers)
    both = [
        [json.loads(line) for line in path.read_text().splitlines()] for path in (problems, answers)
    ]
    said = list(zip(*both, strict=True))
    yes = [pair for pair in said if pair[1]["status"] == "feasible"]
    no = sorted(
        (pair for pair in said if pair[1]["status"] == "infeasible"),
        key=lambda pair: -len(pair[1]["certificate"]["tree"]),
    )
    return [
        Pairs(problem=a[0], answer=a[1], refuted=b[0], proof=b[1])
        for a, b in zip(yes, no, strict=False)
    ]


def _written(*words: str | Path) -> None:
    code, said = ran(*words)
    if code:
        raise SystemExit(f"{' '.join(map(str, words))}: {said}")


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
