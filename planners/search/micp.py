"""MICP (paper E §II and Table II, [11]): m = p f over a grid of McCormick cells, by branch and bound in binaries.

The grid is that of ``relaxation.grid``; which candidate patch a toe takes is binary, too. An envelope comes in as rows
of its own over the whole grid (paper E), or as the box that the grid divides. HiGHS has no second-order cones: with
tangent planes around them "infeasible" holds for the cones, too, while a point may leave them; with planes inside them
a point holds, and "infeasible" says nothing. Whatever a solver claims, its point is projected and verified.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from importlib import import_module, util
from typing import Any, Literal, cast, get_args, overload

import cvxpy as cp
import numpy as np

from ..answer.outcome import Outcome
from ..answer.plan import Plan, PlanOutcome
from ..equilibrium.equations import mccormick
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import Programs
from ..equilibrium.reference import coupled
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput
from ..files.arrays import Array, checked
from ..problem import PostureProblem
from ..problem.course import Course
from ..projection.project import PROJECTIONS, Projection, project
from ..relaxation.boxes import boxes_of
from ..relaxation.domain import domain_of
from ..relaxation.envelope import Envelope, EnvelopeSet
from ..relaxation.grid import (
    Breaks,
    Cells,
    Cones,
    Encoding,
    axes_of,
    cell_error,
    meet,
    of_several_frames,
    planes,
    unit_domain,
    without_squares,
)
from ..relaxation.mccormick import Axes
from .answer import Acceptance, plan_of
from .clock import Clock

_ANY = 1e9  # gap: the first point found ends the search, since a claim needs no best point
_SOLVERS: dict[str, tuple[str, str, tuple[str, str], dict[str, Any]]] = {  # module, time limit, gaps, other options
    "highs": ("highspy", "time_limit", ("mip_rel_gap", "mip_abs_gap"), {"threads": 1, "parallel": "off"}),
    "scip": ("pyscipopt", "limits/time", ("limits/gap", "limits/absgap"), {}),
    "gurobi": ("gurobipy", "TimeLimit", ("MIPGap", "MIPGapAbs"), {"Threads": 1}),
}
GUROBI_LIMITS = (
    "gurobi ended without an answer: its free licence takes 2000 variables and 2000 rows, and 200 variables with cones"
)
ABSOLUTE_GAP = 1e-4
"""Of the objective, in length scales squared: a hundredth of a length scale, 6 mm, off the goal."""
Claim = Literal["feasible", "infeasible", "unknown"]
Cut = Literal["both", "position"]
Domain = Literal["course", "unit"]
EnvelopeUse = Literal["rows", "shrink"]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """How m = p f is cut.

    intervals: pieces of every p_j and f_k, a power of two for the encoding "log". cut: "position" leaves f in one
    piece. domain: what is divided where no envelope shrinks it: bounds that the problem implies ("course"), or [−1, 1],
    paper E's range of every p and f. envelope_use: "rows" adds an envelope's rows to the grid (paper E); "shrink"
    divides the envelope, met with the problem's own bounds. cones: planes around ("outer") or inside them, or "exact";
    None: planes around them for HiGHS, which has none, else exact.
    """

    intervals: int = 4
    encoding: Encoding = "log"
    cut: Cut = "both"
    domain: Domain = "course"
    envelope_use: EnvelopeUse = "rows"
    cones: Cones | None = None

    def __post_init__(self) -> None:
        given = (self.encoding, self.cut, self.domain, self.envelope_use)
        known = {"encoding": Encoding, "cut": Cut, "domain": Domain, "envelope_use": EnvelopeUse}
        for (name, values), value in zip(known.items(), given, strict=True):
            if value not in get_args(values):
                raise InvalidInput(f"{name}: expected one of {', '.join(get_args(values))}, got {value!r}")
        if self.intervals < 1 or (self.encoding == "log" and self.intervals & (self.intervals - 1)):
            raise InvalidInput(f"intervals: expected 1 or more, and a power of two for 'log', got {self.intervals}")

    @property
    def counts(self) -> tuple[int, int]:
        """Pieces of every p_j, and of every f_k."""
        return self.intervals, self.intervals if self.cut == "both" else 1


@dataclass(frozen=True, kw_only=True, eq=False)
class MicpAnswer:
    """What the solver claims, its point where it has one with the candidates chosen in it, and its own time [s].

    moments: net moments at that point with m = p f, where those of the grid are zero, shape (S, 3).
    """

    claim: Claim
    seconds: float
    point: Point | None = None
    choice: Index | None = None
    moments: Array | None = None
    message: str = ""


class Symbols:
    """A posture's ``Scaled`` with parameters for its numbers, which cvxpy compiles once, and cells with theirs."""

    def __init__(self, layout: Layout, grid: Grid) -> None:
        self.layout, contacts = layout, len(layout.contacts[0])
        self.vertices = cp.Parameter((len(layout.vertex_footholds), 3))
        self.frames, self.friction = cp.Parameter((layout.footholds, 3, 3)), cp.Parameter(layout.footholds)
        self.shoulders, self.reach = cp.Parameter((layout.limbs, 3)), cp.Parameter(layout.limbs)
        self.force_min, self.force_max = cp.Parameter((contacts, 3)), cp.Parameter((contacts, 3))
        self.com, self.com_radius = cp.Parameter((1, 3)), cp.Parameter(1)
        self.weight, self.tilt = cp.Parameter(), cp.Parameter()
        self._numbers = {name: symbol for name, symbol in vars(self).items() if isinstance(symbol, cp.Parameter)}
        p, f = (count + 1 for count in grid.counts)
        shapes = ((3 * contacts, p), (3 * contacts, f), (9 * contacts, p * f))
        self._cells = [cp.Parameter(shape) for shape in shapes]
        self.breaks = Breaks(*self._cells)

    def load(self, scaled: Scaled, breaks: Breaks) -> None:
        """Take the numbers of a posture."""
        for name, symbol in self._numbers.items():
            symbol.value = getattr(scaled, name)
        for symbol, numbers in zip(self._cells, breaks, strict=True):
            symbol.value = numbers


class MicpProgram:
    """The mixed-integer program of one problem, or of one layout of postures and one ``Symbols`` in its place.

    envelope: of the envelope rows, where there are any. gap: the relative one to which a course's objective is
    minimised; None takes the first point found. The objective's squares become tangents where cones become planes.
    """

    def __init__(
        self,
        scaled: Scaled | Symbols,
        breaks: Breaks,
        grid: Grid = Grid(),
        *,
        solver: str = "highs",
        axes: Axes = "contact",
        envelope: Envelope | None = None,
        gap: float | None = None,
    ) -> None:
        self._layout, self._solver, self._gap = scaled.layout, solver, gap
        self._plan, self.products, terms = coupled(cast(Scaled, scaled), axes)
        cells, cones = Cells(breaks, grid.counts, grid.encoding), cones_of(grid, solver)
        constraints = [*terms.values(), *cells.terms(*self.products.parts)]
        if envelope is not None:
            constraints += mccormick(self.products.parts, envelope).values()
        if several := [k for k, p in enumerate(self._layout.candidate_footholds) if len(self._layout.corners[p]) > 1]:
            constraints.append(self._plan.shares[several] == cp.Variable(len(several), boolean=True))
        constraints = [plane for row in constraints for plane in planes(row, cones)]
        cost = cells.spread() if gap is None else self._plan.objective()
        if gap is not None and cones != "exact":
            cost, tangents = without_squares(cost)
            constraints += tangents
        self.problem = cp.Problem(cp.Minimize(cost), constraints)
        size, variables = self.problem.size_metrics, self.problem.variables()
        self.figures = {
            "binaries": float(sum(variable.size for variable in variables if variable.attributes["boolean"])),
            "variables": float(size.num_scalar_variables),
            "constraints": float(size.num_scalar_eq_constr + size.num_scalar_leq_constr),
        }

    def solve(self, scaled: Scaled, time_limit_s: float) -> MicpAnswer:
        """Find a point of the grid. scaled: the problem, whose numbers the program has."""
        _, limit, gaps, options = _SOLVERS[self._solver]
        options = options | {"solver": self._solver.upper(), limit: time_limit_s}
        options |= dict(zip(gaps, (_ANY, _ANY) if self._gap is None else (self._gap, ABSOLUTE_GAP), strict=True))
        if self._solver == "gurobi":  # in an environment of its own it does not print its licence
            options["env"] = import_module("gurobipy").Env(params={"OutputFlag": 0})
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # cvxpy's advice about time limits
                self.problem.solve(warm_start=False, **options)
        except cp.SolverError as error:  # a time-out without a point, or a licence too small for the program
            told = GUROBI_LIMITS if self._solver == "gurobi" else str(error)
            return MicpAnswer(claim="unknown", seconds=time.perf_counter() - begin, message=told)
        status, seconds = self.problem.status, float(self.problem.solver_stats.solve_time)
        if status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):  # a bounded objective: never unbounded
            empty = status in (cp.INFEASIBLE, cp.settings.INFEASIBLE_OR_UNBOUNDED)
            return MicpAnswer(claim="infeasible" if empty else "unknown", seconds=seconds)
        return self._answer(scaled, seconds)

    def _answer(self, scaled: Scaled, seconds: float) -> MicpAnswer:
        plan = self._plan
        stance, _, foothold = scaled.layout.contacts
        shares, largest = np.asarray(plan.shares.value), np.full(scaled.layout.footholds, -1, dtype=np.int_)
        for candidate in np.argsort(shares, kind="stable"):
            largest[scaled.layout.candidate_footholds[candidate]] = candidate
        position, world = np.asarray(self.products.position.value), np.asarray(self.products.world.value)
        frames = scaled.frames[largest[foothold]]
        moments = np.zeros((len(scaled.layout.stances), 3))
        np.add.at(moments, stance, np.cross(position, world))
        point = Point(
            com=np.asarray(plan.com.value), rotation=np.asarray(plan.rotation.value),
            toes=np.asarray(plan.toes.value), residual=float("inf"),
            forces=np.matmul(frames.transpose(0, 2, 1), world[..., None])[..., 0],
        )  # fmt: skip
        choice = np.concatenate(scaled.which)[largest]
        return MicpAnswer(claim="feasible", seconds=seconds, point=point, choice=choice, moments=moments)


class MicpPlanner:
    """The papers' planner: claims of a mixed-integer solver, of which only verified witnesses become an answer.

    solver: "highs", "scip" or "gurobi". envelope: a box over the stance contacts, or a learned set of one; it confines
    the search, so that "infeasible" then speaks of the envelope only. gap: relative, to which a course's objective is
    minimised (with planes from below, by tangents of its squares); None takes the first point, which is all that a
    claim needs. time_limit_s: the solver's.
    """

    name = "micp"

    def __init__(
        self,
        *,
        solver: str = "highs",
        grid: Grid = Grid(),
        envelope: Envelope | EnvelopeSet | None = None,
        gap: float | None = None,
        projection: Projection = "scp",
        time_limit_s: float = 60.0,
        acceptance: Acceptance = Acceptance(),
        programs: Programs | None = None,
    ) -> None:
        if solver not in _SOLVERS:
            raise InvalidInput(f"solver: expected one of {', '.join(_SOLVERS)}, got {solver!r}")
        if util.find_spec(_SOLVERS[solver][0]) is None:
            raise InvalidInput(f"solver: {solver} is not installed: pip install stancekit[exact]")
        cones_of(grid, solver)
        if projection not in PROJECTIONS:
            raise InvalidInput(f"projection: expected one of {', '.join(PROJECTIONS)}, got {projection!r}")
        if isinstance(envelope, EnvelopeSet) and len(envelope.envelopes) > 1:
            raise InvalidInput(f"envelopes: expected one for micp, got {len(envelope.envelopes)}")
        self.solver, self.grid, self.envelope = solver, grid, envelope
        self.gap = None if gap is None else checked(gap, "gap", least=0.0)
        self.projection: Projection = projection
        self.time_limit_s = checked(time_limit_s, "time_limit_s", above=0.0)
        self.acceptance, self._programs = acceptance, programs or Programs()

    @overload
    def solve(self, problem: PostureProblem) -> Outcome: ...

    @overload
    def solve(self, problem: Course) -> PlanOutcome: ...

    def solve(self, problem: PostureProblem | Course) -> Outcome | PlanOutcome:
        """Ask the solver, then project and verify what it found. Raises InvalidInput for an envelope of other limbs."""
        clock, scaled = Clock.start(), Scaled.of(problem)
        with clock.compiling():
            program = self.program(problem)
        begin = time.process_time()
        answer = program.solve(scaled, self.time_limit_s)
        clock.count(1, answer.seconds)
        details = program.figures | {"solver_s": answer.seconds, "solver_cpu_s": time.process_time() - begin}
        details["cell_error"] = cell_error(self.boxes(problem)[0], self.grid.counts)
        point, message = None, answer.message
        if answer.point is not None and answer.choice is not None and answer.moments is not None:
            details["claimed_residual"] = float(np.abs(answer.moments).max())
            unit_nm = scaled.force_n * scaled.length_m
            details["claimed_residual_nm"] = unit_nm * float(np.linalg.norm(answer.moments, axis=1).max())
            point = project(self._programs, self.projection, scaled.chosen(answer.choice), answer.point)
            clock.count(point.solves, point.seconds)
        if point is None or not np.isfinite(point.residual):
            point = None
            message = (
                message or f"{self.solver} says {answer.claim}; neither a certificate nor toes that hold came with it"
            )
        said: dict[str, Any] = {"claim": answer.claim, "message": message, "details": details}
        if isinstance(problem, PostureProblem):
            posture = None if point is None else scaled.posture(point)
            return self.acceptance.outcome(
                problem, method=self.name, begin=clock.begin, posture=posture, solves=clock.solves, **said
            )
        plan: Plan | None = None
        if point is not None and answer.choice is not None:
            made = {"planner": self.name, "solver": self.solver, "projection": self.projection}
            plan = plan_of(problem, scaled, answer.choice, point, provenance=made)
        return self.acceptance.plan_outcome(problem, method=self.name, clock=clock, plan=plan, **said)

    def program(self, problem: PostureProblem | Course) -> MicpProgram:
        """The program of a problem; postures of one layout share one, which then has the numbers of this one."""
        scaled, (domain, envelope) = Scaled.of(problem), self.boxes(problem)
        breaks = Breaks.of(domain, self.grid.counts)
        if isinstance(problem, PostureProblem) and envelope is None:
            symbols, program = self._programs.get(_of_layout, scaled.layout, self.grid, self.solver)
            symbols.load(scaled, breaks)
            return program
        gap = None if isinstance(problem, PostureProblem) else self.gap
        axes = axes_of(scaled)
        return MicpProgram(scaled, breaks, self.grid, solver=self.solver, axes=axes, envelope=envelope, gap=gap)

    def boxes(self, problem: PostureProblem | Course) -> tuple[Envelope, Envelope | None]:
        """The domain that the grid divides, and the box of the envelope rows, where there are any."""
        scaled, envelope = Scaled.of(problem), self.box(problem)
        domain = domain_of(scaled, axes_of(scaled)) if self.grid.domain == "course" else unit_domain(scaled)
        if envelope is not None and self.grid.envelope_use == "shrink":
            return meet(envelope, domain), None
        return domain, envelope

    def box(self, problem: PostureProblem | Course) -> Envelope | None:
        """The envelope over the stance contacts of a problem. Raises InvalidInput where it was learned for others."""
        if self.envelope is None:
            return None
        scaled = Scaled.of(problem)
        contacts = len(scaled.force_min)
        if isinstance(problem, Course):
            for row in of_several_frames(scaled)[:1]:
                stance, limb, _ = (part[row] for part in scaled.layout.contacts)
                raise InvalidInput(
                    f"frame {scaled.layout.stance_frames[stance]}, limb {problem.robot.limb_names[limb]}: expected "
                    "candidate patches that share one contact frame, for an envelope on the forces in it; got several"
                )
        if isinstance(self.envelope, EnvelopeSet):
            if isinstance(problem, Course):
                return boxes_of(problem, self.envelope)[0]
            self.envelope.check_fits(problem)
            return self.envelope.envelopes[0]
        if self.envelope.contacts != contacts:
            raise InvalidInput(f"contacts: expected {self.envelope.contacts} for this envelope, got {contacts}")
        return self.envelope


def _of_layout(layout: Layout, grid: Grid, solver: str) -> tuple[Symbols, MicpProgram]:
    symbols = Symbols(layout, grid)
    return symbols, MicpProgram(symbols, symbols.breaks, grid, solver=solver)


def cones_of(grid: Grid, solver: str) -> Cones:
    """What becomes of second-order cones. Raises InvalidInput for what there is not."""
    cones = grid.cones or ("outer" if solver == "highs" else "exact")
    if cones not in ("outer", "inner") and not (cones == "exact" and solver != "highs"):
        raise InvalidInput(f"cones: expected outer, inner, or exact for another solver than highs, got {cones!r}")
    return cones
