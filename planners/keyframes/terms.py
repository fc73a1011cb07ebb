"""The terms that couple key frames (eq. 11 and the objective of §II); all others are those of one posture."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

from ..contact.terms import Body, Toes
from ..scene.course import Weights
from .layout import Layout, one_hot


class Steps:
    """How far body and toes may move between neighbouring key frames."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.com = cp.Parameter(name="com_step")
        self.toe = cp.Parameter(name="toe_step")
        self.rotation = cp.Parameter(name="rotation_step")
        self.direction = cp.Parameter((layout.frames - 1, 3), name="direction") if layout.frames > 1 else None
        self.progress = cp.Parameter(layout.frames - 1, name="progress") if layout.frames > 1 else None

    def limits(self, body: Body, toes: cp.Expression) -> dict[str, cp.Constraint]:
        """‖c[r] − c[r−1]‖, ‖p_i[r] − p_i[r−1]‖, ‖Θ[r] − Θ[r−1]‖ ≤ Δ_max, and the progress of c along its path."""
        if self.direction is None or self.progress is None:
            return {}
        ones = np.ones(self._layout.frames - 1)
        com = body.com[1:] - body.com[:-1]
        found: dict[str, cp.Constraint] = {
            "com_step": cp.SOC(self.com * ones, com.T, axis=0),
            "rotation_step": cp.SOC(self.rotation * ones, (body.rotation[1:] - body.rotation[:-1]).T, axis=0),
            "progress": cp.sum(cp.multiply(self.direction, com), axis=1) >= self.progress,
        }
        moves = self._layout.moves
        if len(moves):
            found["toe_step"] = cp.SOC(self.toe * np.ones(len(moves)), self.toe_moves(self._layout, toes).T, axis=0)
        return found

    @staticmethod
    def toe_moves(layout: Layout, toes: cp.Expression) -> cp.Expression:
        """p_i[r] − p_i[r−1] of every toe that moves, shape (K, 3)."""
        return toes[layout.moves[:, 1]] - toes[layout.moves[:, 0]]


def objective(
    layout: Layout, weights: Weights, length_m: float, body: Body, toes: cp.Expression | None
) -> cp.Expression:
    """Squared distance of the last COM to the goal, and squared steps, in units of the length scale squared.

    toes: shape (P, 3); None where they are held, and their steps a constant.
    """
    goal = cp.Parameter(3, name="goal")
    cost = weights.goal * cp.sum_squares(body.com[-1] - goal)
    cost += weights.tilt / length_m**2 * cp.sum_squares(body.rotation)
    if layout.frames > 1:
        cost += weights.com_step * cp.sum_squares(body.com[1:] - body.com[:-1])
    if len(layout.moves) and toes is not None:
        cost += weights.toe_step * cp.sum_squares(Steps.toe_moves(layout, toes))
    return cost


class LiftedForces:
    """The forces of the lift, f_u := λ_u f, a row for every vertex of every piece, in world axes.

    cvxpy's tensor has a column for every pair of a variable and a parameter. Contact frames for every row would be
    most of the parameters, so here the rows take them, and the vertices, from the slots.
    """

    def __init__(self, layout: Layout, toes: Toes) -> None:
        rows = len(layout.piece_slots) * layout.vertices
        self._toes, self._pieces = toes, layout.slot_of_pieces
        self._pick = one_hot(np.repeat(layout.piece_slots, layout.vertices), layout.slots)
        stance = np.repeat(layout.bearing[0], layout.regions * layout.vertices)
        self._sums = sp.csr_matrix(one_hot(stance, len(layout.stances)).T)
        self.forces = cp.Variable((rows, 3), name="lifted")
        self._axes = [cp.Parameter((layout.slots, 3), name=f"axis_{k}") for k in "nyz"]
        self._friction_axis = cp.Parameter((layout.slots, 3), name="friction_axis")  # μ n
        self._low, self._high = cp.Parameter(3, name="force_min"), cp.Parameter(3, name="force_max")

    def in_cones(self) -> cp.Constraint:
        """√(f_y² + f_z²) ≤ μ f_n for every row (eq. 10)."""
        shear = cp.vstack([self._along(axis) for axis in self._axes[1:]])
        return cp.SOC(self._along(self._friction_axis), shear, axis=0)

    def in_box(self, *, shear: bool) -> list[cp.Constraint]:
        """λ_u f_min ≤ f_u ≤ λ_u f_max; shear: for the shear components, too."""
        share = cp.vec(self._pieces @ self._toes.weights, order="C")
        axes = self._axes if shear else self._axes[:1]
        found: list[cp.Constraint] = []
        for k, axis in enumerate(axes):
            component = self._along(axis)
            found += [component <= self._high[k] * share, component >= self._low[k] * share]
        return found

    def balance(self) -> cp.Constraint:
        """Eq. 5 for every stance, the weight being the unit of force."""
        up = np.tile([[0.0], [0.0], [1.0]], (1, self._sums.shape[0]))
        return up == (self._sums @ self.forces).T

    def moment(self, body: Body, frames: sp.csr_matrix) -> cp.Expression:
        """Net moment about the COM of every stance, Σ v_u × f_u − c × e_z, shape (3, S)."""
        arms = [cp.vec(self._pieces @ v, order="C") for v in self._toes.vertices]
        parts = []
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            parts.append(cp.multiply(arms[i], self.forces[:, j]) - cp.multiply(arms[j], self.forces[:, i]))
        return cp.vstack([self._sums @ part for part in parts]) - body.weight_moment(frames)

    def _along(self, axis: cp.Parameter) -> cp.Expression:
        return cp.sum(cp.multiply(self._pick @ axis, self.forces), axis=1)


class Candidates:
    """Which candidate patches may be used: Σ_u λ_u ≤ 1 where a slot is open, ≤ 0 where it is closed."""

    def __init__(self, layout: Layout) -> None:
        self.opened = cp.Parameter(layout.slots, name="opened", nonneg=True)

    def only_open(self, toes: Toes) -> cp.Constraint:
        """z ≤ opened for every slot."""
        return toes.shares() <= self.opened
