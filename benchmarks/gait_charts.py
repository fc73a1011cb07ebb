"""Charts of the gait optimiser beside each other on the reference terrains, from perturbed guesses
(DESIGN §8).

    python benchmarks/gait_charts.py [--terrains ripple cone hill pit] [--charts decoupled
    warped-exact warped ambient]
        [--tasks 0 5 10] [--seeds 3] [--settings torso_knot_s=.05] [--ipopt mu_oracle=probing]
        [--proximal .3]

Every solve begins at the terrain-following guess with normal noise of .02 (metres, radians, m·g) on
every variable; seed 0 is the guess itself. The robot heads for its goal from the start. All charts
share one set of options. One line a solve, then one line for each terrain and chart: how many were
feasible (violation below 1e-4) within the iterations and seconds allowed, how many the verifier
accepted; then quartiles, over the feasible ones, of iterations, CPU seconds, the force residual
between the nodes [m·g] and the peak acceleration [g].
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from _bench import Options, launch

from stancekit.planners.answer.report import Report
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.gait.formulation import formulate
from stancekit.planners.gait.gait_program import Costs, GaitProgram, GaitSolution
from stancekit.planners.gait.method.subprocess import solve_in_subprocess
from stancekit.planners.gait.task import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.reference import reference_tasks, reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.warp.conformal import flatten

PATIENCE = 10.0
"""A solve is ended from outside after this many times its CPU time, by the clock on the wall."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One solve; figures are None for one that gave no answer in time."""

    solution: GaitSolution | None
    report: Report[Trajectory] | None

    @property
    def feasible(self) -> bool:
        """Success as in the paper."""
        return self.solution is not None and self.solution.success

    @property
    def verified(self) -> bool:
        """Success, and the verifier accepts what is between the nodes, too."""
        return self.feasible and self.report is not None and self.report.accepted

    def text(self) -> str:
        """What is said of it in one line."""
        if self.solution is None or self.report is None:
            return "no answer in time"
        said = f"{self.solution.iterations:4d} it {self.solution.seconds:7.2f} CPU-s  "
        if not self.feasible:
            worst = max(self.solution.violations.items(), key=lambda pair: pair[1])
            return said + f"not feasible: {worst[0]} {worst[1]:.1e}"
        return said + f"F rms {self.report.figures['force_rms']:.3f}  {self.report.message[:110]}"


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which solves, and with what."""

    terrains: tuple[str, ...] = ("ripple", "cone", "hill", "pit")
    charts: tuple[str, ...] = ("decoupled", "warped-exact", "warped", "ambient")
    tasks: tuple[int, ...] = (0, 5, 10)
    seeds: int = 3
    noise: float = 0.02
    iterations: int = 200
    seconds: float = 60.0
    """CPU time of one solve."""
    proximal: float = Costs.proximal
    settings: tuple[str, ...] = ()
    """NAME=NUMBER."""
    ipopt: tuple[str, ...] = ()
    """NAME=VALUE."""


def main(arguments: Arguments) -> None:
    """Measure and print."""
    settings, ipopt = pairs(arguments.settings), pairs(arguments.ipopt)
    lines = []
    for terrain in arguments.terrains:
        field, tasks = reference_terrain(terrain), reference_tasks(terrain)
        warp = lru_cache(maxsize=1)(partial(flatten, field))
        for chart in arguments.charts:
            cells = []
            for number in [task for task in arguments.tasks if task < len(tasks)]:
                one = tasks[number]
                ahead = one.goal_xy_m - one.start_xy_m
                task = Walk(
                    robot=anymal(),
                    terrain=field,
                    start_xy_m=one.start_xy_m,
                    goal_xy_m=one.goal_xy_m,
                    adhesive=one.adhesive,
                    start_yaw_rad=float(np.arctan2(ahead[1], ahead[0])),
                )
                program = formulate(task, GaitSettings(chart=chart, **settings), warp)
                for seed in range(arguments.seeds):
                    cells.append(
                        solved(program, 1000 * number + seed if seed else None, arguments, ipopt)
                    )
                    print(
                        f"{terrain:7} {chart:12} task {number:2d} seed {seed}  {cells[-1].text()}",
                        flush=True,
                    )
            lines.append(summary(terrain, chart, cells))
    print("\n".join(lines))


def solved(
    program: GaitProgram, seed: int | None, arguments: Arguments, ipopt: dict[str, Any]
) -> Cell:
    """One solve in a child process, and the verifier's word."""
    guess = (
        None if seed is None else program.perturbed(np.random.default_rng(seed), arguments.noise)
    )
    try:
        found = solve_in_subprocess(
            program,
            guess,
            time_limit_s=PATIENCE * arguments.seconds,
            costs=Costs(proximal=arguments.proximal),
            max_iterations=arguments.iterations,
            max_cpu_time=arguments.seconds,
            **ipopt,
        )
    except PlanningFailed:
        return Cell(solution=None, report=None)
    return Cell(solution=found, report=check_trajectory(found.trajectory()))


def summary(terrain: str, chart: str, cells: list[Cell]) -> str:
    """One row of the table."""
    good = [cell for cell in cells if cell.feasible]
    said = f"{terrain:7} {chart:12} feasible {len(good):2d}/{len(cells)}  verified {sum(c.verified for c in cells):2d}"

    def quartiles(name: str, values: list[float], digits: int) -> str:
        low, middle, high = np.percentile(values, [25, 50, 75])
        return f"  {name} {low:.{digits}f}/{middle:.{digits}f}/{high:.{digits}f}"

    if not good:
        return said
    solutions = [cell.solution for cell in good if cell.solution is not None]
    figures = [cell.report.figures for cell in good if cell.report is not None]
    return (
        said
        + quartiles("it", [one.iterations for one in solutions], 0)
        + quartiles("CPU-s", [one.seconds for one in solutions], 1)
        + quartiles("F rms", [one["force_rms"] for one in figures], 3)
        + quartiles("peak", [one["peak_acceleration_g"] for one in figures], 2)
        + f"  outside the true cone {100.0 * max(one['outside_cone'] for one in figures):.1f} %"
    )


def pairs(words: Iterable[str]) -> dict[str, Any]:
    """NAME=VALUE words; values that are numbers become numbers."""
    found: dict[str, Any] = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            number = float(text)
            found[name] = (
                int(number)
                if number.is_integer() and "." not in text and "e" not in text
                else number
            )
        except ValueError:
            found[name] = text
    return found


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
