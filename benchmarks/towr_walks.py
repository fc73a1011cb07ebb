"""Walks of another planner, TOWR, for its own ANYmal over level ground, judged as motions from
elsewhere.

    python benchmarks/towr_walks.py FOLDER [--combos walk trot] [--out walks]

FOLDER has the sources of TOWR and ifopt, as for towr.py; ``benchmarks/towr/walk.cc`` asks TOWR as
its ROS example does. Base, feet, contacts and forces are TOWR's; joints are found for this
package's ANYmal so that the centres of its feet are a radius above TOWR's points, with the base
link where TOWR has its body. Every walk is written as a CSV and judged by ``stancekit verify``, as
it is and without its contacts and forces.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from _bench import Options, launch
from scipy.spatial.transform import Rotation
from towr import compiled

from stancekit.checks import check_file
from stancekit.planners.files.writing import write_bytes
from stancekit.planners.formats.table_file import csv_of
from stancekit.planners.motion.motion import MotionTable
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import walking_robot
from stancekit.planners.robot.walker import named_walker

COMBOS = ("walk", "trot", "pace", "bound", "gallop")
"""TOWR's combinations of gaits, by its numbers."""
LIMBS = ("LF", "RF", "LH", "RH")


@dataclass(frozen=True, kw_only=True)
class TowrWalks(Options):
    """Walks of TOWR, judged."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Sources of TOWR and ifopt."""
    combos: tuple[str, ...] = COMBOS
    out: Path = Path("towr-walks")
    """Folder of the CSVs."""
    seconds: float = 2.4
    ahead_m: float = 0.8
    rate_hz: float = 100.0
    limit_s: float = 60.0

    def run(self) -> None:
        """Ask TOWR for each, write it, and print what the verifier says of every group."""
        program = compiled(self.folder, "walk")
        self.out.mkdir(parents=True, exist_ok=True)
        for combo in self.combos:
            numbers = (COMBOS.index(combo), self.seconds, self.ahead_m, self.rate_hz, self.limit_s)
            ran = subprocess.run(
                [program, *map(str, numbers)], capture_output=True, text=True, check=True
            )
            lines = ran.stdout.splitlines()
            begin = next(k for k, line in enumerate(lines) if line.startswith("WALK"))
            ended, used_s, worst, mass_kg = map(float, lines[begin].split()[1:])
            self.say(
                {
                    "walk": combo,
                    "converged": ended == 1.0,
                    "cpu_s": used_s,
                    "worst": worst,
                    "kg": mass_kg,
                }
            )
            rows = np.array([[float(word) for word in line.split()] for line in lines[begin + 1 :]])
            for way in ("as it is", "stripped"):
                table, missed_m = table_of(rows, stripped=way == "stripped")
                path = self.out / f"{combo}{'-stripped' if way == 'stripped' else ''}.csv"
                write_bytes(path, csv_of(table))
                report = check_file(path, robot="anymal", terrain="rough:0:0").report
                self.say(
                    {
                        "walk": combo,
                        "way": way,
                        "missed_mm": round(1e3 * missed_m, 2),
                        "verdict": report.message,
                    }
                )
                for group in report.groups:
                    said = group.message or f"{group.value:.3g} of {group.limit:g} {group.unit}"
                    at = "" if group.when is None else f" {group.where} {group.when:.2f} s"
                    self.say({"group": group.name, "verdict": group.verdict, "says": said + at})


def table_of(rows: np.ndarray, *, stripped: bool) -> tuple[MotionTable, float]:
    """TOWR's rows as a motion of this package's ANYmal, and by how much its feet miss TOWR's at
    most [m].
    """
    kinematics = Kinematics(walking_robot(named_walker("anymal")))
    assert kinematics.robot.limb_names == LIMBS
    origin, turns = rows[:, 1:4], Rotation.from_euler("ZYX", rows[:, [6, 5, 4]])
    feet = rows[:, 7:].reshape(len(rows), len(LIMBS), 7)
    centres = feet[..., 1:4] + [0.0, 0.0, float(kinematics.radii_m[0])]
    angles, missed = [], 0.0
    near = np.concatenate([leg.stance_rad for leg in kinematics.model.legs])
    for place, turn, row in zip(origin, turns, centres, strict=True):
        near, errors = kinematics.reach(turn.inv().apply(row - place), near, near, limits=False)
        missed = max(missed, float(errors.max()))
        angles.append(near)
    known = {} if stripped else {"contact": feet[..., 0] == 1.0, "forces_n": feet[..., 4:]}
    table = MotionTable(
        joints=kinematics.joints,
        limbs=() if stripped else LIMBS,
        columns={
            "time_s": rows[:, 0],
            "angles_rad": np.array(angles),
            "origin_m": origin,
            "quaternion": turns.as_quat(scalar_first=True),
            **known,
        },
        robot="anymal",
        source="TOWR",
    )
    return table, missed


if __name__ == "__main__":
    launch(TowrWalks.run, TowrWalks, __doc__)
