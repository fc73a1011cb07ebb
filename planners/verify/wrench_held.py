"""Largest part of a wrench that a stance holds: the reason for most proofs that it cannot be
carried.

A stance is asked alone, with the multiple σ of its wrench, whatever the robot does before and
after:

    Σ λ_u = 1, λ ≥ 0                                 the toe of a limb on its candidates  (1)
    Σ C f_u = w e_z − σ F                            f_u = λ_u f, as if the toe were at v_u  (5)
    Σ v_u × C f_u − c × (w e_z − σ F) + σ M = 0      (6)
    f_u in its cone, λ_u f_min ≤ f_u ≤ λ_u f_max     (10)
    ‖p − c − s − Θ × s‖ ≤ ρ, ‖c − c_nominal‖ ≤ radius, |Θ| ≤ tilt    (11)

That is the lift of the stance, which every posture is in: where it has no point for some σ, no
posture holds so much. The multiples that it has one for are an interval from 0, but for what the
small way of c adds to c × σ F; its end is found by halving. Half-spaces of reach are left out,
which leaves the end no lower.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import clarabel
import numpy as np

from ..files.arrays import Array, cross, lengths
from ..files.codec import Columns
from .explanation import halved
from .lagrangian import Numbers
from .stances import Index

_HALVINGS = 12
"""Halvings of the interval in which the largest multiple is sought."""
_LESS = 0.99
"""A later stance is named only where it holds less than this share of what an earlier one does."""
_REFUSED = (clarabel.SolverStatus.PrimalInfeasible, clarabel.SolverStatus.AlmostPrimalInfeasible)


def least_held(numbers: Numbers, patches: Sequence[Array]) -> tuple[int, float] | None:
    """The stance that holds the least of its wrench, by number, and the largest share of it that it
    might hold; None where every stance might hold all of it.

    Stances that cannot even bear the weight alone are left out: it is not the wrench that they lack
    forces for.

    Arguments:
        numbers: of one problem.
        patches: vertices of its candidates, shape (U, 3) each, non-dimensional.
    """
    if numbers.wrench is None:
        return None
    result: tuple[int, float] | None = None
    for stance in np.flatnonzero(lengths(numbers.wrench[0]) > 0.0).tolist():
        lift = _Lift(numbers, patches, stance)
        most = 1.0 if result is None else _LESS * result[1]
        if not lift.might_hold(most) and lift.might_hold(0.0):
            result = stance, halved(lift.might_hold, 0.0, most, _HALVINGS)[1]
    return result


class _Lift:
    """The lift of one stance; its columns are λ, c, Θ and f_u for every vertex under a contact."""

    def __init__(self, numbers: Numbers, patches: Sequence[Array], stance: int) -> None:
        assert numbers.wrench is not None
        who = numbers.schedule
        self._numbers, self._frame, self._wrench = (
            numbers,
            int(who.frame[stance]),
            numbers.wrench[0, stance],
        )
        rows = np.flatnonzero(who.stance == stance)
        feet = np.unique(who.foothold[rows])
        under = np.flatnonzero(np.isin(numbers.candidate, feet)).tolist()
        candidate = np.repeat(under, [len(patches[t]) for t in under])  # of every vertex
        foothold, vertices = (
            numbers.candidate[candidate],
            np.concatenate([patches[t] for t in under]),
        )
        vertex, contact = np.nonzero(foothold[:, None] == who.foothold[rows])
        self._shares, self._com = np.arange(len(candidate)), len(candidate) + np.arange(3)
        self._forces = len(candidate) + 6 + np.arange(3 * len(vertex)).reshape(-1, 3)
        self._entries: list[tuple[Index, Index, Array]] = []
        self._right, self._cones = list[float](), list[Any]()
        acts = vertices[vertex]
        if numbers.offsets is not None:
            acts = acts + numbers.offsets[0, candidate[vertex], who.point[rows[contact]]]
        self._balances(acts, numbers.frames[0, candidate[vertex]], foothold, feet)
        self._in_cones(numbers.friction[0, candidate[vertex]])
        self._in_boxes(rows[contact], vertex)
        for foot in feet.tolist():
            self._in_reach(foot, np.flatnonzero(foothold == foot), vertices)
        self._body()

    def might_hold(self, share: float) -> bool:
        """Tell whether the lift has a point with this multiple of the wrench, or the solver does
        not know.
        """
        x, y, z = borne = np.array([0.0, 0.0, self._numbers.weight[0]]) - share * self._wrench[:3]
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # c × b
        blocks = [*self._entries, (np.arange(3, 6)[:, None], self._com, -turn)]
        parts = [[np.ravel(part) for part in np.broadcast_arrays(*block)] for block in blocks]
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort((rows, columns))
        size = int(self._forces[-1, -1]) + 1
        starts = np.searchsorted(columns[order], np.arange(size + 1))
        matrix = Columns(values[order], rows[order], starts, (len(self._right), size))
        right = np.array(self._right)
        right[:3], right[3:6] = borne, -share * self._wrench[3:]
        nothing = Columns(
            np.zeros(0), np.zeros(0, dtype=np.int_), np.zeros(size + 1, dtype=np.int_), (size, size)
        )
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        answer: Any = clarabel.DefaultSolver(
            nothing, np.zeros(size), matrix, right, self._cones, settings
        ).solve()
        return answer.status not in _REFUSED

    def _group(self, count: int, cones: Sequence[Any], right: Sequence[float] | Array) -> Index:
        """New rows A x + s = b with s in these cones, count of them."""
        first = len(self._right)
        self._right += list(right)
        self._cones += cones
        return first + np.arange(count)

    def _put(self, rows: Index, columns: Index, values: Array | float) -> None:
        """Entries of A, broadcast against each other."""
        self._entries.append((rows, columns, np.asarray(values, dtype=np.float64)))

    def _balances(self, acts: Array, turned: Array, foothold: Index, feet: Index) -> None:
        """The balances, without what depends on the multiple of the wrench, and Σ λ = 1."""
        count = 6 + len(feet)
        rows = self._group(count, [clarabel.ZeroConeT(count)], [0.0] * 6 + [1.0] * len(feet))
        moments = cross(acts[:, None], turned.transpose(0, 2, 1)).transpose(
            0, 2, 1
        )  # of unit forces
        self._put(rows[:3, None], self._forces[:, None], turned)
        self._put(rows[3:6, None], self._forces[:, None], moments)
        self._put(rows[6:][np.searchsorted(feet, foothold)], self._shares, 1.0)

    def _in_cones(self, friction: Array) -> None:
        count = len(friction)
        rows = self._group(3 * count, [clarabel.SecondOrderConeT(3)] * count, [0.0] * (3 * count))
        ones = np.ones(count)
        self._put(rows.reshape(-1, 3), self._forces, -np.stack([friction, ones, ones], axis=1))

    def _in_boxes(self, contact: Index, vertex: Index) -> None:
        """f_u within λ_u times the bounds of its contact, and λ ≥ 0."""
        numbers, count = self._numbers, self._forces.size
        for sign, bound in ((1.0, numbers.force_max), (-1.0, numbers.force_min)):
            rows = self._group(count, [clarabel.NonnegativeConeT(count)], [0.0] * count).reshape(
                -1, 3
            )
            self._put(rows, self._forces, sign)
            self._put(rows, self._shares[vertex][:, None], -sign * bound[0, contact])
        count = len(self._shares)
        self._put(
            self._group(count, [clarabel.NonnegativeConeT(count)], [0.0] * count),
            self._shares,
            -1.0,
        )

    def _in_reach(self, foot: int, own: Index, vertices: Array) -> None:
        """The ball of reach of the limb on a foothold."""
        numbers, com = self._numbers, self._com
        limb = int(np.flatnonzero(numbers.schedule.holds[self._frame] == foot)[0])
        x, y, z = shoulder = numbers.shoulders[0, limb]
        right = [numbers.reach[0, limb], *-shoulder]
        rows = self._group(4, [clarabel.SecondOrderConeT(4)], right)[1:]
        self._put(rows[:, None], own, -vertices[own].T)
        self._put(rows, com, 1.0)
        self._put(
            rows[:, None], com + 3, np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        )  # Θ × s

    def _body(self) -> None:
        """The ball of c and the box of Θ."""
        numbers, turn = self._numbers, self._com + 3
        for sign in (1.0, -1.0):
            self._put(
                self._group(3, [clarabel.NonnegativeConeT(3)], [numbers.tilt[0]] * 3), turn, sign
            )
        nominal = numbers.com[0, self._frame]
        rows = self._group(
            4, [clarabel.SecondOrderConeT(4)], [numbers.com_radius[0, self._frame], *-nominal]
        )
        self._put(rows[1:], self._com, -1.0)
