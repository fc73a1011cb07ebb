"""The gait program of a task: a short list of terms over a chart (paper W eqs. 1 and 7)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.arrays import Array, frozen
from .charts.chart import Chart, make_chart
from .constraints.cone import cone
from .constraints.contact import contact
from .constraints.cost import acceleration, force_rate
from .constraints.dynamics import dynamics
from .constraints.ends import goal, start, still_end, still_start
from .constraints.reach import reach
from .constraints.swing import swing
from .constraints.trunk import trunk
from .method.guess import perturbed, terrain_following
from .task import GaitSettings, GaitTask
from .transcription.program import Program
from .variables.structure import Structure
from .variables.timing import ordered

if TYPE_CHECKING:
    from ..warp.spline_map import SplineMap
    from .solution import GaitSolution
    from .transcription.ipopt import Costs


class GaitProgram:
    """A task written down once, to be solved from many guesses.

    structure: chart, variables and signals. program: values and derivatives. guess: the terrain-following initial
    guess, shape (size,).
    """

    def __init__(self, task: GaitTask, settings: GaitSettings, chart: Chart) -> None:
        self.task, self.settings = task, settings
        self.structure = Structure(task, settings, chart)
        self.program = Program(
            self.structure.layout.size, constraints(self.structure), [acceleration(self.structure)],
            force_rate(self.structure),
        )  # fmt: skip
        self._solvers: dict[Any, Any] = {}

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.structure.layout.size

    @cached_property
    def guess(self) -> Array:
        """The terrain-following initial guess, shape (size,)."""
        return frozen(terrain_following(self.structure), (self.size,), "guess")

    def perturbed(self, rng: np.random.Generator, size: float = 0.02) -> Array:
        """The guess with normal noise of this deviation on every variable, shape (size,) [m, rad, m·g]."""
        return perturbed(self.guess, rng, self.structure, size)

    def violations(self, x: Array) -> Mapping[str, float]:
        """The largest violation of each term at a decision vector."""
        from .transcription.ipopt import constraint_values

        return self.program.violations(constraint_values(self, x))

    def solve(
        self,
        guess: Array | None = None,
        callback: Callable[[int, float, float], bool | None] | None = None,
        *,
        costs: Costs | None = None,
        reference: Array | None = None,
        height_factor: float = 1.0,
        max_iterations: int | None = None,
        stop_when_feasible: bool = True,
        **options: Any,
    ) -> GaitSolution:
        """Solve from a guess; see ``solve.solve``."""
        from .transcription.ipopt import solve

        return solve(
            self, guess, callback, costs=costs, reference=reference, height_factor=height_factor,
            max_iterations=max_iterations, stop_when_feasible=stop_when_feasible, options=options,
        )  # fmt: skip


def constraints(structure: Structure) -> list[Any]:
    """All terms, in the order in which violations are reported."""
    found = [
        dynamics(structure),
        contact(structure),
        cone(structure),
        reach(structure),
        *swing(structure),
        trunk(structure),
        still_start(structure),
        *start(structure),
        goal(structure),
        still_end(structure),
        ordered(structure),
    ]
    return [term for term in found if term is not None]


def formulate(task: GaitTask, settings: GaitSettings | None = None, warp: SplineMap | None = None) -> GaitProgram:
    """Write a task down. warp: the terrain's map for the warped charts; made by ``warp.conformal.flatten`` if missing.

    Raises InvalidInput for settings that do not fit the task.
    """
    settings = settings or GaitSettings()
    return GaitProgram(task, settings, make_chart(settings.chart, task.terrain, settings.smoothing_m, warp))
