"""MICP as mixed-integer solvers take it: the paper's program (``papers.micp``), with planes in the
place of cones for a solver that has none.

For postures it is compiled once per layout, with parameters in the place of their numbers. HiGHS,
which has no second-order cones, gets planes around them, and tangents in the place of squares.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Any, Literal, cast, get_args

import cvxpy as cp
import numpy as np
from cvxpy.atoms.affine.add_expr import AddExpression

from ..equilibrium.layout import Index, Layout
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput
from ..files.arrays import Array, checked_choice
from .envelope import Envelope
from .mccormick import Axes
from .papers import Breaks, micp

_ANY = 1e9  # gap: the first point found ends the search, since a claim needs no best point
SOLVERS: Mapping[str, tuple[str, str, tuple[str, str], dict[str, Any]]] = MappingProxyType(
    {  # module, time limit, gaps, other options
        "highs": (
            "highspy",
            "time_limit",
            ("mip_rel_gap", "mip_abs_gap"),
            {"threads": 1, "parallel": "off"},
        ),
        "scip": ("pyscipopt", "limits/time", ("limits/gap", "limits/absgap"), {}),
        "gurobi": ("gurobipy", "TimeLimit", ("MIPGap", "MIPGapAbs"), {"Threads": 1}),
    }
)
GUROBI_LIMITS = "gurobi ended without an answer: its free licence takes 2000 variables and 2000 rows, and 200 variables with cones"
_ABSOLUTE_GAP = 1e-4
"""Absolute gap of the objective, in length scales squared: a hundredth of a length scale, 6 mm, off
the goal."""
Claim = Literal["feasible", "infeasible", "unknown"]
_Domain = Literal["course", "unit"]
_EnvelopeUse = Literal["rows", "shrink"]
_TANGENTS = 16  # planes around a disc: the polygon exceeds it by 2 % at its corners, the polyhedron of a ball by 4 %
KNOTS = np.array([0.0, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.23, 0.33, 0.5, 0.8, 1.3])
"""Where tangents touch a square, either side, in length scales: up to .35 off, y² is at most .0025
above them."""


@dataclass(frozen=True, kw_only=True)
class MicpGrid:
    """Grid that cuts m = p f.

    Arguments:
        intervals: pieces of every p_j and f_k, a power of two.
        domain: what is divided where no envelope shrinks it: bounds that the problem implies
            ("course"), or [−1, 1], Lin et al.'s range of every p and f.
        envelope_use: "rows" adds an envelope's rows to the grid (Lin et al.); "shrink" divides the
            envelope, met with the problem's own bounds.
    """

    intervals: int = 4
    domain: _Domain = "course"
    envelope_use: _EnvelopeUse = "rows"

    def __post_init__(self) -> None:
        checked_choice(self.domain, "domain", get_args(_Domain))
        checked_choice(self.envelope_use, "envelope_use", get_args(_EnvelopeUse))
        object.__setattr__(self, "intervals", int(self.intervals))  # numpy's have no bit_length
        if self.intervals < 1 or self.intervals & (self.intervals - 1):
            raise InvalidInput(f"intervals: expected a power of two, got {self.intervals}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _MicpAnswer:
    """Claim of the solver, its point where it has one with the candidates chosen in it, and its own
    time [s].

    Arguments:
        moments: net moments at that point with m = p f, where those of the grid are zero, shape (S,
            3).
    """

    claim: Claim
    seconds: float
    point: Point | None = None
    choice: Index | None = None
    moments: Array | None = None
    message: str = ""


class _Symbols:
    """A posture's ``Scaled`` with parameters for its numbers, which cvxpy compiles once, and cells
    with theirs.
    """

    def __init__(self, layout: Layout, grid: MicpGrid) -> None:
        self.layout, contacts = layout, len(layout.contacts[0])
        self.vertices = cp.Parameter((len(layout.vertex_footholds), 3))
        self.frames, self.friction = (
            cp.Parameter((layout.footholds, 3, 3)),
            cp.Parameter(layout.footholds),
        )
        self.shoulders, self.reach = cp.Parameter((layout.limbs, 3)), cp.Parameter(layout.limbs)
        self.force_min, self.force_max = cp.Parameter((contacts, 3)), cp.Parameter((contacts, 3))
        self.com, self.com_radius = cp.Parameter((1, 3)), cp.Parameter(1)
        self.weight, self.tilt = cp.Parameter(), cp.Parameter()
        if layout.wrench:
            self.wrench = cp.Parameter((len(layout.stances), 6))
        self._numbers = {
            name: symbol for name, symbol in vars(self).items() if isinstance(symbol, cp.Parameter)
        }
        ends = grid.intervals + 1
        shapes = ((3 * contacts, ends), (3 * contacts, ends), (9 * contacts, ends**2))
        self._cells = [cp.Parameter(shape) for shape in shapes]
        self.breaks = Breaks(*self._cells)

    def load(self, scaled: Scaled, breaks: Breaks) -> None:
        """Take the numbers of a posture."""
        for name, symbol in self._numbers.items():
            symbol.value = getattr(scaled, name)
        for symbol, numbers in zip(self._cells, breaks, strict=True):
            symbol.value = numbers


class MicpProgram:
    """The mixed-integer program of one problem, or of one layout of postures and one ``_Symbols`` in
    its place.

    The objective's squares become tangents where cones become planes.

    Arguments:
        envelope: of the envelope rows, where there are any.
        gap: the relative one to which a course's objective is minimised; None takes the first point
            found.
    """

    def __init__(
        self,
        scaled: Scaled | _Symbols,
        breaks: Breaks,
        *,
        solver: str = "highs",
        axes: Axes = "contact",
        envelope: Envelope | None = None,
        gap: float | None = None,
    ) -> None:
        self._solver, self._gap = solver, gap
        self.model = micp(
            cast(Scaled, scaled),
            breaks,
            axes=axes,
            envelope=envelope,
            optimise=gap is not None,
        )
        cost, constraints = self.model.cost, list(self.model.terms.values())
        if solver == "highs":
            constraints = [plane for row in constraints for plane in planes(row)]
        if gap is not None and solver == "highs":
            cost, tangents = without_squares(cost)
            constraints += tangents
        self.problem = cp.Problem(cp.Minimize(cost), constraints)
        size, variables = self.problem.size_metrics, self.problem.variables()
        self.figures = {
            "binaries": float(
                sum(variable.size for variable in variables if variable.attributes["boolean"])
            ),
            "variables": float(size.num_scalar_variables),
            "constraints": float(size.num_scalar_eq_constr + size.num_scalar_leq_constr),
        }

    def solve(self, scaled: Scaled, time_limit_s: float) -> _MicpAnswer:
        """Find a point of the grid; of a course the best within the gap.

        Arguments:
            scaled: the problem, whose numbers the program has.
            time_limit_s: the solver's.

        Returns:
            Its claim in words, with a point, a choice of candidates and the moments that it thinks
            there are where it found some: nothing is verified here.
        """
        _, limit, gaps, options = SOLVERS[self._solver]
        options = options | {"solver": self._solver.upper(), limit: time_limit_s}
        options |= dict(
            zip(
                gaps, (_ANY, _ANY) if self._gap is None else (self._gap, _ABSOLUTE_GAP), strict=True
            )
        )
        if self._solver == "gurobi":  # in an environment of its own it does not print its licence
            options["env"] = import_module("gurobipy").Env(params={"OutputFlag": 0})
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # cvxpy's advice about time limits
                self.problem.solve(warm_start=False, **options)
        except (
            cp.SolverError
        ) as error:  # a time-out without a point, or a licence too small for the program
            message = GUROBI_LIMITS if self._solver == "gurobi" else str(error)
            return _MicpAnswer(
                claim="unknown", seconds=time.perf_counter() - begin, message=message
            )
        status, seconds = self.problem.status, float(self.problem.solver_stats.solve_time)
        if status not in (
            cp.OPTIMAL,
            cp.OPTIMAL_INACCURATE,
        ):  # a bounded objective: never unbounded
            empty = status in (cp.INFEASIBLE, cp.settings.INFEASIBLE_OR_UNBOUNDED)
            return _MicpAnswer(claim="infeasible" if empty else "unknown", seconds=seconds)
        return self._answer(scaled, seconds)

    def _answer(self, scaled: Scaled, seconds: float) -> _MicpAnswer:
        plan, products = self.model.plan, self.model.products
        assert products is not None
        stance, _, foothold = scaled.layout.contacts
        shares, largest = (
            np.asarray(plan.shares.value),
            np.full(scaled.layout.footholds, -1, dtype=np.int_),
        )
        for candidate in np.argsort(shares, kind="stable"):
            largest[scaled.layout.candidate_footholds[candidate]] = candidate
        position, world = np.asarray(products.position.value), np.asarray(products.world.value)
        frames = scaled.frames[largest[foothold]]
        moments = np.array(scaled.twisted)
        np.add.at(moments, stance, np.cross(position, world))
        point = Point(
            com=np.asarray(plan.com.value),
            rotation=np.asarray(plan.rotation.value),
            toes=np.asarray(plan.toes.value),
            residual=float("inf"),
            forces=np.matmul(frames.transpose(0, 2, 1), world[..., None])[..., 0],
        )
        choice = scaled.numbers[largest]
        return _MicpAnswer(
            claim="feasible", seconds=seconds, point=point, choice=choice, moments=moments
        )


def of_layout(layout: Layout, grid: MicpGrid, solver: str) -> tuple[_Symbols, MicpProgram]:
    """The program of all postures of a layout, and what to load their numbers into."""
    symbols = _Symbols(layout, grid)
    return symbols, MicpProgram(symbols, symbols.breaks, solver=solver)


def cell_error(domain: Envelope, intervals: int) -> float:
    """The most that m may be off p f in a cell: a quarter of the largest product of its sides
    (McCormick 1976).

    Arguments:
        domain: of [p, f].
        intervals: pieces of every p_j and f_k. Non-dimensional, as m is.
    """
    sides = domain.high - domain.low
    return float(np.max(sides[:, :3, None] * sides[:, None, 3:])) / (4.0 * intervals**2)


def planes(constraint: cp.Constraint) -> Sequence[cp.Constraint]:
    """The constraint, or planes around it if it is second-order cones ‖x‖ ≤ t of 2 or 3 components.

    Three components are nested discs, ‖(x₁, x₂)‖ ≤ r and ‖(r, x₃)‖ ≤ t, with a variable r each
    (Ben-Tal, Nemirovski).
    """
    if not isinstance(constraint, cp.SOC):
        return [constraint]
    radius, vectors = (
        cp.reshape(part, (constraint.args[0].size, -1), order="C").T for part in constraint.args
    )
    if constraint.axis == 0 and constraint.args[1].ndim == 2:
        vectors = constraint.args[1]
    angle = np.linspace(0.0, 2.0 * np.pi, _TANGENTS, endpoint=False)
    circle, every = np.column_stack([np.cos(angle), np.sin(angle)]), np.ones((_TANGENTS, 1))
    if vectors.shape[0] == 2:
        return [circle @ vectors <= every @ radius]
    inner, half = (
        cp.Variable((1, vectors.shape[1])),
        circle[:, 0] > -1e-9,
    )  # the first rows imply r ≥ 0
    outer = circle[half] @ cp.vstack([inner, vectors[2:]]) <= every[half] @ radius
    return [circle @ vectors[:2] <= every @ inner, outer]


def without_squares(cost: cp.Expression) -> tuple[cp.Expression, list[cp.Constraint]]:
    """A sum of weighted sums of squares, each square replaced by its highest tangent at ``KNOTS``:
    from below.
    """
    knots, total, rows = np.concatenate([-KNOTS[:0:-1], KNOTS])[:, None], 0.0, []
    for term in cost.args if isinstance(cost, AddExpression) else [cost]:
        weight, squares = term.args
        line = cp.reshape(squares.args[0], (1, squares.args[0].size), order="C")
        above = cp.Variable(line.shape, nonneg=True)
        rows.append(
            np.ones_like(knots) @ above >= 2.0 * knots @ line - knots**2 @ np.ones(line.shape)
        )
        total = total + weight * cp.sum(above)
    return total, rows


def axes_of(scaled: Scaled) -> Axes:
    """The contact frames where the candidates under every stance contact share one, else the
    world's axes.
    """
    return "world" if len(of_several_frames(scaled)) else "contact"


def of_several_frames(scaled: Scaled) -> Index:
    """The stance contacts under which candidates of several frames are open, in order."""
    contact, candidate = scaled.layout.contact_candidates
    first = np.searchsorted(scaled.layout.candidate_footholds, scaled.layout.contacts[2])
    off = np.abs(scaled.frames[candidate] - scaled.frames[first[contact]]).max(axis=(1, 2))
    return np.unique(contact[off > 1e-6])


def unit_domain(scaled: Scaled) -> Envelope:
    """[−1, 1] for every p and f of every stance contact (Lin et al. §II), f_n included."""
    ends = np.ones((len(scaled.layout.contacts[0]), 6))
    return Envelope(low=-ends, high=ends)


def meet(first: Envelope, second: Envelope) -> Envelope:
    """The common part of two boxes; on a side where they have none, the gap between them."""
    ends = (np.maximum(first.low, second.low), np.minimum(first.high, second.high))
    return Envelope.from_vector(np.concatenate(ends, axis=None))
