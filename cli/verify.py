"""``stancekit verify``, ``export`` and ``picture``: answers checked again, knowing nothing of how they
were made, written for other programs, and drawn.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from json import loads
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput

from .console import as_options, complain, emit, grid, out, say, tell, text_of
from .options import (
    OF_FILE,
    FileMeaning,
    OptionalPath,
    OptionalText,
    check_out,
    check_unused,
    in_options,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import FileCheck, Report

_TOLERANCE = 1e-6


@dataclass
class Verify:
    """Check answers again: postures and proofs, a data set, a plan of key frames, a gait.

    With one file, `stancekit verify plan.json`, a plan of key frames or of a leap, a proof that
    there is none, or a gait trajectory is checked against the course or terrain in the file,
    whatever the file says of itself.

    With two, `stancekit verify problems.jsonl answers.jsonl`, the n-th answer is taken for the n-th
    problem; answers are what `stancekit solve --certificate --out answers.jsonl` writes.

    With a motion from elsewhere, `stancekit verify walk.csv --robot go1 --terrain rough:0.1:3`, a
    .csv, a .npz of `stancekit export`, a JointTrajectory (.json, .yaml) or MuJoCo key frames
    (.xml), what stands is told from what does not, group by group; what cannot be known is named.

    With a contact sequence, `stancekit verify steps.csv --robot go1`, a .csv or a .npz of which foot
    comes down where (step, foot, x, y, z, and maybe nx, ny, nz, friction, com.x, com.y, com.z),
    every stance holds with its margins, or the one limit to blame is named; a plan completes it, or
    with --explain the nearest sequence that holds.

    With a folder, `stancekit verify data/wall-3`, every witness and every certificate of a data set
    is checked.

    No solver takes part but in what completes a contact sequence. Exit code 1 if anything is refused,
    and that is also what happens to a claim that comes without its evidence.
    """

    problems: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PROBLEMS")]
    """Problem file, or - for standard input; or a data set, by folder or, where it ships, by name;
    a plan; a gait."""
    answers: Annotated[OptionalPath, tyro.conf.Positional, tyro.conf.arg(metavar="[ANSWERS]")] = (
        None
    )
    """File of answers, or - for standard input; none for a data set, a plan or a gait."""
    tolerance: float = _TOLERANCE
    """Largest violation of an accepted posture (non-dimensional)."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="FILE")] = None
    """The robot that a plan or a gait is for, a .urdf or a .yaml file: an own copy of it that
    differs is refused."""
    course: Annotated[OptionalText, tyro.conf.arg(metavar="COURSE")] = None
    """The course that a plan is for, as `stancekit plan` takes it, for the robot of --robot: a plan
    of other terrain, friction, start, goal, limits or robot is refused."""
    terrain: Annotated[OptionalText, tyro.conf.arg(metavar="NAME|FILE")] = None
    """Heights under a motion from elsewhere, by name or file, or the file of a plan or a walk over
    the same ground; the ground of a contact sequence, by name or file, else the piece under every
    foot alone."""
    file: Annotated[FileMeaning, *OF_FILE] = field(default_factory=FileMeaning)
    """What the numbers of a terrain's file mean."""
    spacing_m: float = 0.05
    """Grid spacing of a terrain's file [m]."""
    explain: bool = False
    """Say for every proof what would have to give, and by how much at least; look for the nearest
    contact sequence that holds."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.json")] = None
    """File for the plan that completes a contact sequence, or for that of the nearest that holds, or
    else for the proof of the first stance that is refuted."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture (.png, .pdf, .svg) of that plan, or of the first stance of a contact sequence that is
    refuted: support, cones, and what would have to change."""
    margins: bool = False
    """Say how large a push every stance of a plan bears, how far the centre of mass may move, and how
    much of the friction is needed."""
    exact: bool = False
    """Replay a file's proof in exact arithmetic, too: its numbers as the fractions that they are,
    with balls that are rounded outwards where a root enters. The message says which arithmetic
    decided which leaf. It needs the extra exact."""
    json: bool = False
    """One JSON object per line."""

    def run(self) -> int:
        """Verify and print the verdicts."""
        if not 0.0 < self.tolerance < 1.0:
            raise InvalidInput(
                f"--tolerance: expected a number between 0 and 1, got {self.tolerance:g}"
            )
        if self.answers is not None or not self.problems.is_file():
            check_unused(
                self,
                ("robot", "course", "terrain", "exact", "margins", "out", "picture"),
                "what is no file of a plan, a proof or a motion",
            )
        if self.answers is None:
            return self._file() if self.problems.is_file() else self._dataset()
        texts = [(text_of(file), str(file)) for file in (self.problems, self.answers)]
        from stancekit.checks import check_answers  # slow to import

        verdicts = list[str]()
        for record in check_answers(*texts, tolerance=self.tolerance, why=self.explain):
            verdicts.append(record["verdict"])
            if verdicts[-1] == "invalid":
                complain(f"stancekit: error: {record['message']}")
            tell(self.json, record, f"{record['where']}: {record['verdict']}: {record['message']}")
        return 2 if "invalid" in verdicts else int("refused" in verdicts)

    def _file(self) -> int:
        """A plan of key frames, a proof or a gait trajectory: one verdict."""
        from stancekit.checks import check_file

        with (
            as_options("tolerance", "robot", "course", "terrain", "explain", "exact", "margins"),
            in_options(),
        ):
            check = check_file(
                self.problems,
                tolerance=self.tolerance,
                robot=self.robot,
                course=self.course,
                terrain=self.terrain,
                options=replace(self.file.asked(), spacing_m=self.spacing_m),
                why=self.explain,
                exact=self.exact,
                margins=self.margins,
            )
        if self.json:
            emit(check.to_json())
        else:
            out.print(f"{self.problems}: {check.message}")
            say(check.report.doubts, "doubt: {}")
            if check.kind == "sequence":
                out.print(_stances(check.report))
            if check.kind == "motion":
                out.print(_groups(check.report))
            if check.kind in ("plan", "gait") and check.accepted and check.report.remark:
                out.print(check.report.remark)
        if self.out is not None or self.picture is not None:
            self._leave(check)
        return int(not check.accepted)

    def _leave(self, check: FileCheck) -> None:
        """Write and draw the plan of a contact sequence, or the proof of a stance that is refuted."""
        from stancekit import draw, save, verify

        answer = check.report.answer
        if check.kind != "sequence":
            wanted = "--out: expected a contact sequence with it and with --picture"
            raise InvalidInput(f"{wanted}, got a {check.kind}")
        if self.picture is not None:
            subject = getattr(answer, "refuted", None)
            draw(*((answer,) if subject is None else (subject, answer)), out=self.picture)
        if self.out is not None and verify(answer).accepted:
            save(answer, self.out)
        elif self.out is not None:
            complain(f"{self.out} is not written: nothing holds, and nothing is proved")

    def _dataset(self) -> int:
        from stancekit.envs.data.ledger import check_there

        check_there(self.problems)
        from stancekit.checks import check_rows  # slow to import

        with as_options("explain", "tolerance"):
            report = check_rows(self.problems, tolerance=self.tolerance, why=self.explain)
        record = report.to_json()
        tell(self.json, record, *(f"{name:16} {value}" for name, value in record.items()))
        return int(not report.accepted)


def _stances(report: Report[Any]) -> Table:
    """A row per stance of a contact sequence, and per group of its plan that has something to say."""
    rows = ((each.name, each.verdict, each.message) for each in report.groups if each.message)
    return grid([(name, {}) for name in ("stance", "verdict", "what")], rows, box=None)


def _groups(report: Report[Any]) -> Table:
    """A row per group of a motion."""
    rows = list[tuple[str, ...]]()
    for group in report.groups:
        share = "" if group.unit == "1" else f" {group.unit}"
        at = "" if group.when is None else f", {group.when:.2f} s"
        place = f"{group.where}{at}".removeprefix(", ")
        rows.append(
            (
                group.name,
                group.verdict,
                f"{group.value:.3g} of {group.limit:g}{share}",
                place,
                group.message,
            )
        )
    return grid([("", {})] * 5, rows, box=None, show_header=False)


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
