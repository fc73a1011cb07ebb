"""How much of every limit walks need: the largest share a group, of the walk files that are named.

    python benchmarks/verifier_room.py walk.json … [--markdown] [--json]

Only walks that the verifier accepts count; those that it refuses are named with their groups. No
walk is planned here.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from _bench import Options, launch

from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.verify.trajectories import GROUPS, check_trajectory


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Walks to judge."""

    walks: Annotated[tuple[Path, ...], tyro.conf.Positional]


def main(asked: Asked) -> None:
    """Verify and print."""
    worst = dict.fromkeys(GROUPS, (0.0, ""))
    for path in asked.walks:
        report = check_trajectory(read_motion(path)[0])
        if not report.accepted:
            print(f"{path}: {report.message}", file=sys.stderr)
            continue
        for group in report.groups:
            share = group.value / group.limit if group.limit > 1e-6 else 0.0
            worst[group.name] = max(worst[group.name], (share, str(path)))
    for name, (share, walk) in worst.items():
        asked.say(
            {"group": name, "share": round(share, 3), "walk": walk},
            lambda row: f"{row['group']:20} {row['share']:6.3f} {row['walk']}",
        )


if __name__ == "__main__":
    launch(main, Asked, __doc__)
