"""The decision vector c of W1: which entry is what, and the rows that read splines off it.

All forces are in units of m·g, lengths in metres, angles in radians. A standing foot of a chart
that flattens the terrain has no height: z̄ = 0 is not a constraint there, it is not a variable
(W8).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ...files.arrays import Array
from ...problem.gaits import FootPhases
from .splines import (
    clamped_basis,
    clamped_knots,
    greville,
    hermite,
    uniform_basis,
    uniform_greville,
    uniform_size,
)

Index = NDArray[np.intp]
NOTHING = -1
"""Stands for an entry that is always 0."""


@dataclass(frozen=True, eq=False)
class FootEntries:
    """Entries of one foot's variables in the decision vector.

    NOTHING marks what is always 0.

    Arguments:
        stances: shape (S + 1, 3), their places.
        swings: shape (S, 6), place and velocity in the middle of each swing.
        forces: for each stance, shape (coefficients, 3), those of its clamped B-spline.
        switches: shape (2 S,), lift-offs and touchdowns, empty where timings are fixed.
    """

    phases: FootPhases
    stances: Index
    swings: Index
    forces: tuple[Index, ...]
    switches: Index


class GaitLayout:
    """Places in the decision vector c (W1, W7), and sparse rows of the splines in it."""

    def __init__(
        self,
        phases: Sequence[FootPhases],
        duration_s: float,
        *,
        torso_knot_s: float,
        force_knot_s: float,
        flat: bool,
        optimised: bool,
    ) -> None:
        self.duration_s, self.torso_knot_s, self.flat = duration_s, torso_knot_s, flat
        self._size = 0
        self.torso = self._take((uniform_size(duration_s, torso_knot_s), 6))
        self.feet = tuple(self._foot(one, force_knot_s, optimised) for one in phases)

    @property
    def size(self) -> int:
        """Number of variables."""
        return self._size

    def timed(self, x: Array) -> GaitLayout:
        """Layout of the same places with the switching times that a decision vector holds, where
        they are variables.
        """
        if not any(len(foot.switches) for foot in self.feet):
            return self
        moved = copy(self)
        moved.feet = tuple(
            replace(foot, phases=FootPhases(x[foot.switches], foot.phases.duration_s))
            for foot in self.feet
        )
        return moved

    @property
    def torso_times_s(self) -> Array:
        """When each coefficient of the torso's spline acts most, shape (coefficients,) [s]."""
        return uniform_greville(self.duration_s, self.torso_knot_s)

    def _take(self, shape: tuple[int, ...]) -> Index:
        count = int(np.prod(shape))
        self._size += count
        return np.arange(self._size - count, self._size).reshape(shape)

    def _foot(self, phases: FootPhases, force_knot_s: float, optimised: bool) -> FootEntries:
        count = phases.swings + 1
        stances = np.full((count, 3), NOTHING)
        stances[:, : 2 if self.flat else 3] = self._take((count, 2 if self.flat else 3))
        forces = []
        for index in range(count):
            begin, end = phases.stance(index)
            entries = np.full((max(2, round((end - begin) / force_knot_s)) + 3, 3), NOTHING)
            free = slice(
                0 if index == 0 else 1, None if index == count - 1 else -1
            )  # 0 at lift-off and touchdown
            entries[free] = self._take(entries[free].shape)
            forces.append(entries)
        return FootEntries(
            phases=phases,
            stances=stances,
            swings=self._take((phases.swings, 6)),
            forces=tuple(forces),
            switches=self._take((2 * phases.swings if optimised else 0,)),
        )

    # --------------------------------------------------------------------------------------- rows
    # of the splines

    def torso_rows(self, times_s: Array, order: int = 0) -> csr_array:
        """Rows of (p̄, θ̄) at times, or of a derivative, shape (6 len(times), size)."""
        basis = uniform_basis(times_s, self.duration_s, self.torso_knot_s, order).tocoo()
        times, knots = basis.coords
        rows = 6 * times[:, None] + np.arange(6)
        return self._rows(rows, self.torso[knots], basis.data[:, None], 6 * len(times_s))

    def foot_rows(self, foot: int, times_s: Array, order: int = 0) -> csr_array:
        """Matrix that maps the decision vector to p̄_i, or to its derivative of this order, at
        these times, shape (3 len(times), size). Switching times are those of the schedule.
        """
        entries, triplets, times = (
            self.feet[foot],
            _Triplets(),
            np.asarray(times_s, dtype=np.float64),
        )
        phase = entries.phases.phase_at(times)
        if order == 0:
            stands = np.flatnonzero(phase % 2 == 0)
            triplets.add(stands, entries.stances[phase[stands] // 2], np.ones(len(stands)))
        swings = np.flatnonzero(phase % 2 == 1)
        edges, index = entries.phases.edges_s, phase[swings] // 2
        begin, end = edges[2 * index + 1], edges[2 * index + 2]
        piece, share = np.divmod(2.0 * (times[swings] - begin) / (end - begin), 1.0)
        half = 0.5 * (end - begin)
        weights = np.array([hermite(one, order) for one in share.tolist()]).reshape(
            -1, 4
        )  # arrays' powers are others
        start, start_speed, stop, stop_speed = weights.T / half**order
        middle, speed = entries.swings[index, :3], entries.swings[index, 3:]
        up, down = np.flatnonzero(piece == 0), np.flatnonzero(piece != 0)
        triplets.add(swings[up], entries.stances[index[up]], start[up])
        triplets.add(swings[up], middle[up], stop[up])
        triplets.add(swings[up], speed[up], (half * stop_speed)[up])
        triplets.add(swings[down], middle[down], start[down])
        triplets.add(swings[down], speed[down], (half * start_speed)[down])
        triplets.add(swings[down], entries.stances[index[down] + 1], stop[down])
        return triplets.matrix(len(times), self.size)

    def force_rows(self, foot: int, times_s: Array, order: int = 0) -> csr_array:
        """Rows of f̄_i at times, zero in swing, shape (3 len(times), size)."""
        entries, triplets = self.feet[foot], _Triplets()
        phase = entries.phases.phase_at(times_s)
        for index, coefficients in enumerate(entries.forces):
            at = np.flatnonzero(phase == 2 * index)
            if not len(at):
                continue
            begin, end = entries.phases.stance(index)
            shares = (np.asarray(times_s)[at] - begin) / (end - begin)
            basis = clamped_basis(shares, len(coefficients) - 3, order).tocoo()
            rows, columns = basis.coords
            triplets.add(at[rows], coefficients[columns], basis.data / (end - begin) ** order)
        return triplets.matrix(len(times_s), self.size)

    def force_times_s(self, foot: int, stance: int) -> Array:
        """When each coefficient of a stance's force acts most, shape (coefficients,) [s]."""
        begin, end = self.feet[foot].phases.stance(stance)
        pieces = len(self.feet[foot].forces[stance]) - 3
        return begin + (end - begin) * greville(clamped_knots(pieces))

    def entry_rows(self, entries: Index) -> csr_array:
        """Rows that read entries, shape (entries.size, size); NOTHING reads 0."""
        flat = entries.ravel()
        return self._rows(np.arange(len(flat)), flat, np.ones(len(flat)), len(flat))

    def _rows(self, rows: Index, columns: Index, weights: Array, count: int) -> csr_array:
        rows, columns, weights = (
            array.ravel() for array in np.broadcast_arrays(rows, columns, weights)
        )
        there = columns != NOTHING
        return csr_array((weights[there], (rows[there], columns[there])), shape=(count, self.size))


class _Triplets:
    """Rows of three that are gathered one after the other."""

    def __init__(self) -> None:
        self._at, self._entries, self._weights = list[Index](), list[Index](), list[Array]()

    def add(self, at: Index, entries: Index, weights: Array) -> None:
        """Add n times three rows: at, weights of shape (n,); entries, of shape (n, 3)."""
        self._at.append(at)
        self._entries.append(entries)
        self._weights.append(weights)

    def matrix(self, count: int, size: int) -> csr_array:
        if not self._at:
            return csr_array((3 * count, size))
        at, entries, weights = (
            np.concatenate(parts) for parts in (self._at, self._entries, self._weights)
        )
        there = entries != NOTHING
        rows, shared = (
            3 * at[:, None] + np.arange(3),
            np.broadcast_to(weights[:, None], entries.shape),
        )
        return csr_array(
            coo_array((shared[there], (rows[there], entries[there])), shape=(3 * count, size))
        )
