"""Films beside the streams of the runs that they show: how far they differ, sample by sample.

    python benchmarks/seen_is_run.py FILE... [--rate-hz 100]

FILE: plans and walks that the verifier accepts, whose robots have legs. Each is run in MuJoCo, and
each picture of its film is compared with what was sent at that time: body, feet, forces, footholds,
joints, and where the picture draws the links. Films are drawn from 100 rows per second; a run at
another rate sends nearly the same. Feet feel nothing here: those that do wait for the ground and
press anew, which no plan knows before.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from _bench import ROOT, Options, launch

sys.path.insert(0, str(ROOT))
from stancekit.planners.formats.motion_file import read_motion
from tests.same_motion import compared


@dataclass(frozen=True, kw_only=True)
class SeenIsRun(Options):
    """Compare films with streams."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    rate_hz: float = 100.0
    """Rows that the run streams per second."""


def main(options: SeenIsRun) -> None:
    """Print a row per file."""
    for path in options.files:
        found = compared(read_motion(path)[0], options.rate_hz)
        options.say({"file": path.name, "samples": found.looked, **found.differs}, said)


def said(row: dict[str, Any]) -> str:
    """A row for people."""
    values = {
        name: f"{value:.3g}" if isinstance(value, float) else value for name, value in row.items()
    }
    return "  ".join(f"{name} {value}" for name, value in values.items())


if __name__ == "__main__":
    launch(main, SeenIsRun, __doc__)
