"""Answer of a conic program: a status, a point and multipliers, by the names of variables and
groups of rows.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array
from .layout import Index


class ConicStatus(enum.Enum):
    """Final status of the conic solver, mapped from its own."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


class Vectors(Protocol):
    """x and z as a solver has them."""

    @property
    def x(self) -> Sequence[float] | Array:
        """Primal, n numbers."""
        ...

    @property
    def z(self) -> Sequence[float] | Array:
        """Dual, m numbers."""
        ...


class Solved(NamedTuple):
    """x, shape (n,), and z, shape (m,)."""

    x: Array
    z: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class ConicSolution:
    """One solve, by the names of variables and groups of rows.

    Arguments:
        answer: the solver's own.
        objective: of x.
        bound: of z, the dual objective.
        exact: whether the solver met its own tolerances.
        seconds: in the solver alone [s].
    """

    status: ConicStatus
    answer: Vectors
    columns: Mapping[str, Index]
    groups: Mapping[str, Index]
    objective: float
    bound: float
    exact: bool
    iterations: int
    seconds: float

    @cached_property
    def x(self) -> Array:
        """Primal, shape (n,)."""
        return np.array(self.answer.x)

    @cached_property
    def z(self) -> Array:
        """Dual, shape (m,); a Farkas ray where infeasible."""
        return np.array(self.answer.z)

    @property
    def solved(self) -> bool:
        """Tell whether x is a point."""
        return self.status is ConicStatus.SOLVED

    def value(self, name: str) -> Array:
        """Value of the variable of this name, in its own shape."""
        return _part(self.x, self.columns[name])

    def dual(self, name: str) -> Array:
        """Multipliers of the group of rows of this name, in its shape: L = objective + z'(A x −
        b).
        """
        return _part(self.z, self.groups[name])


def _part(values: Array, index: Index) -> Array:
    """values[index] for indices in a row, as those of a variable and of a group are."""
    begin = index.item(0) if index.size else 0
    return values[begin : begin + index.size].reshape(index.shape)
