"""How far data travels: the files, functions, own types and objects that four trips run through.

    python benchmarks/trips.py [--against v0.1.0]

The trips are a plan of eight key frames on walls, a run of it, a gait, and one step of an
environment. Functions count that are called, not what is imported; a type counts where an object of
a dataclass of the package is made. The figures follow from the code alone.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from _bench import Options, Row, launch
from _checkouts import ROOT, checkout, of_checkout

TRIPS = {
    "plan": "plan walls --frames 8 --out plan.json",
    "step": "step",
    "run": "run plan.json",
    "gait": "gait ripple --goal 1.5,1 --out gait.json",
}
"""The words of every trip; a run is of the plan before it."""
FIGURES = ("files", "functions", "types", "objects")


@dataclass(frozen=True, kw_only=True)
class Trips(Options):
    """Options of the table."""

    against: str = ""
    """Another checkout, a folder with its links made or a commit, whose figures stand first."""


def line(row: Row) -> str:
    """A row for people."""
    columns = (f"{name} {' → '.join(map(str, row[name])):>14}" for name in FIGURES)
    return f"{row['trip']:5}  {'  '.join(columns)}"


def figures(root: Path) -> dict[str, dict[str, int]]:
    """The figures of every trip in a checkout."""
    found = {}
    with TemporaryDirectory() as folder:
        for name, words in TRIPS.items():
            done = subprocess.run(
                [sys.executable, Path(__file__).with_name("_trip.py"), *words.split()],
                env=of_checkout(root) | {"PYTHONHASHSEED": "0"},
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode:
                sys.exit(f"{root}: {words}: {done.stderr[-2000:]}")
            found[name] = json.loads(done.stderr.splitlines()[-1])
    return found


def main(asked: Trips) -> None:
    """Print a row a trip."""
    with ExitStack() as opened:
        roots = [opened.enter_context(checkout(asked.against))] if asked.against else []
        tables = [figures(root) for root in (*roots, ROOT)]
    for trip in TRIPS:
        columns = {name: [table[trip][name] for table in tables] for name in FIGURES}
        asked.say({"trip": trip, **columns}, line)


if __name__ == "__main__":
    launch(main, Trips, __doc__)
