"""A flat-ground envelope on curved ground: through the warp map, or as it is; and key frames as a gait's first guess.

    python benchmarks/envelope_transfer.py [--count 200] [--samples 500] [--walks 4] [--terrains ripple,cone] [--json]

Envelope: learned once from solved ground-3 postures. Posture problems of the same distribution are drawn in warped
space, at random places, and pushed forward to the terrain. `chart` pushes the envelope with them, `direct`
takes its box in the world's axes as it was learned. P1 and P2 are shares as in paper E's Table I: P1 answers as the
exact planner does; P1 → P2 ends on the bilinear surface.

Key frames: a plan of the two-stage planner on level ground, pushed forward. `hold`: how many of its stances can be
held on their tangent patches. The gait optimiser (hexapod, tripod) starts from them, and from its own guess.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import Any

import numpy as np

from stancekit.envs.terrains import distribution
from stancekit.learners.modes import solved_postures
from stancekit.learners.selectors.quantile import quantile_box
from stancekit.planners.contact.envelope import Envelope
from stancekit.planners.contact.exact import ExactPlanner
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.contact.stages import Stages
from stancekit.planners.gait.formulation import formulate
from stancekit.planners.gait.judge import check_trajectory
from stancekit.planners.gait.robot import hexapod_walker
from stancekit.planners.gait.seeds import Seat, pushed_plan, seeded
from stancekit.planners.gait.task import GaitSettings, GaitTask
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.outcome import InvalidInput, PlanningFailed, Status
from stancekit.planners.plan import Plan
from stancekit.planners.scene.course_spec import spec_from
from stancekit.planners.scene.layout import lay_out
from stancekit.planners.scene.terrains import reference_terrain
from stancekit.planners.warp.conformal import flatten
from stancekit.planners.warp.spline_map import SplineMap

ON_SURFACE = 1e-4
"""Non-dimensional moment that P2 may leave."""
HEIGHT_M = 0.2
"""Of the bodies over the ground, as in ground-3."""
PATH_M = 1.2
"""How far the walks go."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--walks", type=int, default=4)
    parser.add_argument("--terrains", default="ripple,cone")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rng, planner = np.random.default_rng(arguments.seed), ExactPlanner()
    envelope = quantile_box(solved_postures("ground-3", arguments.samples, planner, rng)[1])
    plan = flat_plan()
    for name in arguments.terrains.split(","):
        warp = flatten(reference_terrain(name))
        for row in (*transfer(name, warp, envelope, planner, arguments.count, rng),
                    *walks(name, warp, plan, planner, arguments.walks)):  # fmt: skip
            print(json.dumps(row) if arguments.json else "  ".join(f"{key} {value}" for key, value in row.items()))


def transfer(
    name: str, warp: SplineMap, envelope: Envelope, planner: ExactPlanner, count: int, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """P1 and P2 of the envelope, pushed and as it is, on problems that the exact planner has decided."""
    source, stages = distribution("ground-3"), Stages()
    hits: dict[str, list[tuple[bool, bool, bool]]] = {"chart": [], "direct": []}
    for _ in range(count):
        place = np.array([*rng.uniform(-2.0, 2.0, 2), HEIGHT_M])
        seat = Seat(warp=warp, com_bar_m=place)
        problem = seat.problem(source.sample(rng))
        status = planner.solve(problem).status
        if status is Status.UNDECIDED:
            continue
        scaled = ScaledProblem.of(problem)
        boxes = {"chart": seat.envelope(envelope, problem.length_scale_m), "direct": envelope}
        for way, box in boxes.items():
            admitted, projected = _stages(stages, scaled, box)
            hits[way].append((status is Status.FEASIBLE, admitted, projected))
    return [{"terrain": name, "envelope": way, **_shares(found)} for way, found in hits.items()]


def _stages(stages: Stages, scaled: ScaledProblem, box: Envelope) -> tuple[bool, bool]:
    answer = stages.box(scaled).solve(scaled, box)
    if not answer.feasible or answer.point is None:
        return False, False
    return True, bool(stages.project("scp", scaled, answer.point).residual <= ON_SURFACE)


def _shares(found: list[tuple[bool, bool, bool]]) -> dict[str, Any]:
    table = np.array(found)
    good = table[table[:, 0]]
    bad = table[~table[:, 0]]
    return {
        "feasible": len(good),
        "P1 correct feasible": _percent(good[:, 1]),
        "infeasible": len(bad),
        "P1 correct infeasible": _percent(~bad[:, 1]),
        "P1 → P2 of feasible": _percent(good[:, 2]),
    }


def _percent(flags: np.ndarray[Any, np.dtype[np.bool_]]) -> str:
    return f"{100.0 * flags.mean():.1f} %" if len(flags) else "none"


def flat_plan() -> Plan:
    """Key frames of the hexapod along x on level ground."""
    frames = 13
    spec = spec_from({
        "name": "flat", "frames": frames, "gait": "tripod", "start_m": [0.0, 0.0, HEIGHT_M],
        "goal_m": [PATH_M, 0.0, HEIGHT_M], "stance": {"outward_m": 0.13, "down_m": HEIGHT_M},
        "body": {"com_radius_m": 0.06, "first_radius_m": 0.001, "last_radius_m": 0.001},
        "steps": {"com_m": 0.15, "toe_m": 0.3, "rotation_rad": 0.15},
        "candidates": {"count": 1, "window_m": 0.2, "margin_m": 0.0},
        "terrain": {"kind": "flat", "friction": 0.6},
    })  # fmt: skip
    outcome = TwoStageCoursePlanner().solve(lay_out(spec))
    if outcome.plan is None:
        raise PlanningFailed(f"flat course: expected a plan, got {outcome.message}")
    return outcome.plan


def walks(name: str, warp: SplineMap, plan: Plan, planner: ExactPlanner, count: int) -> list[dict[str, Any]]:
    """The pushed plan in some directions: what can be held, and gaits from it and from the optimiser's own guess."""
    terrain, found = reference_terrain(name), list[dict[str, Any]]()
    starts = np.array([0.0, 0.0]) if name == "ripple" else np.array([-1.6, 0.0])
    for k in range(count):
        yaw = 2.0 * np.pi * k / count if name == "ripple" else np.deg2rad(30.0) * (k - 0.5 * (count - 1)) / count
        frames = pushed_plan(warp, plan, starts, yaw)
        held = [planner.solve(problem).status is Status.FEASIBLE for problem in frames.problems]
        row: dict[str, Any] = {"terrain": name, "heading": f"{np.rad2deg(yaw):.0f}°",
                               "hold": f"{sum(held)} of {len(held)}"}  # fmt: skip
        try:
            task = GaitTask(
                robot=hexapod_walker(), terrain=terrain, start_xy_m=frames.com_m[0, :2],
                goal_xy_m=frames.com_m[-1, :2], start_yaw_rad=yaw, gait="tripod",
            )  # fmt: skip
        except InvalidInput as error:
            found.append(row | {"gait": str(error)})
            continue
        for chart in ("decoupled", "warped-exact"):
            program = formulate(task, replace(GaitSettings(), chart=chart), warp)
            for guess, x in (("own guess", program.guess), ("key frames", seeded(program, frames))):
                solution = program.solve(x, max_iterations=100)
                accepted = solution.success and check_trajectory(solution.trajectory()).accepted
                word = "verified" if accepted else "feasible" if solution.success else "failed"
                row[f"{chart}, {guess}"] = f"{word}, {solution.iterations} it, {solution.seconds:.1f} s"
        found.append(row)
    return found


if __name__ == "__main__":
    main()
