"""Compile a convex model once, then solve it for new data thousands of times (DESIGN: performance is designed in).

A model is written in cvxpy, as the paper has it, with its data as parameters (disciplined parametrised programming).
Its canonical form  minimise q'x  subject to  A x + s = b, s in cones,  is taken once; from then on A, b and q are a
sparse tensor times the vector of parameters, put into one Clarabel solver whose sparsity pattern never changes.
"""

from __future__ import annotations

import enum
import itertools
import time
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace

import clarabel
import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
from numpy.typing import NDArray

from .arrays import Array
from .outcome import StancekitError


class ConicStatus(enum.Enum):
    """What the conic solver ended with, after its statuses were mapped."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True, kw_only=True, eq=False)
class ConicSolution:
    """One solve. x: primal, shape (n,); z: dual, shape (m,), a Farkas ray where infeasible; seconds: solver alone."""

    status: ConicStatus
    x: Array
    z: Array
    objective: float
    iterations: int
    seconds: float


_STATUS = {
    clarabel.SolverStatus.Solved: ConicStatus.SOLVED,
    clarabel.SolverStatus.AlmostSolved: ConicStatus.SOLVED,
    clarabel.SolverStatus.PrimalInfeasible: ConicStatus.INFEASIBLE,
    clarabel.SolverStatus.AlmostPrimalInfeasible: ConicStatus.INFEASIBLE,
}


class ConicModel:
    """A cvxpy problem compiled once. Parameters and variables are known by their names.

    problem: a minimisation that is DPP in its parameters, with a linear objective or a quadratic one that does not
    depend on parameters. duals: names for the constraints whose multipliers will be read.
    equilibrate: a data set, by parameter name, on which Clarabel's scaling is computed; because that scaling stays
    when data is updated, one fixed choice makes every answer independent of what was solved before.
    """

    def __init__(
        self,
        problem: cp.Problem,
        *,
        equilibrate: Mapping[str, Array | float],
        duals: Mapping[str, cp.Constraint] | None = None,
    ) -> None:
        names = [parameter.name() for parameter in problem.parameters()]
        if len(set(names)) < len(names) or not isinstance(problem.objective, cp.Minimize):
            raise StancekitError(f"a conic model is a minimisation whose parameters have different names, got {names}")
        for parameter in problem.parameters():
            parameter.value = np.broadcast_to(equilibrate[parameter.name()], parameter.shape)
        data, chain, inverse = problem.get_problem_data(cp.CLARABEL, enforce_dpp=True, solver_opts={})
        program = data[cp.settings.PARAM_PROB]
        self._n = int(program.x.size)
        self._theta = np.ones(program.total_param_size + 1)
        self._slots = {
            program.id_to_param[key].name(): (
                slice(col, col + program.param_id_to_size[key]),
                program.id_to_param[key].shape,
            )
            for key, col in program.param_id_to_col.items()
            if key in program.id_to_param
        }
        self._names = list(self._slots)
        self._read_tensors(program)
        self._index(problem, chain, inverse, duals or {})
        self._load(equilibrate)
        hessian = sp.csc_matrix(sp.triu(data["P"])) if "P" in data else sp.csc_matrix((self._n, self._n))
        self._cones = dims_to_solver_cones(data["dims"])
        self._hessian = hessian
        self._solver = clarabel.DefaultSolver(
            hessian, self._q(), self._matrix(), self._b(), self._cones, solver_settings()
        )
        if not self._solver.is_data_update_allowed():
            raise StancekitError("the conic solver refuses data updates")

    @property
    def parameter_names(self) -> list[str]:
        """Names of the data that ``solve`` expects."""
        return list(self._names)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of A."""
        return self._shape

    def solve(self, values: Mapping[str, Array | float]) -> ConicSolution:
        """Solve for this data. Keys that the model does not know are passed over: models can share a dictionary."""
        self._load(values)
        return self._solve(self._tensor @ self._theta)

    def solve_all(self, values: Mapping[str, Array | float], count: int) -> list[ConicSolution]:
        """Solve for each of ``count`` sets of data: bit for bit what as many calls of ``solve`` answer.

        values: as for ``solve``, or with an axis more, the first one, where they differ.
        """
        theta = np.ones((len(self._theta), count))
        for name, (where, shape) in self._slots.items():
            value = np.asarray(values[name])
            if value.ndim > len(shape):
                theta[where] = value.T.reshape(theta[where].shape)  # each problem's columns one after the other
            else:
                theta[where] = np.ravel(value, order="F")[:, None]
        return [self._solve(data) for data in np.ascontiguousarray((self._tensor @ theta).T)]

    def _solve(self, data: Array) -> ConicSolution:
        q, a, b = (data[part] for part in self._parts)
        self._solver.update(q=q, A=a, b=b)
        begin = time.perf_counter()
        answer = self._solver.solve()
        if answer.status not in _STATUS:  # rare: ask again with a scaling of its own and refined steps
            careful = solver_settings(careful=True)
            matrix = sp.csc_matrix((a, self._a_row, self._a_indptr), shape=self._shape)
            answer = clarabel.DefaultSolver(self._hessian, q, matrix, b, self._cones, careful).solve()
        return ConicSolution(
            status=_STATUS.get(answer.status, ConicStatus.FAILED),
            x=np.array(answer.x),
            z=np.array(answer.z),
            objective=float(answer.obj_val) + float(data[-1]),
            iterations=int(answer.iterations),
            seconds=time.perf_counter() - begin,  # its own clock counts the set-up again in every solve
        )

    def value(self, name: str, solution: ConicSolution) -> Array:
        """Value of the variable of this name, in its own shape."""
        return np.asarray(solution.x[self._columns[name]])

    def dual(self, name: str, solution: ConicSolution) -> Array:
        """Multipliers of the constraint of this name, as cvxpy would give them; a cone's rows stacked (t, X)."""
        rows, signs = self._rows[name]
        return np.asarray(signs * solution.z[rows])

    def lagrangian(self, solution: ConicSolution) -> tuple[float, Array]:
        """The Lagrangian  z'(A x − b)  as a function of x: its constant −b'z and its slope A'z, shape (n,).

        Of the data that was solved last, objective left out: no x that satisfies the constraints makes it positive.
        """
        weights = solution.z[self._a_row] * self._a_values()
        slope: Array = np.bincount(self._a_col, weights=weights, minlength=self._n).astype(np.float64)
        return -float(self._b() @ solution.z), slope

    def columns(self, name: str) -> NDArray[np.int_]:
        """Where in x the variable of this name is, in its own shape."""
        return np.asarray(self._columns[name])

    def gradient(self, solution: ConicSolution, names: tuple[str, ...]) -> dict[str, Array]:
        """Derivative of the optimal value in the parameters of these names (envelope theorem), in their shapes.

        Exact wherever the optimum is unique: dL/dθ of L = q'x + z'(Ax − b), read off the tensors.
        """
        weights = solution.z[self._a_row] * solution.x[self._a_col]
        by_theta = self._a_tensor.T @ weights - self._b_tensor.T @ solution.z + self._q_tensor.T @ solution.x
        by_theta = by_theta + np.ravel(self._offset_tensor.toarray())
        found = {}
        for name in names:
            where, shape = self._slots[name]
            found[name] = np.asarray(by_theta[where].reshape(shape, order="F"))
        return found

    def bare(
        self, values: Mapping[str, Array | float]
    ) -> tuple[sp.csc_matrix, Array, sp.csc_matrix, Array, list[object]]:
        """Return (P, q, A, b, cones) for this data, for timing a solver alone against ``solve``."""
        self._load(values)
        return self._hessian, self._q(), self._matrix(), self._b(), list(self._cones)

    def _load(self, values: Mapping[str, Array | float]) -> None:
        for name, (where, shape) in self._slots.items():
            value = values[name]
            self._theta[where] = np.ravel(value, order="F") if shape else value

    def _q(self) -> Array:
        return np.asarray(self._q_tensor @ self._theta)

    def _a_values(self) -> Array:
        return np.asarray(self._a_tensor @ self._theta)

    def _b(self) -> Array:
        return np.asarray(self._b_tensor @ self._theta)

    def _matrix(self) -> sp.csc_matrix:
        return sp.csc_matrix((self._a_values(), self._a_row, self._a_indptr), shape=self._shape)

    def _read_tensors(self, program: object) -> None:
        """Split cvxpy's tensor, whose product with (θ, 1) is [−A b] by columns, into one for A and one for b."""
        tensor = sp.csr_matrix(program.A)  # type: ignore[attr-defined]
        q_tensor = sp.csr_matrix(program.q)  # type: ignore[attr-defined]
        m = tensor.shape[0] // (self._n + 1)
        self._shape = (m, self._n)
        of_a = tensor[: m * self._n]
        used = np.flatnonzero(np.diff(of_a.indptr))
        self._a_tensor = sp.csr_matrix(-of_a[used])
        self._a_row, self._a_col = used % m, used // m
        self._a_indptr = np.searchsorted(self._a_col, np.arange(self._n + 1))
        self._b_tensor = sp.csr_matrix(tensor[m * self._n :])
        self._q_tensor = sp.csr_matrix(q_tensor[: self._n])
        self._offset_tensor = sp.csr_matrix(q_tensor[self._n :])
        tensors = (self._q_tensor, self._a_tensor, self._b_tensor, self._offset_tensor)
        self._tensor = sp.csr_matrix(sp.vstack(tensors))
        ends = np.cumsum([0, *(tensor.shape[0] for tensor in tensors)]).tolist()
        self._parts = [slice(*pair) for pair in itertools.pairwise(ends[:-1])]  # of q, A and b; the offset is the last

    def _index(self, problem: cp.Problem, chain: object, inverse: object, duals: Mapping[str, cp.Constraint]) -> None:
        """Find the columns of every variable and the rows of every named constraint by sending a ruler back through."""
        ruler = SimpleNamespace(
            status="Solved", obj_val=0.0, solve_time=0.0, iterations=0,
            x=np.arange(self._n, dtype=float), z=np.arange(1.0, self._shape[0] + 1.0),
        )  # fmt: skip
        problem.unpack_results(ruler, chain, inverse)
        self._columns = {v.name(): np.asarray(v.value).round().astype(int) for v in problem.variables()}
        self._rows = {}
        for name, constraint in duals.items():
            marks = constraint.dual_value
            flat = np.concatenate([np.ravel(part) for part in marks]) if isinstance(marks, list) else np.asarray(marks)
            self._rows[name] = (np.abs(flat).round().astype(int) - 1, np.sign(flat))


def solver_settings(*, careful: bool = False) -> clarabel.DefaultSettings:
    """Clarabel's settings for small models on one thread with data updates; no clock ends a solve, iterations do.

    careful: slower, for the rare problem that the fast settings end on without an answer.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.iterative_refinement_enable = careful
    settings.equilibrate_max_iter = 10 if careful else 2
    return settings
