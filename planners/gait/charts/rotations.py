"""Rotations and frames of charts as CasADi symbols: Euler angles, the polar factor of a shear, the
surface's frame.
"""

from __future__ import annotations

import casadi as cs


def euler(angles: cs.SX) -> cs.SX:
    """R = R_z(yaw) R_y(pitch) R_x(roll) of θ = (roll, pitch, yaw) [rad], shape (3, 3) (Pan et al.
    §III-A).
    """
    cr, cp, cy = (cs.cos(angles[k]) for k in range(3))
    sr, sp, sy = (cs.sin(angles[k]) for k in range(3))
    return cs.vertcat(
        cs.horzcat(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        cs.horzcat(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        cs.horzcat(-sp, cp * sr, cp * cr),
    )


def shear_rotation(slope: cs.SX) -> cs.SX:
    """P(J) of the shear (x, y, z + h) with ∇h = slope, in closed form, shape (3, 3) (W12).

    J differs from a rotation in the plane of the slope and z only; there the polar factor turns by
    atan(|∇h| / 2), about the axis (h_y, −h_x, 0).
    """
    scale = cs.sqrt(4.0 + cs.sumsqr(slope))
    cosine = 2.0 / scale
    axis = cs.vertcat(slope[1], -slope[0], 0.0) / scale
    skew = cs.skew(axis)
    return cs.SX.eye(3) + skew + skew @ skew / (1.0 + cosine)


def surface_frame(slope: cs.SX) -> cs.SX:
    """R_WC: columns t₁ (over the world's x), t₂ = n × t₁ and the true normal n, shape (3, 3)."""
    first = cs.vertcat(1.0, 0.0, slope[0]) / cs.sqrt(1.0 + slope[0] ** 2)
    normal = surface_normal(slope)
    return cs.horzcat(first, cs.cross(normal, first), normal)


def surface_normal(slope: cs.SX) -> cs.SX:
    """(−∇h, 1) / ‖·‖ (Pan et al., after W5), shape (3, 1)."""
    return cs.vertcat(-slope[0], -slope[1], 1.0) / cs.sqrt(1.0 + cs.sumsqr(slope))
