"""``stancekit verify``: check answers again, knowing nothing of how they were made."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
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
