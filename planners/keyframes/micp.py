"""MICP over key frames (paper E §II and Table II): m = p f of every bearing over a grid of McCormick cells.

The grid is that of ``contact.micp``, log₂ K binaries a component. Candidate patches are binaries, too. An envelope
comes in as rows of its own over the whole grid (paper E), or as the box that the grid divides. HiGHS has no
second-order cones: with tangent planes around them "infeasible" holds for the cones, too, while a point may leave them;
with planes inside them a point holds, and "infeasible" says nothing. Whatever a solver claims, its point is projected
and verified.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

import cvxpy as cp
import numpy as np
from cvxpy.atoms.affine.add_expr import AddExpression

from ..arrays import checked
from ..contact.micp import SOLVERS, TANGENTS, Cells, check_options, meet, without_cones
from ..contact.relax import box_values, mccormick_rows
from ..outcome import InvalidInput
from ..plan import PlanOutcome
from ..relaxation.boxes import boxes_of
from ..relaxation.envelope import Envelope, EnvelopeSet
from ..scene.course import Course
from .clock import Clock
from .layout import Index
from .planner import PlanAcceptance, plan_of
from .products import Axes, Products, box_frames, domain_of, product_values
from .project import PlanPoint, Projection
from .scaled import ScaledCourse
from .terms import objective
from .twostage import CourseModels

GUROBI_LIMITS = (
    "gurobi ended without an answer: its free licence takes 2000 variables and 2000 rows, and 200 variables with cones"
)
_GAPS = {
    "highs": ("mip_rel_gap", "mip_abs_gap"),
    "scip": ("limits/gap", "limits/absgap"),
    "gurobi": ("MIPGap", "MIPGapAbs"),
}
ABSOLUTE_GAP = 1e-4
"""Of the objective, in length scales squared: a hundredth of a length scale, 6 mm, off the goal."""
KNOTS = np.array([0.0, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.23, 0.33, 0.5, 0.8, 1.3])
"""Where tangents touch a square, either side, in length scales: up to .35 off, y² is at most .0025 above them."""
Claim = Literal["feasible", "infeasible", "unknown"]
EnvelopeUse = Literal["rows", "shrink"]
Domain = Literal["course", "unit"]
Cones = Literal["exact", "outer", "inner"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CourseMicpAnswer:
    """What the solver claims, its point where it has one with the candidates chosen in it, and its own time [s].

    residual: largest component of a net moment at that point with m = p f, where that of the grid is zero.
    """

    claim: Claim
    seconds: float
    point: PlanPoint | None = None
    choice: Index | None = None
    residual: float = float("nan")
    message: str = ""


class CourseMicp:
    """The mixed-integer program of one course.

    gap: the relative one to which the course's objective is minimised; None takes the first point found.
    domain: the box a bearing that the grid divides; envelope: of the envelope rows, where there are any.
    cones: as they are, or planes around or inside them; then the objective's squares become tangents, too.
    """

    def __init__(
        self,
        scaled: ScaledCourse,
        domain: Envelope,
        *,
        axes: Axes,
        intervals: int = 4,
        solver: str = "highs",
        envelope: Envelope | None = None,
        cones: Cones = "exact",
        gap: float | None = None,
    ) -> None:
        layout, self._solver, self._gap = scaled.layout, solver, gap
        terms = Products(layout, axes)
        cells = Cells(len(layout.bearing[0]), (intervals, intervals), "log")
        self._scaled, self._terms, self._frames = scaled, terms, box_frames(scaled, axes)
        constraints = [*terms.constraints, *cells.rows(terms.position, terms.box_forces, terms.moments)]
        if envelope is not None:
            constraints += mccormick_rows(terms.position, terms.box_forces, terms.moments, 0.0)
        if layout.regions > 1:
            constraints.append(terms.toes.shares() == cp.Variable(layout.slots, boolean=True, name="regions"))
        course, cost = scaled.course, cells.spread()
        if gap is not None:
            cost = objective(layout, course.weights, course.length_scale_m, terms.body, terms.on_toes)
        if cones != "exact":
            constraints = [plane for row in constraints for plane in planes(row, cones)]
            cost, tangents = (cost, []) if gap is None else without_squares(cost)
            constraints += tangents
        self.problem = cp.Problem(cp.Minimize(cost), constraints)
        values = product_values(scaled, self._frames) | cells.values(domain)
        values |= box_values(envelope or domain)
        for parameter in self.problem.parameters():
            parameter.value = np.broadcast_to(values[parameter.name()], parameter.shape)
        size, variables = self.problem.size_metrics, self.problem.variables()
        self.figures = {
            "binaries": float(sum(variable.size for variable in variables if variable.attributes["boolean"])),
            "variables": float(size.num_scalar_variables),
            "constraints": float(size.num_scalar_eq_constr + size.num_scalar_leq_constr),
            "cell_error": cell_error(domain, intervals),
        }

    def solve(self, time_limit_s: float) -> CourseMicpAnswer:
        """Find a point of the grid."""
        _, limit, options = SOLVERS[self._solver]
        options = options | {"solver": self._solver.upper(), limit: time_limit_s}
        if self._gap is not None:
            options |= dict(zip(_GAPS[self._solver], (self._gap, ABSOLUTE_GAP), strict=True))
        if self._solver == "gurobi":
            options["env"] = import_module("gurobipy").Env(params={"OutputFlag": 0})
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # cvxpy's advice about time limits
                self.problem.solve(ignore_dpp=True, warm_start=False, **options)
        except cp.SolverError as error:  # a time-out without a point
            told = GUROBI_LIMITS if self._solver == "gurobi" else str(error)
            return CourseMicpAnswer(claim="unknown", seconds=time.perf_counter() - begin, message=told)
        status, seconds = self.problem.status, float(self.problem.solver_stats.solve_time)
        if status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            empty = status in (cp.INFEASIBLE, cp.settings.INFEASIBLE_OR_UNBOUNDED)
            return CourseMicpAnswer(claim="infeasible" if empty else "unknown", seconds=seconds)
        return self._answer(seconds)

    def _answer(self, seconds: float) -> CourseMicpAnswer:
        layout, terms = self._scaled.layout, self._terms
        shares = np.asarray(terms.toes.shares().value).reshape(layout.placements, layout.regions)
        forces = np.asarray(terms.forces.value).reshape(-1, layout.regions, 3).sum(axis=1)
        point = PlanPoint(
            com=np.asarray(terms.body.com.value), rotation=np.asarray(terms.body.rotation.value),
            toes=np.asarray(terms.on_toes.value), forces=forces, residual=float("inf"),
        )  # fmt: skip
        world = np.matmul(self._frames, np.asarray(terms.box_forces.value)[..., None])[..., 0]
        net = np.zeros((len(layout.stances), 3))
        np.add.at(net, layout.bearing[0], np.cross(np.asarray(terms.position.value), world))
        return CourseMicpAnswer(
            claim="feasible", seconds=seconds, point=point, choice=shares.argmax(axis=1),
            residual=float(np.abs(net).max()),
        )  # fmt: skip


class MicpCoursePlanner:
    """The papers' planner: claims of a mixed-integer solver, of which only verified plans become an answer.

    solver: "highs", "scip" or "gurobi". cones: planes around them for HiGHS, which has none, else exact. envelopes: one
    box a stance, used as ``envelope_use`` says: "rows" adds its McCormick rows to the grid (paper E), "shrink" divides
    it, met with the course's own bounds, in place of these.
    domain: what the grid divides where no envelope shrinks it: the bounds that the course implies, or [−1, 1], paper
    E's range of every p and f. gap: relative, to which the objective is minimised (with planes from below, by tangents
    of its squares); None takes the first point, which is all that a claim needs. time_limit_s: the solver's. An
    envelope confines the search, so that "infeasible" then speaks of the envelope only.
    """

    name = "micp"

    def __init__(
        self,
        *,
        solver: str = "highs",
        intervals: int = 4,
        envelopes: EnvelopeSet | None = None,
        envelope_use: EnvelopeUse = "rows",
        cones: Cones | None = None,
        gap: float | None = None,
        domain: Domain = "course",
        projection: Projection = "scp",
        time_limit_s: float = 60.0,
        acceptance: PlanAcceptance = PlanAcceptance(),
        models: CourseModels | None = None,
    ) -> None:
        check_options(intervals=intervals, encoding="log", grid="both", solver=solver, envelope_use=envelope_use)
        cones = cones or ("outer" if solver == "highs" else "exact")
        if cones not in ("outer", "inner") and not (cones == "exact" and solver != "highs"):
            raise InvalidInput(f"cones: expected outer, inner, or exact for another solver than highs, got {cones!r}")
        if envelopes is not None and len(envelopes.envelopes) > 1:
            raise InvalidInput(f"envelopes: expected one for micp, got {len(envelopes.envelopes)}")
        self.solver, self.intervals, self.projection = solver, intervals, projection
        self.cones: Cones = cones
        if domain not in ("course", "unit"):
            raise InvalidInput(f"domain: expected one of course, unit, got {domain!r}")
        self.domain: Domain = domain
        self.gap = None if gap is None else checked(gap, "gap", least=0.0)
        self.envelopes, self.envelope_use = envelopes, envelope_use
        self.time_limit_s = checked(time_limit_s, "time_limit_s", above=0.0)
        self.acceptance, self._models = acceptance, models or CourseModels()

    def solve(self, course: Course) -> PlanOutcome:
        """Ask the solver, then project and verify what it found. Raises InvalidInput for envelopes of other stances."""
        clock, scaled = Clock.start(), ScaledCourse.of(course)
        with clock.compiling():
            program = self.program(scaled)
        begin = time.process_time()
        answer = program.solve(self.time_limit_s)
        clock.count(1, answer.seconds)
        details = program.figures | {"micp_seconds": answer.seconds, "micp_cpu_seconds": time.process_time() - begin}
        plan = None
        message = f"{self.solver} says {answer.claim}; neither a certificate nor toes that hold came with it"
        if answer.point is not None and answer.choice is not None:
            details["claimed_residual"] = answer.residual
            chosen = scaled.chosen(answer.choice)
            point = self._models.projector(chosen).project(self.projection, chosen, answer.point, clock)
            if point.found:
                made = {"planner": self.name, "solver": self.solver, "projection": self.projection}
                plan, message = plan_of(scaled, answer.choice, point, provenance=made), ""
        elif answer.message:
            message = answer.message
        return self.acceptance.outcome(
            course, method=self.name, clock=clock, plan=plan, claim=answer.claim, message=message, details=details
        )

    def program(self, scaled: ScaledCourse) -> CourseMicp:
        """The program of a course."""
        axes, envelope = axes_of(scaled), None
        domain = domain_of(scaled, axes) if self.domain == "course" else unit_domain(scaled)
        if self.envelopes is not None:
            if axes == "world":
                box_frames(scaled, "contact")  # raises InvalidInput
            (box,) = boxes_of(scaled.course, self.envelopes)
            domain, envelope = (meet(box, domain), None) if self.envelope_use == "shrink" else (domain, box)
        return CourseMicp(
            scaled, domain, axes=axes, intervals=self.intervals, solver=self.solver, envelope=envelope,
            cones=self.cones, gap=self.gap,
        )  # fmt: skip


def unit_domain(scaled: ScaledCourse) -> Envelope:
    """[−1, 1] for every p and f of every bearing (paper E §II), f_n included."""
    ends = np.ones((len(scaled.layout.bearing[0]), 6))
    return Envelope(low=-ends, high=ends)


def cell_error(domain: Envelope, intervals: int) -> float:
    """The most that m may be off p f in a cell: a quarter of the largest product of its sides."""
    sides = (domain.high - domain.low) / intervals
    return float(np.max(sides[:, :3, None] * sides[:, None, 3:])) / 4.0


def axes_of(scaled: ScaledCourse) -> Axes:
    """Axes of the grid's forces: contact frames where the candidates of every toe share one, else the world's."""
    try:
        box_frames(scaled, "contact")
    except InvalidInput:
        return "world"
    return "contact"


def planes(constraint: cp.Constraint, cones: Cones) -> Sequence[cp.Constraint]:
    """The constraint, or planes around or inside it if it is second-order cones."""
    if cones == "inner" and isinstance(constraint, cp.SOC):
        discs = constraint.args[1].shape[0] - 1 if len(constraint.args[1].shape) > 1 else 2  # nested, each with corners
        constraint = cp.SOC(float(np.cos(np.pi / TANGENTS)) ** discs * constraint.args[0], constraint.args[1], axis=0)
    found: Sequence[cp.Constraint] = without_cones(constraint)
    return found


def without_squares(cost: cp.Expression) -> tuple[cp.Expression, list[cp.Constraint]]:
    """A sum of weighted sums of squares, each square replaced by its highest tangent at ``KNOTS``: from below."""
    knots, total, rows = np.concatenate([-KNOTS[:0:-1], KNOTS])[:, None], 0.0, []
    for term in cost.args if isinstance(cost, AddExpression) else [cost]:
        weight, squares = term.args
        line = cp.reshape(squares.args[0], (1, squares.args[0].size), order="C")
        above = cp.Variable(line.shape, nonneg=True)
        rows.append(np.ones_like(knots) @ above >= 2.0 * knots @ line - knots**2 @ np.ones(line.shape))
        total = total + weight * cp.sum(above)
    return total, rows
