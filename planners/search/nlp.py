"""The problem as it is, on IPOPT from several starts, for postures and courses; nothing is ever
proved infeasible.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from ..answer.answer import Answer
from ..answer.plan import Plan
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import checked, checked_choice, checked_int
from ..problem import Problem
from ..projection.nlp import NlpProgram
from ..projection.project import SURFACE
from ..relaxation.lift import solve_lift
from .answer import Acceptance, Claim, TimeLimited, kind_of, plan_of
from .choice import nearest
from .clock import Clock
from .least_steps import over_sides

Start = Literal["nominal", "p1"]
STARTS: tuple[Start, ...] = get_args(Start)


class NlpPlanner(TimeLimited):
    """Feasible by IPOPT from one of several starts, or undecided: a local method proves nothing.

    Of several candidates each toe takes the nearest with friction.

    Arguments:
        start: the first one, nominal (body on its path, toes amid their patches) or p1 (the lift's
            point, where it has one).
        starts: how many, all but the first random; None for 5 of a posture and 1 of a course.
        seed: of the random ones.
        time_limit_s: for all starts together.
    """

    name = "nlp"

    def __init__(
        self,
        *,
        start: Start = "nominal",
        starts: int | None = None,
        seed: int = 0,
        max_iterations: int = 500,
        time_limit_s: float | None = None,
        acceptance: Acceptance = Acceptance(),
        programs: Programs | None = None,
    ) -> None:
        checked_choice(start, "start", STARTS)
        if starts is not None:
            checked_int(starts, "starts", least=1)
        self.start: Start = start
        self.starts, self.seed, self.max_iterations = starts, seed, max_iterations
        self.time_limit_s = (
            None if time_limit_s is None else checked(time_limit_s, "time_limit_s", above=0.0)
        )
        self.acceptance, self._programs = acceptance, programs or Programs()

    @over_sides
    def solve(self, problem: Problem) -> Answer[Plan]:
        """Try the starts in order until one ends on the bilinear surface."""
        clock, scaled, limit_s = Clock.start(), Scaled.of(problem), self.limit_s(kind_of(problem))
        choice = nearest(scaled)
        chosen, count = scaled.chosen(choice), self.starts or (5 if scaled.weights is None else 1)
        with clock.compiling():
            program = self._programs.get(
                NlpProgram,
                chosen.layout,
                scaled.weights is None,
                self.max_iterations,
                limit_s / count,
            )
        best, word, tried = None, "", 0
        for start in self._starting(chosen, count):
            if tried and clock.elapsed() > limit_s:
                break
            point, word = program.attempt(self._programs, chosen, start)
            tried += 1
            clock.count(1, point.seconds)
            if np.isfinite(point.residual) and (best is None or point.residual < best.residual):
                best = point
            if best is not None and best.residual <= max(SURFACE, 0.5 * self.acceptance.tolerance):
                break
        message = "" if best is not None else f"no witness from {tried} starts; IPOPT said {word}"
        made = {"planner": self.name, "start": self.start}
        plan = None if best is None else plan_of(problem, scaled, choice, best, provenance=made)
        claim = Claim(plan=plan, word=word, message=message, details={"starts": float(tried)})
        return self.acceptance.answer(problem, claim, method=self.name, clock=clock)

    def _starting(self, chosen: Scaled, count: int) -> list[Point]:
        starts = starting_points(chosen, count, seed=self.seed)
        if self.start == "p1":
            lifted = solve_lift(self._programs, chosen, least_moment=chosen.weights is None)
            if lifted.solved and np.isfinite(lifted.bound):
                point, nominal = lifted.rounded()[1], starts[0]
                starts[0] = Point(
                    com=point.com,
                    rotation=point.rotation,
                    toes=point.toes,
                    forces=nominal.forces,
                    residual=np.inf,
                )
        return starts


def starting_points(scaled: Scaled, count: int, *, seed: int) -> list[Point]:
    """The patches' centroids, then random convex combinations of their vertices, the same ones for
    the same seed.

    The body is at its nominal pose; the limbs of a stance share the weight and press with half
    their normal force. One candidate a foothold.
    """
    rng = np.random.default_rng(seed)
    stance = scaled.layout.contacts[0]
    carrying = np.bincount(stance)[stance]
    if scaled.layout.wrench:  # R_WCᵀ b, what is borne, in contact axes
        borne = (scaled.borne[stance] / carrying[:, None])[:, None]
        forces = np.matmul(borne, scaled.contact_frames)[:, 0]
    else:
        forces = scaled.contact_frames[:, 2, :] * (
            scaled.weight / carrying[:, None]
        )  # R_WCᵀ e_z: upward
    forces[:, 0] = np.maximum(forces[:, 0], 0.5 * scaled.force_max[:, 0])
    forces = np.clip(forces, scaled.force_min, scaled.force_max)
    toes = [np.array([piece.mean(axis=0) for piece in scaled.pieces])]
    for _ in range(count - 1):
        toes.append(
            np.array([rng.dirichlet(np.ones(len(piece))) @ piece for piece in scaled.pieces])
        )
    still = np.zeros_like(scaled.com)
    return [
        Point(com=scaled.com, rotation=still, toes=some, forces=forces, residual=float("inf"))
        for some in toes
    ]
