"""Published scenes (loco-3d/sl1m) and planners of contacts side by side: L1 and MIP without forces, two-stage,
with a push to bear, exact and decoupled.

    python benchmarks/scenes.py [--scene NAME|FILE ...] [--method NAME ...] [--robot FILE|NAME]
        [--reach FOLDER] [--time-limit-s 60] [--out out/bench-scenes] [--pictures] [--json]

l1 and mip-highs, mip-scip are sl1m's, written here as published: kinematics alone. Every cell is one
planner on one scene and a file of its own, written when it is measured: a run that is stopped goes
on with the next cell. Who plans without forces is judged twice: as planned, with its body where it
was planned, and verified, at its feet alone, where any body and any forces will do. Cells, courses,
plans and table.md are kept in the folder of --out.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np
from _bench import Options, cell, launch
from published.kinematic import SOLVERS, KinematicPlanner
from published.scene import SCENES, read_scene

from stancekit import Answer, Motion, Status
from stancekit.files import save
from stancekit.pictures import draw
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_choice
from stancekit.planners.files.documents import read_json
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.search.methods import PlannerOptions, make_planner
from stancekit.planners.verify import check_plan, explain
from stancekit.planners.verify.margins import stance_margins

KINEMATIC = ("l1", "mip-highs", "mip-scip")
"""Planners without forces; the last where it is installed."""
METHODS = (*KINEMATIC, "two-stage", "steady", "exact", "decoupled")
PUSH_SHARE = 0.03
"""Horizontal push that every stance bears in plans of "steady", the two-stage planner's, as a share of
the weight."""
FEET_ALONE = ("anymal-inclined-surfaces", "talos-ramp")
"""Scenes that are published without a centre of mass: planners without forces have none there
either."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which scenes, by which planners."""

    scene: tuple[str, ...] = SCENES
    """Names, or YAML files of scenes."""
    method: tuple[str, ...] = METHODS
    robot: str | None = None
    """A robot in place of the published polytopes: anymal (boxes of reach), a .urdf file, or a .yaml
    file that names one."""
    reach: Path | None = None
    """Reach polytopes in place of the scene's own."""
    time_limit_s: float = 60.0
    """Time limit of each planner on each scene [s]."""
    out: Path = Path("out/bench-scenes")
    pictures: bool = False
    """A picture of every plan."""


def main(arguments: Arguments) -> None:
    """Measure what is missing, and write the table."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for row in run(arguments):
        rows.append(row)
        arguments.say(row, _line)
    write_text(arguments.out / "table.md", page(rows, arguments))
    if not arguments.json:
        print(f"cells, plans and table: {arguments.out}")


def run(arguments: Arguments) -> Iterator[dict[str, Any]]:
    """Measure the cells that the folder does not have with these settings; yield the row of every
    cell, in order.

    Raises InvalidInput for a scene or a method that there is not; a scene whose data contradict
    themselves is a row that says so.
    """
    for method in arguments.method:
        checked_choice(method, "method", METHODS)
    installed = SOLVERS["scip"] in cp.installed_solvers()
    for scene in arguments.scene:
        for method in arguments.method:
            if method == "mip-scip" and not installed:
                continue
            path = arguments.out / f"{Path(scene).stem}-{method}.json"
            shared = {
                "scene": scene,
                "robot": arguments.robot,
                "reach": None if arguments.reach is None else str(arguments.reach),
                "limit": arguments.time_limit_s,
            }
            saved = read_json(path) if path.exists() else {}
            if saved.get("settings") != shared:
                saved = {"settings": shared, "row": measure(scene, method, arguments)}
                write_text(path, json.dumps(saved, indent=1) + "\n")
            yield saved["row"]


def measure(scene: str, method: str, arguments: Arguments) -> dict[str, Any]:
    """The row of one planner on one scene; times in s, of the planner's whole work.

    success: it says that it has a plan. verified: the verifier accepts it; of planners without
    forces as_planned, with their own body, and verified, at their feet. status: feasible,
    infeasible (with a proof that was checked), or undecided.
    """
    row: dict[str, Any] = {"scene": Path(scene).stem, "method": method}
    try:
        course = read_scene(scene, robot=arguments.robot, reach=arguments.reach)
    except InvalidInput as error:
        if arguments.robot is not None or scene not in SCENES:
            raise
        refused = {"status": "undecided", "success": False, "verified": False}
        return {**row, **refused, "message": str(error)}
    save(course, arguments.out / f"{row['scene']}.course.json")
    if method == "steady":
        course, method = replace(course, push_n=PUSH_SHARE * course.weight_n), "two-stage"
    begin = time.process_time()
    outcome = _solved(course, row["scene"], method, arguments.time_limit_s)
    cpu_s = time.process_time() - begin
    if outcome.solution is not None:
        file = arguments.out / f"{row['scene']}-{row['method']}.plan.json"
        write_motion(file, outcome.solution, check_plan(outcome.solution))
        if arguments.pictures:
            draw(outcome.solution, file.with_suffix("").with_suffix(".png"))
    return {**row, **_answer(course, outcome), "cpu_s": cpu_s}


def _solved(course: Problem, scene: str, method: str, time_limit_s: float) -> Answer[Motion]:
    if method in KINEMATIC:
        choice, _, solver = method.partition("-")
        planner = KinematicPlanner(
            "l1" if choice == "l1" else "mip",
            solver=solver or "highs",
            body=scene not in FEET_ALONE,
            time_limit_s=time_limit_s,
        )
        return planner.solve(course)
    return make_planner(method, PlannerOptions(time_limit_s=time_limit_s), of="courses").solve(
        course
    )


def _answer(course: Problem, outcome: Answer[Motion]) -> dict[str, Any]:
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
        "inside_m": None
        if outcome.solution is None
        else float(stance_margins(outcome.solution, ("support_m",))["support_m"].min()),
        "message": message,
    }


def page(rows: list[dict[str, Any]], arguments: Arguments) -> str:
    """The rows as Markdown: a line per scene and method, the sums, and what is said of each."""
    reach = arguments.robot or arguments.reach or "the published polytopes"
    lines = [f"# Scenes, reach of {reach}, {arguments.time_limit_s:g} s a cell", ""]
    lines += [
        "| scene | steps | method | plan | as planned | verified | status | CPU s | to the goal | inside |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        words = (_yes(row["success"]), _yes(row.get("as_planned")), _yes(row["verified"]))
        figures = [_number(row.get(name)) for name in ("cpu_s", "goal_m", "inside_m")]
        cells = (row["scene"], row.get("steps", ""), row["method"], *words, row["status"], *figures)
        lines.append(f"| {' | '.join(map(cell, cells))} |")
    lines += ["", "| method | scenes | plan | as planned | verified | refuted | CPU s |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for method in dict.fromkeys(row["method"] for row in rows):
        of = [row for row in rows if row["method"] == method]
        sums = (
            len(of),
            sum(row["success"] for row in of),
            sum(bool(row.get("as_planned", row["verified"])) for row in of),
            sum(row["verified"] for row in of),
            sum(row["status"] == "infeasible" for row in of),
            _number(sum(row.get("cpu_s", 0.0) for row in of)),
        )
        lines.append(f"| {method} | {' | '.join(map(str, sums))} |")
    lines += ["", "What is said:", ""]
    lines += [
        f"- {row['scene']}, {row['method']}: {row['message']}" for row in rows if row.get("message")
    ]
    return "\n".join(lines) + "\n"


def _line(row: Mapping[str, Any]) -> str:
    cpu_s = f"{row['cpu_s']:.2f} CPU s" if "cpu_s" in row else ""
    words = f"plan {_yes(row['success'])}, verified {_yes(row['verified'])}"
    return f"{row['scene']:26} {row['method']:10} {words}, {row['status']} {cpu_s}  {row.get('message', '')[:60]}"


def _yes(value: bool | None) -> str:
    return "" if value is None else "yes" if value else "no"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
