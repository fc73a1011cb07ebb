"""P1 lift: the relaxation that needs no learned box.

With p_w = Σ λ_u v_u (E1) and f_u := λ_u f the moment Σ p_w × f is Σ_u v_u × f_u, linear; Σ_u f_u =
f holds by definition, and each f_u lies in the friction cone and in λ_u times the force box. Only
toe-in-patch times force is relaxed; the centre of mass is not, since Σ f is fixed
(``terms.Moments``). Over several candidate patches r of a toe, λ_{r,u} with z_r = Σ_u λ_{r,u}, and
f_{r,u} in the cone of μ_r: the convex hull of "one of the patches" comes with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..arguments import cached_property
from ..equilibrium.layout import Layout, Of
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs, multipliers
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes, Given, Moments, objective
from ..files.arrays import Array
from .envelope import Envelope
from .relaxed import RelaxationAnswer, Relaxed, unit_shares


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftAnswer(Relaxed):
    """One solve of the lift.

    Arguments:
        status: INFEASIBLE with multipliers that refute the relaxation, and so the problem.
        bound: on the least moment residual, or on the objective of a course: inf where infeasible,
            and 0 or −inf, which prove nothing, where the solver gave up. Where there is a point its
            forces are f_u, (F, 3).
    """

    status: ConicStatus
    bound: float
    solution: ConicSolution

    @cached_property
    def multipliers(self) -> Array:
        """A certificate's row for the bound."""
        return multipliers(self.scaled.layout, self.solution)

    @property
    def solved(self) -> bool:
        """Tell whether the solver came to an end, one way or the other."""
        return self.status is not ConicStatus.FAILED

    @property
    def by_vertex(self) -> Array:
        """f_u in contact frames, shape (F, 3)."""
        return self.forces


class LiftProgram:
    """The lift of one layout.

    Arguments:
        implied: leave out the rows of the force box that the cones imply (``Scaled.box_implied``).
        least_moment: minimise the moment residual, for which there is an answer nearly always; else
            the course's objective, moments being zero.
    """

    over_boxes: ClassVar[bool] = False
    about_points: ClassVar[bool] = False

    def __init__(self, layout: Layout, implied: bool, least_moment: bool) -> None:
        self.layout, self.rows = layout, Rows[Given](keep=layout.frames == 1)
        rows = self.rows
        body = BodyVariables(rows, layout)
        toes = FreeToes(rows, layout, explicit=not least_moment, implied=implied)
        forces = Forces.of_vertices(rows, layout, toes)
        self._forces = (forces.contact, forces.candidate)
        forces.balance()
        moments = Moments(layout)
        moments.add(forces.stance, forces.columns, Of("scaled.arms"))
        moments.of_weight(body)
        if least_moment:
            rows.linear(moments.within(rows), 1.0)
        else:
            moments.vanish(rows)
            objective(rows, layout, body, toes)
        forces.in_cones()
        forces.in_box(implied=implied)
        body.reach(toes)
        body.limits()
        body.steps(toes)

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The least moment residual, whatever the box (``table.RelaxedProgram``)."""
        return cls.answers(programs, [scaled], [[box]], [])[0]

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The least moment residual of each problem (``table.RelaxedProgram``)."""
        return [as_relaxation(solve_lift(programs, one, least_moment=True)) for one in scaled]

    def solve(self, scaled: Scaled) -> LiftAnswer:
        """Solve for a problem of this layout."""
        solution = self.rows.solve(Given(scaled))
        return self._answer(scaled, solution)

    def _answer(self, scaled: Scaled, solution: ConicSolution) -> LiftAnswer:
        least = "residual" in solution.columns
        bound = {
            ConicStatus.SOLVED: max(0.0, solution.objective) if least else solution.bound,
            ConicStatus.INFEASIBLE: float("inf"),
            ConicStatus.FAILED: 0.0 if least else float("-inf"),
        }[solution.status]
        return LiftAnswer(
            scaled=scaled,
            status=solution.status,
            bound=bound,
            solution=solution,
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            weights=unit_shares(scaled, solution.value("weights")),
            forces=solution.value("forces"),
            rows=self._forces,
            seconds=solution.seconds,
        )


def solve_lift(programs: Programs, scaled: Scaled, *, least_moment: bool) -> LiftAnswer:
    """Solve the lift, in its small form where that says the same.

    Arguments:
        programs: to share.
        least_moment: minimise the moment residual; else the course's objective, moments being zero.

    Returns:
        An answer whose ``bound`` is proved: of the residual, or of the objective; inf where there
        is none.
    """
    return programs.get(LiftProgram, scaled.layout, scaled.box_implied, least_moment).solve(scaled)


def as_relaxation(lift: LiftAnswer) -> RelaxationAnswer:
    """The lift of a posture in P1's words: its margin is the moment residual."""
    if not lift.solved:
        return RelaxationAnswer(margin=float("nan"))
    return RelaxationAnswer(margin=lift.bound, relaxed=None if np.isinf(lift.bound) else lift)
