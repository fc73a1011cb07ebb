"""P1 lift over key frames: the relaxation of ``contact.lift``, a piece for every limb, stance and candidate patch.

With λ_{r,u} over the vertices of all candidates r of a toe, z_r = Σ_u λ_{r,u}, and f_{r,u} := λ_{r,u} f in the friction
cone of μ_r: the convex hull of "one of the patches" comes with the lift. Binary z make it the region choice.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from ..contact.terms import Body, Residual, Toes
from ..scene.course import Weights
from .layout import Index, Layout
from .scaled import ScaledCourse
from .terms import Candidates, LiftedForces, Steps, objective


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftedPlan:
    """One solve of the lift over a course.

    status: INFEASIBLE with a ray that refutes the relaxation, and so the course. shares: z of every slot, (P, R).
    toes: by slot, where the slot's share of the toe stands, (P, R, 3). forces: in world axes, a row a bearing, (B, 3).
    residual: of the moments, 0 where they are hard.
    """

    status: ConicStatus
    solution: ConicSolution
    objective: float
    com: Array
    rotation: Array
    shares: Array
    toes: Array
    forces: Array
    residual: float

    def rounded(self) -> tuple[Index, Array]:
        """The candidate of the largest share for every placement, and the toe on it; shapes (P,), (P, 3)."""
        choice = np.asarray(self.shares.argmax(axis=1), dtype=np.int_)
        return choice, self.toes[np.arange(len(choice)), choice]


class LiftedCourse:
    """The lift for one layout, compiled.

    soft: minimise the largest component of the net moments instead, for which there is an answer nearly always.
    """

    def __init__(self, layout: Layout, weights: Weights, length_m: float, typical: ScaledCourse, *, soft: bool) -> None:
        self._layout = layout
        body = Body(layout.frames * layout.limbs, layout.frame_of_limbs)
        toes = Toes(layout.slots, layout.vertices, layout.toe_of_slots)
        forces, position = LiftedForces(layout, toes), toes.position()
        named: dict[str, cp.Constraint] = {
            "balance": forces.balance(),
            "reach": body.within_reach(layout.toe_of_limbs @ position),
            **Steps(layout).limits(body, position),
        }
        moment = forces.moment(body, layout.frame_of_stances)
        constraints = [
            *named.values(), *toes.on_patches(), forces.in_cones(), *forces.in_box(shear=layout.whole_box),
            *body.within_limits(),
        ]  # fmt: skip
        if layout.regions > 1:
            constraints.append(Candidates(layout).only_open(toes))
        if soft:
            residual = Residual(moment)
            cost, self._soft = residual.slack, True
            constraints += residual.rows()
        else:
            named["moment"] = moment == 0
            cost, self._soft = objective(layout, weights, length_m, body, position), False
            constraints.append(named["moment"])
        self._model = ConicModel(
            cp.Problem(cp.Minimize(cost), constraints), equilibrate=lifted_values(typical), duals=named
        )

    @property
    def model(self) -> ConicModel:
        """The compiled model."""
        return self._model

    def solve(self, scaled: ScaledCourse) -> LiftedPlan:
        """Solve the relaxation for a course of this layout."""
        layout, model = self._layout, self._model
        solution = model.solve(lifted_values(scaled))
        solved = solution.status is ConicStatus.SOLVED
        shape = (layout.placements, layout.regions)
        weights = np.maximum(model.value("weights", solution), 0.0) if solved else np.ones((layout.slots, 1))
        shares = weights.sum(axis=1)
        by_slot = np.matmul(weights[:, None, :], scaled.vertices)[:, 0] if solved else np.zeros((layout.slots, 3))
        return LiftedPlan(
            status=solution.status,
            solution=solution,
            objective=solution.objective,
            com=model.value("com", solution),
            rotation=model.value("rotation", solution),
            shares=shares.reshape(shape),
            toes=(by_slot / np.maximum(shares, 1e-12)[:, None]).reshape(*shape, 3),
            forces=model.value("lifted", solution).reshape(-1, layout.regions * layout.vertices, 3).sum(axis=1),
            residual=max(0.0, float(model.value("residual", solution))) if solved and self._soft else 0.0,
        )


def lifted_values(scaled: ScaledCourse) -> dict[str, Array | float]:
    """Data of the lift."""
    normal, y, z = np.moveaxis(scaled.frames, 2, 0)
    return scaled.values() | {
        "axis_n": normal,
        "axis_y": y,
        "axis_z": z,
        "friction_axis": scaled.friction[:, None] * normal,
        "force_min": scaled.course.force_min,
        "force_max": scaled.course.force_max,
    }
