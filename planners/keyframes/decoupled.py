"""The decoupled planner (paper E's ref. [3]): positions first, with no knowledge of forces, then forces for them.

The baseline that coupling is measured against. Its positions meet eqs. 1 and 11 and have the same objective; which of
several patches a toe takes is rounded from the shares. Then toes and body are held, and every stance gets forces, if it
can. Where friction decides, the positions are blind to it, and the second stage's failure never reaches the first.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from ..contact.project import Point
from ..contact.scaled import ScaledProblem
from ..contact.stages import Stages
from ..contact.terms import Body, Toes
from ..outcome import Certificate
from ..plan import PlanOutcome
from ..scene.course import Course, Weights
from .clock import Clock
from .layout import Index, Layout
from .planner import PlanAcceptance, plan_of
from .project import PlanPoint
from .scaled import ScaledCourse
from .search import LEAF, farkas
from .terms import Candidates, Steps, objective
from .twostage import CourseModels


class Positions:
    """Body and toes of all key frames without forces, for one layout, compiled: eqs. 1 and 11, limits and objective."""

    def __init__(self, layout: Layout, weights: Weights, length_m: float, typical: ScaledCourse) -> None:
        self._layout = layout
        body = Body(layout.frames * layout.limbs, layout.frame_of_limbs)
        toes = Toes(layout.slots, layout.vertices, layout.toe_of_slots)
        position = toes.position()
        named: dict[str, cp.Constraint] = {
            "reach": body.within_reach(layout.toe_of_limbs @ position),
            **Steps(layout).limits(body, position),
        }
        constraints = [*named.values(), *toes.on_patches(), *body.within_limits()]
        if layout.regions > 1:
            constraints.append(Candidates(layout).only_open(toes))
        cost = objective(layout, weights, length_m, body, position)
        self.model = ConicModel(cp.Problem(cp.Minimize(cost), constraints), equilibrate=typical.values(), duals=named)

    def solve(self, scaled: ScaledCourse) -> tuple[ConicSolution, Array, PlanPoint]:
        """The solution, the shares of all slots, shape (P, R), and the point without forces, toes mixed from them."""
        layout, model = self._layout, self.model
        solution = model.solve(scaled.values())
        weights = np.maximum(model.value("weights", solution), 0.0)
        by_slot = np.matmul(weights[:, None, :], scaled.vertices)[:, 0].reshape(layout.placements, layout.regions, 3)
        point = PlanPoint(
            com=model.value("com", solution),
            rotation=model.value("rotation", solution),
            toes=by_slot.sum(axis=1) / np.maximum(weights.reshape(layout.placements, -1).sum(axis=1), 1e-12)[:, None],
            forces=np.zeros((len(layout.bearing[0]), 3)),
            residual=float("inf"),
            solver_seconds=solution.seconds,
        )
        return solution, weights.sum(axis=1).reshape(layout.placements, layout.regions), point


class DecoupledPlanner:
    """Positions, rounded to one patch a toe, then forces for them; what either stage cannot do is not tried again.

    Feasible or undecided; infeasible where there are no positions at all, which has the same certificate as the lift.
    """

    name = "decoupled"

    def __init__(self, *, acceptance: PlanAcceptance = PlanAcceptance(), models: CourseModels | None = None) -> None:
        self.acceptance = acceptance
        self._models = models or CourseModels()
        self._positions: dict[tuple[object, ...], Positions] = {}

    def solve(self, course: Course) -> PlanOutcome:
        """Plan one course."""
        clock, scaled = Clock.start(), ScaledCourse.of(course)
        details: dict[str, float] = {}
        solution, shares, point = self._place(scaled, clock)
        if solution.status is ConicStatus.INFEASIBLE:
            row = farkas(scaled.layout, self._model(scaled, clock).model, solution, balanced=False)
            proof = Certificate(tree=np.array([LEAF]), multipliers=row[None])
            return self.acceptance.outcome(course, method=self.name, clock=clock, certificate=proof)
        choice = np.asarray(np.where(_opened(scaled) > 0.0, shares, -1.0).argmax(axis=1), dtype=np.int_)
        chosen, bound = scaled.chosen(choice), solution.objective * course.length_scale_m**2
        if scaled.layout.regions > 1 and solution.status is ConicStatus.SOLVED:
            solution, _, point = self._place(chosen, clock)
        plan, message = None, "the patches of the largest shares admit no positions"
        if solution.status is ConicStatus.SOLVED:
            details["on_ice"] = _on_ice(chosen)
            placed, point = point, self._models.projector(chosen).fix_p(chosen, point, clock)
            details["residual"] = point.residual
            message = "the positions admit no forces that hold the robot"
            if point.residual > 0.5 * self.acceptance.tolerance:
                message += f": {_worst_stance(course, choice, placed)}"
        if point.residual <= 0.5 * self.acceptance.tolerance:
            plan, message = plan_of(scaled, choice, point, provenance={"planner": self.name}), ""
        return self.acceptance.outcome(
            course, method=self.name, clock=clock, plan=plan, bound=bound, message=message, details=details
        )

    def _place(self, scaled: ScaledCourse, clock: Clock) -> tuple[ConicSolution, Array, PlanPoint]:
        found = self._model(scaled, clock).solve(scaled)
        clock.count(1, found[0].seconds)
        return found

    def _model(self, scaled: ScaledCourse, clock: Clock) -> Positions:
        weights, length_m = scaled.course.weights, scaled.course.length_scale_m
        if scaled.key not in self._positions:
            with clock.compiling():
                self._positions[scaled.key] = Positions(scaled.layout, weights, length_m, scaled.typical())
        return self._positions[scaled.key]


def _worst_stance(course: Course, choice: Index, placed: PlanPoint) -> str:
    """Which stance its positions leave most moment, or no balance of forces at all."""
    stages, worst, told = Stages(), -1.0, ""
    for stance in course.stances:
        limbs = list(stance.limbs)
        scaled = ScaledProblem.of(course.posture_problem(stance, choice))
        toes = placed.toes[course.holds[stance.frame, limbs]]
        at = Point(
            com=placed.com[stance.frame], rotation=placed.rotation[stance.frame], toes=toes,
            forces=np.zeros_like(toes), residual=float("inf"),
        )  # fmt: skip
        residual = stages.project("fix-p", scaled, at).residual
        if residual > worst:
            worst = residual
            left = f"{residual * course.weight_n * course.length_scale_m:.3g} Nm are left over"
            missing = left if np.isfinite(residual) else "they cannot carry the weight"
            told = f"frame {stance.frame} on {', '.join(course.robot.limb_names[i] for i in limbs)}, {missing}"
    return told


def _opened(scaled: ScaledCourse) -> Array:
    return scaled.opened.reshape(scaled.layout.placements, scaled.layout.regions)


def _on_ice(chosen: ScaledCourse) -> float:
    """Share of the toes that stand where there is no friction."""
    return float(np.mean(chosen.friction == 0.0))
