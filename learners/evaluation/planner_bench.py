"""Lin et al.'s Table II again: how long the planners of courses take, and how large their programs
are.

Every cell of the table is one planner at one number of key frames, and a file of its own, written
when it is measured: a run that is stopped goes on with the next cell. Of two-stage planners
compiling and re-solving are timed apart.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from stancekit.planners.answer.answer import Answer
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_json
from stancekit.planners.files.writing import write_text
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.lift import LiftProgram
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Micp
from stancekit.planners.search.two_stage import TwoStage

from ..selectors.mixture import solved_postures
from ..selectors.selector import quantile_box

_Form = Literal[
    "lift", "envelope", "unit-4", "rows-4", "course-4", "shrink-4", "unit-2", "course-2", "shrink-2"
]
FORMS: Mapping[_Form, str] = MappingProxyType(
    {
        "lift": "two-stage, lift",
        "envelope": "two-stage, envelope",
        "unit-4": "MICP, K = 4",
        "rows-4": "MICP, K = 4, envelope rows",
        "course-4": "MICP, K = 4, course's grid",
        "shrink-4": "MICP, K = 4, shrunk grid",
        "unit-2": "MICP, K = 2",
        "course-2": "MICP, K = 2, course's grid",
        "shrink-2": "MICP, K = 2, shrunk grid",
    }
)
"""Names. K intervals a component, over [−1, 1] as in Lin et al., or over the bounds that the course
implies (no envelope), or over the envelope. Only programs of the same K have as many binaries."""
MICP: tuple[_Form, ...] = tuple(form for form in FORMS if "-" in form)
_OPTIMISED: tuple[_Form, ...] = ("unit-4", "rows-4", "shrink-4", "unit-2", "shrink-2")
_PAPER: Mapping[tuple[_Form, int], dict[str, Any]] = {
    ("envelope", 8): {"seconds": 0.16, "variables": 4128, "binaries": 0, "constraints": 1176},
    ("unit-4", 4): {"seconds": 91.0, "variables": 16608, "binaries": 276, "constraints": 3360},
    ("rows-4", 4): {"seconds": 33.0, "variables": 16608, "binaries": 276, "constraints": 4008},
    ("unit-4", 8): {
        "seconds": float("inf"),
        "more_than": 1000,
        "variables": 33216,
        "binaries": 552,
        "constraints": 6720,
    },
    ("rows-4", 8): {"seconds": 152.0, "variables": 33216, "binaries": 552, "constraints": 8016},
}
"""Table II (Intel i5-6260U, Gurobi)."""


@dataclass(frozen=True, kw_only=True)
class PlannerBenchSettings:
    """Settings of the measurement.

    Arguments:
        two_stage, micp, optimised: numbers of key frames, of the last kind MICP with the objective
            minimised to ``gap`` instead of the first point taken.
        solver: of MICP.
        cap_s: its time limit.
        repeats: of re-solving, the median counts.
        samples: solved postures of wall-3 that the envelope is the 5 % quantile box of.
    """

    course: str = "walls"
    two_stage: tuple[int, ...] = (4, 8, 16, 32)
    micp: tuple[int, ...] = (1, 2, 4, 8)
    optimised: tuple[int, ...] = (1, 2, 4)
    gap: float = 0.05
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    cap_s: float = 120.0
    repeats: int = 7
    samples: int = 300
    seed: int = 0

    @classmethod
    def quick(cls) -> PlannerBenchSettings:
        """Small enough to try it out."""
        return cls(
            two_stage=(4, 8), micp=(1, 2), optimised=(1,), cap_s=20.0, repeats=3, samples=100
        )


@dataclass(frozen=True)
class _PlannerCell:
    """One planner at M key frames.

    Arguments:
        gap: of MICP, None for the first point.
    """

    form: _Form
    frames: int
    gap: float | None = None

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.form}-{self.frames}{'' if self.gap is None else '-optimised'}.json"


def cells(settings: PlannerBenchSettings) -> list[_PlannerCell]:
    """Every cell, the quick ones first."""
    planner_cells = [
        _PlannerCell(form, frames)
        for form in FORMS
        if form not in MICP
        for frames in settings.two_stage
    ]
    planner_cells += [_PlannerCell(form, frames) for frames in settings.micp for form in MICP]
    return planner_cells + [
        _PlannerCell(form, frames, settings.gap)
        for frames in settings.optimised
        for form in _OPTIMISED
    ]


def run(
    settings: PlannerBenchSettings,
    folder: Path,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> Iterator[dict[str, Any]]:
    """Measure the cells that the folder does not have with these settings; yield the row of every
    cell, in order.
    """
    every, request = cells(settings), json.loads(json.dumps(asdict(settings)))
    shared = {
        name: request[name]
        for name in ("course", "solver", "cap_s", "repeats", "samples", "seed", "gap")
    }
    envelopes = _wall_envelope(settings, folder)
    for index, cell in enumerate(every):
        if on_progress is not None:
            on_progress(f"{FORMS[cell.form]}, M = {cell.frames}", index, len(every))
        path = folder / cell.file
        saved = read_json(path) if path.exists() else {}
        if saved.get("settings") != shared:
            saved = {"settings": shared, "row": measure(cell, settings, envelopes)}
            write_text(path, json.dumps(saved, indent=1) + "\n")
        yield saved["row"]
    if on_progress is not None:
        on_progress("done", len(every), len(every))


def _wall_envelope(settings: PlannerBenchSettings, folder: Path) -> EnvelopeSet:
    """The envelope of the table, from the folder where it was learned with the same settings
    before.
    """
    path, made = (
        folder / "envelope.json",
        {"method": "quantile", "samples": settings.samples, "seed": settings.seed},
    )
    if path.exists():
        try:
            known = EnvelopeSet.from_json(read_json(path))
            if dict(known.provenance) == made:
                return known
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None
    problems, points = solved_postures(
        "wall-3", settings.samples, Exact(), np.random.default_rng(settings.seed)
    )
    envelopes = EnvelopeSet.for_problems("wall-3", problems, [quantile_box(points)], made)
    write_text(path, json.dumps(envelopes.to_json()) + "\n")
    return envelopes


def measure(
    cell: _PlannerCell, settings: PlannerBenchSettings, envelopes: EnvelopeSet
) -> dict[str, Any]:
    """The row of one cell; times in seconds.

    Of re-solving: seconds, solver_s and verify_s, the solver's and the verifier's parts, of the
    median; cpu_s: CPU time in the mean. over_solver: planning, the verifier left out, over the
    solver's own time, the median over all.
    """
    figures = (
        _micp(cell, settings, envelopes)
        if cell.form in MICP
        else _two_stage(cell, settings, envelopes)
    )
    row = {
        "method": FORMS[cell.form],
        "frames": cell.frames,
        "optimised": cell.gap is not None,
        **figures,
    }
    paper = _PAPER.get((cell.form, cell.frames)) if cell.gap is None else None
    return (
        row
        if paper is None
        else {**row, "paper": {k: v for k, v in paper.items() if v != float("inf")}}
    )


def _two_stage(
    cell: _PlannerCell, settings: PlannerBenchSettings, envelopes: EnvelopeSet
) -> dict[str, Any]:
    course, programs = read_course(settings.course, frames=cell.frames), Programs()
    lifted = cell.form == "lift"
    planner = TwoStage(envelopes=None if lifted else envelopes, programs=programs)
    first = planner.solve(course)
    cpu_s = time.process_time()
    again = [planner.solve(course) for _ in range(settings.repeats)]
    cpu_s = (time.process_time() - cpu_s) / settings.repeats
    middle = sorted(again, key=lambda outcome: outcome.effort.seconds)[len(again) // 2]
    over = [
        (outcome.effort.seconds - outcome.effort.verifier_s) / outcome.effort.solver_s
        for outcome in again
    ]
    scaled = Scaled.of(course)
    program = (
        programs.get(LiftProgram, scaled.layout, scaled.box_implied, False)
        if lifted
        else programs.get(McCormick, scaled.layout, "contact", False)
    )
    rows, columns = program.rows.shape
    return {
        **_answer(middle),
        "variables": columns,
        "binaries": 0,
        "constraints": rows,
        "compile_s": first.effort.compile_s,
        "seconds": middle.effort.seconds,
        "solver_s": middle.effort.solver_s,
        "cpu_s": cpu_s,
        "verify_s": middle.effort.verifier_s,
        "over_solver": float(np.median(over)),
    }


def _micp(
    cell: _PlannerCell, settings: PlannerBenchSettings, envelopes: EnvelopeSet
) -> dict[str, Any]:
    course = read_course(settings.course, frames=cell.frames)
    form, intervals = cell.form.split("-")
    planner = Micp(
        solver=settings.solver,
        intervals=int(intervals),
        domain="course" if form == "course" else "unit",
        envelope_use="shrink" if form == "shrink" else "rows",
        envelopes=envelopes if form in ("rows", "shrink") else None,
        gap=cell.gap,
        time_limit_s=settings.cap_s,
    )
    outcome = planner.solve(course)
    sizes = {name: int(outcome.details[name]) for name in ("variables", "binaries", "constraints")}
    return {
        **_answer(outcome),
        **sizes,
        "compile_s": outcome.effort.compile_s,
        "seconds": outcome.details["solver_s"],
        "cpu_s": outcome.details["solver_cpu_s"],
        "capped": outcome.claim == "unknown",
        "cell_error": outcome.details["cell_error"],
        "claimed_residual": outcome.details.get("claimed_residual"),
    }


def _answer(outcome: Answer[Plan]) -> dict[str, Any]:
    objective = None if np.isnan(outcome.objective) else outcome.objective
    return {
        "status": outcome.status.value,
        "claim": outcome.claim,
        "objective": objective,
        "message": outcome.message,
    }


def growth(rows: list[dict[str, Any]], method: str) -> float:
    """Exponent k of CPU seconds ~ M^k over the rows of one method, by least squares; NaN for fewer
    than two.
    """
    pairs = [(row["frames"], row["cpu_s"]) for row in rows if row["method"] == method]
    if len(pairs) < 2:
        return float("nan")
    logs = np.log(np.array(pairs))
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])
