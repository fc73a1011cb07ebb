"""A convex model as cvxpy has it, with the answer that the programs written as rows give: rays, and
both bounds.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace

import cvxpy as cp
import numpy as np

from ..files.arrays import Array
from .conic_solution import ConicSolution, ConicStatus, Solved
from .layout import Index
from .rows import EXACT, STATUS

Terms = dict[str, cp.Constraint]
"""Constraints by name."""


@dataclass(frozen=True, eq=False)
class ConicModel:
    """Minimise the cost subject to the terms; both are named as in ``rows``."""

    cost: cp.Expression
    terms: Terms

    def solve(self) -> ConicSolution:
        """Solve by Clarabel as cvxpy calls it, on one thread."""
        problem = cp.Problem(cp.Minimize(self.cost), list(self.terms.values()))
        data, chain, inverse = problem.get_problem_data(cp.CLARABEL, solver_opts={})
        begin = time.perf_counter()
        answer = chain.solve_via_data(problem, data, solver_opts={"max_threads": 1})
        seconds = time.perf_counter() - begin
        # cvxpy keeps rays to itself: whatever came is sent back through its reductions as if it
        # were a solution
        fields_of_answer = {
            name: getattr(answer, name)
            for name in ("obj_val", "solve_time", "iterations", "x", "z")
        }
        problem.unpack_results(SimpleNamespace(status="Solved", **fields_of_answer), chain, inverse)
        constant = float(problem.value) - answer.obj_val
        x, columns = _packed((variable.name(), variable.value) for variable in problem.variables())
        z, groups = _packed((name, _dual(term)) for name, term in self.terms.items())
        return ConicSolution(
            status=STATUS.get(answer.status, ConicStatus.FAILED),
            answer=Solved(x=x, z=z),
            columns=columns,
            groups=groups,
            objective=answer.obj_val + constant,
            bound=min(answer.obj_val, answer.obj_val_dual) + constant,
            exact=answer.status in EXACT,
            iterations=answer.iterations,
            seconds=seconds,
        )

    def solve_as(self, columns: Mapping[str, Index], groups: Mapping[str, Index]) -> ConicSolution:
        """``solve``, x and z in the order of a program in rows.

        A name whose size the model does not have is left out, with NaN in its place: toes that are
        columns of their own, and groups that are smaller where some rows follow from the others.
        """
        solution = self.solve()
        x, matched = _placed(columns, solution.columns, solution.x)
        z, rows = _placed(groups, solution.groups, solution.z)
        return replace(solution, answer=Solved(x=x, z=z), columns=matched, groups=rows)


def _placed(
    wanted: Mapping[str, Index], has: Mapping[str, Index], values: Array
) -> tuple[Array, dict[str, Index]]:
    """Values in the places that are wanted, by name, and those names."""
    matched = {name: at for name, at in wanted.items() if name in has and has[name].size == at.size}
    placed = np.full(sum(at.size for at in wanted.values()), np.nan)
    for name, at in matched.items():
        placed[at] = values[has[name]].reshape(at.shape)
    return placed, matched


def _dual(term: cp.Constraint) -> Array:
    """Multipliers of a constraint; of cones a row each, (t, x)."""
    if isinstance(term, cp.SOC):
        return np.column_stack(term.dual_value)
    return np.asarray(term.dual_value)


def _packed(named: Iterable[tuple[str, Array]]) -> tuple[Array, dict[str, Index]]:
    """All values in one row, and where each is in it, in its own shape."""
    parts, where, size = [np.zeros(0)], dict[str, Index](), 0
    for name, value in named:
        where[name] = size + np.arange(value.size).reshape(value.shape)
        parts.append(np.ravel(value))
        size += value.size
    return np.concatenate(parts), where
