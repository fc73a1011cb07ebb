"""Conic programs written row by row: named groups of rows and index blocks, once a layout; numbers
are filled in later.

    minimise  ½ x'P x + q'x  subject to  A x + s = b,  s in a product of zero, non-negative and
    second-order cones.

The papers' programs stand in cvxpy, to read, in ``relaxation.papers``; tests hold both equal. Here a
block of A is put once, rows and columns, with what gives its values for a problem:
numbers of the problem as they are (``Of``), all of which are loaded in one gather, or a function.
Clarabel solves. A program of one frame keeps its solver and has its data updated, without
equilibration; a longer one is set up anew each time, with it. Either way an answer depends on its
own problem alone.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Generic

import clarabel
import numpy as np

from ..files.arrays import Array
from ..files.codec import Columns as Columns
from .layout import D, Fill, Gather, GatheredNumbers, Index, Values
from .programs import ConicSolution, ConicStatus


def _pattern_of(rows: Index, columns: Index, shape: tuple[int, int]) -> Columns:
    """A matrix of zeros at these entries, which are sorted by columns."""
    indptr = np.searchsorted(columns, np.arange(shape[1] + 1))
    return Columns(np.zeros(len(rows)), rows.astype(np.int32), indptr.astype(np.int32), shape)


def solver_settings(*, equilibrate: bool, careful: bool = False) -> clarabel.DefaultSettings:
    """Clarabel's settings for small programs on one thread; no clock ends a solve, iterations do.

    Arguments:
        careful: slower, for the rare problem that the fast settings end on without an answer.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.iterative_refinement_enable = careful
    settings.equilibrate_enable = equilibrate
    settings.equilibrate_max_iter = 10 if careful else 2
    return settings


STATUS = MappingProxyType(
    {
        clarabel.SolverStatus.Solved: ConicStatus.SOLVED,
        clarabel.SolverStatus.AlmostSolved: ConicStatus.SOLVED,
        clarabel.SolverStatus.PrimalInfeasible: ConicStatus.INFEASIBLE,
        clarabel.SolverStatus.AlmostPrimalInfeasible: ConicStatus.INFEASIBLE,
    }
)
"""Statuses of Clarabel; what is not here failed."""
EXACT = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.PrimalInfeasible)


class Rows(Generic[D]):
    """A conic program whose numbers come from problems of the type D.

    Arguments:
        keep: keep one solver and update its data, without equilibration (see the module).
    """

    def __init__(self, *, keep: bool) -> None:
        self._keep = keep
        self.cone_list: list[Any] = []
        self._blocks: list[tuple[Index, Index, Values[D]]] = []
        self._right: list[tuple[Index, Values[D]]] = []
        self._squares: list[tuple[Index, Index, Fill[D] | float]] = []
        self._linear: list[tuple[Index, Values[D]]] = []
        self._constants: list[Fill[D]] = []
        self._solver: clarabel.DefaultSolver | None = None
        self.columns: dict[str, Index] = {}
        self.groups: dict[str, Index] = {}
        self.shape = (0, 0)

    def variable(self, name: str, *shape: int) -> Index:
        """Add a variable to the program, and return the indices of its columns in x, in the
        variable's shape.

        After a solve ``ConicSolution.value`` gives the value of the variable by its name.
        """
        size = int(np.prod(shape, dtype=int))
        self.columns[name] = self.shape[1] + np.arange(size).reshape(shape)
        self.shape = (self.shape[0], self.shape[1] + size)
        return self.columns[name]

    def equal(self, name: str, *shape: int) -> Index:
        """New rows A x = b."""
        return self._group(name, shape, clarabel.ZeroConeT)

    def at_most(self, name: str, *shape: int) -> Index:
        """New rows A x ≤ b."""
        return self._group(name, shape, clarabel.NonnegativeConeT)

    def cones(self, name: str, count: int, size: int) -> Index:
        """New second-order cones: with b − A x = (t, v) a row of the group, ‖v‖ ≤ t.

        Arguments:
            count, size: how many, and of how many rows each.

        Returns:
            The numbers of the rows, shape (count, size).
        """
        rows = self.shape[0] + np.arange(count * size).reshape(count, size)
        self.cone_list += [clarabel.SecondOrderConeT(size)] * count
        self.groups[name], self.shape = rows, (self.shape[0] + rows.size, self.shape[1])
        return rows

    def put(self, rows: Index, columns: Index, values: Values[D]) -> None:
        """Entries of A at ``rows`` × ``columns``, which are broadcast against each other.

        Arguments:
            values: numbers, or what gives them for a problem, of the broadcast shape or one that
                broadcasts to it. An entry may be put once only: entries are not added up.
        """
        rows, columns = np.broadcast_arrays(rows, columns)
        self._blocks.append((rows, columns, values))

    def right(self, rows: Index, values: Values[D]) -> None:
        """Add to b at these rows."""
        self._right.append((rows, values))

    def square(self, first: Index, second: Index | None, weight: Fill[D] | float) -> None:
        """Add weight · Σ (x[first] − x[second])² to the objective, or weight · Σ x[first]² where
        second is None.

        Arguments:
            first, second: columns of one shape.
            weight: a number ≥ 0, or what gives it for a problem.
        """
        pairs = [(first, first, 2.0)]
        if second is not None:
            pairs += [
                (second, second, 2.0),
                (np.minimum(first, second), np.maximum(first, second), -2.0),
            ]
        for row, column, factor in pairs:
            self._squares.append((row.ravel(), column.ravel(), _scaled(factor, weight)))

    def linear(self, columns: Index, values: Values[D], constant: Fill[D] | None = None) -> None:
        """Add values · x[columns] and a constant to the objective."""
        self._linear.append((columns, values))
        self._constants += [] if constant is None else [constant]

    def solve(self, data: D) -> ConicSolution:
        """Solve for this problem, by the kept solver with its numbers updated, or by a new one.

        Arguments:
            data: of the layout that the rows were written for.

        Returns:
            An answer whose status is SOLVED, INFEASIBLE (with a Farkas ray as dual) or FAILED;
            where the solver gave up it was asked again with smaller steps.
        """
        begin = time.perf_counter()
        if self._solver is None or not self._keep:
            hessian, q, matrix, b = self.load(data)
            begin = time.perf_counter()
            settings = solver_settings(equilibrate=not self._keep)
            self._solver = clarabel.DefaultSolver(hessian, q, matrix, b, self.cone_list, settings)
        else:
            self._update(self._solver, data)
        answer = self._solver.solve()
        if not self._keep:  # its factors are most of a long course's memory
            self._solver = None
        status = answer.status
        if status not in STATUS:  # rare: ask again, with refined steps
            hessian, q, matrix, b = self.load(data)
            careful = solver_settings(equilibrate=True, careful=True)
            answer = clarabel.DefaultSolver(hessian, q, matrix, b, self.cone_list, careful).solve()
            status = answer.status
        constants = (float(np.sum(fill(data))) for fill in self._constants)
        value, constant = float(answer.obj_val), sum(constants, start=0.0)
        return ConicSolution(
            status=STATUS.get(status, ConicStatus.FAILED),
            answer=answer,
            columns=self.columns,
            groups=self.groups,
            objective=value + constant,
            bound=min(value, float(answer.obj_val_dual)) + constant,
            exact=status in EXACT,
            iterations=int(answer.iterations),
            seconds=time.perf_counter() - begin,
        )

    def _update(self, solver: clarabel.DefaultSolver, data: D) -> None:
        """Load the numbers of a problem into the kept solver, as lists, which are read faster."""
        numbers = self._numbers.of(data)
        loaded = {
            "A": self._a.load(numbers, data).tolist(),
            "b": self._b.load(numbers, data).tolist(),
        }
        if self._q.constant is None:
            loaded["q"] = self._q.load(numbers, data).tolist()
        if any(callable(weight) for *_, weight in self._squares):
            loaded["P"] = self._hessian(data).data.tolist()
        solver.update(**loaded)

    def lagrangian(
        self, data: D, solution: ConicSolution, without: Sequence[str] = ()
    ) -> tuple[float, Array]:
        """The Lagrangian  z'(A x − b)  as a function of x: its constant −b'z and its slope A'z,
        shape (n,).

        No x that satisfies the constraints makes it positive.

        Arguments:
            without: groups of rows that are left out.
        """
        _, _, matrix, b = self.load(data)
        z = solution.z.copy()
        for name in without:
            z[self.groups[name]] = 0.0
        return -float(b @ z), matrix.transposed_times(z)

    def load(self, data: D) -> tuple[Columns, Array, Columns, Array]:
        """(P, q, A, b) for this problem; P has its upper triangle alone."""
        if not hasattr(self, "_matrix"):
            self._compile(data)
        numbers = self._numbers.of(data)
        pattern = self._matrix
        matrix = Columns(
            self._a.load(numbers, data), pattern.indices, pattern.indptr, pattern.shape
        )
        return self._hessian(data), self._q.load(numbers, data), matrix, self._b.load(numbers, data)

    def _group(self, name: str, shape: tuple[int, ...], kind: type) -> Index:
        size = int(np.prod(shape, dtype=int))
        rows = self.shape[0] + np.arange(size).reshape(shape)
        if size:
            self.cone_list.append(kind(size))
        self.groups[name], self.shape = rows, (self.shape[0] + size, self.shape[1])
        return rows

    def _compile(self, data: D) -> None:
        """Sort the entries by columns.

        Arguments:
            data: any problem, for the shapes of its numbers.
        """
        self._numbers = GatheredNumbers(
            [values for *_, values in (*self._blocks, *self._right, *self._linear)], data
        )
        rows = np.concatenate([block[0].ravel() for block in self._blocks])
        columns = np.concatenate([block[1].ravel() for block in self._blocks])
        order = np.lexsort((rows, columns))
        self._matrix = _pattern_of(rows[order], columns[order], self.shape)
        first, second = (
            np.concatenate([np.zeros(0, dtype=np.int_), *(b[k] for b in self._squares)])
            for k in (0, 1)
        )
        squared, self._square_places = np.unique(
            second * self.shape[1] + first, return_inverse=True
        )
        second, first = np.divmod(squared, self.shape[1])
        self._squared = _pattern_of(first, second, (self.shape[1], self.shape[1]))
        self._a: Gather[D] = Gather(len(rows), self._numbers)
        places = np.argsort(order)
        for block, _, values in self._blocks:
            block_places, places = np.split(places, [block.size])
            self._a.add(block_places.reshape(block.shape), values)
        self._q: Gather[D] = Gather(self.shape[1], self._numbers)
        self._b: Gather[D] = Gather(self.shape[0], self._numbers)
        for gather, vectors in ((self._q, self._linear), (self._b, self._right)):
            for index, values in vectors:
                gather.add(index, values)

    def _hessian(self, data: D) -> Columns:
        values = [
            np.broadcast_to(w(data) if callable(w) else w, row.shape) for row, _, w in self._squares
        ]
        if not values:
            return self._squared
        added = np.bincount(self._square_places, np.concatenate(values))
        return replace(self._squared, data=added.astype(np.float64, copy=False))


def _scaled(factor: float, weight: Fill[D] | float) -> Fill[D] | float:
    return (lambda d: factor * np.asarray(weight(d))) if callable(weight) else factor * weight
