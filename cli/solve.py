"""``stancekit solve``: answer posture problems."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.table import Table
from rich.text import Text

from stancekit.planners.errors import InvalidInput

from .console import as_options, complain, emit, out, progress, text_of
from .names import PROJECTION, named
from .options import OptionalFloat, OptionalPath, OptionalText, check_planner

if TYPE_CHECKING:
    from stancekit.planners.problem import Problem
    from stancekit.planners.search.answer import Planner

LIMITED = ("exact", "nlp", "micp")
"""The methods that have a use for a time limit."""
SETTINGS = (
    "method",
    "relaxation",
    "envelope",
    "envelopes",
    "projection",
    "solver",
    "intervals",
    "time_limit_s",
)
"""What a planner's complaint may begin with that is an option here."""


@dataclass
class SolvePostures:
    """Can the robot hold these postures, and how?

    One answer a problem, in input order.

    A FILE holds one problem, an array of them, or JSON lines; `-` is standard input. `stancekit
    sample wall-3` shows what a problem looks like.

    status is feasible (with a posture that the verifier accepted), infeasible (with a proof that it
    accepted) or undecided (a limit was met, a solver failed, or the method cannot prove what it
    claims; see claim). It always speaks of the problem itself: a relaxation over a learned envelope
    reports its margin in details and decides nothing alone. lower_bound is a proved bound on the
    moment residual in units of force scale × length scale, and 1e6 where a problem is infeasible
    even without the moment balance.

    Exit code 0 whatever the answers are; 2 if a problem could not be read, and then the others are
    still answered.
    """

    files: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Problem files, or - for standard input."""
    method: Annotated[str, named("stancekit.planners.search.methods:METHODS")] = "exact"
    """exact: branch and bound. p1: relaxation over an envelope. lift: relaxation without one.
    two-stage: relaxation (over the envelope, or the lift) and projection. nlp: IPOPT. micp:
    piecewise McCormick grid. One of your own counts as far as the verifier accepts its postures and
    certificates."""
    envelope: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Envelope file for p1, two-stage and micp."""
    relaxation: Annotated[
        OptionalText, named("stancekit.planners.relaxation.table:RELAXATIONS")
    ] = None
    """Which relaxation over the envelope: p1, the paper's, where none is named; coned and joint are
    tighter."""
    projection: Annotated[OptionalText, PROJECTION] = None
    """Projection after the relaxation of two-stage (there scp unless another is named), p1 or
    lift."""
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    """Solver of micp."""
    intervals: int = 4
    """Pieces of each axis in micp's grid, a power of two."""
    time_limit_s: OptionalFloat = None
    """Limit a problem for exact, nlp and micp (30 unless another is given); what is not decided by
    then is undecided [s]."""
    certificate: bool = False
    """Add the certificate to infeasible answers, for `stancekit verify`."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File for the answers, JSON lines, written at the end whole."""
    json: bool = False
    """One JSON object a line on standard output."""

    def run(self) -> int:
        """Answer every problem that can be read; exit code 2 if any could not."""
        from stancekit.planners.files.writing import check_writable, write_text
        from stancekit.postures import planner_of

        self._check()
        if self.out is not None:
            check_writable(self.out)
        options = {
            "envelopes": self.envelope,
            "relaxation": self.relaxation,
            "projection": self.projection,
            "solver": self.solver,
            "intervals": self.intervals,
        }
        settings: dict[str, Any] = {
            name: value for name, value in options.items() if value is not None
        }
        with as_options(*SETTINGS):
            planner = planner_of(self.method, time_limit_s=self.time_limit_s, **settings)
        problems = list(_problems(self.files))
        lines: list[dict[str, Any]] = []
        with progress(f"solve by {self.method}") as bar:
            for where, problem in problems:
                lines.append(self._answer(where, problem, planner))
                if self.json:
                    emit(lines[-1])
                bar(len(lines), len(problems))
        if self.out is not None:
            write_text(
                self.out, "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
            )
        if not self.json:
            out.print(_table(lines))
        return 2 if any(line["status"] == "invalid" for line in lines) else 0

    def _check(self) -> None:
        """Raise InvalidInput for an option that is out of range, or that the method does not
        know.
        """
        from stancekit.planners.search.methods import METHODS

        if not self.files:
            raise InvalidInput(
                "FILE: expected one or more problem files, got none (- is standard input)"
            )
        check_planner(self, "method", METHODS, "postures")
        if self.method in METHODS and self.method not in LIMITED and self.time_limit_s is not None:
            raise InvalidInput(
                f"--time-limit-s: expected --method {' or '.join(LIMITED)} with it, got "
                f"{self.method}"
            )

    def _answer(
        self, where: str, problem: Problem | InvalidInput, planner: Planner
    ) -> dict[str, Any]:
        if isinstance(problem, InvalidInput):
            return _invalid(where, problem)
        from stancekit.postures import solve

        try:
            outcome = solve(problem, planner)
        except InvalidInput as error:
            return _invalid(where, InvalidInput(f"{where}: {error}"))
        return {"where": where, **outcome.to_json(proof=self.certificate)}


def _problems(files: tuple[str, ...]) -> Iterator[tuple[str, Problem | InvalidInput]]:
    from stancekit.postures import read_problems

    for name in files:
        try:
            text = text_of(name)
        except InvalidInput as error:
            yield name, error
            continue
        yield from read_problems(text, name)


def _invalid(where: str, error: InvalidInput) -> dict[str, Any]:
    complain(f"stancekit: error: {error}")
    return {"where": where, "status": "invalid", "error": str(error)}


def _table(lines: list[dict[str, Any]]) -> Table:
    table = Table(box=None, header_style="bold")
    for name, side in (
        ("problem", "left"),
        ("status", "left"),
        ("net moment", "right"),
        ("proved residual", "right"),
        ("ms", "right"),
        ("", "left"),
    ):
        folds = name in ("problem", "")
        table.add_column(name, justify=side, overflow="fold", no_wrap=not folds)  # type: ignore[arg-type]
    colour = {"feasible": "green", "infeasible": "red", "undecided": "yellow", "invalid": "magenta"}
    for line in lines:
        where, status = line["where"], Text(line["status"], style=colour[line["status"]])
        if line["status"] == "invalid":
            table.add_row(where, status, "", "", "", "see the message above")
            continue
        moment = "" if line["residual_nm"] is None else f"{line['residual_nm']:.1e} Nm"
        bound = "" if line["status"] != "infeasible" else f"> {line['lower_bound']:.2g}"
        message = line.get("message", "")
        table.add_row(where, status, moment, bound, f"{1e3 * line['seconds']:.1f}", message)
    return table
