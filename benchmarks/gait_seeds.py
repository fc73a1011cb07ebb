"""Three first guesses of a gait: the terrain-following one, key frames of the flat chart, key
frames of the world.

    python benchmarks/gait_seeds.py [--terrains ripple cone] [--walks 6] [--charts decoupled
    warped-exact] [--json]

The hexapod walks PATH_M m in several directions, in the tripod gait. `guess`: the terrain-following
guess. `flat`: key frames that the two-stage planner made once on level ground, pushed forward by
the warp map. `world`: key frames that the same planner makes for every walk on the terrain itself,
given as tangent squares of PATCH_M m about the path. Both plans have the same steps and limits.
`plan`: CPU time of the planner [s], of flat the push alone; the plan on level ground is printed
first. `hold`: how many stances of the pushed plan the exact planner can hold on tangent patches.
One line a walk, then for each terrain, chart and guess: how many were feasible within 100
iterations, how many the verifier accepted, and the median iterations and CPU time of those solved
from all three.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from _bench import Options, launch
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.gait.formulation import formulate
from stancekit.planners.gait.method.guess import along_key_frames
from stancekit.planners.gait.task import GaitSettings
from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import hexapod_walker
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.warp.conformal import flatten
from stancekit.planners.warp.contact_plans import KeyFrames, pushed_plan
from stancekit.planners.warp.spline_map import SplineMap

HEIGHT_M = 0.2
"""Of the bodies over the ground."""
PATH_M = 1.2
"""How far the walks go."""
PATCH_M = 0.12
"""Side of the squares that stand for curved ground."""
GUESSES = ("guess", "flat", "world")


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which walks, in which charts."""

    terrains: tuple[str, ...] = ("ripple", "cone")
    walks: int = 6
    charts: tuple[str, ...] = ("decoupled", "warped-exact")


def main(arguments: Arguments) -> None:
    """Measure and print."""
    began = time.process_time()
    flat = planned(flat_course())
    arguments.say({"course": "level ground", "plan": round(time.process_time() - began, 2)})
    rows: list[dict[str, Any]] = []
    for name in arguments.terrains:
        field = reference_terrain(name)
        warp = flatten(field)
        for start, yaw in directions(name, arguments.walks):
            for row in walk(field, warp, flat, start, yaw, arguments.charts):
                rows.append(row)
                arguments.say(row)
    for row in summary(rows):
        arguments.say(row)


def directions(name: str, count: int) -> Iterator[tuple[Array, float]]:
    """Starts and headings: all around on the ripple, over and beside the top of other terrains."""
    for k in range(count):
        around = 2.0 * np.pi * k / count
        fan = np.deg2rad(60.0) * (k - 0.5 * (count - 1)) / count
        yield (np.zeros(2), around) if name == "ripple" else (np.array([-1.6, 0.0]), fan)


def walk(
    field: HeightField, warp: SplineMap, flat: Plan, start: Array, yaw: float, charts: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """One row a chart and guess."""
    frames, plan_s = dict[str, KeyFrames](), {"guess": 0.0}
    began = time.process_time()
    frames["flat"] = pushed_plan(warp, flat, start, yaw)
    plan_s["flat"] = time.process_time() - began
    planner = ExactPlanner()
    held = [planner.solve(problem).status is Status.FEASIBLE for problem in frames["flat"].problems]
    at: dict[str, Any] = {"terrain": field.name, "heading": round(float(np.rad2deg(yaw)))}
    ends = frames["flat"].com_m[[0, -1], :2]
    try:
        task = Walk(
            robot=hexapod_walker(),
            terrain=field,
            start_xy_m=ends[0],
            goal_xy_m=ends[1],
            start_yaw_rad=yaw,
            gait="tripod",
        )
    except InvalidInput as error:
        yield at | {"refused": str(error)}
        return
    began = time.process_time()
    try:
        frames["world"] = world_frames(field, ends, yaw)
    except (InvalidInput, PlanningFailed) as error:
        at["world"] = str(error)
    plan_s["world"] = time.process_time() - began
    for chart in charts:
        program = formulate(task, GaitSettings(chart=chart), warp)  # type: ignore[arg-type]
        for guess in GUESSES:
            row = at | {"chart": chart, "from": guess, "plan": round(plan_s[guess], 2)}
            if guess == "flat":
                row["hold"] = f"{sum(held)} of {len(held)}"
            if guess != "guess" and guess not in frames:
                yield row | {"feasible": False, "verified": False}
                continue
            x = (
                program.guess
                if guess == "guess"
                else along_key_frames(program.structure, frames[guess])
            )
            solution = program.solve(x, max_iterations=100)
            accepted = solution.success and check_trajectory(solution.trajectory()).accepted
            yield row | {
                "violation at first": float(f"{solution.history[0][0]:.2g}"),
                "feasible": solution.success,
                "verified": accepted,
                "iterations": solution.iterations,
                "seconds": round(solution.seconds, 2),
            }


def summary(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Counts, and medians over the walks that were solved from all guesses."""
    cases = dict.fromkeys((row["terrain"], row["chart"]) for row in rows if "chart" in row)
    for terrain, chart in cases:
        own = [row for row in rows if (row["terrain"], row.get("chart")) == (terrain, chart)]
        solved = {
            guess: {row["heading"] for row in own if row["from"] == guess and row["feasible"]}
            for guess in GUESSES
        }
        both = set.intersection(*solved.values())
        for guess in GUESSES:
            mine = [row for row in own if row["from"] == guess]
            common = [row for row in mine if row["heading"] in both]
            yield {
                "terrain": terrain,
                "chart": chart,
                "from": guess,
                "feasible": f"{len(solved[guess])} of {len(mine)}",
                "verified": sum(row["verified"] for row in mine),
                "of": len(common),
                **{
                    f"median {name}": float(np.median([row[name] for row in common]))
                    if common
                    else None
                    for name in ("iterations", "seconds", "plan")
                },
            }


def flat_course() -> dict[str, Any]:
    """Key frames along x on level ground."""
    return course(
        np.array([[0.0, 0.0, HEIGHT_M], [PATH_M, 0.0, HEIGHT_M]]), {"kind": "flat", "friction": 0.6}
    )


def course(path_m: Array, terrain: dict[str, Any]) -> dict[str, Any]:
    """A course of the hexapod along a path, shape (L, 3) [m]."""
    return {
        "name": "walk",
        "frames": 13,
        "gait": "tripod",
        "start_m": path_m[0].tolist(),
        "goal_m": path_m[-1].tolist(),
        "via_m": path_m[1:-1].tolist(),
        "stance": {"outward_m": 0.13, "down_m": HEIGHT_M},
        "body": {"com_radius_m": 0.06, "first_radius_m": 0.001, "last_radius_m": 0.001},
        "steps": {"com_m": 0.15, "toe_m": 0.3, "rotation_rad": 0.15},
        "candidates": {"count": 1, "window_m": 0.2, "margin_m": 0.0},
        "terrain": terrain,
    }


def planned(data: dict[str, Any]) -> Plan:
    """The two-stage planner's answer. Raises PlanningFailed where there is none."""
    outcome = TwoStageCoursePlanner().solve(build_course(spec_from(data)))
    if outcome.solution is None:
        raise PlanningFailed(outcome.message)
    return outcome.solution


def world_frames(field: HeightField, ends_m: Array, yaw: float) -> KeyFrames:
    """Key frames on the terrain itself, planned in axes that lie along the walk; ends_m: start and
    goal, (2, 2) [m].
    """
    turn = np.array(
        [[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
    home = np.append(ends_m[0], 0.0)
    way = (ends_m - ends_m[0]) @ turn[:2, :2]
    line = np.linspace(way[0], way[1], 9)
    body = field.smoothed(0.3).height(line @ turn[:2, :2].T + ends_m[0])
    squares = tangent_squares(field, way, turn, home)
    terrain = {
        "kind": "polygons",
        "friction": 0.6,
        "polygons": [{"vertices_m": one.tolist()} for one in squares],
    }
    plan = planned(course(np.column_stack([line, body + HEIGHT_M]), terrain))
    toes = plan.toes_m @ turn.T + home
    return KeyFrames(
        limbs=tuple(limb.name for limb in plan.problem.robot.limbs),
        com_m=plan.com_m @ turn.T + home,
        rotation=turn @ Rotation.from_rotvec(plan.rotation_rad.copy()).as_matrix(),
        toes_m=np.array([toes[plan.problem.holds[frame]] for frame in range(plan.problem.frames)]),
        problems=(),
    )


def tangent_squares(field: HeightField, way_m: Array, turn: Array, home: Array) -> Array:
    """Corners of squares of the tangent planes about a straight way, in its axes, shape (P, 4, 3)
    [m].
    """
    low, high = way_m.min(axis=0) - 0.6, way_m.max(axis=0) + 0.6
    centres = np.stack(
        np.meshgrid(
            *(np.arange(a, b, PATCH_M) for a, b in zip(low, high, strict=True)), indexing="ij"
        ),
        -1,
    )
    xy = centres.reshape(-1, 2)
    world = xy @ turn[:2, :2].T + home[:2]
    height, slope = field.height_and_gradient(world)
    slope = slope @ turn[:2, :2]
    corners = 0.5 * PATCH_M * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    z = height[:, None] + slope @ corners.T
    return np.concatenate([xy[:, None] + corners, z[..., None]], axis=2)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
