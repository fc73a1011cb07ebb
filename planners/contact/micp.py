"""P MICP: m = p f over a grid of cells with a McCormick envelope each, a mixed-integer program (paper E §II, [11]).

Every p_j and f_k is cut into intervals. Over one cell the envelope of m = p f is the hull of the four points
(p, f, p f) at its corners, so that over the grid

    (p, f, m) = Σ_ab w_ab (P_a, F_b, P_a F_b),   w ≥ 0, Σ w = 1,   α_a = Σ_b w_ab and β_b = Σ_a w_ab of type SOS2,

with breakpoints P_a, F_b: weight lies on one cell's corners only. So do Dai, Izatt and Tedrake (2019, [11]) in Drake
(``AddBilinearProductMcCormickEnvelopeSos2``). The three products of a p_j share its α, those of an f_k its β, so that
binaries are per variable and not per cell: log₂ K by a Gray code (Vielma and Nemhauser 2011), or one an interval in
Padberg's (2000) locally ideal form. HiGHS has no second-order cones and gets tangent planes around them, so that
"infeasible" still means that the grid has no point. A point of the grid is a claim, and is projected and verified.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from importlib import import_module, util
from typing import Any, Literal

import cvxpy as cp
import numpy as np

from ..arrays import Array, checked
from ..outcome import InvalidInput, Outcome, Posture
from ..scene import PostureProblem
from ..verify import check_posture
from .envelope import Envelope
from .planner import Acceptance
from .project import Point, Projector
from .relax import box_values, mccormick_rows
from .scaled import ScaledProblem, side_by_side, skew
from .terms import Body, Equilibrium, Forces, Toes

TANGENTS = 16  # planes around a disc: the polygon exceeds it by 2 % at its corners, the polyhedron of a ball by 4 %
_ANY = 1e9  # gap: the first point found ends the search, since a claim needs no best point
SOLVERS: dict[str, tuple[str, str, dict[str, Any]]] = {  # its module, its time limit's key, its other options
    "highs": ("highspy", "time_limit", {"threads": 1, "parallel": "off", "mip_rel_gap": _ANY, "mip_abs_gap": _ANY}),
    "scip": ("pyscipopt", "limits/time", {"limits/gap": _ANY}),
    "gurobi": ("gurobipy", "TimeLimit", {"Threads": 1, "MIPGap": _ANY}),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class MicpAnswer:
    """What the solver claims of the grid, its point where it has one, and its own time [s]."""

    claim: Literal["feasible", "infeasible", "unknown"]
    point: Point | None
    seconds: float


class MicpModel:
    """The mixed-integer program for N contacts and U vertices a patch, written once; a solve only loads new numbers.

    intervals: pieces that every p_j and f_k is cut in; a power of two for the "log" encoding. grid: "both", or
    "position", where f is one piece. envelope_rows: adds McCormick rows over a further box (paper E, Table II).
    """

    def __init__(
        self,
        contacts: int,
        vertices: int,
        *,
        intervals: int = 4,
        encoding: Literal["log", "unary"] = "log",
        grid: Literal["both", "position"] = "both",
        solver: str = "highs",
        envelope_rows: bool = False,
    ) -> None:
        check_options(intervals=intervals, encoding=encoding, grid=grid, solver=solver)
        _, self._limit, options = SOLVERS[solver]
        self._options = options | {"solver": solver.upper()}
        if solver == "gurobi":  # in an environment of its own it does not print its licence
            self._options["env"] = import_module("gurobipy").Env(params={"OutputFlag": 0})
        body, toes, forces = Body(contacts), Toes(contacts, vertices), Forces(contacts)
        position, moments = cp.Variable((contacts, 3), name="position"), cp.Variable((contacts, 9), name="moments")
        toes_w, axes = toes.position(), cp.Parameter((3, 9 * contacts), name="moment_axes")
        self._answers = (body.com, body.rotation, toes_w, forces.forces)
        self._cells = Cells(contacts, (intervals, intervals if grid == "both" else 1), encoding)
        constraints = [
            Equilibrium(3 * contacts).of_forces(forces.flat()), forces.in_cones(), *forces.in_box(),
            *toes.on_patches(), body.within_reach(toes_w), *body.within_limits(),
            position == toes_w - cp.vstack([body.com] * contacts), axes @ cp.vec(moments, order="C") == 0,
            *self._cells.rows(position, forces.forces, moments),
            *(mccormick_rows(position, forces.forces, moments, 0.0) if envelope_rows else []),
        ]  # fmt: skip
        if solver == "highs":
            constraints = [row for constraint in constraints for row in without_cones(constraint)]
        self.problem = cp.Problem(cp.Minimize(self._cells.spread()), constraints)
        size, variables = self.problem.size_metrics, self.problem.variables()
        self.figures = {
            "binaries": float(sum(variable.size for variable in variables if variable.attributes["boolean"])),
            "variables": float(size.num_scalar_variables),
            "constraints": float(size.num_scalar_eq_constr + size.num_scalar_leq_constr),
        }

    def solve(
        self, scaled: ScaledProblem, domain: Envelope, *, envelope: Envelope | None = None, time_limit_s: float = 60.0
    ) -> MicpAnswer:
        """Find a point of the grid whose cells divide ``domain``; ``envelope`` is the box of the envelope rows."""
        axes = side_by_side(np.matmul(skew(np.eye(3)), scaled.frames[:, None]).reshape(-1, 3, 3))
        values = scaled.values() | {"moment_axes": axes} | self._cells.values(domain) | box_values(envelope or domain)
        for parameter in self.problem.parameters():
            parameter.value = values[parameter.name()]
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # cvxpy's advice about time limits
                self.problem.solve(enforce_dpp=True, warm_start=False, **self._options | {self._limit: time_limit_s})
        except cp.SolverError:  # a time-out without a point, or a licence too small for the program
            return MicpAnswer(claim="unknown", point=None, seconds=time.perf_counter() - begin)
        status, seconds = self.problem.status, float(self.problem.solver_stats.solve_time)
        if status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):  # a bounded objective: never unbounded
            empty = status in (cp.INFEASIBLE, cp.settings.INFEASIBLE_OR_UNBOUNDED)
            return MicpAnswer(claim="infeasible" if empty else "unknown", point=None, seconds=seconds)
        com, rotation, toes, forces = (np.asarray(part.value) for part in self._answers)
        point = Point(com=com, rotation=rotation, toes=toes, forces=forces, residual=float("nan"))
        return MicpAnswer(claim="feasible", point=point, seconds=seconds)


class MicpPlanner:
    """The papers' baseline: claims of a mixed-integer solver, of which only verified witnesses become an answer.

    solver: "highs", "scip" or "gurobi". envelope_use: "rows" adds the envelope's McCormick rows to the grid (paper E);
    "shrink" divides the envelope, met with the problem's own bounds, in place of these. time_limit_s: the solver's.
    Either use of an envelope confines the search to it, so that "infeasible" then speaks of the envelope only.
    """

    name = "micp"

    def __init__(
        self,
        *,
        solver: str = "highs",
        intervals: int = 4,
        encoding: Literal["log", "unary"] = "log",
        grid: Literal["both", "position"] = "both",
        envelope: Envelope | None = None,
        envelope_use: Literal["rows", "shrink"] = "rows",
        time_limit_s: float = 60.0,
        acceptance: Acceptance | None = None,
    ) -> None:
        check_options(intervals=intervals, encoding=encoding, grid=grid, solver=solver, envelope_use=envelope_use)
        self.solver, self.envelope, self.envelope_use = solver, envelope, envelope_use
        self.time_limit_s = checked(time_limit_s, "time_limit_s", above=0.0)
        self.acceptance = acceptance or Acceptance()
        self._options: dict[str, Any] = {"intervals": intervals, "encoding": encoding, "grid": grid, "solver": solver}
        self._options["envelope_rows"] = envelope is not None and envelope_use == "rows"
        self._compiled: dict[tuple[int, int], tuple[MicpModel, Projector]] = {}

    def solve(self, problem: PostureProblem) -> Outcome:
        """Ask the solver, then project and verify what it found. Raises InvalidInput for an envelope of other limbs."""
        begin = time.perf_counter()
        scaled = ScaledProblem.of(problem)
        if scaled.size not in self._compiled:
            self._compiled[scaled.size] = (MicpModel(*scaled.size, **self._options), Projector(*scaled.size))
        model, projector = self._compiled[scaled.size]
        envelope, domain = self.envelope, domain_of(scaled)
        if envelope is not None and envelope.contacts != scaled.size[0]:
            raise InvalidInput(f"contacts: expected {envelope.contacts} for this envelope, got {scaled.size[0]}")
        if envelope is not None and self.envelope_use == "shrink":
            domain, envelope = meet(envelope, domain), None
        answer = model.solve(scaled, domain, envelope=envelope, time_limit_s=self.time_limit_s)
        details = model.figures | {"solver_seconds": answer.seconds}
        posture, solves = None, 0
        message = f"{self.solver} says {answer.claim}; neither a certificate nor toes that hold came with it"
        if answer.point is not None:
            details["claimed_residual_nm"] = check_posture(problem, _posture(scaled, answer.point)).residual_nm
            projected = projector.scp(scaled, answer.point)
            solves = projected.solves
            if np.isfinite(projected.residual):
                posture, message = _posture(scaled, projected), ""
        return self.acceptance.outcome(
            problem, method=self.name, begin=begin, posture=posture, solves=solves, claim=answer.claim, message=message,
            details=details,
        )  # fmt: skip


class Cells:
    """The grid over p and f of every contact, and m = p f on it.

    counts: pieces a p_j and an f_k. Rows of α, β and w: 3i + j, 3i + k and 9i + 3j + k for contact i.
    """

    def __init__(self, contacts: int, counts: tuple[int, int], encoding: str) -> None:
        self._counts = counts
        p_ends, f_ends = ends = counts[0] + 1, counts[1] + 1
        alpha, beta = self._pieces = [cp.Variable((3 * contacts, end), nonneg=True) for end in ends]
        corners = cp.Variable((9 * contacts, p_ends * f_ends), nonneg=True)  # w_ab in column a (K_f + 1) + b
        self._sums = []
        for name, weights in (("p", alpha), ("f", beta), ("m", corners)):
            breaks = cp.Parameter(weights.shape, name=f"breaks_{name}")
            self._sums.append(cp.sum(cp.multiply(breaks, weights), axis=1))
        three, every = np.eye(3), np.eye(contacts)
        of_p, of_f = np.kron(every, np.kron(three, np.ones((3, 1)))), np.kron(every, np.tile(three, (3, 1)))
        self._linked = [
            cp.sum(alpha, axis=1) == 1, *neighbouring(alpha, encoding),
            cp.sum(beta, axis=1) == 1, *neighbouring(beta, encoding),
            corners @ np.kron(np.eye(p_ends), np.ones((f_ends, 1))) == of_p @ alpha,
            corners @ np.kron(np.ones((p_ends, 1)), np.eye(f_ends)) == of_f @ beta,
        ]  # fmt: skip

    def spread(self) -> cp.Expression:
        """Σ of α and β times the squared distance (in intervals) of their breakpoint from the middle one.

        Least on neighbours for a given p or f: HiGHS finds them ten times faster than without an objective.
        """
        alpha, beta = (w @ (np.arange(k + 1) - 0.5 * k) ** 2 for w, k in zip(self._pieces, self._counts, strict=True))
        return cp.sum(alpha) + cp.sum(beta)

    def rows(self, *variables: cp.Variable) -> list[cp.Constraint]:
        """(p, f, m) lies in the envelope of one cell; p, f: shape (N, 3); m: shape (N, 9)."""
        return self._linked + [cp.vec(v, order="C") == s for v, s in zip(variables, self._sums, strict=True)]

    def values(self, domain: Envelope) -> dict[str, Array | float]:
        """Breakpoints that cut every side of the domain evenly, and their products."""
        boxes = zip((domain.position, domain.force), self._counts, strict=True)
        p, f = (np.linspace(low, high, count + 1, axis=-1) for (low, high), count in boxes)
        m = p[:, :, None, :, None] * f[:, None, :, None, :]  # i, j, k, a, b
        flat = {"p": p.reshape(-1, p.shape[-1]), "f": f.reshape(-1, f.shape[-1]), "m": m.reshape(9 * len(m), -1)}
        return {f"breaks_{name}": breaks for name, breaks in flat.items()}


def neighbouring(weights: cp.Variable, encoding: str) -> list[cp.Constraint]:
    """Every row of ``weights``, shape (R, K + 1), is zero but for two neighbours (SOS2); one interval needs no row."""
    rows, count = weights.shape[0], weights.shape[1] - 1
    if count == 1:
        return []
    if encoding == "unary":  # Padberg: weight up to breakpoint a wants an interval up to a; from a on, from a − 1 on
        chosen, ends = cp.Variable((rows, count), boolean=True), np.ones((count + 1, count))
        return [
            cp.sum(chosen, axis=1) == 1,
            weights @ np.triu(ends) <= chosen @ np.triu(ends[1:]),
            weights @ np.tril(ends, -1) <= chosen @ np.tril(ends[1:]),
        ]
    bits = count.bit_length() - 1
    code = np.array([k ^ (k >> 1) for k in range(count)])[:, None] >> np.arange(bits) & 1 == 1  # Gray, by digit
    beside = np.stack([code[[0, *range(count)]], code[[*range(count), count - 1]]])  # of both intervals at a breakpoint
    digit = cp.Variable((rows, bits), boolean=True)
    return [weights @ beside.all(axis=0) <= digit, weights @ (~beside).all(axis=0) <= 1 - digit]


def domain_of(scaled: ScaledProblem) -> Envelope:
    """Bounds on [p, f] that the problem implies: the domain of the grid.

    p: vertices against the ball of the centre of mass, met with the shoulder's reach at any tilt. f: the force box, met
    with the cone's. Bounds that exclude each other change places: the program's own rows are infeasible then.
    """
    toes, size = scaled.vertices - scaled.com, np.abs(scaled.shoulders)
    reach = scaled.reach[:, None] + scaled.tilt * (size.sum(axis=1, keepdims=True) - size)  # |(Θ × v)_j| ≤ tilt Σ |v_k|
    normal = np.maximum(scaled.force_max[:, :1], 0.0)
    cone = normal * np.column_stack([np.ones_like(scaled.friction), scaled.friction, scaled.friction])
    low = np.hstack([np.maximum(toes.min(axis=1) - scaled.com_radius, scaled.shoulders - reach), scaled.force_min])
    high = np.hstack([np.minimum(toes.max(axis=1) + scaled.com_radius, scaled.shoulders + reach), scaled.force_max])
    low[:, 3:] = np.maximum(low[:, 3:], cone * [0.0, -1.0, -1.0])
    high[:, 3:] = np.minimum(high[:, 3:], cone)
    return Envelope.from_vector(np.concatenate([low, high], axis=None))


def meet(first: Envelope, second: Envelope) -> Envelope:
    """The common part of two boxes; on a side where they have none, the gap between them."""
    ends = (np.maximum(first.low, second.low), np.minimum(first.high, second.high))
    return Envelope.from_vector(np.concatenate(ends, axis=None))


def without_cones(constraint: cp.Constraint) -> list[cp.Constraint]:
    """The constraint, or tangent planes around it if it is second-order cones ‖x‖ ≤ t of 2 or 3 components, by columns.

    Three components are nested discs, ‖(x₁, x₂)‖ ≤ r and ‖(r, x₃)‖ ≤ t, with a variable r each (Ben-Tal, Nemirovski).
    """
    if not isinstance(constraint, cp.SOC):
        return [constraint]
    radius, vectors = (cp.reshape(part, (-1, constraint.args[0].size), order="C") for part in constraint.args)
    angle = np.linspace(0.0, 2.0 * np.pi, TANGENTS, endpoint=False)
    circle, every = np.column_stack([np.cos(angle), np.sin(angle)]), np.ones((TANGENTS, 1))
    if vectors.shape[0] == 2:
        return [circle @ vectors <= every @ radius]
    inner, half = cp.Variable((1, vectors.shape[1])), circle[:, 0] > -1e-9  # the first rows imply r ≥ 0
    outer = circle[half] @ cp.vstack([inner, vectors[2:]]) <= every[half] @ radius
    return [circle @ vectors[:2] <= every @ inner, outer]


def check_options(*, intervals: int, encoding: str, grid: str, solver: str, envelope_use: str = "rows") -> None:
    """Raise InvalidInput for options that there are not, and for a solver that is not installed."""
    given = {"encoding": encoding, "grid": grid, "envelope_use": envelope_use, "solver": solver}
    known = (("log", "unary"), ("both", "position"), ("rows", "shrink"), tuple(SOLVERS))
    for (name, value), values in zip(given.items(), known, strict=True):
        if value not in values:
            raise InvalidInput(f"{name}: expected one of {', '.join(values)}, got {value!r}")
    if intervals < 1 or (encoding == "log" and intervals & (intervals - 1)):
        raise InvalidInput(f"intervals: expected 1 or more, and a power of two for 'log', got {intervals}")
    if util.find_spec(SOLVERS[solver][0]) is None:
        raise InvalidInput(f"solver: {solver} is not installed: pip install stancekit[exact]")


def _posture(scaled: ScaledProblem, point: Point) -> Posture:
    return scaled.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)
