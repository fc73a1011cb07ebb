"""Programs of the layouts met last, so that rows are written once a layout; shared by planners and
environments.
"""

from __future__ import annotations

import enum
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array
from .layout import Index, Layout


class ConicStatus(enum.Enum):
    """Final status of the conic solver, mapped from its own."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


class _Vectors(Protocol):
    """x and z as a solver has them."""

    @property
    def x(self) -> Sequence[float] | Array:
        """Primal, n numbers."""
        ...

    @property
    def z(self) -> Sequence[float] | Array:
        """Dual, m numbers."""
        ...


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
    answer: _Vectors
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


def multiplier_shapes(layout: Layout) -> dict[str, tuple[int, ...]]:
    """The groups of a leaf's row, in its order."""
    stances, steps = (len(layout.stances), 3), layout.frames - 1
    return {
        "nu_F": stances,
        "nu_M": stances,
        "reach": (layout.frames, layout.limbs, 3),
        "com_step": (steps, 3),
        "rotation_step": (steps, 3),
        "progress": (steps,),
        "toe_step": (len(layout.moves), 3),
        "reach_rows": (layout.frames, len(layout.row_limbs)),
        "relative_reach": (len(layout.relative_rows[0]),),
        "linear_step": (steps, layout.linear),
    }


def multipliers(layout: Layout, solution: ConicSolution) -> Array:
    """A leaf's row of a ``Certificate``, in single precision, its largest entry ±1.

    ν_F, ν_M of the balances (zero where the program has none), then r of the reach, a, t and g of
    the steps of c and Θ and the progress, b of the toes' steps, σ of half-spaces of reach and of
    feet (``verify.certificate``), and those of further rows of the body's steps.
    """
    nothing = np.zeros((len(layout.stances), 3))
    groups = solution.groups

    def cone(name: str) -> Array:
        return -solution.dual(name)[:, 1:] if name in groups else np.zeros(0)

    moment = nothing
    if "moment" in groups:
        moment = solution.dual("moment")
    elif "above" in groups:
        moment = solution.dual("above") - solution.dual("below")
        if solution.status is ConicStatus.INFEASIBLE:
            moment = nothing  # refuted whatever the moments: what is there is rounding
    force = solution.dual("balance") if "balance" in groups else nothing
    progress = solution.dual("progress") if "progress" in groups else np.zeros(0)
    rows = np.zeros(0)
    if "reach_rows" in groups:  # of their inner sets, which are cones, the first of each
        rows = np.maximum(
            solution.dual("reach_rows").reshape(layout.frames * len(layout.row_limbs), -1)[:, 0],
            0.0,
        )
    apart = (
        np.maximum(solution.dual("relative_reach"), 0.0)
        if "relative_reach" in groups
        else np.zeros(0)
    )
    if not len(apart):  # toes that are held
        apart = np.zeros(len(layout.relative_rows[0]))
    steps = (cone("com_step"), cone("rotation_step"), progress, cone("toe_step"))
    linear = np.zeros((layout.frames - 1) * layout.linear)
    if "linear_step" in groups:
        linear = np.maximum(solution.dual("linear_step"), 0.0)
    parts = (force, moment, cone("reach"), *steps, rows, apart, linear)
    flat = np.concatenate([np.ravel(part) for part in parts])
    return np.asarray(
        (flat / max(float(np.abs(flat).max()), 1e-300)).astype(np.float32).astype(np.float64)
    )


T = TypeVar("T")
_MOST = 64
"""Programs that are kept; a long course over many candidates takes some megabytes."""


class Programs:
    """Keeps the programs that were used last.

    What they answer does not depend on whether they were kept.

    One thread at a time may use them: a program holds the numbers of the problem that it solves. A
    copy (deepcopy, pickle) has none yet and writes its own.
    """

    def __init__(self, most: int = _MOST) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, object] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {"_most": self._most, "_kept": OrderedDict()}

    def get(self, make: Callable[..., T], *key: Hashable) -> T:
        """``make(*key)``, or what it made last time."""
        name = (make, *key)
        made = self._kept.get(name)
        if made is not None:
            self._kept.move_to_end(name)
        else:
            made = self._kept[name] = make(*key)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return cast(T, made)


class _Thread(threading.local):
    """Storage of one thread."""

    def __init__(self) -> None:
        self.programs = Programs()


_THREAD = _Thread()


def programs_of_this_thread() -> Programs:
    """The programs of the thread that asks: for tasks in a worker process, which come one by one
    and are alike.
    """
    return _THREAD.programs
