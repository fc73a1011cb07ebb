"""What a user waits for: whole commands of this checkout against another's, a release's or a
commit's.

    git worktree add ../before v0.1.0; (cd ../before && python setup.py links)
    python benchmarks/commands.py --against ../before [--pairs 15] [--only plan gait]
        [--out out/commands]

The two take turns, the first of each pair by lot; a cell is the CPU time [s] of a process and all
that it starts, imports and model building included, and the ratio is after by before of a pair.
What commands read was written by the same checkout's own commands before. A yardstick, cold solves
of one cone program in which nothing is ours, is timed before and after. Cells are kept: a run that
is stopped goes on with the next one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from _bench import Options, Row, kept, launch, spread
from _checkouts import checkouts, of_checkout
from _yardstick import yardstick

MAKE = (
    "sample wall-3 --count 200 > postures.jsonl",
    "solve postures.jsonl --certificate --out answers.jsonl",
    "plan stairs --out climb.json",
    "plan walls --frames 30 --out walls.json",
    "label wall-3 rows --feasible 100 --infeasible 100",
    "label wall-3 test --feasible 100 --infeasible 100 --seed 1",
    "fit rows --method quantile --out box.json",
)
"""What is there before anything is timed."""
COMMANDS = {
    "help": "--help",
    "help of plan": "plan --help",
    "sample": "sample wall-3 --count 200",
    "solve": "solve postures.jsonl --certificate",
    "verify": "verify postures.jsonl answers.jsonl",
    "label": "label wall-3 again --feasible 100 --infeasible 100",
    "evaluate": "evaluate test --selector box.json",
    "check plan": "verify walls.json",
    "plan stairs": "plan stairs --out again.json",
    "plan walls 30": "plan walls --frames 30 --out again.json",
    "plan stairs 30": "plan stairs --frames 30 --out again.json",
    "plan icy-walls 30": "plan icy-walls --frames 30 --out again.json",
    "plan walls 127": "plan walls --frames 127 --out again.json",
    "plan icy-walls": "plan icy-walls --out again.json",
    "simulate": "simulate climb.json",
    "run": "run climb.json",
    "gait ripple": "gait ripple --goal 2,0 --out again.json",
    "gait cone": "gait cone --goal 2,0 --out again.json",
    "gait pit": "gait pit --goal 2.6,0 --adhesive LF,RF --robot anymal-boxes --out again.json",
}
"""The commands, by their names in the table; ``again`` is theirs to write."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Against what, and how often."""

    against: Path
    pairs: int = 15
    only: tuple[str, ...] = ()
    """Some of the commands, by the first words of their names."""
    out: Path = Path("out/commands")


def main(arguments: Arguments) -> None:
    """Prepare both, run the pairs, print the table."""
    out, sides = arguments.out.resolve(), checkouts(arguments.against)
    for name, folder in sides.items():
        prepare(folder, out / name)
    rng, begin = np.random.default_rng(arguments.seed), yardstick()
    for name, command in COMMANDS.items():
        if arguments.only and not name.startswith(arguments.only):
            continue
        cells: dict[str, list[Row]] = {side: [] for side in sides}
        for pair in range(arguments.pairs):
            for side in rng.permutation(list(sides)).tolist():
                path = out / "cells" / f"{name.replace(' ', '-')}-{pair}-{side}.json"
                measure = partial(timed, command, sides[side], out / side)
                cells[side].append(kept(path, measure))
        arguments.say(row_of(name, cells), shown)
    arguments.say({"yardstick, CPU-s before and after": f"{begin:.2f}, {yardstick():.2f}"})


def prepare(checkout: Path, folder: Path) -> None:
    """Files for the commands to read, once."""
    if (folder / "made").exists():
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for line in MAKE:
        command, _, target = line.partition(" > ")
        with open(folder / (target or os.devnull), "wb") as output:
            subprocess.run(
                called(command), cwd=folder, env=of_checkout(checkout), stdout=output, check=True
            )
    (folder / "made").touch()


def called(command: str) -> list[str]:
    """The command line of a verb."""
    return [sys.executable, "-m", "stancekit.cli.main", *command.split()]


def timed(command: str, checkout: Path, folder: Path) -> Row:
    """CPU time of a command and of all that it starts, and how it ended."""
    for left in (folder / "again", folder / "again.json"):
        shutil.rmtree(left, ignore_errors=True) if left.is_dir() else left.unlink(missing_ok=True)
    with subprocess.Popen(
        called(command),
        cwd=folder,
        env=of_checkout(checkout),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return {"cpu_s": used.ru_utime + used.ru_stime, "code": process.returncode}


def row_of(name: str, cells: dict[str, list[Row]]) -> Row:
    """Medians of both, and the ratios of the pairs."""
    times = {side: np.array([cell["cpu_s"] for cell in found]) for side, found in cells.items()}
    codes = {side: sorted({cell["code"] for cell in found}) for side, found in cells.items()}
    medians = {f"{side}_s": float(np.median(each)) for side, each in times.items()}
    ratios = times["after"] / times["before"]
    return {
        "command": name,
        **medians,
        "ratio": float(np.median(ratios)),
        "ratios": spread(ratios),
        "codes": codes,
    }


def shown(row: Row) -> str:
    """A row for people."""
    codes = (
        ""
        if row["codes"]["before"] == row["codes"]["after"] == [0]
        else f"  exit codes {row['codes']}"
    )
    return f"{row['command']:16} {row['before_s']:8.3f} {row['after_s']:8.3f} CPU-s   × {row['ratios']}{codes}"


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
