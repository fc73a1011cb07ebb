"""How much of every limit walks need: the largest share a group, of the walk files that are named.

``python benchmarks/verifier_room.py walk.json …``. Only walks that the verifier accepts count;
those that it refuses are named with their groups. No walk is planned here.
"""

from __future__ import annotations

import sys

from stancekit.planners.formats.trajectory_file import read_trajectory
from stancekit.planners.verify.trajectories import GROUPS, check_trajectory


def main() -> None:
    """Verify and print."""
    worst = dict.fromkeys(GROUPS, (0.0, ""))
    for path in sys.argv[1:]:
        report = check_trajectory(read_trajectory(path).trajectory)
        if not report.accepted:
            print(f"{path}: {report.message}")
            continue
        for group in report.groups:
            share = group.value / group.limit if group.limit > 1e-6 else 0.0
            worst[group.name] = max(worst[group.name], (share, path))
    for name, (share, path) in worst.items():
        print(f"{name:20} {share:6.3f} {path}")


if __name__ == "__main__":
    main()
