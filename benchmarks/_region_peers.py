"""The region choice of a course handed to mixed-integer solvers: the same lift, a binary a
candidate, no objective.

Both get the conic form that the two-stage planner's own nodes are made of, and the rows Σ_u λ_{r,u}
≤ z_r, Σ_r z_r = 1. SCIP takes the second-order cones as they are. HiGHS has none: it gets planes
about the cones for "no" (a relaxation, so what it refutes is refuted), and planes within them for
plans.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from stancekit.planners.equilibrium.layout import Index
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.equilibrium.terms import Given
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.lift import LiftProgram

Label = Literal["feasible", "infeasible", "unknown"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Said:
    """What a solver says of the lift with binaries. x: of the conic form, then z; seconds: of the
    solver alone.
    """

    label: Label
    x: Array | None
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Mixed:
    """b − A x in cones: zero rows, rows ≥ 0 and second-order cones (row slices); x ends with z, a
    candidate each, from ``first`` on; columns: of the lift, by the names of its variables.
    """

    matrix: sp.csr_matrix
    offset: Array
    zero: slice
    positive: slice
    cones: list[slice]
    first: int
    columns: Mapping[str, Index]

    @classmethod
    def of(cls, lift: LiftProgram, scaled: Scaled) -> Mixed:
        """The lift of a course, with a binary a candidate."""
        _, _, columns, offset = lift.rows.load(Given(scaled))
        matrix = sp.csc_matrix((columns.data, columns.indices, columns.indptr), shape=columns.shape)
        layout, n = scaled.layout, matrix.shape[1]
        count = len(layout.candidate_footholds)
        shares = sp.lil_matrix((count, n + count))
        shares[layout.vertex_candidates, lift.rows.columns["weights"]] = 1.0
        shares[np.arange(count), n + np.arange(count)] = -1.0  # Σ_u λ_u − z ≤ 0
        one = sp.lil_matrix((layout.footholds, n + count))
        one[layout.candidate_footholds, n + np.arange(count)] = 1.0  # Σ_r z_r = 1
        wide = sp.hstack([matrix, sp.csr_matrix((matrix.shape[0], count))]).tocsr()
        spans, at = [], 0
        for cone in lift.rows.cone_list:
            spans.append((type(cone).__name__, slice(at, at + cone.dim)))  # type: ignore[attr-defined]
            at += cone.dim  # type: ignore[attr-defined]
        zero = [wide[span] for name, span in spans if name.startswith("Zero")] + [one]
        above = [wide[span] for name, span in spans if name.startswith("Nonnegative")] + [shares]
        round_ = [(wide[span], offset[span]) for name, span in spans if name.startswith("Second")]
        zeros = [offset[span] for name, span in spans if name.startswith("Zero")] + [
            np.ones(layout.footholds)
        ]
        aboves = [offset[span] for name, span in spans if name.startswith("Nonnegative")]
        aboves += [np.zeros(count)]
        e, p = sum(part.shape[0] for part in zero), sum(part.shape[0] for part in above)
        ends = e + p + np.cumsum([0] + [len(b) for _, b in round_])
        return cls(
            matrix=sp.vstack([*zero, *above, *(rows for rows, _ in round_)]).tocsr(),
            offset=np.concatenate([*zeros, *aboves, *(b for _, b in round_)]),
            zero=slice(0, e),
            positive=slice(e, e + p),
            cones=[slice(int(a), int(b)) for a, b in itertools.pairwise(ends)],
            first=n,
            columns=lift.rows.columns,
        )


def highs(mixed: Mixed, *, inner: bool, time_limit_s: float) -> Said:
    """HiGHS on one thread. inner: planes within the cones, else about them."""
    import highspy

    matrix, low, high = _planes(mixed, inner=inner)
    columns = matrix.shape[1]
    program = highspy.HighsLp()
    program.num_col_, program.num_row_ = columns, matrix.shape[0]
    infinite = highspy.kHighsInf
    of_z = np.arange(columns) >= mixed.first
    program.col_cost_ = np.zeros(columns)
    program.col_lower_, program.col_upper_ = (
        np.where(of_z, 0.0, -infinite),
        np.where(of_z, 1.0, infinite),
    )
    program.row_lower_, program.row_upper_ = np.maximum(low, -infinite), np.minimum(high, infinite)
    rows = matrix.tocsr()
    program.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    program.a_matrix_.start_, program.a_matrix_.index_, program.a_matrix_.value_ = (
        rows.indptr,
        rows.indices,
        rows.data,
    )
    kinds = (highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger)
    program.integrality_ = [kinds[int(is_z)] for is_z in of_z]
    solver = highspy.Highs()
    for name, value in {"output_flag": False, "threads": 1, "time_limit": time_limit_s}.items():
        solver.setOptionValue(name, value)
    solver.passModel(program)
    begin = time.perf_counter()
    solver.run()
    seconds = time.perf_counter() - begin
    status = solver.getModelStatus()
    if status == highspy.HighsModelStatus.kOptimal:
        return Said(label="feasible", x=np.array(solver.getSolution().col_value), seconds=seconds)
    refuted = status in (
        highspy.HighsModelStatus.kInfeasible,
        highspy.HighsModelStatus.kUnboundedOrInfeasible,
    )
    return Said(label="infeasible" if refuted else "unknown", x=None, seconds=seconds)


def scip(mixed: Mixed, *, time_limit_s: float) -> Said:
    """SCIP on one thread, the cones as they are."""
    import pyscipopt

    model = pyscipopt.Model()
    model.hideOutput()
    model.setParam("limits/time", time_limit_s)
    x = [model.addVar(lb=None, ub=None) for _ in range(mixed.first)]
    x += [model.addVar(vtype="B") for _ in range(mixed.matrix.shape[1] - mixed.first)]

    def side(row: int) -> Any:
        span = slice(mixed.matrix.indptr[row], mixed.matrix.indptr[row + 1])
        entries = zip(mixed.matrix.indices[span], mixed.matrix.data[span], strict=True)
        return float(mixed.offset[row]) - pyscipopt.quicksum(
            float(a) * x[j] for j, a in entries if a
        )

    for row in range(mixed.zero.start, mixed.zero.stop):
        model.addCons(side(row) == 0.0)
    for row in range(mixed.positive.start, mixed.positive.stop):
        model.addCons(side(row) >= 0.0)
    for cone in mixed.cones:
        s = [
            model.addVar(lb=0.0 if row == cone.start else None, ub=None)
            for row in range(cone.start, cone.stop)
        ]
        for variable, row in zip(s, range(cone.start, cone.stop), strict=True):
            model.addCons(side(row) - variable == 0.0)
        model.addCons(pyscipopt.quicksum(v * v for v in s[1:]) - s[0] * s[0] <= 0.0)
    begin = time.perf_counter()
    model.optimize()
    seconds = time.perf_counter() - begin
    if model.getNSols():
        return Said(label="feasible", x=np.array([model.getVal(v) for v in x]), seconds=seconds)
    refuted = model.getStatus() in ("infeasible", "inforunbd")
    return Said(label="infeasible" if refuted else "unknown", x=None, seconds=seconds)


def _planes(mixed: Mixed, *, inner: bool) -> tuple[sp.csr_matrix, Array, Array]:
    """low ≤ rows x ≤ high, each cone ‖s‖ ≤ t replaced by a·s ≤ t or, within it, a·s ≤ κ t for unit
    vectors a.
    """
    matrix, low, high = (
        [mixed.matrix[: mixed.positive.stop]],
        [mixed.offset[mixed.zero]],
        [mixed.offset[mixed.zero]],
    )
    low.append(np.full(mixed.positive.stop - mixed.positive.start, -np.inf))
    high.append(mixed.offset[mixed.positive])
    for size in sorted({cone.stop - cone.start for cone in mixed.cones}):
        vectors, shrunk = directions(size - 1)
        cones = [cone for cone in mixed.cones if cone.stop - cone.start == size]
        starts = np.array([cone.start for cone in cones])
        pick = np.hstack(
            [np.full((len(vectors), 1), -(shrunk if inner else 1.0)), vectors]
        )  # a·s − κ t ≤ 0
        rows = np.concatenate([np.arange(start, start + size) for start in starts])
        select = sp.kron(sp.eye(len(cones)), sp.csr_matrix(pick))
        matrix.append(-(select @ mixed.matrix[rows]))  # s = b − A x
        high.append(-(select @ mixed.offset[rows]))
        low.append(np.full(len(high[-1]), -np.inf))
    return sp.vstack(matrix).tocsr(), np.concatenate(low), np.concatenate(high)


def directions(dimension: int) -> tuple[Array, float]:
    """Unit vectors whose planes stand about the unit ball, and the radius κ of a ball about what
    they then enclose.

    a·s ≤ κ for all of them implies ‖s‖ ≤ 1: κ is the least, over directions, of the largest a·d.
    """
    if dimension == 2:
        angle = 2.0 * np.pi * np.arange(12) / 12
        return np.column_stack([np.cos(angle), np.sin(angle)]), float(np.cos(np.pi / 12))
    assert dimension == 3
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [(0.0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    twelve = np.array([np.roll(corner, k) for corner in corners for k in range(3)]) / np.hypot(
        1.0, golden
    )
    near = [(i, j) for i in range(12) for j in range(i) if twelve[i] @ twelve[j] > 0.4]
    middles = np.array([twelve[i] + twelve[j] for i, j in near])
    vectors = np.vstack([twelve, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vectors)
    return vectors, float(
        np.min(-hull.equations[:, 3])
    )  # the nearest face of the hull is the widest gap
