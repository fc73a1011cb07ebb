"""The decoupled planner (Lin et al.'s ref. [3]): positions first, with no knowledge of forces, then
forces for them.

The baseline that coupling is measured against. Its positions meet E1 and E11 and have the same
objective; which of several patches a toe takes is rounded from the shares. Then toes and body are
held, and every stance gets forces, if it can. Where friction decides, the positions are blind to
it, and the second stage's failure never reaches the first.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs, multipliers
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, FreeToes, Given, objective
from ..errors import InvalidInput
from ..problem import Problem
from ..projection.project import project
from .answer import Acceptance, Claim, Kind, kind_of, plan_of
from .clock import Clock
from .cuts import LEAF, alone
from .least_steps import over_sides


class Positions:
    """Body and toes of all key frames without forces, for one layout: E1, E11, limits and
    objective.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout, self.rows = layout, Rows[Given](keep=layout.frames == 1)
        body = BodyVariables(self.rows, layout)
        toes = FreeToes(self.rows, layout, explicit=True)
        objective(self.rows, layout, body, toes)
        body.reach(toes, inner=True)
        body.limits()
        body.steps(toes)

    def solve(self, scaled: Scaled) -> tuple[ConicSolution, Index, Point]:
        """The solution, the candidates of the largest shares by number, (P,), and the point without
        forces.
        """
        layout, solution = self.layout, self.rows.solve(Given(scaled))
        weights = np.maximum(solution.value("weights"), 0.0)
        shares = np.bincount(
            layout.vertex_candidates, weights, minlength=len(layout.candidate_footholds)
        )
        toes, total = np.zeros((layout.footholds, 3)), np.zeros(layout.footholds)
        np.add.at(toes, layout.vertex_footholds, weights[:, None] * scaled.vertices)
        np.add.at(total, layout.vertex_footholds, weights)
        point = Point(
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            toes=toes / np.maximum(total, 1e-12)[:, None],
            forces=np.zeros((len(layout.contacts[0]), 3)),
            residual=float("inf"),
            seconds=solution.seconds,
        )
        table = scaled.by_candidate(shares.astype(np.float64), -1.0)
        return solution, np.asarray(table.argmax(axis=1), dtype=np.int_), point


class DecoupledPlanner:
    """Positions, rounded to one patch a toe, then forces for them; what either stage cannot do is
    not tried again.

    Feasible or undecided; infeasible where there are no positions at all, which has the same
    certificate as the lift.
    """

    name = "decoupled"
    answers: ClassVar[Kind] = "courses"

    def __init__(
        self, *, acceptance: Acceptance = Acceptance(), programs: Programs | None = None
    ) -> None:
        self.acceptance = acceptance
        self.programs = programs or Programs()

    def check(self, kind: Kind) -> None:
        """Raise InvalidInput for postures."""
        if kind == "postures":
            raise InvalidInput(
                f"method: expected one for postures, got {self.name}, which plans courses"
            )

    @over_sides
    def solve(self, course: Problem) -> Answer[Plan]:
        """Plan one course."""
        self.check(kind_of(course))
        clock, scaled = Clock.start(), Scaled.of(course)
        details: dict[str, float] = {}
        solution, choice, point = self._place(scaled, clock)
        if solution.status is ConicStatus.INFEASIBLE:
            proof = Certificate(
                tree=np.array([LEAF]), multipliers=multipliers(scaled.layout, solution)[None]
            )
            return self.acceptance.answer(
                course, Claim(certificate=proof), method=self.name, clock=clock
            )
        bound = solution.bound * course.length_scale_m**2 if solution.solved else float("nan")
        chosen = scaled.chosen(choice)
        if scaled.options > 1 and solution.solved:
            solution, _, point = self._place(chosen, clock)
        plan, message = None, "the patches of the largest shares admit no positions"
        if solution.solved:
            details["on_ice"] = float(np.mean(chosen.friction == 0.0))
            placed, point = point, project(self.programs, "fix-p", chosen, point)
            clock.count(1, point.seconds)
            details["residual"] = point.residual
            message = "the positions admit no forces that hold the robot"
            if point.residual > 0.5 * self.acceptance.tolerance:
                message += f": {self._worst_stance(course, chosen, placed)}"
        if point.residual <= 0.5 * self.acceptance.tolerance:
            plan, message = (
                plan_of(course, scaled, choice, point, provenance={"planner": self.name}),
                "",
            )
        claim = Claim(plan=plan, message=message, details=details)
        return self.acceptance.answer(course, claim, method=self.name, clock=clock, bound=bound)

    def _place(self, scaled: Scaled, clock: Clock) -> tuple[ConicSolution, Index, Point]:
        solution = self.programs.get(Positions, scaled.layout).solve(scaled)
        clock.count(1, solution[0].seconds)
        return solution

    def _worst_stance(self, course: Problem, chosen: Scaled, placed: Point) -> str:
        """Stance that its positions leave most moment, or no balance of forces at all."""
        worst, message = -1.0, ""
        for index, stance in enumerate(course.stances):
            part, footholds, contacts = alone(chosen, index)
            at = Point(
                com=placed.com[[stance.frame]],
                rotation=placed.rotation[[stance.frame]],
                toes=placed.toes[footholds],
                forces=np.zeros((len(contacts), 3)),
                residual=float("inf"),
            )
            residual = project(self.programs, "fix-p", part, at).residual
            if residual > worst:
                worst = residual
                left = f"{residual * course.weight_n * course.length_scale_m:.3g} Nm are left over"
                missing = left if np.isfinite(residual) else "they cannot carry the weight"
                names = ", ".join(course.robot.limb_names[i] for i in stance.limbs)
                message = f"frame {stance.frame} on {names}, {missing}"
        return message
