"""Programs written as rows, many problems of one layout solved together by Moreau: on a CUDA
device, or the processor.

Moreau is a batched interior-point solver (https://github.com/moreau-project/moreau) with Clarabel's
tolerances.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Generic, Literal, get_args

import clarabel
import numpy as np

from ..errors import InvalidInput, not_installed
from ..files.arrays import Array
from .columns import Columns
from .conic_solution import ConicSolution, ConicStatus, Solved
from .gather import D
from .layout import Index
from .rows import Rows

Device = Literal["cuda", "cpu"]
MOST = 16384
"""Problems that are solved at once; more of them in parts."""
REFINEMENT_STEPS = 0
"""Iterative refinement of each linear solve on a CUDA device. Half of the time went into Moreau's
two steps, and verdicts are the same without them; what is doubtful is solved again anyway.
"""
CONES = (clarabel.ZeroConeT, clarabel.NonnegativeConeT, clarabel.SecondOrderConeT)
"""In the order in which Moreau takes their rows."""


class MoreauSolver(Generic[D]):
    """Solves a program for many problems at once; ``Rows.solve_together`` takes its ``solve_all``.

    Arguments:
        rows: the program.
        device: where. Batches are filled up to a power of two, so that few sizes are compiled.

    Raises:
        InvalidInput: where Moreau or the device is not there.
    """

    def __init__(self, rows: Rows[D], device: Device) -> None:
        check_device(device)
        self._rows, self._device = rows, device
        self._compiled: dict[int, Any] = {}

    def solve_all(self, data: Sequence[D]) -> list[ConicSolution]:
        """Answers of ``Rows.solve`` to each, within the solvers' tolerances; FAILED where there is
        no clear answer.

        ``seconds`` is an equal share of the batch's.
        """
        parts = [data[begin : begin + MOST] for begin in range(0, len(data), MOST)]
        return [solution for part in parts for solution in self._solve(part)]

    def _solve(self, data: Sequence[D]) -> list[ConicSolution]:
        from moreau import SolverStatus

        begin = time.perf_counter()
        loaded = [self._rows.load(one) for one in data]
        hessians, q, matrices, b = (list(column) for column in zip(*loaded, strict=True))
        size = 1 << (len(data) - 1).bit_length()
        if size not in self._compiled:
            self._compiled[size] = self._compile(hessians[0], matrices[0], size)
        solver, filled = self._compiled[size], [*range(len(data)), *[0] * (size - len(data))]
        solver.setup(
            np.stack([hessian.data[self._both] for hessian in hessians])[filled],
            np.stack([matrix.data[self._by_rows] for matrix in matrices])[filled],
        )
        answers = solver.solve(np.stack(q)[filled], np.stack(b)[filled][:, self._order])
        x, z = np.asarray(answers.x), np.empty_like(answers.z)
        z[:, self._order] = answers.z
        status = solver.info.status
        seconds = (time.perf_counter() - begin) / len(data)
        clear = {
            SolverStatus.Solved: ConicStatus.SOLVED,
            SolverStatus.PrimalInfeasible: ConicStatus.INFEASIBLE,
        }
        return [
            ConicSolution(
                status=clear.get(status[k], ConicStatus.FAILED),
                answer=Solved(x=x[k], z=z[k]),
                columns=self._rows.columns,
                groups=self._rows.groups,
                objective=float(solver.info.obj_val[k]) + self._rows.constant(one),
                bound=_dual(hessians[k], x[k], b[k], z[k]) + self._rows.constant(one),
                exact=status[k] in clear,
                iterations=int(solver.info.iterations[k]),
                seconds=seconds,
            )
            for k, one in enumerate(data)
        ]

    def _compile(self, hessian: Columns, matrix: Columns, size: int) -> Any:
        """Moreau's solver for this many problems: all of P, and A with its rows in the order of
        ``CONES``, by rows.
        """
        import moreau

        (m, n), cones = matrix.shape, self._rows.cone_list
        starts = np.cumsum([0, *(cone.dim for cone in cones)])
        spans = [
            (type(cone), np.arange(begin, begin + cone.dim))
            for cone, begin in zip(cones, starts, strict=False)
        ]
        rows = [[span for made, span in spans if made is kind] for kind in CONES]
        self._order = np.concatenate(
            [np.zeros(0, dtype=int), *(span for kind in rows for span in kind)]
        )
        place = np.empty(m, dtype=int)
        place[self._order] = np.arange(m)
        self._by_rows, offsets, columns = _by_rows(place[matrix.indices], matrix.columns, m)
        upper, right = hessian.indices, hessian.columns
        mirrored = np.flatnonzero(upper != right)
        ends = np.concatenate([upper, right[mirrored]]), np.concatenate([right, upper[mirrored]])
        sorted_, own_offsets, own_columns = _by_rows(*ends, n)
        self._both = np.concatenate([np.arange(len(upper)), mirrored])[sorted_]
        zero, positive, second = ([len(span) for span in kind] for kind in rows)
        return moreau.CompiledSolver(
            n,
            m,
            own_offsets,
            own_columns,
            offsets,
            columns,
            moreau.Cones(
                num_zero_cones=sum(zero), num_nonneg_cones=sum(positive), so_cone_dims=second
            ),
            moreau.Settings(
                device=self._device,
                batch_size=size,
                ipm_settings=moreau.IPMSettings(cudss_ir_steps=REFINEMENT_STEPS),
            ),
        )


def check_device(device: Device) -> None:
    """Raise InvalidInput where Moreau, or a device of this kind, is not there."""
    if device not in get_args(Device):
        raise InvalidInput(f"device: expected cuda or cpu, got {device!r}")
    try:
        import moreau
    except ModuleNotFoundError:
        raise not_installed("backend", "Moreau", "batches", "moreau") from None
    if not moreau.device_available(device):
        why = (
            moreau.device_error(device)
            or "Moreau finds none; it needs moreau[cuda12] or moreau[cuda13]"
        )
        raise InvalidInput(
            f"backend: expected a CUDA device for moreau, got none: {' '.join(why.split())}"
        )


def _by_rows(rows: Index, columns: Index, count: int) -> tuple[Index, Index, Index]:
    """Entries sorted by rows: their order, where each of ``count`` rows begins and the last one
    ends, their columns.
    """
    order = np.lexsort((columns, rows))
    return order, np.searchsorted(rows[order], np.arange(count + 1)), columns[order]


def _dual(hessian: Columns, x: Array, b: Array, z: Array) -> float:
    """The dual objective  −½ x'P x − b'z."""
    upper, right = hessian.indices, hessian.columns
    curved = hessian.data * x[upper] * x[right] * np.where(upper == right, 0.5, 1.0)
    return -float(curved.sum() + b @ z)
