"""MICP (Lin et al. §II and Table II, [11]): m = p f over a grid of McCormick cells, by branch and
bound in binaries.

The program is ``relaxation.papers.micp``; which candidate patch a toe takes is binary, too. An
envelope comes in as rows of its own over the whole grid (Lin et al.), or as the box that the grid
divides. HiGHS has no second-order cones: with tangent planes around them "infeasible" holds for the
cones, too, while a point may leave them; with planes inside them a point holds, and "infeasible"
says nothing. Whatever a solver claims, its point is projected and verified.
"""

from __future__ import annotations

import time
from importlib import util
from typing import ClassVar, Literal, get_args

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs, multipliers
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, FreeToes, Given, objective
from ..errors import InvalidInput, not_installed
from ..files.arrays import checked, checked_choice, checked_int
from ..problem import Problem
from ..projection.nlp import NlpProgram
from ..projection.project import PROJECTIONS, SURFACE, Projection, project
from ..relaxation.boxes import boxes_of
from ..relaxation.envelope import Envelope, EnvelopeSet
from ..relaxation.lift import solve_lift
from ..relaxation.mccormick import domain_of
from ..relaxation.micp import (
    SOLVERS,
    MicpGrid,
    MicpProgram,
    axes_of,
    cell_error,
    cones_of,
    meet,
    of_layout,
    of_several_frames,
    unit_domain,
)
from ..relaxation.papers import Breaks
from .answer import Acceptance, Claim, Clock, Kind, TimeLimited, check_unused, kind_of, plan_of
from .choice import nearest
from .cuts import LEAF, alone
from .enveloped import over_sides

_Start = Literal["nominal", "p1"]
STARTS: tuple[_Start, ...] = get_args(_Start)


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
        start: _Start = "nominal",
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
        self.start: _Start = start
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
        bound = solution.bound * course.unit_m**2 if solution.solved else float("nan")
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
                left = f"{residual * course.weight_n * course.unit_m:.3g} Nm are left over"
                missing = left if np.isfinite(residual) else "they cannot carry the weight"
                names = ", ".join(course.robot.limb_names[i] for i in stance.limbs)
                message = f"frame {stance.frame} on {names}, {missing}"
        return message


_LEAST_S = 1e-3
"""A solver is given this much time even where writing the model down took all of it [s]."""


class MicpPlanner(TimeLimited):
    """The papers' planner: claims of a mixed-integer solver, of which only verified witnesses
    become an answer.

    Arguments:
        solver: "highs", "scip" or "gurobi".
        envelope: a box over the stance contacts, or a learned set of one; it confines the search,
            so that "infeasible" then speaks of the envelope only.
        gap: relative, to which a course's objective is minimised (with planes from below, by
            tangents of its squares); None takes the first point, which is all that a claim needs.
        time_limit_s: the solver's.
    """

    name = "micp"

    def __init__(
        self,
        *,
        solver: str = "highs",
        grid: MicpGrid = MicpGrid(),
        envelope: Envelope | EnvelopeSet | None = None,
        gap: float | None = None,
        projection: Projection = "scp",
        time_limit_s: float | None = None,
        acceptance: Acceptance = Acceptance(),
        programs: Programs | None = None,
    ) -> None:
        checked_choice(solver, "solver", SOLVERS)
        if util.find_spec(SOLVERS[solver][0]) is None:
            raise not_installed("solver", SOLVERS[solver][0], repr(solver), "exact")
        cones_of(grid, solver)
        PROJECTIONS.get(projection)
        if isinstance(envelope, EnvelopeSet) and len(envelope.envelopes) > 1:
            raise InvalidInput(
                f"envelopes: expected one envelope for micp, got {len(envelope.envelopes)}"
            )
        self.solver, self.grid, self.envelope = solver, grid, envelope
        self.gap = None if gap is None else checked(gap, "gap", least=0.0)
        self.projection: Projection = projection
        self.time_limit_s = (
            None if time_limit_s is None else checked(time_limit_s, "time_limit_s", above=0.0)
        )
        self.acceptance, self._programs = acceptance, programs or Programs()

    def check(self, kind: Kind) -> None:
        """Raise InvalidInput for a setting that this kind of question has no use for."""
        if kind == "postures":
            check_unused(self, envelope_use="rows", gap=None, projection="scp")

    @property
    def envelope_use(self) -> str:
        """The use that the grid makes of an envelope."""
        return self.grid.envelope_use

    @over_sides
    def solve(self, problem: Problem) -> Answer[Plan]:
        """Ask the solver, then project and verify what it found.

        Raises InvalidInput for an envelope of other limbs.
        """
        clock, scaled = Clock.start(), Scaled.of(problem)
        with clock.compiling():
            program = self.program(problem)
        begin = time.process_time()
        answer = program.solve(
            scaled, max(self.limit_s(kind_of(problem)) - clock.elapsed(), _LEAST_S)
        )
        clock.count(1, answer.seconds)
        details = program.figures | {
            "solver_s": answer.seconds,
            "solver_cpu_s": time.process_time() - begin,
        }
        details["cell_error"] = cell_error(self.boxes(problem)[0], self.grid.counts)
        point, message = None, answer.message
        if answer.point is not None and answer.choice is not None and answer.moments is not None:
            details["claimed_residual"] = float(np.abs(answer.moments).max())
            unit_nm = scaled.force_n * scaled.length_m
            details["claimed_residual_nm"] = unit_nm * float(
                np.linalg.norm(answer.moments, axis=1).max()
            )
            point = project(
                self._programs, self.projection, scaled.chosen(answer.choice), answer.point
            )
            clock.count(point.solves, point.seconds)
        if point is None or not np.isfinite(point.residual):
            point = None
            message = (
                message
                or f"{self.solver} says {answer.claim}; neither a certificate nor toes that hold came with it"
            )
        plan: Plan | None = None
        if point is not None and answer.choice is not None:
            made = {"planner": self.name, "solver": self.solver, "projection": self.projection}
            plan = plan_of(problem, scaled, answer.choice, point, provenance=made)
        claim = Claim(plan=plan, word=answer.claim, message=message, details=details)
        return self.acceptance.answer(problem, claim, method=self.name, clock=clock)

    def program(self, problem: Problem) -> MicpProgram:
        """The program of a problem; postures of one layout share one, which then has the numbers of
        this one.
        """
        scaled, (domain, envelope) = Scaled.of(problem), self.boxes(problem)
        breaks = Breaks.of(domain, self.grid.counts)
        if problem.is_posture and envelope is None:
            symbols, program = self._programs.get(of_layout, scaled.layout, self.grid, self.solver)
            symbols.load(scaled, breaks)
            return program
        gap = None if problem.is_posture else self.gap
        axes = axes_of(scaled)
        return MicpProgram(
            scaled, breaks, self.grid, solver=self.solver, axes=axes, envelope=envelope, gap=gap
        )

    def boxes(self, problem: Problem) -> tuple[Envelope, Envelope | None]:
        """The domain that the grid divides, and the box of the envelope rows, where there are
        any.
        """
        scaled, envelope = Scaled.of(problem), self.box(problem)
        domain = (
            domain_of(scaled, axes_of(scaled))
            if self.grid.domain == "course"
            else unit_domain(scaled)
        )
        if envelope is not None and self.grid.envelope_use == "shrink":
            return meet(envelope, domain), None
        return domain, envelope

    def box(self, problem: Problem) -> Envelope | None:
        """The envelope over the stance contacts of a problem.

        Raises InvalidInput where it was learned for others.
        """
        if self.envelope is None:
            return None
        scaled = Scaled.of(problem)
        contacts = len(scaled.force_min)
        if not problem.is_posture:
            for row in of_several_frames(scaled)[:1]:
                stance, limb, _ = (part[row] for part in scaled.layout.contacts)
                raise InvalidInput(
                    f"frame {scaled.layout.stance_frames[stance]}, limb "
                    f"{problem.robot.limb_names[limb]}: expected "
                    "candidate patches that share one contact frame, for an envelope on the forces "
                    "in it; got several"
                )
        if isinstance(self.envelope, EnvelopeSet):
            if not problem.is_posture:
                return boxes_of(problem, self.envelope)[0]
            self.envelope.check_fits(problem)
            return self.envelope.envelopes[0]
        if self.envelope.contacts != contacts:
            raise InvalidInput(
                f"contacts: expected {self.envelope.contacts} for this envelope, got {contacts}"
            )
        return self.envelope
