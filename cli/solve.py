"""``stancekit solve``: answer posture problems."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.table import Table
from stancekit.planners.outcome import InvalidInput

from .console import complain, emit, out


@dataclass
class Solve:
    """Can the robot hold these postures, and how? One answer a problem, in input order.

    A FILE holds one problem, an array of them, or JSON lines; `-` is standard input. `stancekit sample wall-3` shows
    what a problem looks like.

    status is feasible (with a posture that the verifier accepted), infeasible (with a proof that it accepted) or
    undecided (a limit was met, a solver failed, or the method cannot prove what it claims; see claim). It always
    speaks of the problem itself: a relaxation over a learned envelope reports its margin in details and decides
    nothing alone. lower_bound is a proved bound on the moment residual in units of force scale × length scale;
    1e6 stands for: infeasible even without the moment balance.
    """

    files: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Problem files, or - for standard input."""
    method: Literal["exact", "p1", "lift", "micp", "nlp", "two-stage"] = "exact"
    """exact: branch and bound. p1: relaxation over an envelope. lift: relaxation without one. two-stage: relaxation
    (over the envelope, or the lift) and projection. nlp: IPOPT. micp: piecewise McCormick grid."""
    envelope: Path | None = None
    """Envelope file for p1, two-stage and micp."""
    project: Literal["fix-p", "fix-f", "fix-toes", "scp", "nlp"] = "scp"
    """Projection of two-stage."""
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    """Solver of micp."""
    intervals: int = 4
    """Pieces of each axis in micp's grid."""
    time_limit_s: float = 30.0
    """Limit a problem; what is not decided by then is undecided [s]."""
    certificate: bool = False
    """Add the certificate to infeasible answers, for `stancekit verify`."""
    out: Path | None = None
    """File for the answers, JSON lines, written at the end whole."""
    json: bool = False
    """One JSON object a line on standard output."""

    def run(self) -> int:
        """Answer every problem that can be read; exit code 2 if any could not."""
        from stancekit.planners.contact.methods import make_planner
        from stancekit.planners.files import read_envelopes, write_text

        if not self.files:
            raise InvalidInput("FILE: expected one or more problem files, got none (- is standard input)")
        if not self.time_limit_s > 0.0:
            raise InvalidInput(f"--time-limit-s: expected a number above 0, got {self.time_limit_s:g}")
        planner = make_planner(
            self.method,
            envelopes=None if self.envelope is None else read_envelopes(self.envelope),
            projection=self.project,
            solver=self.solver,
            intervals=self.intervals,
            time_limit_s=self.time_limit_s,
        )
        lines: list[dict[str, Any]] = []
        for record in self._answers(planner):
            lines.append(record)
            if self.json:
                emit(record)
        if self.out is not None:
            write_text(self.out, "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines))
        if not self.json:
            out.print(_table(lines))
        return 2 if any(line["status"] == "invalid" for line in lines) else 0

    def _answers(self, planner: Any) -> Iterator[dict[str, Any]]:
        from stancekit.planners.files import outcome_to_json, read_problems

        for name, text in _texts(self.files):
            if isinstance(text, InvalidInput):
                yield _invalid(name, text)
                continue
            for where, problem in read_problems(text, name):
                if isinstance(problem, InvalidInput):
                    yield _invalid(where, problem)
                    continue
                try:
                    outcome = planner.solve(problem)
                except InvalidInput as error:
                    yield _invalid(where, InvalidInput(f"{where}: {error}"))
                    continue
                yield {"where": where, **outcome_to_json(outcome, proof=self.certificate)}


def _texts(files: tuple[str, ...]) -> Iterator[tuple[str, str | InvalidInput]]:
    from stancekit.planners.files import read_text

    for name in files:
        if name == "-":
            text = sys.stdin.read()
            yield "-", text if text.strip() else InvalidInput("-: expected JSON on standard input, got nothing")
            continue
        try:
            yield name, read_text(name)
        except InvalidInput as error:
            yield name, error


def _invalid(where: str, error: InvalidInput) -> dict[str, Any]:
    complain(f"stancekit: error: {error}")
    return {"where": where, "status": "invalid", "error": str(error)}


def _table(lines: list[dict[str, Any]]) -> Table:
    table = Table(box=None, header_style="bold")
    for name, side in (
        ("problem", "left"), ("status", "left"), ("net moment", "right"), ("proved residual", "right"),
        ("ms", "right"), ("", "left"),
    ):  # fmt: skip
        table.add_column(name, justify=side)  # type: ignore[arg-type]
    colour = {"feasible": "green", "infeasible": "red", "undecided": "yellow", "invalid": "magenta"}
    for line in lines:
        status = line["status"]
        if status == "invalid":
            table.add_row(line["where"], f"[{colour[status]}]{status}[/]", "", "", "", "see the message above")
            continue
        moment = "" if line["residual_nm"] is None else f"{line['residual_nm']:.1e} Nm"
        bound = "" if status != "infeasible" else f"> {line['lower_bound']:.2g}"
        table.add_row(
            line["where"], f"[{colour[status]}]{status}[/]", moment, bound, f"{1e3 * line['seconds']:.1f}",
            line.get("message", ""),
        )  # fmt: skip
    return table
