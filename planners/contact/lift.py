"""P1 lift: the relaxation that needs no learned box.

With p_w = Σ λ_u v_u and f_u := λ_u f the moment Σ p_w × f is Σ_u v_u × f_u, linear; Σ_u f_u = f holds by definition,
and each f_u lies in the friction cone and in λ_u times the force box. Only toe-in-patch times force is relaxed; the
centre of mass is not, since Σ f is fixed (see ``terms.Equilibrium``). Minimising the moment residual over the lift
gives a lower bound on the residual of the posture problem, and multipliers that prove it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from .project import Point
from .scaled import ScaledProblem, side_by_side, skew
from .terms import Body, Equilibrium, Residual, Toes, friction_cones


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftAnswer:
    """One solve of the lift.

    bound: least moment residual over the relaxation, inf where it is infeasible even without the moment balance.
    multipliers: a certificate's row for this bound, shape (6 + 3N,). The rest is there where the bound is finite:
    toes: shape (N, 3); forces: Σ_u f_u, shape (N, 3); by_vertex: f_u, shape (N, U, 3); weights: λ, shape (N, U).
    solved: False where the solver gave up; then the bound is 0, which proves nothing.
    """

    solved: bool
    bound: float
    multipliers: Array
    toes: Array
    forces: Array
    by_vertex: Array
    weights: Array
    com: Array
    rotation: Array

    @property
    def point(self) -> Point:
        """The answer as a point to project from; only where ``bound`` is finite."""
        return Point(com=self.com, rotation=self.rotation, toes=self.toes, forces=self.forces, residual=self.bound)


class LiftModel:
    """The lift for N contacts and U vertices a patch, compiled.

    whole_box: keep every row of the force box. Where ``ScaledProblem.box_implied`` holds they are implied by the cones
    and the normal-force limit, and the model without them is half the size.
    """

    def __init__(self, contacts: int, vertices: int, *, whole_box: bool) -> None:
        body, toes = Body(contacts), Toes(contacts, vertices)
        lifted = cp.Variable(3 * contacts * vertices, name="lifted")
        by_vertex = cp.reshape(lifted, (contacts * vertices, 3), order="C")
        share = cp.vec(toes.weights, order="C")
        equilibrium = Equilibrium(3 * contacts * vertices)
        friction = cp.Parameter(contacts * vertices, name="friction")
        low = cp.Parameter((contacts * vertices, 3), name="force_min")
        high = cp.Parameter((contacts * vertices, 3), name="force_max")
        residual = Residual(equilibrium.moment(lifted, body))
        balance, reach = equilibrium.of_forces(lifted), body.within_reach(toes.position())
        one, positive = toes.on_patches()
        if whole_box:
            box = [by_vertex[:, k] <= cp.multiply(high[:, k], share) for k in range(3)]
            box += [by_vertex[:, k] >= cp.multiply(low[:, k], share) for k in range(3)]
            box.append(positive)
        else:
            box = [by_vertex[:, 0] <= cp.multiply(high[:, 0], share)]
        constraints = [balance, one, *residual.rows(), friction_cones(by_vertex, friction), *box, reach]
        self._model = ConicModel(
            cp.Problem(cp.Minimize(residual.slack), constraints + body.within_limits()),
            equilibrate=lift_values(ScaledProblem.typical(contacts, vertices)),
            duals={"balance": balance, "above": residual.above, "below": residual.below, "reach": reach},
        )

    def solve(self, scaled: ScaledProblem) -> LiftAnswer:
        """Least moment residual over the lift."""
        return self._read(self._model.solve(lift_values(scaled)), scaled)

    def solve_all(self, scaled: ScaledProblem) -> list[LiftAnswer]:
        """The same of every problem of a batch."""
        solutions = self._model.solve_all(lift_values(scaled), len(scaled.friction))
        return [self._read(solution, scaled.select(k)) for k, solution in enumerate(solutions)]

    def _read(self, solution: ConicSolution, scaled: ScaledProblem) -> LiftAnswer:
        multipliers = self._multipliers(solution, scaled.size[0])
        if solution.status is ConicStatus.INFEASIBLE:
            return _without_point(float("inf"), multipliers, solved=True)
        if solution.status is ConicStatus.FAILED:
            return _without_point(0.0, multipliers, solved=False)
        weights = np.maximum(self._model.value("weights", solution), 0.0)
        weights = weights / weights.sum(axis=1, keepdims=True)
        by_vertex = self._model.value("lifted", solution).reshape(*scaled.size, 3)
        return LiftAnswer(
            solved=True,
            bound=max(0.0, float(self._model.value("residual", solution))),
            multipliers=multipliers,
            toes=np.matmul(weights[:, None, :], scaled.vertices)[:, 0],
            forces=by_vertex.sum(axis=1),
            by_vertex=by_vertex,
            weights=weights,
            com=self._model.value("com", solution),
            rotation=self._model.value("rotation", solution),
        )

    def _multipliers(self, solution: ConicSolution, contacts: int) -> Array:
        """ν_F, ν_M and r of the certificate's Lagrangian, from the solver's duals, in single precision.

        A ray that refutes the lift whatever the moment residual has no ν_M, and any length.
        """
        dual = self._model.dual
        reach = dual("reach", solution)[contacts:].reshape(3, contacts)
        found = np.concatenate(
            [-dual("balance", solution), dual("above", solution) - dual("below", solution), -reach.T.ravel()]
        )
        if solution.status is ConicStatus.INFEASIBLE:
            found[3:6] = 0.0
            found = found / max(float(np.max(np.abs(found))), 1e-300)
        return np.asarray(found.astype(np.float32).astype(np.float64))


def lift_values(scaled: ScaledProblem) -> dict[str, Array | float]:
    """Data of the lift."""
    vertices = scaled.size[1]
    frames = np.repeat(scaled.frames, vertices, axis=-3)  # of every vertex, shape (NU, 3, 3)
    arms = skew(scaled.vertices).reshape(frames.shape)  # [v_u]×
    return scaled.values() | {
        "force_map": side_by_side(frames),
        "moment_map": side_by_side(np.matmul(arms, frames)),
        "friction": np.repeat(scaled.friction, vertices, axis=-1),
        "force_min": np.repeat(scaled.force_min, vertices, axis=0),
        "force_max": np.repeat(scaled.force_max, vertices, axis=0),
    }


def _without_point(bound: float, multipliers: Array, *, solved: bool) -> LiftAnswer:
    none = np.zeros(0)
    return LiftAnswer(
        solved=solved, bound=bound, multipliers=multipliers, toes=none, forces=none, by_vertex=none, weights=none,
        com=none, rotation=none,
    )  # fmt: skip
