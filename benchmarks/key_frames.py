"""Climbs between two walls by IPOPT from many starts, beside the two-stage planner (Lin et al.'s
"possible speed up of around 100 times"), and MICP to an optimum with the gap that is left (Table II).

    python benchmarks/key_frames.py starts [--courses walls icy-walls tube] [--frames 8 32]
    [--starts 20]
    python benchmarks/key_frames.py optima [--frames 1 2 4 8] [--solvers highs scip gurobi]
    [--cap-s 600] [--envelope FILE] [--out FOLDER]

starts: courses with the toes' patches given, as a nonlinear program with exact
derivatives (`planners.projection.nlp`), from the patches' centroids and from random toes; each start
alone. A start succeeds where the verifier accepts its plan. Times are CPU seconds without compiling;
"all starts" is what a user pays who keeps the best. "within 1 %": starts whose objective is within
1 % of the best known one.

optima: the grid of K = 4 intervals over [−1, 1] (Lin et al.), to a relative gap of 0.001, without and
with an envelope's rows; bound, best point and gap are the solver's own at the end of --cap-s. A
cell is a file in --out, and what is there is not measured again; a cell that met a shorter cap is.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any, Literal

import cvxpy as cp
import numpy as np
import tyro
from _bench import Options, Row, kept, launch, markdown

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.formats.question_file import read_envelopes
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.nlp import NlpProgram
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.micp import GUROBI_LIMITS, SOLVERS
from stancekit.planners.search.answer import Acceptance, Clock, plan_of
from stancekit.planners.search.choice import nearest
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Micp, starting_points
from stancekit.planners.search.two_stage import TwoStage

GAP = 1e-3
"""Relative, to which MICP is asked to go."""
NEAR = 1.01
"""Objectives within this factor of the best count as the same."""
ZERO = 1e-6
"""Objectives below this are zero [m²]: at M = 1 the best is."""
REPEATS = 5


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What to measure, and on which climbs."""

    what: tyro.conf.Positional[Literal["starts", "optima"]]
    courses: tuple[str, ...] = ("walls",)
    frames: tuple[int, ...] = (1, 2, 4, 8)
    starts: int = 20
    solvers: tuple[str, ...] = ("highs", "scip", "gurobi")
    cap_s: float = 600.0
    envelope: Path | None = None
    out: Path = Path("out/key-frames")


def main(arguments: Arguments) -> None:
    """Measure and print."""
    for name, frames in product(arguments.courses, arguments.frames):
        course = read_course(name, frames=frames)
        found = by_starts if arguments.what == "starts" else optima
        for row in found(course, arguments):
            arguments.say({"course": name, **row})


def by_starts(course: Problem, arguments: Arguments) -> Iterator[Row]:
    """The two-stage planner, the exact one, and IPOPT."""
    programs, planners = Programs(), {}
    planners["two-stage"] = TwoStage(programs=programs)
    planners["exact"] = Exact(programs=programs, time_limit_s=arguments.cap_s)
    best, quick = np.inf, np.nan
    for name, planner in planners.items():
        planner.solve(course)  # compiles
        repeats = REPEATS if name == "two-stage" else 1
        began = time.process_time()
        answers = [planner.solve(course) for _ in range(repeats)]
        seconds = (time.process_time() - began) / repeats
        quick = seconds if name == "two-stage" else quick
        found = answers[-1].status is Status.FEASIBLE
        best = min(best, answers[-1].objective) if found else best
        yield {
            "frames": course.frames,
            "planner": name,
            "accepted": found,
            "cpu_s": round(seconds, 4),
            "objective": answers[-1].objective,
            "bound": answers[-1].bound,
        }
    yield from from_starts(course, programs, best, quick, arguments)


def from_starts(
    course: Problem, programs: Programs, best: float, quick: float, arguments: Arguments
) -> Iterator[Row]:
    """IPOPT from every start, as quartiles."""
    scaled = Scaled.of(course)
    choice = nearest(scaled)
    chosen = scaled.chosen(choice)
    program = programs.get(NlpProgram, chosen.layout, False, 500, arguments.cap_s)
    seconds, objectives = list[float](), list[float]()
    for start in starting_points(chosen, arguments.starts, seed=arguments.seed):
        began = time.process_time()
        point, _ = program.attempt(programs, chosen, start)
        seconds.append(time.process_time() - began)
        if not np.isfinite(point.residual):
            objectives.append(np.inf)
            continue
        answer = Acceptance().answer(
            course, plan=plan_of(course, scaled, choice, point), method="nlp", clock=Clock.start()
        )
        objectives.append(answer.objective if answer.status is Status.FEASIBLE else np.inf)
    accepted = np.isfinite(objectives)
    best = min(best, *objectives)
    low, middle, high = np.percentile(seconds, [25, 50, 75])
    yield {
        "frames": course.frames,
        "planner": "IPOPT",
        "starts": len(seconds),
        "accepted": int(accepted.sum()),
        "within 1 %": int(np.sum(np.array(objectives) <= NEAR * best + ZERO)),
        "cpu_s": round(float(middle), 4),
        "quartiles": [round(float(low), 4), round(float(high), 4)],
        "all starts": round(sum(seconds), 3),
        "times two-stage, a start": round(float(middle) / quick, 2),
        "times two-stage, all starts": round(sum(seconds) / quick, 1),
        "objective": float(min(objectives)),
    }


def optima(course: Problem, arguments: Arguments) -> Iterator[Row]:
    """MICP by every solver, without and with envelope rows."""
    envelopes = None if arguments.envelope is None else read_envelopes(arguments.envelope)
    for solver in arguments.solvers:
        if find_spec(SOLVERS[solver][0]) is None:
            yield {"frames": course.frames, "solver": solver, "refused": "not installed"}
            continue
        for rows in (None,) if envelopes is None else (None, envelopes):
            name = f"{solver}-{course.frames}-{'plain' if rows is None else 'rows'}.json"
            path = arguments.out / name
            if path.exists() and capped(kept(path, dict)) < arguments.cap_s:
                path.unlink()
            yield kept(path, partial(optimum, course, solver, rows, arguments.cap_s))


def capped(row: Row) -> float:
    """The cap that a cell met, inf where it came to an end."""
    return float(row["cap_s"]) if row.get("open", False) else np.inf


def optimum(course: Problem, solver: str, envelopes: EnvelopeSet | None, cap_s: float) -> Row:
    """One program, to GAP or until the cap."""
    planner = Micp(solver=solver, intervals=4, domain="unit", envelopes=envelopes, gap=GAP)
    program = planner.program(course)
    _, limit, gaps, options = SOLVERS[solver]
    data, chain, _ = program.problem.get_problem_data(getattr(cp, solver.upper()))
    settings: dict[str, Any] = {**options, limit: cap_s, gaps[0]: GAP, gaps[1]: 0.0}
    if solver == "scip":
        settings = {"scip_params": {limit: cap_s, gaps[0]: GAP}}
    row: Row = {
        "frames": course.frames,
        "solver": solver,
        "envelope rows": envelopes is not None,
        "cap_s": cap_s,
        **{name: int(value) for name, value in program.figures.items()},
    }
    began, cpu = time.perf_counter(), time.process_time()
    try:
        raw = chain.solve_via_data(program.problem, data, solver_opts=settings)
    except Exception as error:
        return row | {"refused": GUROBI_LIMITS if solver == "gurobi" else str(error)}
    row |= {
        "wall_s": round(time.perf_counter() - began, 2),
        "cpu_s": round(time.process_time() - cpu, 2),
    }
    try:
        best, bound = ends(solver, raw)
    except AttributeError:  # Gurobi's licence refused the model, and there is no bound
        return row | {"refused": GUROBI_LIMITS}
    gap = (best - bound) / max(abs(best), 1e-9) if np.isfinite(best) else np.inf
    return row | {
        "best": best if np.isfinite(best) else None,
        "bound": bound if np.isfinite(bound) else None,
        "gap": round(gap, 4) if np.isfinite(gap) else None,
        "open": not gap <= 1.01 * GAP,
    }


def ends(solver: str, raw: Any) -> tuple[float, float]:
    """Value of the best point, inf for none, and the bound of all."""
    if solver == "highs":
        info = raw["info"] if isinstance(raw, dict) else raw.info
        best, bound = info.objective_function_value, info.mip_dual_bound
        return (best if info.primal_solution_status == 2 else np.inf), bound  # 2: feasible
    model = raw["model"]
    if solver == "scip":
        return (model.getPrimalbound() if model.getNSols() else np.inf), model.getDualbound()
    return (model.ObjVal if model.SolCount else np.inf), model.ObjBound


def page(rows: list[Row]) -> Iterable[str]:
    """IPOPT beside the two-stage planner (docs/reproduction.md)."""
    head = ("course", "M", "two-stage", "IPOPT, a start", "times", "all starts, times", "accepted")
    quick = {
        (row["course"], row["frames"]): row["cpu_s"]
        for row in rows
        if row["planner"] == "two-stage"
    }
    return markdown(
        (*head, "within 1 % of the best"),
        (
            (
                row["course"],
                row["frames"],
                f"{quick[row['course'], row['frames']]:.3f}",
                f"{row['cpu_s']:.3f}",
                f"{row['times two-stage, a start']:.1f}",
                f"{row['times two-stage, all starts']:.0f}",
                f"{row['accepted']} of {row['starts']}",
                row["within 1 %"],
            )
            for row in rows
            if row["planner"] == "IPOPT"
        ),
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__, starts=page)
