"""One attempt at a gait task: a chart, a homotopy in the terrain's height, an initial guess; and
the verifier's word.

What a portfolio is made of, and what ``stancekit/WarpedGait-v0`` chooses among.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ...answer.report import Report
from ...answer.trajectory import STEP_S, Trajectory
from ...equilibrium.programs import Programs
from ...files.arrays import Array
from ...problem.walk import Walk
from ...verify.trajectories import check_trajectory
from ...warp.conformal import flatten
from ...warp.spline_map import SplineMap
from ..charts import CHARTS
from ..gait_program import GaitProgram, GaitSolution, formulate, sure
from ..settings import GaitSettings

Progress = Callable[["Attempt", int, float, float, str], "bool | None"]
"""Called at every iteration with the attempt, the iteration over all its solves, the largest
violation, the cost and the phase, ``feasible``, ``smooth`` or ``densify``, after "piece 2 of 9, "
where there are some; may return True to stop."""
Homotopy = Literal["height", "smoothing"]
"""Way to make a terrain gentler: lower heights, or a Gaussian."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Method of solving a task.

    Arguments:
        chart: a name of ``charts.CHARTS`` or ``FILE.py:NAME``.
        heights: factors on the terrain's gradients, solved one after another, the last is 1.
        by: whether factors below 1 scale the heights, or are what a Gaussian leaves of the steepest
            gradient.
        noise: deviation of what is added to every variable of the terrain-following guess [m, rad,
            m·g].
    """

    chart: str = "decoupled"
    heights: tuple[float, ...] = (1.0,)
    by: Homotopy = "height"
    noise: float = 0.0
    seed: int = 0

    def perturbed(self, seed: int, noise: float = 0.02) -> Attempt:
        """Attempt from a perturbed guess."""
        return replace(self, seed=seed, noise=noise)

    def guess(self, program: GaitProgram) -> Array:
        """Guess for a program, shape (size,): the terrain-following one, with noise where there is
        any.
        """
        if not self.noise:
            return program.guess
        return program.perturbed(np.random.default_rng(self.seed), self.noise)

    @property
    def name(self) -> str:
        """Name in tables and files."""
        words = [self.chart]
        if len(self.heights) > 1:
            words.append(
                f"{len(self.heights)} {'heights' if self.by == 'height' else 'smoothings'}"
            )
        if self.noise:
            words.append(f"seed {self.seed}")
        return ", ".join(words)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempted:
    """Result of an attempt.

    Arguments:
        solution: of its last stage.
        iterations, seconds: of all stages, CPU time.
        history: the largest violation at every iterate.
        trajectory, report: of the point it ended at, feasible or not.
    """

    attempt: Attempt
    solution: GaitSolution
    trajectory: Trajectory
    report: Report[Trajectory]
    iterations: int
    seconds: float
    history: Array

    @property
    def verified(self) -> bool:
        """Tell whether the solve succeeded and the verifier accepted."""
        return self.solution.success and self.report.accepted


class Workbench:
    """A task with what has been written down for it: a program a chart, and the map of the terrain.

    One thread at a time may use it. A copy (deepcopy, pickle) has the map, and writes its own
    programs.

    Arguments:
        kept: as of ``formulate``.
    """

    def __init__(
        self,
        task: Walk,
        settings: GaitSettings | None = None,
        warp: SplineMap | None = None,
        kept: Programs | None = None,
    ) -> None:
        self.task, self.settings, self.warp = task, sure(task, settings or GaitSettings()), warp
        self._kept = kept
        self._programs: dict[str, GaitProgram] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_programs": {}}

    def program(self, chart: str) -> GaitProgram:
        """The task in this chart, written down once.

        Raises InvalidInput, and PlanningFailed for a map that folds.
        """
        if chart not in self._programs:
            self._programs[chart] = formulate(
                self.task, replace(self.settings, chart=chart), self._flattened, self._kept
            )
        return self._programs[chart]

    def _flattened(self) -> SplineMap:
        """The terrain's map, made once for all charts that need it."""
        if self.warp is None:
            self.warp = flatten(self.task.terrain)
        return self.warp

    def run(self, attempt: Attempt, progress: Progress | None = None) -> Attempted:
        """Solve stage by stage, each from the last one's point, and verify what comes out. A chart
        with a map has no heights but 1, and no Gaussian is used here.
        """
        program = self.program(attempt.chart)
        heights = (
            attempt.heights
            if CHARTS.get(attempt.chart).scales and attempt.by == "height"
            else (1.0,)
        )
        x = attempt.guess(program)
        history: list[float] = []
        seconds, stages, stopped = 0.0, 0, False

        def on_iterate(_iteration: int, violation: float, cost: float) -> bool:
            nonlocal stopped
            history.append(violation)
            stopped = bool(
                progress and progress(attempt, len(history) - 1, violation, cost, "feasible")
            )
            return stopped

        for factor in heights:
            solution = program.solve(x, on_iterate, height_factor=factor)
            x, seconds, stages = solution.x, seconds + solution.seconds, stages + 1
            if stopped:
                break
        solution = solution if solution.height_factor == 1.0 else solution.on(program)
        provenance = self.provenance(attempt, solution, iterations=solution.iterations)
        trajectory = replace(solution.trajectory(STEP_S), provenance=provenance)
        return Attempted(
            attempt=attempt,
            solution=solution,
            trajectory=trajectory,
            report=check_trajectory(trajectory),
            iterations=max(len(history) - stages, 0),
            seconds=seconds,
            history=np.array(history),
        )

    def provenance(
        self, attempt: Attempt, solution: GaitSolution, iterations: int
    ) -> dict[str, Any]:
        """Provenance that a trajectory carries, without clock times."""
        return {
            "chart": attempt.chart,
            "heights": " ".join(f"{factor:g}" for factor in attempt.heights),
            "noise": attempt.noise,
            "seed": float(attempt.seed),
            "gait": self.task.gait,
            "timings": self.task.timings,
            "dynamics": self.settings.dynamics,
            "hessian": self.settings.hessian,
            "footing": float(self.settings.footing or 0.0),
            "largest_violation": solution.violation,
            "iterations": float(iterations),
        }
