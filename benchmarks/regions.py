"""Walls with panels of ice: who finds plans, who proves that there is none, and how fast? One
thread each.

python benchmarks/regions.py --count 30 --seed 0 --out out/regions

Random panels of .3 m, half of them without friction, M = 4 and 8 key frames, 2 to 4 candidate
patches a toe. The peers HiGHS and SCIP get the lift with a binary a candidate
(``_region_peers.py``); their choices and toes go through the same P2 and verifier as the two-stage
planner's. A course is proved infeasible where the verifier accepts the certificate; HiGHS and SCIP
only claim. Times are wall times. Finished courses are kept in the folder.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import _region_peers
import numpy as np
from _bench import Options, kept, launch
from rich.console import Console
from rich.table import Table

from stancekit import Answer, Motion, Status
from stancekit.envs.distributions.courses import icy_walls
from stancekit.planners.equilibrium.layout import Index
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.projection.project import SURFACE, project
from stancekit.planners.relaxation.lift import LiftProgram
from stancekit.planners.search.answer import Acceptance, Clock, plan_of
from stancekit.planners.search.micp import Decoupled
from stancekit.planners.search.two_stage import TwoStage


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, and for how long."""

    frames: tuple[int, ...] = (4, 8)
    regions: tuple[int, ...] = (2, 3, 4)
    """Candidate patches a toe."""
    count: int = 30
    """Courses of every size."""
    planners: tuple[str, ...] = ("two-stage", "decoupled", "highs", "scip")
    time_limit_s: float = 20.0
    """Of every planner, a course."""
    out: Path = Path("out/regions")
    """Folder of finished courses; another run goes on from them."""


class Peer:
    """A mixed-integer solver on the lift with binaries, then P2 and the verifier."""

    def __init__(self, name: str, programs: Programs, time_limit_s: float) -> None:
        self.name, self._programs, self._limit = name, programs, time_limit_s

    def solve(self, course: Problem) -> Answer[Motion]:
        """HiGHS: planes within the cones for a plan, then planes about them for a refutation. SCIP:
        the cones.
        """
        clock, scaled = Clock.start(), Scaled.of(course)
        mixed = _region_peers.Mixed.of(
            self._programs.get(LiftProgram, scaled.layout, False, False), scaled
        )
        plan, word, message = None, "", ""
        for said in self._said(mixed):
            clock.count(1, said.seconds)
            word = said.label
            if said.x is not None:
                choice, start = rounded(mixed, scaled, said.x)
                point = project(self._programs, "scp", scaled.chosen(choice), start)
                clock.count(point.solves, point.seconds)
                found = point.residual <= SURFACE
                message = "" if found else "P2 found no plan"
                made = {"planner": self.name}
                plan = plan_of(course, scaled, choice, point, provenance=made) if found else None
            if plan is not None or word == "infeasible":
                break
        details = {"projected": float(word == "feasible")}
        return Acceptance().answer(
            course,
            plan=plan,
            word=word,
            message=message,
            details=details,
            method=self.name,
            clock=clock,
        )

    def _said(self, mixed: _region_peers.Mixed) -> Any:
        if self.name == "scip":
            yield _region_peers.scip(mixed, time_limit_s=self._limit)
            return
        inner = _region_peers.highs(mixed, inner=True, time_limit_s=0.5 * self._limit)
        if inner.label == "feasible":
            yield inner
        yield _region_peers.highs(mixed, inner=False, time_limit_s=self._limit - inner.seconds)


def rounded(mixed: _region_peers.Mixed, scaled: Scaled, x: Array) -> tuple[Index, Point]:
    """The candidate of the largest binary of every foothold, by number, and where the solver has
    the toe on it.
    """
    layout = scaled.layout
    choice = np.asarray(scaled.by_candidate(x[mixed.first :], -1.0).argmax(axis=1))
    weights = np.maximum(x[mixed.columns["weights"]], 0.0)
    weights *= (np.concatenate(scaled.which) == choice[layout.candidate_footholds])[
        layout.vertex_candidates
    ]
    toes, total = np.zeros((layout.footholds, 3)), np.zeros(layout.footholds)
    np.add.at(toes, layout.vertex_footholds, weights[:, None] * scaled.vertices)
    np.add.at(total, layout.vertex_footholds, weights)
    start = Point(
        com=x[mixed.columns["com"]],
        rotation=x[mixed.columns["rotation"]],
        toes=toes / np.maximum(total, 1e-9)[:, None],
        forces=np.zeros((len(layout.contacts[0]), 3)),
        residual=float("inf"),
    )
    return choice, start


def main(options: Arguments) -> None:
    """Solve, print and keep."""
    programs = Programs()
    planners: dict[str, Any] = {
        "two-stage": TwoStage(programs=programs, time_limit_s=options.time_limit_s),
        "decoupled": Decoupled(programs=programs),
        **{name: Peer(name, programs, options.time_limit_s) for name in ("highs", "scip")},
    }
    for frames in options.frames:
        for regions in options.regions:
            rows = [
                course_row(planners, options, frames, regions, index)
                for index in range(options.count)
            ]
            cells = [
                cell(rows, name) | {"frames": frames, "regions": regions}
                for name in options.planners
            ]
            show(cells, options)


def course_row(
    planners: dict[str, Any], options: Arguments, frames: int, regions: int, index: int
) -> dict[str, dict[str, Any]]:
    """Every planner's answer to one course, from the folder where it is there."""
    rng = np.random.default_rng(
        np.random.SeedSequence(options.seed, spawn_key=(frames, regions, index))
    )
    course = icy_walls(rng, frames, regions)
    row = {}
    for turn in range(len(options.planners)):
        name = options.planners[(turn + index) % len(options.planners)]
        path = (
            options.out
            / f"{options.seed}-{frames}-{regions}-{index}-{name}-{options.time_limit_s:g}.json"
        )
        row[name] = kept(path, partial(measured, planners[name], course))
    return row


def measured(planner: Any, course: Problem) -> dict[str, Any]:
    """One planner's answer to one course."""
    begin = time.perf_counter()
    outcome = planner.solve(course)
    return {
        "status": outcome.status.value,
        "claim": outcome.claim,
        "message": outcome.message,
        "seconds": outcome.effort.seconds,
        "solver_seconds": outcome.effort.solver_s,
        "solves": outcome.effort.solves,
        "wall_s": time.perf_counter() - begin,
        "compile_s": outcome.effort.compile_s,
        **outcome.details,
    }


def cell(rows: list[dict[str, dict[str, Any]]], name: str) -> dict[str, Any]:
    """What one planner did on the courses of one size, beside what is known of them from all
    planners.
    """
    feasible = [
        any(said["status"] == Status.FEASIBLE.value for said in row.values()) for row in rows
    ]
    refuted = [
        any(said["status"] == Status.INFEASIBLE.value for said in row.values()) for row in rows
    ]
    said = [row[name] for row in rows]
    seconds = np.array([s["seconds"] for s in said])
    found = np.array([s["status"] == Status.FEASIBLE.value for s in said])
    proved = np.array([s["status"] == Status.INFEASIBLE.value for s in said])
    tried = sum(s.get("projected", 0.0) for s in said)
    return {
        "planner": name,
        "feasible": sum(feasible),
        "infeasible": sum(refuted),
        "open": len(rows) - sum(feasible) - sum(refuted),
        "found": int(found.sum()),
        "proved": int(proved.sum()),
        "claimed_infeasible": sum(s["claim"] == "infeasible" for s in said),
        "false_no": sum(
            s["claim"] == "infeasible" and yes for s, yes in zip(said, feasible, strict=True)
        ),
        "unknown": sum(s["status"] == "undecided" and s["claim"] != "infeasible" for s in said),
        "p2_success": float(found.sum() / tried) if tried else None,
        "median_s": float(np.median(seconds)),
        "p90_s": float(np.quantile(seconds, 0.9)),
        "max_s": float(seconds.max()),
        "found_median_s": float(np.median(seconds[found])) if found.any() else None,
        "proved_median_s": float(np.median(seconds[proved])) if proved.any() else None,
        "on_ice": float(np.mean([s["on_ice"] for s in said if "on_ice" in s] or [np.nan])),
    }


def show(cells: list[dict[str, Any]], options: Arguments) -> None:
    """One size's table."""
    if options.json:
        for found in cells:
            options.say(found)
        return
    first = cells[0]
    table = Table(
        title=f"M = {first['frames']}, {first['regions']} regions: {first['feasible']} courses with a plan, "
        f"{first['infeasible']} refuted, {first['open']} open"
    )
    heads = (
        "planner",
        "plans",
        "proved no",
        "claimed no",
        "unknown",
        "P2 %",
        "median s",
        "p90 s",
        "max s",
        "on ice %",
    )
    for head in heads:
        table.add_column(head, justify="left" if head == "planner" else "right")
    for found in cells:
        p2, ice = found["p2_success"], found["on_ice"]
        table.add_row(
            found["planner"],
            str(found["found"]),
            str(found["proved"]),
            str(found["claimed_infeasible"]),
            str(found["unknown"]),
            "" if p2 is None else f"{100 * p2:.0f}",
            f"{found['median_s']:.2f}",
            f"{found['p90_s']:.2f}",
            f"{found['max_s']:.2f}",
            f"{100 * ice:.0f}" if ice == ice else "",
        )
    Console(width=120).print(table)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
