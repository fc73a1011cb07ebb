"""Published scenes and planners of contacts side by side: L1 and MIP without forces, two-stage,
exact and decoupled.

Every cell is one planner on one scene and a file of its own, written when it is measured: a run
that is stopped goes on with the next cell. Who plans without forces is judged twice: with its body
where it was planned, and at its feet alone, where any body and any forces will do.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_json
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.plan_file import write_plan
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import builtin_scenes, read_course
from stancekit.planners.search.kinematic import SOLVERS, KinematicPlanner
from stancekit.planners.search.methods import PlannerOptions, make_planner
from stancekit.planners.verify import check_plan, explain

KINEMATIC = ("l1", "mip-highs", "mip-scip")
"""Planners without forces; the last where it is installed."""
COUPLED = ("two-stage", "exact", "decoupled")
METHODS = (*KINEMATIC, *COUPLED)
FEET_ALONE = ("anymal-inclined-surfaces", "talos-ramp")
"""Scenes that are published without a centre of mass: planners without forces have none there
either."""


@dataclass(frozen=True, kw_only=True)
class SceneBenchSettings:
    """Settings of the measurement.

    Arguments:
        scenes: names or files.
        methods: of ``METHODS``.
        robot: in place of the published polytopes, as ``read_course`` has it.
        reach: a folder of polytopes in their place.
        time_limit_s: of each planner on each scene.
    """

    scenes: tuple[str, ...] = ()
    methods: tuple[str, ...] = METHODS
    robot: str | None = None
    reach: str | None = None
    time_limit_s: float = 60.0

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in METHODS:
                raise InvalidInput(f"method: expected some of {', '.join(METHODS)}, got {method!r}")
        if not self.time_limit_s > 0.0:
            raise InvalidInput(
                f"time_limit_s: expected a number above 0, got {self.time_limit_s:g}"
            )

    @property
    def all_scenes(self) -> tuple[str, ...]:
        """Scenes that the settings name, or all that come with the package."""
        return self.scenes or builtin_scenes()


def run(
    settings: SceneBenchSettings,
    folder: Path,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> Iterator[dict[str, Any]]:
    """Measure the cells that the folder does not have with these settings; yield the row of every
    cell, in order.

    Plans that are found are kept beside the rows, as ``SCENE-METHOD.plan.json``. Raises
    InvalidInput for a scene that there is not; one whose data contradict themselves is a row that
    says so.
    """
    methods = [
        m for m in settings.methods if m != "mip-scip" or SOLVERS["scip"] in cp.installed_solvers()
    ]
    cells = [(scene, method) for scene in settings.all_scenes for method in methods]
    for index, (scene, method) in enumerate(cells):
        if on_progress is not None:
            on_progress(f"{scene}: {method}", index, len(cells))
        path = folder / f"{Path(scene).stem}-{method}.json"
        shared = {
            "scene": scene,
            "robot": settings.robot,
            "reach": settings.reach,
            "limit": settings.time_limit_s,
        }
        saved = read_json(path) if path.exists() else {}
        if saved.get("settings") != shared:
            row = measure(scene, method, settings, folder / f"{path.stem}.plan.json")
            saved = {"settings": shared, "row": row}
            write_text(path, json.dumps(saved, indent=1) + "\n")
        yield saved["row"]
    if on_progress is not None:
        on_progress("done", len(cells), len(cells))


def measure(
    scene: str, method: str, settings: SceneBenchSettings, plan_file: Path
) -> dict[str, Any]:
    """The row of one planner on one scene; times in s, of the planner's whole work.

    success: it says that it has a plan. verified: the verifier accepts it; of planners without
    forces as_planned, with their own body, and verified, at their feet. status: feasible,
    infeasible (with a proof that was checked), or undecided.
    """
    row: dict[str, Any] = {"scene": Path(scene).stem, "method": method}
    try:
        course = read_course(scene, robot=settings.robot, reach=settings.reach)
    except InvalidInput as error:
        if settings.robot is not None or scene not in builtin_scenes():
            raise
        return {
            **row,
            "status": "undecided",
            "success": False,
            "verified": False,
            "message": str(error),
        }
    begin = time.process_time()
    outcome = _solved(course, Path(scene).stem, method, settings)
    cpu_s = time.process_time() - begin
    if outcome.solution is not None:
        write_plan(plan_file, outcome.solution, check_plan(outcome.solution))
    return {**row, **_answer(course, outcome), "cpu_s": cpu_s}


def _solved(course: Problem, scene: str, method: str, settings: SceneBenchSettings) -> Answer[Plan]:
    if method in KINEMATIC:
        choice, _, solver = method.partition("-")
        planner = KinematicPlanner(
            "l1" if choice == "l1" else "mip",
            solver=solver or "highs",
            body=scene not in FEET_ALONE,
            time_limit_s=settings.time_limit_s,
        )
        return planner.solve(course)
    return make_planner(
        method, PlannerOptions(time_limit_s=settings.time_limit_s), of="courses"
    ).solve(course)


def _answer(course: Problem, outcome: Answer[Plan]) -> dict[str, Any]:
    details, claimed = outcome.details, outcome.claim == "feasible"
    message = outcome.message
    if outcome.certificate is not None:
        message = explain(outcome.certificate).message
    elif outcome.solution is not None and "placed" not in details:
        message = check_plan(outcome.solution).message
    return {
        "status": outcome.status.value,
        "claim": outcome.claim,
        "success": claimed or outcome.status is Status.FEASIBLE,
        "verified": outcome.status is Status.FEASIBLE,
        "as_planned": bool(details["as_planned"]) if "as_planned" in details else None,
        "steps": sum(len(lifted) for lifted in course.lifts),
        "frames": course.frames,
        "objective": None if math.isnan(outcome.objective) else outcome.objective,
        "goal_m": None
        if outcome.solution is None
        else float(np.linalg.norm(outcome.solution.com_m[-1] - course.goal_m)),
        "seconds": outcome.effort.seconds + outcome.effort.compile_s,
        "solver_s": outcome.effort.solver_s,
        "tried": details.get("tried"),
        "message": message,
    }


def shares(rows: list[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Shares by method: scenes, with a plan, verified as planned, verified, with a proof that there
    is none; CPU s in sum.
    """
    lines = []
    for method in dict.fromkeys(row["method"] for row in rows):
        rows_of_method = [row for row in rows if row["method"] == method]
        lines.append(
            {
                "method": method,
                "scenes": len(rows_of_method),
                "success": sum(row["success"] for row in rows_of_method),
                "as_planned": sum(
                    bool(row.get("as_planned", row["verified"])) for row in rows_of_method
                ),
                "verified": sum(row["verified"] for row in rows_of_method),
                "refuted": sum(row["status"] == "infeasible" for row in rows_of_method),
                "cpu_s": sum(row.get("cpu_s", 0.0) for row in rows_of_method),
            }
        )
    return lines


def page(rows: list[dict[str, Any]], settings: SceneBenchSettings) -> str:
    """The rows as Markdown: a line a scene and method, the sums, and what is said of each."""
    reach = settings.robot or settings.reach or "the published polytopes"
    lines = [f"# Scenes, reach of {reach}, {settings.time_limit_s:g} s a cell", ""]
    lines += [
        "| scene | steps | method | plan | as planned | verified | status | CPU s | to the goal |"
    ]
    lines += ["|---|---|---|---|---|---|---|---|---|"]
    for row in rows:
        lines.append(
            f"| {row['scene']} | {row.get('steps', '')} | {row['method']} | {_yes(row['success'])} "
            "| "
            f"{_yes(row.get('as_planned'))} | {_yes(row['verified'])} | {row['status']} | "
            f"{_number(row.get('cpu_s'))} | {_number(row.get('goal_m'))} |"
        )
    lines += [
        "",
        "| method | scenes | plan | as planned | verified | refuted | CPU s |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {s['method']} | {s['scenes']} | {s['success']} | {s['as_planned']} | {s['verified']} | "
        f"{s['refuted']} | "
        f"{_number(s['cpu_s'])} |"
        for s in shares(list(rows))
    ]
    lines += ["", "What is said:", ""]
    lines += [
        f"- {row['scene']}, {row['method']}: {row['message']}" for row in rows if row.get("message")
    ]
    return "\n".join(lines) + "\n"


def _yes(value: bool | None) -> str:
    return "" if value is None else "yes" if value else "no"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
