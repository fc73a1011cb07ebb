"""How long ``stancekit.solve`` takes on hard, balanced postures, against another checkout.

    python benchmarks/solves.py --against ../before --classes wall-3 ground-3 wall-5 --count 100

Half of the postures have a witness and half a certificate; those whose convex part alone is
infeasible are left out. Each checkout draws them itself from the seed and solves them in a process
of its own, one call after the other, after a first call that counts for nothing. The checkouts take
turns in pairs. Times are CPU times of the process.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, checkouts, launch, of_checkout, spread
from _yardstick import yardstick

import stancekit
from stancekit.planners.answer.answer import Status

DRAWN = 20
"""Postures drawn at once, for each that is wanted; most are easy."""
ASK = """
import json, sys, time
import stancekit
name, seed, drawn, chosen = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), json.loads(sys.argv[4])
problems = stancekit.sample(name, drawn, rng=seed)
stancekit.solve(problems[chosen[0]])
times, answers = [], []
for k in chosen:
    begin = time.process_time()
    answer = stancekit.solve(problems[k])
    times.append(1e3 * (time.process_time() - begin))
    answers.append(answer.status.value)
print(json.dumps([times, answers]))
"""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which postures, and against what."""

    against: Path
    classes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="CLASS ...")] = (
        "wall-3",
        "ground-3",
        "wall-5",
    )
    count: int = 100
    """Postures of each class, half of them feasible."""
    pairs: int = 15


def main(arguments: Arguments) -> None:
    """Print a row per class, and the yardstick before and after."""
    sides, begin = checkouts(arguments.against), yardstick()
    for name in arguments.classes:
        drawn = DRAWN * arguments.count
        chosen = hard_indices(name, arguments.seed, drawn, arguments.count)
        times: dict[str, list[np.ndarray[Any, Any]]] = {side: [] for side in sides}
        answers = set[str]()
        for pair in range(arguments.pairs):
            for side in list(sides)[:: 1 if pair % 2 else -1]:
                ms, said = asked(sides[side], name, arguments.seed, drawn, chosen)
                times[side].append(np.array(ms))
                answers.add(json.dumps(said))
        ratios = [
            np.median(a) / np.median(b) for a, b in zip(*reversed(times.values()), strict=True)
        ]
        arguments.say(
            {
                "class": name,
                "postures": len(chosen),
                "answers_equal": len(answers) == 1,
                **{f"{side}_ms": _figures(found) for side, found in times.items()},
                "ratio": spread(ratios),
            },
            lambda row: "  ".join(f"{key} {value}" for key, value in row.items()),
        )
    arguments.say({"yardstick, CPU-s before and after": f"{begin:.2f}, {yardstick():.2f}"})


def hard_indices(name: str, seed: int, drawn: int, count: int) -> list[int]:
    """Indices of hard postures among those drawn, as many feasible as infeasible ones."""
    room = {Status.FEASIBLE: count - count // 2, Status.INFEASIBLE: count // 2}
    chosen = list[int]()
    for k, problem in enumerate(stancekit.sample(name, drawn, rng=seed)):
        if not any(room.values()):
            break
        outcome = stancekit.solve(problem)
        if outcome.details["trivial"] or not room.get(outcome.status):
            continue
        room[outcome.status] -= 1
        chosen.append(k)
    return chosen


def asked(
    checkout: Path, name: str, seed: int, drawn: int, chosen: Sequence[int]
) -> tuple[list[float], list[str]]:
    """Time of every call [ms], and what was answered, by a process of a checkout."""
    command = [sys.executable, "-c", ASK, name, str(seed), str(drawn), json.dumps(chosen)]
    done = subprocess.run(command, env=of_checkout(checkout), stdout=subprocess.PIPE, check=True)
    times, answers = json.loads(done.stdout)
    return times, answers


def _figures(times: Sequence[np.ndarray[Any, Any]]) -> str:
    pooled = np.concatenate(times)
    return f"{np.median(pooled):.2f} (p99 {np.quantile(pooled, 0.99):.1f})"


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
