"""A task written down as a program, to be solved from many guesses, and what a solve of it
found.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypedDict

import numpy as np

from ..answer.trajectory import STEP_S, Trajectory
from ..arguments import cached_property
from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..files.arrays import Array, checked, read_only
from ..problem.walk import Walk
from ..warp.spline_map import SplineMap
from .charts import CHARTS
from .charts.warped import Shear
from .constraints.dynamics import (
    acceleration,
    cone,
    contact,
    durations,
    dynamics,
    force_rate,
    goal,
    heading_end,
    poised,
    start,
    still_end,
    still_start,
    trunk,
)
from .constraints.feet import SHARE, footing, reach, slope_about, swing
from .method.guess import GuessedWalk, perturbed, terrain_following
from .settings import GaitSettings
from .transcription.program import Callback, Ipopt, Program
from .transcription.taylor import Constraint, Kernels
from .variables import Structure, sampled

Costs = tuple[float, float, float]
"""Weights of the objective ½ w₀ ‖x − x₁‖² + ½ w₁ ∫ acceleration² + ½ w₂ ∫ force rate²
(``constraints.cost``)."""
_CLOSE: Costs = (0.3, 0.0, 0.0)


class SolveOptions(TypedDict, total=False):
    """Options of a solve besides its guess, see ``GaitProgram.solve``."""

    costs: Costs
    reference: Array | None
    height_factor: float
    max_iterations: int | None
    stop_when_feasible: bool


class GaitProgram:
    """A task written down once, to be solved from many guesses (W1, W7).

    Arguments:
        structure: chart, variables and features; nlp: values and derivatives of its terms; guess:
            the terrain-following initial guess, shape (size,); size: number of variables.
            ``formulate`` makes one.
        kernels: as of ``Program``.
    """

    def __init__(
        self,
        task: Walk,
        settings: GaitSettings,
        structure: Structure,
        terms: Sequence[Constraint],
        kernels: Kernels | None = None,
    ) -> None:
        self.task, self.settings, self.structure = task, settings, structure
        self.size = structure.layout.size
        self.nlp = Program(
            structure.layout.size, terms, [acceleration(structure)], force_rate(structure), kernels
        )
        self._ipopt = Ipopt(
            self.nlp, exact=settings.hessian == "exact", tolerance=settings.tolerance
        )

    @cached_property
    def guess(self) -> Array:
        """The terrain-following initial guess, shape (size,)."""
        return read_only(terrain_following(self.structure), (self.size,), "guess")

    def perturbed(self, rng: np.random.Generator, size: float = 0.02) -> Array:
        """The guess with normal noise of this deviation on every variable, shape (size,) [m, rad,
        m·g].
        """
        return perturbed(self.guess, rng, self.structure, size)

    def violations(self, x: Array, parameters: Array | None = None) -> Mapping[str, float]:
        """The largest violation of each term at a decision vector, shape (size,).

        Arguments:
            parameters: of ``Program``, shape (size + 4,); None for the terrain as it is.
        """
        given = np.concatenate([x, np.zeros(3), [1.0]]) if parameters is None else parameters
        return self.nlp.violations(
            np.asarray(self.nlp.constraint(x, given), dtype=np.float64).ravel()
        )

    def build(self, *, costs: Costs = _CLOSE, max_iterations: int | None = None, **_: Any) -> None:
        """Build what ``solve`` needs with these options, so that child processes find it ready."""
        limit = self.settings.max_iterations if max_iterations is None else max_iterations
        self._ipopt.build(costs=any(costs[1:]), max_iterations=limit)

    def solve(
        self,
        guess: Array | None = None,
        callback: Callback | None = None,
        *,
        costs: Costs = _CLOSE,
        reference: Array | None = None,
        height_factor: float = 1.0,
        max_iterations: int | None = None,
        stop_when_feasible: bool = True,
        **options: Any,
    ) -> GaitSolution:
        """Solve from a guess until the first feasible iterate.

        Arguments:
            guess: shape (size,), the program's own if missing. callback(iteration, violation,
                cost): may return True to stop.
            costs: weights of the objective; unless given, the distance from the reference alone
                keeps the answer near.
            reference: x₁, shape (size,), the guess if missing.
            height_factor: on the terrain's heights (homotopy), for charts that have no map of their
                own.
            stop_when_feasible: else IPOPT goes on to its own end or to max_iterations, of the
                settings if missing.
            options: further options of IPOPT.

        Returns:
            The first feasible point or, with ``success`` False, the last.

        Raises:
            InvalidInput: for arrays of another shape and for a height_factor other than 1 in a
                chart with a map.
        """
        checked(height_factor, "height_factor", least=0.0)
        if height_factor != 1.0 and not self.structure.chart.scales:
            raise InvalidInput(
                f"height_factor: expected 1 in the chart {self.settings.chart}, whose map is for "
                "one terrain, "
                f"got {height_factor:g}"
            )
        start = self.guess if guess is None else read_only(guess, (self.size,), "guess")
        parameters = np.concatenate(
            [
                start if reference is None else read_only(reference, (self.size,), "reference"),
                [*costs, height_factor],
            ]
        )
        result = self._ipopt.solve(
            start,
            parameters,
            costs=any(costs[1:]),
            callback=callback,
            stop_when_feasible=stop_when_feasible,
            max_iterations=self.settings.max_iterations
            if max_iterations is None
            else max_iterations,
            options=options,
        )
        return GaitSolution(
            program=self,
            success=result.success,
            iterations=result.iterations,
            history=result.history,
            x=read_only(result.x, (self.size,), "x"),
            violations=self.violations(result.x, parameters),
            status=result.status,
            seconds=result.seconds,
            seconds_evaluating=result.seconds_evaluating,
            seconds_linear=max(result.seconds - result.seconds_evaluating, 0.0),
            height_factor=height_factor,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitSolution:
    """Result of one solve.

    Arguments:
        success: a point of largest violation below the tolerance.
        x: that point, else the last one, shape (size,).
        iterations: of IPOPT until then.
        history: (violation, cost) at every iteration from the guess on.
        violations: by term, at x.
        seconds: CPU time of the solve, in all, in functions and derivatives, and in IPOPT with its
            linear solver.
        status: what IPOPT said.
    """

    program: GaitProgram
    success: bool
    iterations: int
    history: tuple[tuple[float, float], ...]
    x: Array
    violations: Mapping[str, float]
    status: str
    seconds: float
    seconds_evaluating: float
    seconds_linear: float
    height_factor: float = 1.0
    provenance: Mapping[str, str | float] = field(default_factory=dict)

    @property
    def violation(self) -> float:
        """The largest violation of any constraint at x."""
        return max(self.violations.values(), default=0.0)

    def on(self, program: GaitProgram) -> GaitSolution:
        """The point of a gentler terrain as one of the task's own program: a success only if it is
        one there, too.

        Nothing that a gentler terrain accepts is an answer to the task.
        """
        violations = program.violations(self.x)
        success = max(violations.values(), default=0.0) < program.settings.tolerance
        status = self.status if success else f"{self.status}, on a gentler terrain"
        return replace(
            self,
            program=program,
            success=success,
            violations=violations,
            status=status,
            height_factor=1.0,
        )

    def samples(self, times_s: Array) -> Trajectory:
        """The motion at times in [0, T], shape (K,) [s]."""
        return sampled(
            self.program.structure,
            self.x,
            np.asarray(times_s, dtype=np.float64),
            self.height_factor,
        )

    def trajectory(self, dt_s: float = STEP_S) -> Trajectory:
        """The motion in the world frame on a grid of about dt_s, of four samples or more, whatever
        the chart was.

        Equal solves give equal trajectories: no clock is in the provenance. Raises InvalidInput for
        a dt_s that is not above 0 or goes beyond the duration.
        """
        task, settings = self.program.task, self.program.settings
        checked(dt_s, "dt_s", above=0.0, most=task.duration_s)
        steps = max(3, round(task.duration_s / dt_s))
        at = self.samples(np.linspace(0.0, task.duration_s, steps + 1))
        return replace(
            at.asked(still=(True, settings.still_end)),
            provenance={
                "chart": settings.chart,
                "dynamics": settings.dynamics,
                "hessian": settings.hessian,
                "gait": task.gait,
                "timings": task.timings,
                "iterations": float(self.iterations),
                "violation": self.violation,
                **self.provenance,
            },
        )


def terms(structure: Structure) -> list[Constraint]:
    """All constraints, in the order in which violations are reported (W1, W7)."""
    every = [
        dynamics(structure),
        contact(structure),
        cone(structure),
        footing(structure),
        reach(structure),
        swing(structure),
        trunk(structure),
        still_start(structure),
        *start(structure),
        goal(structure),
        heading_end(structure),
        still_end(structure),
        poised(structure),
        durations(structure),
    ]
    return [term for term in every if term is not None]


def formulate(
    task: Walk,
    settings: GaitSettings | None = None,
    warp: SplineMap | Callable[[], SplineMap] | None = None,
    programs: Programs | None = None,
) -> GaitProgram:
    """Write a task down as a program (W1 in the ambient chart, W7 in a warped one).

    >>> plan = formulate(task, GaitSettings(chart="shear")).solve()  # doctest: +SKIP

    Arguments:
        warp: the terrain's map for charts that need it, or what gives it; made by
            ``warp.conformal.flatten`` if missing.
        programs: keep the kernels of programs that differ in their numbers alone.

    Raises:
        InvalidInput: for settings that do not fit the task and for a map of another terrain, and
            PlanningFailed where no map of the terrain can be made.
    """
    settings = sure(task, settings or GaitSettings())

    def flattened() -> SplineMap:
        if warp is None:
            from ..warp.conformal import flatten  # of charts with a map alone

            return flatten(task.terrain)
        return warp if isinstance(warp, SplineMap) else warp()

    chart = CHARTS.get(settings.chart).of(
        task.terrain, smoothing_m=settings.smoothing_m, flattened=flattened
    )
    structure = Structure(task, settings, chart)
    kernels = None if programs is None else programs.get(_kernels, structure.kind)
    return GaitProgram(task, settings, structure, terms(structure), kernels)


def _kernels(kind: Hashable) -> Kernels:
    """None yet."""
    return {}


def sure(task: Walk, settings: GaitSettings) -> GaitSettings:
    """The settings with a share in ``footing``, where they leave that to the task.

    ``SHARE`` where feet that do not stick have sure footing near every place where a straight walk
    would put them, and not all ground is gentle anyway; else 0. Robots that stand on two feet at a
    time and put them on edges fall in simulations of others. Where a hill is as steep as friction
    holds there is nothing else to stand on, and walks are planned as the paper has them.
    """
    if settings.footing is not None:
        return settings
    limit = SHARE * task.friction
    if task.terrain.steepest <= limit or all(task.adhesive):
        return replace(settings, footing=0.0)
    surer = replace(settings, footing=SHARE)
    walk = GuessedWalk(Structure(task, surer, Shear(task.terrain)))
    feet = [walk.footholds(foot)[:, :2] for foot, sticks in enumerate(task.adhesive) if not sticks]
    has = slope_about(task.terrain, np.concatenate(feet)).max() <= limit
    return surer if has else replace(settings, footing=0.0)
