"""The nonlinear program: values, exact sparse Jacobians and Hessians out of blocks, as CasADi
functions for IPOPT.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ...arguments import cached_property
from ...files.arrays import Array
from .taylor import Block, Compiled, Constraint, Kernels, TaylorBank, blocks_of, matrix, scattered


class Program:
    """lower ≤ g(x) ≤ upper, and an objective, from constraints and cost blocks.

    Parameters of all functions, p: the reference x₁ (size), the weights of the objective's parts
    (3) and the factor on the heights of the terrain. Objective: ½ w₀ ‖x − x₁‖² + ½ w₁ Σ costs + ½
    w₂ ‖rates x‖².

    Arguments:
        kernels: what programs that differ from it in their numbers alone have written.
        rows: number of constraints.
        errors: what was raised where the functions were evaluated; CasADi does not pass it on.
    """

    def __init__(
        self,
        size: int,
        constraints: Sequence[Constraint],
        costs: Sequence[Block],
        rates: csr_array,
        kernels: Kernels | None = None,
    ) -> None:
        self.size, self.constraints = size, tuple(constraints)
        self.lower = np.concatenate([one.lower for one in constraints])
        self.upper = np.concatenate([one.upper for one in constraints])
        self._kernels = kernels
        self.rows = len(self.lower)
        self._blocks = [Compiled(block, kernels) for block in blocks_of(constraints)]
        self._costs_of, self._rates = tuple(costs), rates
        linear = [
            one.linear if one.linear is not None else csr_array((one.rows, size))
            for one in constraints
        ]
        self._linear = matrix(vstack(linear))
        self._x, self._p = cs.MX.sym("x", size), cs.MX.sym("p", size + 4)
        self._reference, self._weights, self._factor = cs.vertsplit(
            self._p, [0, size, size + 3, size + 4]
        )
        self._bank = TaylorBank(self._x, self._factor)
        self.errors = self._bank.errors
        self._scatters = [
            matrix(scattered(compiled.block.scatter, self.rows)) for compiled in self._blocks
        ]
        self._multipliers = cs.MX.sym("lam_g", self.rows)

    @cached_property
    def _costs(self) -> list[Compiled]:
        return [Compiled(block, self._kernels) for block in self._costs_of]

    # ------------------------------------------------------------------------------------------ the
    # constraints

    @cached_property
    def constraint(self) -> cs.Function:
        """(x, p) → g."""
        return cs.Function("nlp_g", [self._x, self._p], [self._constraint], ["x", "p"], ["g"])

    @cached_property
    def _constraint(self) -> cs.MX:
        total = self._linear @ self._x
        for compiled, scatter in zip(self._blocks, self._scatters, strict=True):
            value = compiled.kernel(0).map(compiled.block.count)(
                *compiled.at(self._x, self._bank, 0)
            )
            total += scatter @ cs.densify(cs.vec(value))
        return total

    @cached_property
    def jacobian(self) -> cs.Function:
        """(x, p) → nothing, ∂g/∂x, sparse; IPOPT asks for g apart."""
        total = cs.MX(self._linear)
        for compiled, scatter in zip(self._blocks, self._scatters, strict=True):
            total += scatter @ self._slopes(compiled)
        nothing = cs.MX(self.rows, 1)
        return cs.Function(
            "nlp_jac_g", [self._x, self._p], [nothing, total], ["x", "p"], ["g", "jac_g_x"]
        )

    def _slopes(self, compiled: Compiled) -> cs.MX:
        """Derivatives of all outputs of a block in x, shape (K · outputs, size)."""
        kernel, count = compiled.kernel(1), compiled.block.count
        slopes = kernel.map(count)(*compiled.at(self._x, self._bank, 1))
        return _diagonal(kernel, slopes, count) @ compiled.gather

    def _curvature(self, compiled: Compiled, multipliers: cs.MX) -> cs.MX:
        """Hessian of multipliers · outputs, multipliers of shape (outputs, K)."""
        kernel, count = compiled.kernel(2), compiled.block.count
        curvature = kernel.map(count)(*compiled.at(self._x, self._bank, 2), multipliers)
        return compiled.gather.T @ (_diagonal(kernel, curvature, count) @ compiled.gather)

    # --------------------------------------------------------------------------------------------
    # the objective

    def objective(self, costs: bool) -> cs.Function:
        """(x, p) → f; ``costs``: with all parts, else the first alone."""
        return cs.Function("nlp_f", [self._x, self._p], [self._objective(costs)], ["x", "p"], ["f"])

    def _objective(self, costs: bool) -> cs.MX:
        total = 0.5 * self._weights[0] * cs.sumsqr(self._x - self._reference)
        if costs:
            for compiled in self._costs:
                value = compiled.kernel(0).map(compiled.block.count)(
                    *compiled.at(self._x, self._bank, 0)
                )
                total += 0.5 * self._weights[1] * cs.sum2(value)
            total += 0.5 * self._weights[2] * cs.sumsqr(matrix(self._rates) @ self._x)
        return total

    def gradient(self, costs: bool) -> cs.Function:
        """(x, p) → f, ∇f; dense, for an interior-point code reads every entry."""
        total = self._weights[0] * (self._x - self._reference)
        if costs:
            for compiled in self._costs:
                slopes = self._slopes(compiled)
                total += (
                    0.5 * self._weights[1] * cs.densify(slopes.T @ cs.MX.ones(compiled.block.count))
                )
            rates = matrix(self._rates)
            total += self._weights[2] * (rates.T @ (rates @ self._x))
        total = cs.densify(total)
        if total.nnz() != self.size:
            raise AssertionError("the gradient has to be dense")
        return cs.Function(
            "nlp_grad_f",
            [self._x, self._p],
            [self._objective(costs), total],
            ["x", "p"],
            ["f", "grad_f_x"],
        )

    def hessian(self, costs: bool) -> cs.Function:
        """(x, p, λ_f, λ_g) → upper triangle of the Lagrangian's Hessian, sparse."""
        sigma = cs.MX.sym("lam_f")
        total = sum(self._curvatures, sigma * self._weights[0] * cs.MX(cs.DM.eye(self.size)))
        if costs:
            for compiled in self._costs:
                total += self._curvature(
                    compiled, 0.5 * sigma * self._weights[1] * cs.MX.ones(1, compiled.block.count)
                )
            rates = matrix(self._rates)
            total += sigma * self._weights[2] * (rates.T @ rates)
        return cs.Function(
            "nlp_hess_l",
            [self._x, self._p, sigma, self._multipliers],
            [cs.triu(total)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        )

    @cached_property
    def _curvatures(self) -> list[cs.MX]:
        """Hessian of multipliers · g, block by block."""
        parts = []
        for compiled, scatter in zip(self._blocks, self._scatters, strict=True):
            outputs, count = compiled.block.scatter.shape[1], compiled.block.count
            local = scatter.T @ self._multipliers
            parts.append(self._curvature(compiled, cs.reshape(local, outputs, count)))
        return parts

    # ------------------------------------------------------------------------------------------------
    # violations

    def excess(self, values: Array) -> Array:
        """Distance of g outside its bounds, shape (rows,), at least 0."""
        return np.asarray(np.maximum(np.maximum(self.lower - values, values - self.upper), 0.0))

    def violations(self, values: Array) -> dict[str, float]:
        """The largest violation of each named group of constraints."""
        ends = np.cumsum([one.rows for one in self.constraints])
        largest: dict[str, float] = {}
        for one, excess in zip(self.constraints, np.split(self.excess(values), ends), strict=False):
            largest[one.name] = max(largest.get(one.name, 0.0), float(excess.max(initial=0.0)))
        return largest


def _diagonal(kernel: cs.Function, found: cs.MX, count: int) -> cs.MX:
    """The block-diagonal matrix of a map's outputs, which stand side by side."""
    pattern = kernel.sparsity_out(0)
    return cs.MX(cs.diagcat(*[pattern] * count), cs.reshape(found.nz[:], found.nnz(), 1))


Callback = Callable[[int, float, float], "bool | None"]
"""Called at every iterate with its number, the largest violation and the cost; may return True to
stop."""
_OPTIONS: dict[str, Any] = {
    "ipopt.linear_solver": "mumps",
    "ipopt.mumps_pivot_order": 0,  # approximate minimum degree, the quickest on these patterns
    "ipopt.mumps_permuting_scaling": 0,  # half of a factorisation, for nothing
    "ipopt.nlp_scaling_method": "none",
    "ipopt.mu_strategy": "adaptive",  # monotone barriers of the default take tens of iterations more, or fail
    "ipopt.tol": 1e-6,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class _IpoptResult:
    """Result of a solve.

    Arguments:
        x: the first feasible iterate, or the last where that was not asked for, shape (size,).
        success: x violates no constraint by the tolerance or more.
        iterations: until x.
        history: (violation, cost) at every iterate from the start on.
        status: what IPOPT said.
        seconds: CPU time in all, and in functions and derivatives.
    """

    x: Array
    success: bool
    iterations: int
    history: tuple[tuple[float, float], ...]
    status: str
    seconds: float
    seconds_evaluating: float


class Ipopt:
    """Solves one program, again and again; what IPOPT compiles is kept.

    Arguments:
        exact: the exact Hessian, else L-BFGS.
        tolerance: a point is feasible whose largest violation is below it.
    """

    def __init__(self, program: Program, *, exact: bool, tolerance: float) -> None:
        self._program, self._exact, self._tolerance = program, exact, tolerance
        self._solvers: dict[Any, tuple[Any, _IterateRecorder]] = {}

    def solve(
        self,
        start: Array,
        parameters: Array,
        *,
        costs: bool,
        max_iterations: int,
        callback: Callback | None = None,
        stop_when_feasible: bool = True,
        options: Mapping[str, Any] | None = None,
    ) -> _IpoptResult:
        """Solve from a point, shape (size,).

        An interrupt, or whatever else is raised on the way, ends the solve and is raised.

        Arguments:
            parameters: of the program's functions, shape (size + 4,).
            costs: the objective with all its parts, else the distance from the reference alone.
            options: further ones of IPOPT by their own names.
        """
        solver, recorder = self._solver(costs, max_iterations, dict(options or {}))
        recorder.begin(callback, stop_when_feasible)
        errors = self._program.errors
        errors.clear()
        began = time.process_time()
        try:
            solver(x0=start, p=parameters, lbg=self._program.lower, ubg=self._program.upper)
        finally:
            if errors:
                raise errors[0]
        seconds = time.process_time() - began
        stats = solver.stats()
        x, iterations, success = recorder.result()
        return _IpoptResult(
            x=x,
            success=success,
            iterations=iterations,
            history=tuple(recorder.history),
            status=str(stats["return_status"]),
            seconds=seconds,
            seconds_evaluating=sum(stats[key] for key in stats if key.startswith("t_proc_nlp_")),
        )

    def build(
        self, *, costs: bool, max_iterations: int, options: Mapping[str, Any] | None = None
    ) -> None:
        """Build what ``solve`` needs with these arguments, before a copy of this process does it
        again.
        """
        self._solver(costs, max_iterations, dict(options or {}))

    def _solver(
        self, costs: bool, limit: int, options: dict[str, Any]
    ) -> tuple[Any, _IterateRecorder]:
        """IPOPT on the program, and what looks at its iterates; built once for each kind of
        objective and options.
        """
        key = (costs, limit, tuple(sorted(options.items())))
        if key not in self._solvers:
            nlp = self._program
            recorder = _IterateRecorder(nlp, self._tolerance)
            defaults = {
                "ipopt.max_iter": limit,
                "ipopt.print_level": 0,
                "ipopt.sb": "yes",
                "print_time": False,
                "no_nlp_grad": True,
                "calc_lam_p": False,
                "ipopt.hessian_approximation": "exact" if self._exact else "limited-memory",
                **_OPTIONS,
                **{f"ipopt.{name}": value for name, value in options.items()},
                "iteration_callback": recorder,
                "jac_g": nlp.jacobian,
                "grad_f": nlp.gradient(costs),
            }
            if self._exact:
                defaults["hess_lag"] = nlp.hessian(costs)
            x, p = cs.MX.sym("x", nlp.size), cs.MX.sym("p", nlp.size + 4)
            oracle = {"x": x, "p": p, "f": nlp.objective(costs)(x, p), "g": nlp.constraint(x, p)}
            self._solvers[key] = cs.nlpsol("gait", "ipopt", oracle, defaults), recorder
        return self._solvers[key]


class _IterateRecorder(cs.Callback):
    """Looks at every iterate: records its violation and cost, keeps the first feasible one, and
    stops there.
    """

    def __init__(self, program: Program, tolerance: float) -> None:
        super().__init__()
        size, rows, self._program, self._tolerance = program.size, program.rows, program, tolerance
        self._sizes = {
            "x": size,
            "f": 1,
            "g": rows,
            "lam_x": size,
            "lam_g": rows,
            "lam_p": size + 4,
        }
        self.begin(None, True)
        self.construct("recorder", {})

    def begin(self, callback: Callback | None, stop: bool) -> None:
        """Forget the solve before.

        Arguments:
            stop: at the first feasible iterate.
        """
        self.history: list[tuple[float, float]] = []
        self._x: Array = np.zeros(self._program.size)
        self._feasible: Array | None = None
        self._callback, self._stop = callback, stop

    def result(self) -> tuple[Array, int, bool]:
        """The first feasible iterate, or the last one where ``stop`` was not asked for; its
        iteration; success.
        """
        if self._stop and self._feasible is not None:
            return self._feasible, len(self.history) - 1, True
        return (
            self._x,
            len(self.history) - 1,
            bool(self.history) and self.history[-1][0] < self._tolerance,
        )

    def get_n_in(self) -> int:
        """Number of values that IPOPT gives."""
        return int(cs.nlpsol_n_out())

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """All dense."""
        return cs.Sparsity.dense(self._sizes[cs.nlpsol_out(i)], 1)

    def eval(self, arguments: Sequence[cs.DM]) -> list[Any]:
        """IPOPT's call at each iterate: 1 stops it."""
        self._x = np.asarray(arguments[0], dtype=np.float64).ravel()
        violation = float(self._program.excess(np.asarray(arguments[2]).ravel()).max(initial=0.0))
        self.history.append((violation, float(arguments[1])))
        stop = bool(self._callback and self._callback(len(self.history) - 1, *self.history[-1]))
        if violation < self._tolerance and self._feasible is None:
            self._feasible = self._x.copy()
        stop = stop or bool(self._program.errors)
        return [int(stop or (self._stop and self._feasible is not None))]
