"""What becomes of motions that leave and come back: judged again, without contacts and forces, and
spoiled.

    python benchmarks/exports.py FILE.json ... [--to csv npz mujoco] [--out LINES.jsonl]

Every file of a plan or a walk is exported and the export verified, by the functions of the two
commands, beside the table that was exported: the same verdict, and figures within 1e-6; once more
without contacts and forces: the same verdict per group where it is known; and four times spoiled,
each of which has to be found: a foot that slips by 40 mm along x where it stands, a foot that goes
30 mm into what it stands on, a joint 0.05 rad beyond its limit, a body 60 mm beside the outermost
foot that stands, which tips over. A motion without joints is named and left out, and so is the
limit of a robot whose joints have none. FILEs are what
``stancekit plan`` and ``gait`` write.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import tyro
from _bench import Options, launch, share

import stancekit
from stancekit.checks import check_file
from stancekit.exports import read_accepted
from stancekit.planners.answer.report import Report
from stancekit.planners.motion.motion import MotionTable
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.verify.motions import check_motion, nearest
from stancekit.runner.export.formats import FORMATS, moved_of, scene_of
from stancekit.runner.worlds.world import Terrain

SLIP_M, DEEP_M, BEYOND_RAD, BESIDE_M = 0.04, 0.03, 0.05, 0.06
WANTED = {
    "slip": ("slip",),
    "overlap": ("bodies", "penetration"),
    "limit": ("joints",),
    "tip-over": ("balance",),
}
"""By what was done to a motion, the groups of which one has to be violated."""


@dataclass(frozen=True, kw_only=True)
class Exports(Options):
    """Motions that leave and come back."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Plans and walks."""
    to: tuple[str, ...] = ("csv", "npz", "jointtrajectory", "mujoco")
    """Formats of the round trips."""
    out: Path | None = None
    """A line per file."""

    def run(self) -> None:
        """Judge all of them, and say what came of it."""
        lines = [line for line in map(self._line, self.files) if "without" not in line]
        for name in ("accepted", "same", "stripped_same", *WANTED):
            known = [line[name] for line in lines if line[name] is not None]
            self.say({"figure": name, "of": share(sum(each is True for each in known), len(known))})
        self.say({"figures off by at most": max(float(line["off"]) for line in lines)})

    def _line(self, path: Path) -> dict[str, object]:
        subject = read_accepted(path)
        robot, _, terrain, gravity = scene_of(subject)
        assert robot is not None
        moved = moved_of(subject, "npz", 100.0, str(path))
        if moved.without:
            self.say(line := {"file": str(path), "without": moved.without})
            return line

        def judged(table: MotionTable) -> Report[MotionTable]:
            return check_motion(table, robot, terrain, gravity_m_s2=gravity)

        first = judged(moved.table)
        line: dict[str, object] = {
            "file": str(path),
            "accepted": first.accepted,
            "message": first.message,
        }
        off, same = 0.0, True
        with TemporaryDirectory() as folder:
            for to in self.to:
                file = Path(folder) / f"motion{FORMATS[to].suffixes[0]}"
                stancekit.export(path, file, to=to)
                back = check_file(file, terrain=path).report
                known = [
                    (a, b) for a, b in zip(first.groups, back.groups, strict=True) if not b.message
                ]
                if (
                    to == "mujoco"
                ):  # contacts are derived there: what does not rest on them is compared
                    apart = ("slip", "balance")
                    known = [(a, b) for a, b in known if a.name not in apart]
                same &= all(a.verdict == b.verdict for a, b in known)
                off = max([off, *(abs(a.value - b.value) for a, b in known)])
        bare = judged(moved.table.with_columns(contact=None, forces_n=None))
        known = [
            (a, b)
            for a, b in zip(first.groups, bare.groups, strict=True)
            if b.verdict != "not checked"
        ]
        line |= {
            "off": off,
            "same": same,
            "stripped_same": all(a.verdict == b.verdict for a, b in known),
        }
        kinematics = Kinematics(robot)
        for name, wanted in WANTED.items():
            if name == "limit" and not np.isfinite(kinematics.highest_rad).any():
                line |= {name: None}
                continue
            report = judged(spoiled(moved.table, name, kinematics, terrain))
            broken = [group.name for group in report.refused]
            line |= {name: any(each in wanted for each in broken), f"{name}_refused": broken}
        self.say(line)
        if self.out is not None:
            with self.out.open("a") as lines:
                lines.write(json.dumps(line) + "\n")
        return line


def spoiled(table: MotionTable, how: str, kinematics: Kinematics, terrain: Terrain) -> MotionTable:
    """The motion with one thing wrong in its middle; its contacts and forces are left out."""
    known = table.arrays()
    angles, origin = np.array(known["angles_rad"]), np.array(known["origin_m"])
    count = len(angles)
    hump = np.sin(np.pi * np.clip(np.linspace(-0.5, 1.5, count), 0.0, 1.0)) ** 2
    bare = table.with_columns(contact=None, forces_n=None, torques_nm=None, rates_rad_s=None)
    if how == "limit":
        joint = int(np.argmax(np.isfinite(kinematics.highest_rad)))
        past = kinematics.highest_rad[joint] + BEYOND_RAD - angles[:, joint]
        angles[:, joint] += hump * past.max()
        return bare.with_columns(angles_rad=angles)
    if (
        how == "tip-over"
    ):  # the body goes aside, and its feet with it but those that stand: the joints follow
        aside = (
            np.where(known["contact"], known["feet_m"][..., 1], -np.inf).max(axis=1)
            - known["com_m"][:, 1]
        )
        far = float(aside[hump > 0.5].max()) + BESIDE_M
        origin[:, 1] += hump * far
        return bare.with_columns(
            origin_m=origin, angles_rad=_followed(bare, origin, kinematics, None)
        )
    foot = int(np.argmax(known["contact"].sum(axis=0)))
    along = np.tile([SLIP_M, 0.0, 0.0], (count, 1))
    if how == "overlap":
        radii = np.full(count, kinematics.radii_m[foot])
        along = -DEEP_M * nearest(terrain, known["feet_m"][:, foot], radii)[1]
    return bare.with_columns(
        angles_rad=_followed(bare, origin, kinematics, (foot, hump[:, None] * along))
    )


def _followed(
    table: MotionTable,
    origin: np.ndarray,
    kinematics: Kinematics,
    slides: tuple[int, np.ndarray] | None,
) -> np.ndarray:
    """Joints whose feet are where the table's are, but for one that is moved by so much, shape (T,
    3).
    """
    known, rotation, found = table.arrays(), table.rotation, []
    for row, angles in enumerate(known["angles_rad"]):
        feet = known["origin_m"][row] + kinematics.feet(angles) @ rotation[row].T
        if slides is not None:
            feet[slides[0]] += slides[1][row]
        near = found[-1] + angles - known["angles_rad"][row - 1] if found else angles
        found.append(
            kinematics.reach((feet - origin[row]) @ rotation[row], near, near, limits=False)[0]
        )
    return np.array(found)


if __name__ == "__main__":
    launch(Exports.run, Exports, __doc__)
