"""The terms of paper E's posture problem, each written once; every model is a short list of them.

All quantities are non-dimensional. Contacts are rows: N contacts, U vertices a patch. One posture is the plain case;
where a model has many, constant selections say which posture, toe or balance each row belongs to.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import scipy.sparse as sp


class Body:
    """Centre of mass c and small rotation Θ, and what limits them.

    frames: for M postures, which of them each contact belongs to, rows of zeros and a one, shape (contacts, M).
    """

    def __init__(self, contacts: int, frames: sp.csr_matrix | None = None) -> None:
        self._frames = frames
        shape = (3,) if frames is None else (frames.shape[1], 3)
        self.com = cp.Variable(shape, name="com")
        self.rotation = cp.Variable(shape, name="rotation")
        self.shoulders = cp.Parameter((contacts, 3), name="shoulders")
        self.reach = cp.Parameter(contacts, name="reach")
        self.com_nominal = cp.Parameter(shape, name="com_nominal")
        self.com_radius = cp.Parameter(shape[:-1], name="com_radius")
        self.tilt = cp.Parameter(name="tilt")

    def within_reach(self, toes: cp.Expression) -> cp.Constraint:
        """‖p_w − c − (I + [Θ]×) v‖ ≤ Δ_FK for every limb (eq. 11), R linearised. toes: shape (N, 3)."""
        legs = [toes[:, k] - self._seen(self.com, k) - self.shoulders[:, k] - self._turned(k) for k in range(3)]
        return cp.SOC(self.reach, cp.vstack(legs), axis=0)

    def within_limits(self) -> list[cp.Constraint]:
        """‖c − c_nominal‖ ≤ radius and |Θ_i| ≤ tilt."""
        return [
            cp.SOC(self.com_radius, (self.com - self.com_nominal).T, axis=0),
            self.rotation <= self.tilt,
            -self.rotation <= self.tilt,
        ]

    def weight_moment(self, stances: sp.csr_matrix | None = None) -> cp.Expression:
        """c × e_z: the moment of a unit upward force at the centre of mass, about the origin, shape (3,).

        stances: the frame of each of S balances, rows of zeros and a one, shape (S, M); then the shape is (3, S).
        """
        if stances is None:
            return cp.hstack([self.com[1], -self.com[0], 0.0])
        return cp.vstack([stances @ self.com[:, 1], -(stances @ self.com[:, 0]), np.zeros(stances.shape[0])])

    def _seen(self, variable: cp.Variable, axis: int) -> cp.Expression:
        """Component of c or Θ, for every contact."""
        return variable[axis] if self._frames is None else self._frames @ variable[:, axis]

    def _turned(self, axis: int) -> cp.Expression:
        """Component of Θ × v, shape (N,)."""
        j, k = (axis + 1) % 3, (axis + 2) % 3
        turn = [self._seen(self.rotation, other) for other in (j, k)]
        return cp.multiply(self.shoulders[:, k], turn[0]) - cp.multiply(self.shoulders[:, j], turn[1])


class Toes:
    """Toes as convex combinations of their patch's vertices (eq. 1).

    toes: where a toe has several candidate patches, a row each: whose row it is, shape (toes, rows).
    """

    def __init__(self, rows: int, vertices: int, toes: sp.csr_matrix | None = None) -> None:
        self._toes = toes
        self.weights = cp.Variable((rows, vertices), name="weights")
        self.vertices = [cp.Parameter((rows, vertices), name=f"vertices_{axis}") for axis in "xyz"]

    def position(self) -> cp.Expression:
        """p_w = Σ λ_u v_u, shape (N, 3)."""
        rows = [cp.sum(cp.multiply(v, self.weights), axis=1) for v in self.vertices]
        return cp.vstack(rows if self._toes is None else [self._toes @ row for row in rows]).T

    def shares(self) -> cp.Expression:
        """z = Σ_u λ_u, how much of its toe each row has, shape (rows,): 1 where there is one patch a toe."""
        return cp.sum(self.weights, axis=1)

    def on_patches(self) -> list[cp.Constraint]:
        """Σ λ_u = 1 over all of a toe's rows, λ ≥ 0."""
        total = self.shares() if self._toes is None else self._toes @ self.shares()
        return [total == 1, self.weights >= 0]


class Forces:
    """Contact forces (f_n, f_y, f_z) of all contacts (eq. 3), their cone and their box."""

    def __init__(self, contacts: int) -> None:
        self.forces = cp.Variable((contacts, 3), name="forces")
        self.friction = cp.Parameter(contacts, name="friction")
        self.low = cp.Parameter((contacts, 3), name="force_min")
        self.high = cp.Parameter((contacts, 3), name="force_max")

    def in_cones(self) -> cp.Constraint:
        """Eq. 10 for every contact."""
        return friction_cones(self.forces, self.friction)

    def in_box(self) -> list[cp.Constraint]:
        """f_min ≤ f ≤ f_max."""
        return [self.forces <= self.high, self.forces >= self.low]

    def flat(self) -> cp.Expression:
        """All components, contact by contact, shape (3N,)."""
        return cp.vec(self.forces, order="C")


def friction_cones(forces: cp.Expression, friction: cp.Expression) -> cp.Constraint:
    """√(f_y² + f_z²) ≤ μ f_n as second-order cones (eq. 10). forces: shape (K, 3); friction: shape (K,)."""
    return cp.SOC(cp.multiply(friction, forces[:, 0]), forces[:, 1:].T, axis=0)


class Equilibrium:
    """Σ f + F = 0 (eq. 5) and Σ p × f + M = 0 (eqs. 6, 9), gravity being all of F and M = 0 about the centre of mass.

    columns: how many force components the maps act on. Because Σ f is fixed to the weight, the moment of the forces
    about the moving centre of mass is  Σ p_w × f − w c × e_z, linear in c.
    stances: for S balances, how many components each has, in order, and the frame of each, shape (S, M). Each has maps
    of its own, ``force_map_s``: with one for all, cvxpy's tensor grows with the square of its size.
    """

    def __init__(self, columns: int, stances: tuple[tuple[int, ...], sp.csr_matrix] | None = None) -> None:
        self._frames = None if stances is None else stances[1]
        self._sizes = (columns,) if stances is None else stances[0]
        names = [""] if stances is None else [f"_{s}" for s in range(len(self._sizes))]
        self.force_maps = [cp.Parameter((3, n), name="force_map" + s) for n, s in zip(self._sizes, names, strict=True)]
        self.moment_maps = [
            cp.Parameter((3, n), name="moment_map" + s) for n, s in zip(self._sizes, names, strict=True)
        ]
        self.weight = cp.Parameter(name="weight")

    def of_forces(self, components: cp.Expression) -> cp.Constraint:
        """Eq. 5 for the contact-frame components, shape (columns,)."""
        up = np.array([0.0, 0.0, 1.0])
        if self._frames is not None:
            up = np.tile(up[:, None], (1, self._frames.shape[0]))
        return self._mapped(self.force_maps, components) == self.weight * up

    def moment(self, components: cp.Expression, body: Body) -> cp.Expression:
        """Net moment about the centre of mass, shape (3,) or (3, S); the moment map holds [p]× R_WC."""
        return self._mapped(self.moment_maps, components) - self.weight * body.weight_moment(self._frames)

    def _mapped(self, maps: list[cp.Parameter], components: cp.Expression) -> cp.Expression:
        return maps[0] @ components if self._frames is None else by_stance(maps, components, self._sizes)


def by_stance(maps: list[cp.Parameter], components: cp.Expression, sizes: tuple[int, ...]) -> cp.Expression:
    """The product of each stance's map with its own part of the components, side by side, shape (3, S)."""
    ends = np.cumsum(sizes)
    parts = [components[end - size : end] for end, size in zip(ends, sizes, strict=True)]
    return cp.vstack([matrix @ part for matrix, part in zip(maps, parts, strict=True)]).T


class Residual:
    """The slack s ≥ |net moment| that the exact methods drive to zero."""

    def __init__(self, moment: cp.Expression) -> None:
        self.slack = cp.Variable(name="residual")
        self.above = moment <= self.slack
        self.below = -moment <= self.slack

    def rows(self) -> list[cp.Constraint]:
        """−s ≤ moment ≤ s and s ≥ 0."""
        return [self.above, self.below, self.slack >= 0]
