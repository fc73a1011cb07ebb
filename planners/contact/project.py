"""P2: back onto the bilinear surface m = p·f, from a point of a relaxation.

Each projection keeps one part of the point and solves a convex problem, or a few, for the rest:

========== =========================== ====================== ==============================================
name       keeps                       frees                  source
========== =========================== ====================== ==============================================
fix-p      p (toes relative to body)   f                      paper E §IV-A, "we use p_b from P1 to solve f"
fix-f      f                           toes, c, Θ             paper E §II
fix-toes   toes in the world           f, c, Θ                convex as Σ f is fixed (``terms.Equilibrium``)
scp        nothing, starts at the toes all                    fix-toes, then up to 4 linearised steps
nlp        nothing, starts at point    all                    paper E §IV-A, ``nlp.py``
========== =========================== ====================== ==============================================
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from .scaled import ScaledProblem, side_by_side, skew
from .terms import Body, Equilibrium, Forces, Residual, Toes

SURFACE = 1e-7
"""A point this close to the bilinear surface (non-dimensional moment residual) needs no further step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A point in the space of postures, non-dimensional; on the bilinear surface where ``residual`` is about zero.

    com, rotation: shape (3,); toes, forces (contact frames): shape (N, 3); residual: largest component of the net
    moment, inf where the projection has no answer; solves: convex problems solved to get here.
    """

    com: Array
    rotation: Array
    toes: Array
    forces: Array
    residual: float
    solves: int = 0


class FixToes:
    """Least moment residual with the toes held: exact and convex in (c, Θ, f)."""

    def __init__(self, contacts: int, *, hold_body: bool = False) -> None:
        body, forces, equilibrium = Body(contacts), Forces(contacts), Equilibrium(3 * contacts)
        toes = cp.Parameter((contacts, 3), name="toes")
        residual = Residual(equilibrium.moment(forces.flat(), body))
        constraints = [equilibrium.of_forces(forces.flat()), *residual.rows(), forces.in_cones(), *forces.in_box()]
        if hold_body:
            held = cp.Parameter(3, name="held_com")
            constraints += [body.com == held, body.rotation == 0.0]
        else:
            constraints += [body.within_reach(toes), *body.within_limits()]
        typical = ScaledProblem.typical(contacts, 3)
        self._hold_body = hold_body
        self._model = ConicModel(
            cp.Problem(cp.Minimize(residual.slack), constraints),
            equilibrate=_toe_values(typical, typical.vertices.mean(axis=1)) | {"held_com": typical.com},
        )

    def solve(self, scaled: ScaledProblem, toes: Array, start: Point | None = None) -> Point:
        """Hold the toes, shape (N, 3). With ``hold_body`` also c and Θ of ``start``, so that p_b is held (fix-p)."""
        values = _toe_values(scaled, toes)
        if self._hold_body and start is not None:
            values["held_com"] = start.com
        solution = self._model.solve(values)
        point = _point(self._model, solution, toes=toes)
        if self._hold_body and start is not None:
            return Point(
                com=start.com,
                rotation=start.rotation,
                toes=toes,
                forces=point.forces,
                residual=point.residual,
                solves=1,
            )
        return point


    def solve_all(self, scaled: ScaledProblem, toes: Array) -> list[Point]:
        """Hold the toes of every problem of a batch, shape (B, N, 3), the body free."""
        solutions = self._model.solve_all(_toe_values(scaled, toes), len(toes))
        return [_point(self._model, solution, toes=held) for solution, held in zip(solutions, toes, strict=True)]


class FixForces:
    """Least moment residual with the contact-frame forces held (fix-f): convex in toes, c and Θ."""

    def __init__(self, contacts: int, vertices: int) -> None:
        body, toes = Body(contacts), Toes(contacts, vertices)
        levers = cp.Parameter((3, contacts * vertices), name="levers")
        weight = cp.Parameter(name="weight")
        moment = levers @ cp.vec(toes.weights, order="C") - weight * body.weight_moment()
        residual = Residual(moment)
        typical = ScaledProblem.typical(contacts, vertices)
        self._model = ConicModel(
            cp.Problem(
                cp.Minimize(residual.slack),
                [*residual.rows(), *toes.on_patches(), body.within_reach(toes.position()), *body.within_limits()],
            ),
            equilibrate=_lever_values(typical, np.tile([1.0 / contacts, 0.0, 0.0], (contacts, 1))),
        )

    def solve(self, scaled: ScaledProblem, start: Point) -> Point:
        """Hold the forces of ``start``."""
        solution = self._model.solve(_lever_values(scaled, start.forces))
        return _point(self._model, solution, scaled=scaled, forces=start.forces)


class Linearised:
    """One convex step of SCP: q × F replaced by q̄ × F + (q − q̄) × F̄ about a point (q̄, F̄)."""

    def __init__(self, contacts: int, vertices: int) -> None:
        body, toes, forces = Body(contacts), Toes(contacts, vertices), Forces(contacts)
        equilibrium = Equilibrium(3 * contacts)
        levers = cp.Parameter((3, contacts * vertices), name="levers")
        offset = cp.Parameter(3, name="offset")
        moment = equilibrium.moment(forces.flat(), body) + levers @ cp.vec(toes.weights, order="C") - offset
        residual = Residual(moment)
        typical = ScaledProblem.typical(contacts, vertices)
        start = np.tile([1.0 / contacts, 0.0, 0.0], (contacts, 1))
        self._model = ConicModel(
            cp.Problem(
                cp.Minimize(residual.slack),
                [
                    equilibrium.of_forces(forces.flat()), *residual.rows(), forces.in_cones(), *forces.in_box(),
                    *toes.on_patches(), body.within_reach(toes.position()), *body.within_limits(),
                ],
            ),
            equilibrate=_step_values(typical, typical.vertices.mean(axis=1), start),
        )  # fmt: skip

    def solve(self, scaled: ScaledProblem, about: Point) -> Point:
        """Step from ``about``; the residual is that of the linearised moment."""
        return _point(self._model, self._model.solve(_step_values(scaled, about.toes, about.forces)), scaled=scaled)


class Projector:
    """The convex projections for N contacts and U vertices a patch, compiled when first used."""

    def __init__(self, contacts: int, vertices: int) -> None:
        self._size = (contacts, vertices)
        self._fix_toes = FixToes(contacts)
        self._step: Linearised | None = None
        self._fix_p: FixToes | None = None
        self._fix_f: FixForces | None = None

    def fix_toes(self, scaled: ScaledProblem, start: Point) -> Point:
        """Keep the toes; free f, c and Θ."""
        return self._fix_toes.solve(scaled, start.toes)

    def fix_p(self, scaled: ScaledProblem, start: Point) -> Point:
        """Keep p_b, the toes relative to the body; free f (paper E's convex projection)."""
        self._fix_p = self._fix_p or FixToes(self._size[0], hold_body=True)
        return self._fix_p.solve(scaled, start.toes, start)

    def fix_f(self, scaled: ScaledProblem, start: Point) -> Point:
        """Keep f; free the toes, c and Θ."""
        self._fix_f = self._fix_f or FixForces(*self._size)
        return self._fix_f.solve(scaled, start)

    def fix_all_toes(self, scaled: ScaledProblem, toes: Array) -> list[Point]:
        """``fix_toes`` of every problem of a batch; toes: shape (B, N, 3)."""
        return self._fix_toes.solve_all(scaled, toes)

    def scp(self, scaled: ScaledProblem, start: Point, *, steps: int = 4, worth: float = np.inf) -> Point:
        """Fix the toes; while that leaves a moment, step along the linearised surface and fix the new toes.

        worth: where the start's toes leave more than this moment residual, no step is taken.
        """
        self._step = self._step or Linearised(*self._size)
        best = self._fix_toes.solve(scaled, start.toes)
        point, solves = best, 1
        for _ in range(steps):
            if not SURFACE < best.residual <= worth or not np.isfinite(point.residual):
                break
            stepped = self._step.solve(scaled, point)
            solves += 1
            if not np.isfinite(stepped.residual):
                break
            point = self._fix_toes.solve(scaled, stepped.toes)
            solves += 1
            best = point if point.residual < best.residual else best
        return Point(
            com=best.com, rotation=best.rotation, toes=best.toes, forces=best.forces, residual=best.residual,
            solves=solves,
        )  # fmt: skip


def _toe_values(scaled: ScaledProblem, toes: Array) -> dict[str, Array | float]:
    return scaled.values() | {"toes": toes, "moment_map": side_by_side(np.matmul(skew(toes), scaled.frames))}


def _lever_values(scaled: ScaledProblem, forces: Array) -> dict[str, Array | float]:
    world = np.matmul(scaled.frames, forces[..., None])[..., 0]
    levers = -np.matmul(skew(world)[:, None], scaled.vertices[..., None])[..., 0]  # v_u × F̄, shape (N, U, 3)
    return scaled.values() | {"levers": levers.reshape(-1, 3).T}


def _step_values(scaled: ScaledProblem, toes: Array, forces: Array) -> dict[str, Array | float]:
    world = np.matmul(scaled.frames, forces[..., None])
    offset = np.matmul(skew(toes), world)[..., 0].sum(axis=0)  # Σ q̄ × F̄
    return _lever_values(scaled, forces) | _toe_values(scaled, toes) | {"offset": offset}


def _point(
    model: ConicModel,
    solution: ConicSolution,
    *,
    scaled: ScaledProblem | None = None,
    toes: Array | None = None,
    forces: Array | None = None,
) -> Point:
    """Read a point off a solution: what was not held is taken from the model's variables."""
    solved = solution.status is ConicStatus.SOLVED
    if toes is None and scaled is not None:
        weights = np.maximum(model.value("weights", solution), 0.0) if solved else np.ones(scaled.size)
        weights = weights / weights.sum(axis=1, keepdims=True)
        toes = np.matmul(weights[:, None, :], scaled.vertices)[:, 0]
    assert toes is not None
    if forces is None:
        forces = model.value("forces", solution) if solved else np.zeros_like(toes)
    return Point(
        com=model.value("com", solution) if solved else np.zeros(3),
        rotation=model.value("rotation", solution) if solved else np.zeros(3),
        toes=toes,
        forces=forces,
        residual=max(0.0, float(model.value("residual", solution))) if solved else float("inf"),
        solves=1,
    )
