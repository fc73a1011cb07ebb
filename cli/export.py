"""``stancekit export`` and ``picture``: motions for other programs, and postures drawn."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from json import loads
from pathlib import Path
from typing import Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput

from .console import as_options, tell, text_of
from .options import OptionalPath, OptionalText, check_out, check_unused


@dataclass
class Export:
    """Write a motion in the format of another program.

    The motion is the one that `stancekit run` streams: time, angles, rates and torques of joints,
    contacts, forces and body, with names. It is played open loop in MuJoCo: pace and gains at which
    it stood, or where it fell, are said here, and in .npz and MJCF (`open_loop`).

      csv, npz         a table
      jointtrajectory  ROS 2's trajectory_msgs/JointTrajectory, .json or .yaml
      mujoco           MJCF of robot and terrain, with a key frame per row
      reference        the .npz that mjlab's tracking task reads
      crocoddyl        an .npz, and a script that follows it with Crocoddyl
      foxglove         MCAP of ROS 2's messages, for Foxglove, too (extra viz)

      stancekit export plan.json --to csv
      stancekit export walk.json --to mujoco --rate-hz 50 --out walk.xml

    Exit code: 0 written; 2 bad input, nothing is written.
    """

    subject: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION")]
    """File of a plan, a walk or a leap."""
    to: Annotated[OptionalText, tyro.conf.arg(metavar="FORMAT")] = None
    """Which format; what the ending of --out says where it is missing."""
    out: OptionalPath = None
    """File; a name beside the motion's where it is missing."""
    rate_hz: float = 100.0
    """Rows per second."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Export, and say what was written."""
        from stancekit import export

        with as_options("to", "out", "rate_hz"):
            done = export(self.subject, self.out, to=self.to, rate_hz=self.rate_hz)
        tell(
            self.json,
            {
                "file": str(done.path),
                "without": done.without,
                "open_loop": done.open_loop,
                "doubts": list(done.doubts),
            },
            f"wrote {done.path}"
            + (f" without joints: {done.without}" if done.without else "")
            + (f"; open loop in MuJoCo: {done.open_loop}" if done.open_loop else ""),
            *(f"doubt: {each}" for each in done.doubts),
        )
        return 0


@dataclass
class Picture:
    """Draw a posture problem with its answer, or the file of a motion or a proof: terrain, limbs,
    contact forces in their friction cones; of a proof the limb to blame and what it lacks.
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """Problem file, - for standard input, or the file of a plan, a walk, a leap or a proof;
    `stancekit sample wall-3 --out problem.json` makes one."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Picture to write: .png, .pdf or .svg."""
    index: int = 0
    """Which problem of the file, from 0."""
    json: bool = False
    """Print what was drawn as one JSON object."""

    def run(self) -> int:
        """Solve, draw, write."""
        from stancekit import draw, explain, load, solve
        from stancekit.planners.formats.motion_file import is_evidence
        from stancekit.postures import read_problems

        check_out(self.out)
        text, content = text_of(self.file), None
        with suppress(ValueError):
            content = loads(text)
        record: dict[str, Any] = {"where": str(self.file), "out": str(self.out)}
        if is_evidence(content):
            check_unused(self, ("index",), "a motion or a proof")
            draw(load(self.file), out=self.out)
            tell(self.json, record, f"{self.out}: {self.file}")
            return 0
        problems = list(read_problems(text, str(self.file)))
        if not 0 <= self.index < len(problems):
            raise InvalidInput(
                f"--index: expected 0 to {len(problems) - 1} for {self.file}, got {self.index}"
            )
        where, problem = problems[self.index]
        if isinstance(problem, InvalidInput):
            raise problem
        outcome = solve(problem)
        caption = f"{outcome.method}: {outcome.status.value}, {1e3 * outcome.effort.seconds:.1f} ms"
        why = "" if outcome.certificate is None else explain(outcome).message
        draw(problem, outcome.solution or outcome.certificate, caption=caption, out=self.out)
        tell(
            self.json,
            record | {"where": where, "status": outcome.status.value},
            f"{self.out}: {'; '.join(filter(None, (caption, why)))}",
        )
        return 0
