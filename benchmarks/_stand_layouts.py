"""Layouts of courses, each tried alone: what the package's own order of them is made from."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
from _stand_commands import STARVED
from _stand_list import Entry, Lines

import stancekit
from stancekit.planners.errors import StancekitError
from stancekit.planners.problem.alternatives import (
    ALTERNATIVES,
    AS_ASKED,
    TABLE,
    Alternative,
    Missing,
)
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.search.methods import PlannerOptions, make_planner
from stancekit.planners.search.plan_course import plan_course

MISSING = get_args(Missing)


def rows(entry: Entry, folder: Path, lines: Lines, limit_s: float) -> Iterator[dict[str, Any]]:
    """Lines of an entry over the layout that is asked for, and where that has no plan over all
    others.
    """
    missing = ""
    for alternative in ALTERNATIVES:
        key = f"{entry.name}:{alternative.message}"
        if key not in lines.rows:
            row = {"entry": entry.name, "layout": alternative.message, "missing": missing}
            yield lines.add(key, row | tried(entry, folder, alternative, limit_s))
        if alternative is AS_ASKED:
            if lines.rows[key]["accepted"]:
                return
            missing = lines.rows[key]["without"]


def tried(entry: Entry, folder: Path, alternative: Alternative, limit_s: float) -> dict[str, Any]:
    """Whether there is a plan over one layout alone, what is missing where there is none, and CPU
    time.
    """
    mesh = folder / "grounds" / f"{entry.name}.obj"
    mesh.parent.mkdir(parents=True, exist_ok=True)
    ground = entry.ground()
    ground.write(mesh)
    start, goal = ([round(float(x), 3) for x in place] for place in (ground.start_m, ground.goal_m))
    over = stancekit.terrain(mesh, friction=ground.friction, robot=entry.source)
    planner = make_planner("two-stage", PlannerOptions(time_limit_s=limit_s), of="courses")
    began, begun = time.process_time(), time.perf_counter()
    accepted, without, message = False, "contacts", ""
    try:
        answer = plan_course(
            laid_between(over, start, goal, robot=entry.source),
            planner,
            layouts=(alternative,),
            deadline=begun + limit_s,
        )
        accepted, message = answer.status.value == "feasible", answer.message
        without = "" if accepted else "contacts" if answer.solution is None else "body"
    except StancekitError as error:
        message = str(error)
    cpu_s, wall_s = time.process_time() - began, time.perf_counter() - begun
    starved = not accepted and wall_s > STARVED * limit_s and cpu_s < STARVED * wall_s
    found = {"accepted": accepted, "without": without, "message": message[:200], "starved": starved}
    return {**found, "cpu_s": round(cpu_s, 1), "wall_s": round(wall_s, 1)}


def table(found: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """By what is missing over the layout that is asked for, a row for each other: of how many
    entries it has a plan.

    In the order in which each next one adds most entries that those before it have no plan for,
    then by its successes. What was short of a processor counts for nothing.
    """
    tables = dict[str, list[dict[str, Any]]]()
    for missing in MISSING:
        some = [
            row
            for row in found
            if row["missing"] == missing and row["layout"] and not row["starved"]
        ]
        left, done, rows_of = (
            list(dict.fromkeys(each.message for each in ALTERNATIVES[1:])),
            set[str](),
            [],
        )
        hits = {
            name: {row["entry"] for row in some if row["layout"] == name and row["accepted"]}
            for name in left
        }
        while left:
            best = max(
                left, key=lambda name: (len(hits[name] - done), len(hits[name]), -left.index(name))
            )
            cpu_s = [row["cpu_s"] for row in some if row["layout"] == best]
            row = {
                "layout": best,
                "accepted": len(hits[best]),
                "of": len(cpu_s),
                "adds": len(hits[best] - done),
            }
            rows_of.append(row | {"cpu_s": round(float(np.median(cpu_s)), 1) if cpu_s else None})
            left.remove(best)
            done |= hits[best]
        tables[missing] = rows_of
    return tables


def write(tables: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Put them where the package reads them."""
    lines = [
        f" {json.dumps(missing)}: [\n" + ",\n".join(f"  {json.dumps(row)}" for row in some) + "\n ]"
        for missing, some in tables.items()
    ]
    TABLE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
