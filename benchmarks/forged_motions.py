"""Are forged columns of motions refused? Every column of exported motions, off by shares and
multiples of the stated width, in all rows and in a fifth of them.

    python benchmarks/forged_motions.py MOTION.json ... [--rate-hz 100]

A row a motion and column: how many forgeries above twice the width were accepted, how many below
half of it refused. Exit code 1 if there is any of either, or a motion is refused as it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from _bench import Options, launch

from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.motion.motion import MotionTable
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.verify.motions import COLUMNS, check_motion
from stancekit.runner.export.formats import moved_of

ABOVE, BELOW = (2.0, 5.0, 100.0, 1e6), (0.01, 0.5)
"""Errors in units of what is left to the width."""


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Motions that are accepted."""

    motions: Annotated[tuple[Path, ...], tyro.conf.Positional]
    rate_hz: float = 100.0


def main(asked: Asked) -> int:
    """Forge, verify and print."""
    wrong = 0
    for path in asked.motions:
        moved = moved_of(read_motion(path)[0], "npz", asked.rate_hz)
        assert moved.robot is not None
        kinematics = Kinematics(moved.robot, gravity_m_s2=moved.gravity_m_s2)
        scales = {"rates": kinematics.velocity_rad_s, "effort": kinematics.torque_nm}
        honest = check_motion(moved.table, moved.robot, moved.terrain)
        missed = {group.name for group in honest.refused}
        for name, column in COLUMNS.items():
            row = {
                "motion": path.stem,
                "column": column,
                "accepted": 0,
                "refused": int(name in missed),
            }
            group = honest.group(name)
            for error, fake in forgeries(moved.table, column):
                size = error * (group.limit if error > 1.0 else group.limit - group.value)
                try:
                    table = fake(size * scales.get(name, 1.0))
                    held = check_motion(table, moved.robot, moved.terrain).group(name)
                    holds = held.verdict == "holds"
                except InvalidInput:
                    holds = False
                row["accepted"] += int(holds and error > 1.0)
                row["refused"] += int(not holds and error < 1.0)
            wrong += row["accepted"] + row["refused"]
            asked.say(row)
    return int(wrong > 0)


def forgeries(table: MotionTable, column: str) -> Iterator[tuple[float, object]]:
    """Errors, and the table with one of a size in all rows or a fifth of them."""
    rows = len(table.time_s)
    for part in (slice(None), slice(2 * rows // 5, 3 * rows // 5)):
        for error in (*ABOVE, *BELOW):

            def fake(size: np.ndarray | float, part: slice = part) -> MotionTable:
                array = np.array(table.arrays()[column])
                array[part, ..., -1:] += size if np.ndim(size) == 0 else size[-1:]
                return table.with_columns(**{column: array})

            yield error, fake


if __name__ == "__main__":
    launch(main, Asked, __doc__)
