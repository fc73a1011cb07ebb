"""Legs to first order: feet, levers of their joints and how these move, for many postures at once.

The lever of joint j is ∂p_F/∂q_j of its own foot, so that a force f on the foot takes the torque
−lever · f. With a_j the unit vector that a joint turns about (0 where it slides)

    ∂lever_j/∂q_k = a_min(j, k) × lever_max(j, k)   for joints of one leg,
    ∂lever_j/∂δ   = δ × lever_j   for a small rotation δ of the base about the world's axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array, cross
from .leg import Leg


@dataclass(frozen=True, kw_only=True, eq=False)
class LegSlopes:
    """K postures of N legs with J joints in all, turned into the world.

    Arguments:
        feet: R_WB p_BF, shape (K, N, 3) [m].
        levers: levers of every joint, shape (K, J, 3) [m].
        axes: a, shape (K, J, 3).
    """

    feet: Array
    levers: Array
    axes: Array

    @classmethod
    def of(cls, legs: Sequence[Leg], angles: Array, rotations: Array) -> LegSlopes:
        """The slopes of K postures.

        Arguments:
            angles: joint angles in the legs' order, shape (K, J) [rad].
            rotations: R_WB, shape (K, 3, 3).
        """
        feet, levers, axes, begin = [], [], [], 0
        for leg in legs:
            q = angles[:, begin : begin + len(leg.joints)]
            foot, jacobian = leg.chain.feet_and_jacobian(q)
            turns = leg.chain.frames(q)[0]
            feet.append(foot[:, None])
            levers.append(jacobian.transpose(0, 2, 1))
            axes.append(
                np.einsum("knij,nj->kni", turns, leg.chain.axes) * ~leg.chain.slides[:, None]
            )
            begin += len(leg.joints)
        back = rotations.transpose(0, 2, 1)
        return cls(
            feet=np.concatenate(feet, axis=1) @ back,
            levers=np.concatenate(levers, axis=1) @ back,
            axes=np.concatenate(axes, axis=1) @ back,
        )

    def lever_slopes(self, first: np.ndarray, second: np.ndarray) -> Array:
        """∂lever/∂q of pairs of joints of one leg, by number, shape (K, pairs, 3) [m/rad]."""
        inner, outer = np.minimum(first, second), np.maximum(first, second)
        return np.asarray(cross(self.axes[:, inner], self.levers[:, outer]))


def turning(rotation_rad: Array) -> Array:
    """The left Jacobian of rotation vectors: R(Θ + δ) ≈ exp([D δ]×) R(Θ), shapes (K, 3) to (K, 3,
    3).
    """
    angle = np.linalg.norm(rotation_rad, axis=-1)[:, None, None]
    x, y, z = rotation_rad.T
    zero = np.zeros_like(x)
    cross_of = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    # (1 − cos a)/a² and (a − sin a)/a³ by their series: tilts are small
    small = angle**2
    one = 0.5 - small / 24.0 + small**2 / 720.0 - small**3 / 40320.0
    two = 1.0 / 6.0 - small / 120.0 + small**2 / 5040.0 - small**3 / 362880.0
    return np.asarray(np.eye(3) + one * cross_of + two * (cross_of @ cross_of))
