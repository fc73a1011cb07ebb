"""P2 over key frames: back onto the bilinear surface, one patch chosen for every toe.

========== ===================================== ======================= =======================================
name       keeps                                 frees                   source
========== ===================================== ======================= =======================================
fix-p      toes, c and Θ (so p_b)                f                       paper E §IV-A
fix-toes   toes in the world                     f, c, Θ                 convex, as Σ f is fixed
scp        nothing, starts at the toes           all                     fix-toes, then up to 6 linearised steps
========== ===================================== ======================= =======================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicStatus
from ..contact.scaled import side_by_side, skew
from ..contact.terms import Body, Equilibrium, Forces, Residual, Toes, by_stance
from ..scene.course import Weights
from .clock import Clock
from .layout import Layout, one_hot
from .scaled import ScaledCourse
from .terms import Steps, objective

Projection = Literal["fix-p", "fix-toes", "scp"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)
SURFACE = 1e-8
"""Moments this small, non-dimensional, need no further step."""
MOMENT_PRICE = 30.0
"""Of the moments that a linearised step leaves, in units of the objective: large against its own slopes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanPoint:
    """A point in the space of plans, non-dimensional.

    com, rotation: (M, 3); toes: (P, 3); forces: contact frames, a row a bearing, (B, 3); residual: largest component
    of a net moment, inf without an answer; solver_seconds: of the solve that gave it [s].
    """

    com: Array
    rotation: Array
    toes: Array
    forces: Array
    residual: float
    objective: float = float("nan")
    solver_seconds: float = 0.0

    @property
    def found(self) -> bool:
        """Whether there is an answer on the surface."""
        return self.residual <= SURFACE


class HeldToes:
    """The toes held: exact and convex in (c, Θ, f). hold_body: c and Θ, too. soft: least moments, not the objective."""

    def __init__(
        self, layout: Layout, weights: Weights, typical: ScaledCourse, *, hold_body: bool = False, soft: bool = False
    ) -> None:
        body, forces = Body(layout.frames * layout.limbs, layout.frame_of_limbs), Forces(len(layout.bearing[0]))
        equilibrium = Equilibrium(forces.forces.size, layout.balances(3))
        toes = cp.Parameter((layout.placements, 3), name="toes")
        moment, self._soft, self._hold_body = equilibrium.moment(forces.flat(), body), soft, hold_body
        constraints = [equilibrium.of_forces(forces.flat()), forces.in_cones(), *forces.in_box()]
        if hold_body:
            constraints += [
                body.com == cp.Parameter((layout.frames, 3), name="held_com"),
                body.rotation == cp.Parameter((layout.frames, 3), name="held_rotation"),
            ]
        else:
            constraints += [body.within_reach(layout.toe_of_limbs @ toes), *body.within_limits()]
            steps = Steps(layout).limits(body, toes)
            constraints += [term for name, term in steps.items() if name != "toe_step"]
        if soft or hold_body:
            residual = Residual(moment)
            constraints += residual.rows()
            cost = residual.slack
        else:
            constraints.append(moment == 0)
            cost = objective(layout, weights, typical.course.length_scale_m, body, None)
        self._model = ConicModel(
            cp.Problem(cp.Minimize(cost), constraints), equilibrate=_toe_values(typical, _centres(typical))
        )

    def solve(self, scaled: ScaledCourse, toes: Array, start: PlanPoint | None = None) -> PlanPoint:
        """Hold the toes, shape (P, 3), and with ``hold_body`` also c and Θ of ``start``. scaled: one region."""
        values = _toe_values(scaled, toes)
        if start is not None:
            values |= {"held_com": start.com, "held_rotation": start.rotation}
        solution = self._model.solve(values)
        solved = solution.status is ConicStatus.SOLVED
        slack = self._soft or self._hold_body
        return PlanPoint(
            com=self._model.value("com", solution),
            rotation=self._model.value("rotation", solution),
            toes=toes,
            forces=self._model.value("forces", solution),
            residual=float("inf") if not solved else float(self._model.value("residual", solution)) if slack else 0.0,
            objective=solution.objective,
            solver_seconds=solution.seconds,
        )

    @property
    def model(self) -> ConicModel:
        """The compiled model."""
        return self._model


class Linearised:
    """One convex step of SCP: q × F replaced by q̄ × F + (q − q̄) × F̄ about a point (q̄, F̄), in every stance."""

    def __init__(self, layout: Layout, weights: Weights, typical: ScaledCourse) -> None:
        bearings = len(layout.bearing[0])
        body, forces = Body(layout.frames * layout.limbs, layout.frame_of_limbs), Forces(bearings)
        toes = Toes(layout.placements, layout.vertices)
        equilibrium, position = Equilibrium(3 * bearings, layout.balances(3)), toes.position()
        sizes = layout.balances(layout.vertices)[0]  # levers v_u × F̄: a column for every vertex under a bearing
        levers = [cp.Parameter((3, size), name=f"levers_{s}") for s, size in enumerate(sizes)]
        offset = cp.Parameter((3, len(layout.stances)), name="offset")
        of_bearings = cp.vec(one_hot(layout.bearing[2], layout.placements) @ toes.weights, order="C")
        moved = by_stance(levers, of_bearings, sizes)
        residual = Residual(equilibrium.moment(forces.flat(), body) + moved - offset)
        cost = objective(layout, weights, typical.course.length_scale_m, body, position)
        self._model = ConicModel(
            cp.Problem(
                cp.Minimize(cost + MOMENT_PRICE * residual.slack),
                [
                    equilibrium.of_forces(forces.flat()), *residual.rows(), forces.in_cones(), *forces.in_box(),
                    *toes.on_patches(), body.within_reach(layout.toe_of_limbs @ position), *body.within_limits(),
                    *Steps(layout).limits(body, position).values(),
                ],
            ),
            equilibrate=_step_values(typical, _centres(typical), np.tile([1.0 / layout.limbs, 0, 0], (bearings, 1))),
        )  # fmt: skip

    def solve(self, scaled: ScaledCourse, about: PlanPoint) -> PlanPoint:
        """Step from ``about``; the residual is that of the linearised moments. scaled: one region."""
        solution = self._model.solve(_step_values(scaled, about.toes, about.forces))
        solved = solution.status is ConicStatus.SOLVED
        weights = np.maximum(self._model.value("weights", solution), 0.0)
        weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        return PlanPoint(
            com=self._model.value("com", solution),
            rotation=self._model.value("rotation", solution),
            toes=np.matmul(weights[:, None, :], scaled.vertices)[:, 0] if solved else about.toes,
            forces=self._model.value("forces", solution),
            residual=float(self._model.value("residual", solution)) if solved else float("inf"),
            objective=solution.objective,
            solver_seconds=solution.seconds,
        )


class PlanProjector:
    """The projections for one layout of one region, compiled when first used."""

    def __init__(self, layout: Layout, weights: Weights, typical: ScaledCourse) -> None:
        self._args = (layout, weights, typical)
        self._exact: HeldToes | None = None
        self._soft: HeldToes | None = None
        self._fix_p: HeldToes | None = None
        self._step: Linearised | None = None

    def fix_toes(self, scaled: ScaledCourse, start: PlanPoint, clock: Clock) -> PlanPoint:
        """Keep the toes; free f, c and Θ, at the least objective."""
        if self._exact is None:
            with clock.compiling():
                self._exact = HeldToes(*self._args)
        return _counted(self._exact.solve(scaled, start.toes), clock)

    def fix_p(self, scaled: ScaledCourse, start: PlanPoint, clock: Clock) -> PlanPoint:
        """Keep toes, c and Θ; free f (paper E's convex projection)."""
        if self._fix_p is None:
            with clock.compiling():
                self._fix_p = HeldToes(*self._args, hold_body=True)
        point = _counted(self._fix_p.solve(scaled, start.toes, start), clock)
        return replace(point, com=start.com, rotation=start.rotation)

    def scp(self, scaled: ScaledCourse, start: PlanPoint, clock: Clock, *, steps: int = 6) -> PlanPoint:
        """Fix the toes; where they do not hold, step along the linearised surface and fix the new toes."""
        point = self.fix_toes(scaled, start, clock)
        if point.found:
            return point
        if self._soft is None or self._step is None:
            with clock.compiling():
                self._soft, self._step = HeldToes(*self._args, soft=True), Linearised(*self._args)
        held = _counted(self._soft.solve(scaled, start.toes), clock)
        about = held if np.isfinite(held.residual) else start
        for _ in range(steps):
            stepped = _counted(self._step.solve(scaled, about), clock)
            if not np.isfinite(stepped.residual):
                break
            point = self.fix_toes(scaled, stepped, clock)
            if point.found:
                break
            held = _counted(self._soft.solve(scaled, stepped.toes), clock)
            about = held if np.isfinite(held.residual) else stepped
        return point

    def project(self, projection: Projection, scaled: ScaledCourse, start: PlanPoint, clock: Clock) -> PlanPoint:
        """Project by name. scaled: one region."""
        ways = {"fix-p": self.fix_p, "fix-toes": self.fix_toes, "scp": self.scp}
        return ways[projection](scaled, start, clock)


def _counted(point: PlanPoint, clock: Clock) -> PlanPoint:
    clock.count(1, point.solver_seconds)
    return point


def _centres(scaled: ScaledCourse) -> Array:
    return np.asarray(scaled.vertices.mean(axis=1))


def _toe_values(scaled: ScaledCourse, toes: Array) -> dict[str, Array | float]:
    placement = scaled.layout.bearing[2]
    frames = scaled.frames[placement]
    return (
        scaled.values()
        | scaled.force_bounds(len(placement))
        | scaled.layout.split("force_map", side_by_side(frames))
        | scaled.layout.split("moment_map", side_by_side(np.matmul(skew(toes[placement]), frames)))
        | {
            "toes": toes,
            "friction": scaled.friction[placement],
            "held_com": scaled.com,
            "held_rotation": np.zeros_like(scaled.com),
        }
    )


def _step_values(scaled: ScaledCourse, toes: Array, forces: Array) -> dict[str, Array | float]:
    stance, _, placement = scaled.layout.bearing
    world = np.matmul(scaled.frames[placement], forces[..., None])
    offset = np.zeros((len(scaled.layout.stances), 3))
    np.add.at(offset, stance, np.cross(toes[placement], world[..., 0]))  # Σ q̄ × F̄ of every stance
    levers = -np.matmul(skew(world[..., 0])[:, None], scaled.vertices[placement][..., None])[..., 0]  # v_u × F̄
    return _toe_values(scaled, toes) | scaled.layout.split("levers", levers.reshape(-1, 3).T) | {"offset": offset.T}
