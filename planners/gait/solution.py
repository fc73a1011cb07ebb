"""What a solve found, and the motion that it stands for, in world quantities at any time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array, checked
from .trajectory import STEP_S, Trajectory
from .transcription.taylor import JetMap, Site

if TYPE_CHECKING:
    from .formulation import GaitProgram
    from .variables.structure import Structure


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitSolution:
    """What one solve found.

    success: a point of largest violation below the tolerance; x: that point, else the last one, shape (size,).
    iterations: of IPOPT until then. history: (violation, cost) at every iteration from the guess on. violations: by
    term, at x. seconds: CPU time of the solve, in all, in functions and derivatives, and in IPOPT with its linear
    solver. status: what IPOPT said.
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
        """The point of a gentler terrain as one of the task's own program: a success only if it is one there, too.

        Nothing that a gentler terrain accepts is an answer to the task.
        """
        violations = program.violations(self.x)
        success = max(violations.values(), default=0.0) < program.settings.tolerance
        status = self.status if success else f"{self.status}, on a gentler terrain"
        return replace(self, program=program, success=success, violations=violations, status=status, height_factor=1.0)

    def samples(self, times_s: Array) -> Samples:
        """The motion at times in [0, T], shape (K,) [s]."""
        return sampled(self.program.structure, self.x, np.asarray(times_s, dtype=np.float64), self.height_factor)

    def trajectory(self, dt_s: float = STEP_S) -> Trajectory:
        """The motion in the world frame on a grid of about dt_s, of three samples or more, whatever the chart was.

        Equal solves give equal trajectories: no clock is in the provenance. Raises InvalidInput for a dt_s that is not
        above 0 or goes beyond the duration.
        """
        task, settings = self.program.task, self.program.settings
        checked(dt_s, "dt_s", above=0.0, most=task.duration_s)
        steps = max(2, round(task.duration_s / dt_s))
        at = self.samples(np.linspace(0.0, task.duration_s, steps + 1))
        return Trajectory(
            times_s=at.times_s,
            torso_m=at.torso_m,
            rotation=at.rotation,
            feet_m=at.feet_m,
            forces_n=at.forces_n,
            contact=at.contact,
            robot=task.robot,
            terrain=task.terrain if self.height_factor == 1.0 else task.terrain.scaled(self.height_factor),
            friction=task.friction,
            adhesive=np.array(task.adhesive),
            start_xy_m=task.start_xy_m,
            goal_xy_m=task.goal_xy_m,
            provenance={
                "chart": settings.chart, "dynamics": settings.dynamics, "hessian": settings.hessian,
                "gait": task.gait, "timings": task.timings, "iterations": float(self.iterations),
                "violation": self.violation, **self.provenance,
            },
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A motion at K times: torso p_WB (K, 3) [m], R_WB (K, 3, 3), feet p_WF (K, E, 3) [m], contact forces f_W (K, E, 3)
    [N], and which feet stand (K, E), bool."""

    times_s: Array
    torso_m: Array
    rotation: Array
    feet_m: Array
    forces_n: Array
    contact: NDArray[np.bool_]


def sampled(structure: Structure, x: Array, times_s: Array, height_factor: float = 1.0) -> Samples:
    """Evaluate a decision vector at times, shape (K,) [s]."""
    layout, push = structure.layout.timed(x), Pushforward(structure, height_factor)
    torso_m, rotation = push.torso((layout.torso_rows(times_s) @ x).reshape(-1, 6))
    feet: list[Array] = []
    forces: list[Array] = []
    contact: list[NDArray[np.bool_]] = []
    for foot, entries in enumerate(layout.feet):
        place = (layout.foot_rows(foot, times_s) @ x).reshape(-1, 3)
        force = (layout.force_rows(foot, times_s) @ x).reshape(-1, 3)
        p_i, f_i = push.foot(place, force)
        feet, forces = [*feet, p_i], [*forces, f_i * structure.task.robot.weight_n]
        contact.append(entries.phases.stands(times_s))
    return Samples(
        times_s=times_s, torso_m=torso_m, rotation=rotation, feet_m=np.stack(feet, axis=1),
        forces_n=np.stack(forces, axis=1), contact=np.stack(contact, axis=1),
    )  # fmt: skip


class Pushforward:
    """A chart as functions of numbers."""

    def __init__(self, structure: Structure, height_factor: float = 1.0) -> None:
        self._chart, self._factor = structure.chart, height_factor

    def torso(self, bar: Array) -> tuple[Array, Array]:
        """(p̄, θ̄), shape (K, 6), to p_WB (K, 3) [m] and R_WB (K, 3, 3)."""
        p, r = self._torso.map(len(bar))(bar.T)
        return np.asarray(p).T, np.asarray(r).T.reshape(-1, 3, 3).swapaxes(1, 2)

    def foot(self, bar: Array, force: Array) -> tuple[Array, Array]:
        """p̄_i and f̄_i, shape (K, 3), to p_i (K, 3) [m] and f_i (K, 3)."""
        p, f = self._foot.map(len(bar))(bar.T, force.T)
        return np.asarray(p).T, np.asarray(f).T

    @cached_property
    def _torso(self) -> cs.Function:
        bar = cs.SX.sym("y", 6)
        site, jets = self._site(self._chart.torso_map, bar)
        p, r = self._chart.torso(bar, site)
        return self._evaluated(self._chart.torso_map, [bar], jets, [p, cs.vec(r)])

    @cached_property
    def _foot(self) -> cs.Function:
        bar, force = cs.SX.sym("p", 3), cs.SX.sym("f", 3)
        site, jets = self._site(self._chart.foot_map, bar)
        p, f = self._chart.foot(bar, site), self._chart.force(force, bar, site)
        return self._evaluated(self._chart.foot_map, [bar, force], jets, [p, f])

    @staticmethod
    def _site(chart_map: JetMap | None, bar: cs.SX) -> tuple[Site | None, cs.SX]:
        if chart_map is None:
            return None, cs.SX(0, 1)
        jet, point = cs.SX.sym("j", chart_map.size(1)), bar[: chart_map.inputs]
        return Site(chart_map.polynomial(1), point, point, jet), jet

    def _evaluated(
        self, chart_map: JetMap | None, inputs: list[cs.SX], jets: cs.SX, outputs: list[cs.SX]
    ) -> cs.Function:
        kernel = cs.Function("chart", [*inputs, jets], [cs.densify(output) for output in outputs])
        if chart_map is None:
            jet = cs.MX(0, 1)
            symbols = [cs.MX.sym("v", one.shape[0]) for one in inputs]
        else:
            symbols = [cs.MX.sym("v", one.shape[0]) for one in inputs]
            jet = chart_map.jet(1)(symbols[0][: chart_map.inputs])
            jet = jet * self._factor if chart_map.homogeneous else jet
        return cs.Function("pushforward", symbols, list(kernel(*symbols, jet)))
