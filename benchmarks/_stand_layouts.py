"""Layouts of courses, each tried alone: what the package's own order of them is made from."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args
from unittest.mock import patch

import numpy as np
from _stand_list import Entry, Lines

import stancekit
from stancekit.planners.errors import StancekitError
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.course_keys import (
    ALTERNATIVES,
    AS_ASKED,
    TABLE,
    Alternative,
    Missing,
)
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

    Arguments:
        limit_s: processor time [s].
    """
    mesh = folder / "grounds" / f"{entry.name}.obj"
    mesh.parent.mkdir(parents=True, exist_ok=True)
    ground = entry.ground()
    ground.write(mesh)
    start, goal = ([round(float(x), 3) for x in place] for place in (ground.start_m, ground.goal_m))
    over = stancekit.terrain(mesh, friction=ground.friction, robot=entry.source)
    planner = make_planner("two-stage", PlannerOptions(time_limit_s=limit_s), of="courses")
    accepted, without, message, began = False, "contacts", "", time.process_time()
    try:
        with processor_time():
            answer = plan_course(
                laid_between(over, start, goal, robot=entry.source),
                planner,
                layouts=(alternative,),
                deadline=began + limit_s,
            )
        accepted, message = answer.status.value == "feasible", answer.message
        without = "" if accepted else "contacts" if answer.solution is None else "body"
    except StancekitError as error:
        message = str(error)
    found = {"accepted": accepted, "without": without, "message": message[:200]}
    return {**found, "cpu_s": round(time.process_time() - began, 1)}


@contextmanager
def processor_time() -> Iterator[None]:
    """Planners' clocks count the processor time of this process, so that their limits end the same
    search on a busy computer.
    """
    with patch.object(time, "perf_counter", time.process_time):
        yield


def table(found: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """By what is missing over the layout that is asked for, a row for each other: of how many
    entries it has a plan.

    In the order in which each next one adds most entries that those before it have no plan for,
    then by its successes.
    """
    tables = dict[str, list[dict[str, Any]]]()
    for missing in MISSING:
        some = [row for row in found if row["missing"] == missing and row["layout"]]
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


def orders(
    found: Sequence[dict[str, Any]], budget_s: float
) -> dict[str, dict[str, tuple[bool, float]]]:
    """Whether every entry that has no plan as it was asked for has one within the budget, and the
    processor time that it takes, by order: as listed in the package, and as the table of the other
    robots' entries has it.

    Arguments:
        budget_s: processor time of an entry, over all layouts but the one that is asked for.
    """
    robots = {row["entry"]: row["entry"].split("-")[0] for row in found}
    listed = [each.message for each in ALTERNATIVES[1:]]
    ways: dict[str, dict[str, tuple[bool, float]]] = {"as listed": {}, "by the table": {}}
    for entry, robot in robots.items():
        own = {row["layout"]: row for row in found if row["entry"] == entry}
        if own[AS_ASKED.message]["accepted"] or len(own) < len(ALTERNATIVES):
            continue
        tables = table([row for row in found if robots[row["entry"]] != robot])
        missing = own[listed[0]]["missing"]
        by_table = [row["layout"] for row in tables[missing]]
        for way, names in zip(ways, (listed, by_table), strict=True):
            ways[way][entry] = gone_through([own[name] for name in names], budget_s)
    return ways


def gone_through(rows: Sequence[Mapping[str, Any]], budget_s: float) -> tuple[bool, float]:
    """Whether one of the layouts, tried one after the other, has a plan before the budget ends, and
    the processor time until then.
    """
    used_s = 0.0
    for row in rows:
        used_s += row["cpu_s"]
        if used_s > budget_s:
            return False, budget_s
        if row["accepted"]:
            return True, used_s
    return False, used_s


def by_robot(found: Mapping[str, tuple[bool, float]]) -> dict[str, str]:
    """How many of how many entries of every robot."""
    robots: dict[str, list[bool]] = {}
    for entry, (accepted, _) in found.items():
        robots.setdefault(entry.split("-")[0], []).append(accepted)
    return {robot: f"{sum(each)}/{len(each)}" for robot, each in robots.items()}


def write(tables: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Put them where the package reads them."""
    lines = [
        f" {json.dumps(missing)}: [\n" + ",\n".join(f"  {json.dumps(row)}" for row in some) + "\n ]"
        for missing, some in tables.items()
    ]
    TABLE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
