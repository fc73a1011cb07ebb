"""The terms of paper E's posture problem, each written once; every model is a short list of them.

All quantities are non-dimensional. Contacts are rows: N contacts, U vertices a patch.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np


class Body:
    """Centre of mass c and small rotation Θ, and what limits them."""

    def __init__(self, contacts: int) -> None:
        self.com = cp.Variable(3, name="com")
        self.rotation = cp.Variable(3, name="rotation")
        self.shoulders = cp.Parameter((contacts, 3), name="shoulders")
        self.reach = cp.Parameter(contacts, name="reach")
        self.com_nominal = cp.Parameter(3, name="com_nominal")
        self.com_radius = cp.Parameter(name="com_radius")
        self.tilt = cp.Parameter(name="tilt")

    def within_reach(self, toes: cp.Expression) -> cp.Constraint:
        """‖p_w − c − (I + [Θ]×) v‖ ≤ Δ_FK for every limb (eq. 11), R linearised. toes: shape (N, 3)."""
        legs = [toes[:, k] - self.com[k] - self.shoulders[:, k] - self._turned(k) for k in range(3)]
        return cp.SOC(self.reach, cp.vstack(legs), axis=0)

    def within_limits(self) -> list[cp.Constraint]:
        """‖c − c_nominal‖ ≤ radius and |Θ_i| ≤ tilt."""
        return [
            cp.SOC(self.com_radius, self.com - self.com_nominal),
            self.rotation <= self.tilt,
            -self.rotation <= self.tilt,
        ]

    def weight_moment(self) -> cp.Expression:
        """c × e_z: the moment of a unit upward force at the centre of mass, about the origin."""
        return cp.hstack([self.com[1], -self.com[0], 0.0])

    def _turned(self, axis: int) -> cp.Expression:
        """Component of Θ × v, shape (N,)."""
        j, k = (axis + 1) % 3, (axis + 2) % 3
        return self.shoulders[:, k] * self.rotation[j] - self.shoulders[:, j] * self.rotation[k]


class Toes:
    """Toes as convex combinations of their patch's vertices (eq. 1)."""

    def __init__(self, contacts: int, vertices: int) -> None:
        self.weights = cp.Variable((contacts, vertices), name="weights")
        self._vertices = [cp.Parameter((contacts, vertices), name=f"vertices_{axis}") for axis in "xyz"]

    def position(self) -> cp.Expression:
        """p_w = Σ λ_u v_u, shape (N, 3)."""
        return cp.vstack([cp.sum(cp.multiply(v, self.weights), axis=1) for v in self._vertices]).T

    def on_patches(self) -> list[cp.Constraint]:
        """Σ λ_u = 1, λ ≥ 0."""
        return [cp.sum(self.weights, axis=1) == 1, self.weights >= 0]


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
    """

    def __init__(self, columns: int) -> None:
        self.force_map = cp.Parameter((3, columns), name="force_map")
        self.moment_map = cp.Parameter((3, columns), name="moment_map")
        self.weight = cp.Parameter(name="weight")

    def of_forces(self, components: cp.Expression) -> cp.Constraint:
        """Eq. 5 for the contact-frame components, shape (columns,)."""
        return self.force_map @ components == self.weight * np.array([0.0, 0.0, 1.0])

    def moment(self, components: cp.Expression, body: Body) -> cp.Expression:
        """Net moment about the centre of mass, shape (3,); the moment map holds [p]× R_WC."""
        return self.moment_map @ components - self.weight * body.weight_moment()


class Residual:
    """The slack s ≥ |net moment| that the exact methods drive to zero."""

    def __init__(self, moment: cp.Expression) -> None:
        self.slack = cp.Variable(name="residual")
        self.above = moment <= self.slack
        self.below = -moment <= self.slack

    def rows(self) -> list[cp.Constraint]:
        """−s ≤ moment ≤ s and s ≥ 0."""
        return [self.above, self.below, self.slack >= 0]
