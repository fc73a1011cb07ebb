"""MICP (Lin et al. §II and Table II, [11]): m = p f over a grid of McCormick cells, by branch and
bound in binaries.

The program is ``relaxation.papers.micp``; which candidate patch a toe takes is binary, too. An
envelope comes in as rows of its own over the whole grid (Lin et al.), or as the box that the grid
divides. HiGHS has no second-order cones: with tangent planes around them "infeasible" holds for the
cones, too, while a point may leave them. Whatever a solver claims, its point is projected and
verified.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields
from importlib import util
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, ConicStatus, multipliers
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, FreeToes, Given, objective
from ..errors import InvalidInput, not_installed
from ..files.arrays import check_numbers, checked_int
from ..files.documents import shown
from ..problem import Problem
from ..projection.held import toes_of
from ..projection.project import PROJECTIONS, SURFACE, Projection, project
from ..relaxation.boxes import boxes_of
from ..relaxation.envelope import Envelope, EnvelopeSet
from ..relaxation.lift import solve_lift
from ..relaxation.mccormick import domain_of
from .answer import Clock, Kind, Method, kind_of, plan_of
from .choice import nearest
from .cuts import LEAF, alone
from .enveloped import over_sides

if TYPE_CHECKING:  # cvxpy and CasADi are loaded where one of these methods is asked
    from ..relaxation.micp import MicpGrid, MicpProgram

MOST_INTERVALS = 64
"""A finer grid takes minutes to write down and more memory than most machines have."""
_Start = Literal["nominal", "p1"]


@dataclass(frozen=True, kw_only=True)
class Nlp(Method):
    """The nonlinear program as it is, solved by IPOPT: feasible from one of several starts, or
    undecided, since a local method proves nothing.

    Of several candidates each toe takes the nearest with friction.

    Arguments:
        start: the first one, nominal (body on its path, toes amid their patches) or p1 (the lift's
            point, where it has one).
        starts: how many, all but the first random; None for 5 of a posture and 1 of a course.
        seed: of the random ones.
        max_iterations: of IPOPT.
        time_limit_s: for all starts together.
        acceptance, programs, most_s: of every method, see ``Method``.

    Raises:
        InvalidInput: for an unknown start, and counts below 1.
    Source:
        Lin et al. §IV-A (NLP in Table I).

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.Nlp()).status.value
        'feasible'
    """

    name: ClassVar[str] = "nlp"
    start: _Start = "nominal"
    starts: int | None = None
    seed: int = 0
    max_iterations: int = 500

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.starts is not None:
            checked_int(self.starts, "starts", least=1)

    @over_sides
    def solve(self, problem: Problem) -> Answer[Plan]:
        """Try the starts in order until one ends on the bilinear surface."""
        from ..projection.nlp import NlpProgram

        clock, scaled = Clock.start(), Scaled.of(problem)
        limit_s = max(self.limit_s(kind_of(problem)), _LEAST_S)
        choice = nearest(scaled)
        chosen, count = scaled.chosen(choice), self.starts or (5 if scaled.weights is None else 1)
        with clock.compiling():
            program = self.kept.get(
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
            point, word = program.attempt(self.kept, chosen, start)
            tried += 1
            clock.count(1, point.seconds)
            if np.isfinite(point.residual) and (best is None or point.residual < best.residual):
                best = point
            if best is not None and best.residual <= max(SURFACE, 0.5 * self.acceptance.tolerance):
                break
        message = "" if best is not None else f"no witness from {tried} starts; IPOPT said {word}"
        made = {"planner": self.name, "start": self.start}
        plan = None if best is None else plan_of(problem, scaled, choice, best, provenance=made)
        return self.acceptance.answer(
            problem,
            plan=plan,
            word=word,
            message=message,
            details={"starts": float(tried)},
            method=self.name,
            clock=clock,
        )

    def _starting(self, chosen: Scaled, count: int) -> list[Point]:
        starts = starting_points(chosen, count, seed=self.seed)
        if self.start == "p1":
            lifted = solve_lift(self.kept, chosen, least_moment=chosen.weights is None)
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
        point = Point(
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            toes=toes_of(solution, scaled),
            forces=np.zeros((len(layout.contacts[0]), 3)),
            residual=float("inf"),
            seconds=solution.seconds,
        )
        table = scaled.by_candidate(shares.astype(np.float64), -1.0)
        return solution, np.asarray(table.argmax(axis=1), dtype=np.int_), point


@dataclass(frozen=True, kw_only=True)
class Decoupled(Method):
    """Positions first, rounded to one patch a toe, and forces for them after, for courses: a baseline
    that fails on ice; what either stage cannot do is not tried again, long before any time limit.

    Feasible or undecided; infeasible where there are no positions at all, which has the same
    certificate as the lift.

    Arguments:
        time_limit_s, acceptance, programs, most_s: of every method, see ``Method``.

    Source:
        None: the common order of planners without forces.

    Example:
        >>> import stancekit
        >>> stancekit.plan("stairs", stancekit.Decoupled(), frames=3).status.value
        'feasible'
    """

    name: ClassVar[str] = "decoupled"
    answers: ClassVar[Kind | None] = "courses"

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
            return self.acceptance.answer(course, certificate=proof, method=self.name, clock=clock)
        bound = solution.bound * course.unit_m**2 if solution.solved else float("nan")
        chosen = scaled.chosen(choice)
        if scaled.options > 1 and solution.solved:
            solution, _, point = self._place(chosen, clock)
        plan, message = None, "the patches of the largest shares admit no positions"
        if solution.solved:
            details["on_ice"] = float(np.mean(chosen.friction == 0.0))
            placed, point = point, project(self.kept, "fix-p", chosen, point)
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
        return self.acceptance.answer(
            course,
            plan=plan,
            message=message,
            details=details,
            method=self.name,
            clock=clock,
            bound=bound,
        )

    def _place(self, scaled: Scaled, clock: Clock) -> tuple[ConicSolution, Index, Point]:
        solution = self.kept.get(Positions, scaled.layout).solve(scaled)
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
            residual = project(self.kept, "fix-p", part, at).residual
            if residual > worst:
                worst = residual
                left = f"{residual * course.weight_n * course.unit_m:.3g} Nm are left over"
                missing = left if np.isfinite(residual) else "they cannot carry the weight"
                names = ", ".join(course.robot.limb_names[i] for i in stance.limbs)
                message = f"frame {stance.frame} on {names}, {missing}"
        return message


_LEAST_S = 1e-3
"""A solver is given this much time even where writing the model down took all of it [s]."""


@dataclass(frozen=True, kw_only=True)
class Micp(Method):
    """A piecewise McCormick grid, mixed-integer: claims of a solver, of which only verified
    witnesses become an answer; needs the extra exact for other solvers than HiGHS.

    Arguments:
        solver: "highs", "scip" or "gurobi".
        intervals, domain, envelope_use: the grid, see ``MicpGrid``.
        envelopes: a box over the stance contacts, or a learned set of one, that the grid is over;
            it confines the search, so that "infeasible" then speaks of the envelope only.
        gap: of courses: relative, to which the objective is minimised (with planes from below, by
            tangents of its squares); None takes the first point, which is all that a claim needs.
        projection: P2 after the grid.
        time_limit_s: the solver's.
        acceptance, programs, most_s: of every method, see ``Method``.

    Raises:
        InvalidInput: for a solver, a use or a projection that there is not, and for several
            envelopes.
    Source:
        Lin et al. §IV; the grid is that of piecewise McCormick envelopes.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.Micp(intervals=2)).status.value
        'feasible'
    """

    name: ClassVar[str] = "micp"
    OF_COURSES: ClassVar[tuple[str, ...]] = ("envelope_use", "gap", "projection")
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    intervals: int = 4
    envelopes: Envelope | EnvelopeSet | None = None
    envelope_use: Literal["rows", "shrink"] = "rows"
    gap: float | None = None
    projection: Projection = "scp"
    domain: str = "course"

    def __post_init__(self) -> None:
        super().__post_init__()
        from ..relaxation.micp import SOLVERS

        if self.intervals > MOST_INTERVALS:
            raise InvalidInput(
                f"intervals: expected {MOST_INTERVALS} or less, got {shown(self.intervals)}"
            )
        check_numbers(self, least=("gap",))
        PROJECTIONS.get(self.projection)
        _ = self.grid  # refuses what no grid has
        if isinstance(self.envelopes, EnvelopeSet) and len(self.envelopes.envelopes) > 1:
            raise InvalidInput(
                f"envelopes: expected one envelope for micp, got {len(self.envelopes.envelopes)}"
            )
        if util.find_spec(SOLVERS[self.solver][0]) is None:
            raise not_installed("solver", SOLVERS[self.solver][0], repr(self.solver), "exact")

    @property
    def grid(self) -> MicpGrid:
        """The grid that cuts m = p f."""
        from ..relaxation.micp import MicpGrid

        return MicpGrid(**{each.name: getattr(self, each.name) for each in fields(MicpGrid)})

    @over_sides
    def solve(self, problem: Problem) -> Answer[Plan]:
        """Ask the solver, then project and verify what it found.

        Raises InvalidInput for an envelope of other limbs.
        """
        from ..relaxation.micp import cell_error

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
        details["cell_error"] = cell_error(self.boxes(problem)[0], self.grid.intervals)
        point, message = None, answer.message
        if answer.point is not None and answer.choice is not None and answer.moments is not None:
            details["claimed_residual"] = float(np.abs(answer.moments).max())
            unit_nm = scaled.force_n * scaled.length_m
            details["claimed_residual_nm"] = unit_nm * float(
                np.linalg.norm(answer.moments, axis=1).max()
            )
            point = project(self.kept, self.projection, scaled.chosen(answer.choice), answer.point)
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
        return self.acceptance.answer(
            problem,
            plan=plan,
            word=answer.claim,
            message=message,
            details=details,
            method=self.name,
            clock=clock,
        )

    def program(self, problem: Problem) -> MicpProgram:
        """The program of a problem; postures of one layout share one, which then has the numbers of
        this one.
        """
        from ..relaxation.micp import MicpProgram, axes_of, of_layout
        from ..relaxation.papers import Breaks

        scaled, (domain, envelope) = Scaled.of(problem), self.boxes(problem)
        breaks = Breaks.of(domain, self.grid.intervals)
        if problem.is_posture and envelope is None:
            symbols, program = self.kept.get(of_layout, scaled.layout, self.grid, self.solver)
            symbols.load(scaled, breaks)
            return program
        gap = None if problem.is_posture else self.gap
        axes = axes_of(scaled)
        return MicpProgram(
            scaled, breaks, solver=self.solver, axes=axes, envelope=envelope, gap=gap
        )

    def boxes(self, problem: Problem) -> tuple[Envelope, Envelope | None]:
        """The domain that the grid divides, and the box of the envelope rows, where there are
        any.
        """
        from ..relaxation.micp import axes_of, meet, unit_domain

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
        from ..relaxation.micp import of_several_frames

        if self.envelopes is None:
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
        if isinstance(self.envelopes, EnvelopeSet):
            if not problem.is_posture:
                return boxes_of(problem, self.envelopes)[0]
            self.envelopes.check_fits(problem)
            return self.envelopes.envelopes[0]
        if self.envelopes.contacts != contacts:
            raise InvalidInput(
                f"contacts: expected {self.envelopes.contacts} for this envelope, got {contacts}"
            )
        return self.envelopes
