"""How much the house adds to the solver: P1 through ``McCormick.solve`` against bare Clarabel on the same data.

    python benchmarks/p1_speed.py [--problem wall-3] [--count 400] [--seed 0] [--json]

Both are timed in turn, problem by problem, in one process on one thread. "bare" hands finished matrices with the same
settings to a solver: `solve` is the solver's solve call alone, `set up + solve` what a program without data updates
pays. Our total is everything from the scaled problem to the margin, gap and point.
"""

from __future__ import annotations

import argparse
import json
import time

import clarabel
import cvxpy as cp
import numpy as np

from stancekit.envs.terrains import DISTRIBUTIONS, distribution
from stancekit.planners.arrays import Array
from stancekit.planners.conic import solver_settings
from stancekit.planners.contact.envelope import Envelope
from stancekit.planners.contact.relax import McCormick, p1_values
from stancekit.planners.contact.scaled import ScaledProblem


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problem", choices=list(DISTRIBUTIONS), default="wall-3")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    scenes = [ScaledProblem.of(distribution(arguments.problem).sample(rng)) for _ in range(arguments.count)]
    record = measure(scenes)
    if arguments.json:
        print(json.dumps({"problem": arguments.problem, **record}))
        return
    for name, value in record.items():
        print(f"{name:44} {value:.4g}")


def measure(scenes: list[ScaledProblem]) -> dict[str, float]:
    """Times of every scene, three ways in turn; medians and ratios of sums."""
    model, envelope = McCormick(*scenes[0].size), middle_box(scenes)
    for scene in scenes[:20]:
        model.solve(scene, envelope)
    ours, bare, whole = [], [], []
    for scene in scenes:
        begin = time.perf_counter()
        margin = model.solve(scene, envelope).margin
        ours.append(time.perf_counter() - begin)
        hessian, q, a, b, cones = model.model.bare(p1_values(scene, envelope))
        begin = time.perf_counter()
        solver = clarabel.DefaultSolver(hessian, q, a, b, cones, solver_settings())
        middle = time.perf_counter()
        answer = solver.solve()
        end = time.perf_counter()
        bare.append(end - middle)
        whole.append(end - begin)
        if np.isfinite(margin) and abs(answer.obj_val - margin) > 1e-6:
            raise SystemExit(f"bare and ours disagree: {answer.obj_val} and {margin}")
    return {
        "scenes": float(len(scenes)),
        "ours: ms a solve, median": 1e3 * float(np.median(ours)),
        "ours: solves a second": len(ours) / sum(ours),
        "bare solve: ms, median": 1e3 * float(np.median(bare)),
        "bare set up + solve: ms, median": 1e3 * float(np.median(whole)),
        "ours / bare solve (sums)": sum(ours) / sum(bare),
        "ours / bare set up + solve (sums)": sum(ours) / sum(whole),
        "cvxpy re-solve / ours": cvxpy_resolve(scenes[:20]) / float(np.median(ours)),
    }


def middle_box(scenes: list[ScaledProblem]) -> Envelope:
    """A box of the width that learned envelopes have, about the patches."""
    position = np.stack([scene.vertices.mean(axis=1) for scene in scenes])
    force = np.tile([0.5, 0.0, 0.2], (len(scenes), position.shape[1], 1))
    points: Array = np.concatenate([position, force], axis=2)
    return Envelope(low=points.mean(axis=0) - 0.25, high=points.mean(axis=0) + 0.25)


def cvxpy_resolve(scenes: list[ScaledProblem]) -> float:
    """Median seconds of cvxpy's own re-solve of the same DPP model with Clarabel."""
    model, envelope = McCormick(*scenes[0].size), middle_box(scenes)
    times = []
    for scene in scenes:
        values = p1_values(scene, envelope)
        for parameter in model.problem.parameters():
            parameter.value = np.broadcast_to(values[parameter.name()], parameter.shape)
        begin = time.perf_counter()
        model.problem.solve(solver=cp.CLARABEL, enforce_dpp=True)
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


if __name__ == "__main__":
    main()
