"""Feedback of the body: a wrench that brings it back, shared by the feet that stand, within their
cones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .settings import Feedback

Array = NDArray[np.float64]
ROUNDS, DONE, KEPT, FLAT = 30, 1e-4, 1e-3, 1e-6
"""Rounds of accelerated projected gradients; the change, in units of all planned force, below which
there are no more; what a change of force costs beside a miss of the wrench; what keeps the rows of
few feet independent."""


def wrench(
    gains: Feedback,
    mass_kg: float,
    off_m: Array,
    speed_m_s: Array,
    turn_rad: Array,
    rate_rad_s: Array,
) -> Array:
    """Force and moment about the centre of mass that bring the body back, shape (6,), as springs
    and dampers do.

    Arguments:
        gains: of the settings.
        mass_kg: of the robot.
        off_m: where the centre of mass should be, from where it is, shape (3,) [m].
        speed_m_s: how fast it should be, less how fast it is, shape (3,).
        turn_rad: the same of its rotation, shape (3,).
        rate_rad_s: and of how fast it turns, shape (3,).
    """
    slow, fast = 2.0 * np.pi * gains.position_hz, 2.0 * np.pi * gains.rotation_hz
    inertia = mass_kg * gains.gyration_m**2
    force = mass_kg * (slow**2 * off_m + 2.0 * gains.damping * slow * speed_m_s)
    moment = inertia * (fast**2 * turn_rad + 2.0 * gains.damping * fast * rate_rad_s)
    return np.concatenate([force, moment])


def shared(
    gains: Feedback, wanted: Array, arms_m: Array, forces_n: Array, normals: Array, friction: Array
) -> Array:
    """Forces of n feet within their cones whose sum over the planned ones is nearest to a wrench,
    shape (n, 3) [N].

    Arguments:
        gains: of the settings.
        wanted: change of force and of moment about the centre of mass, shape (6,).
        arms_m: from the centre of mass to the feet, shape (n, 3) [m].
        forces_n: planned, shape (n, 3) [N].
        normals: of the ground under them, shape (n, 3).
        friction: of the ground under them, shape (n,).
    """
    count = len(arms_m)
    scale = np.r_[np.ones(3), np.full(3, 1.0 / gains.gyration_m)]
    rows: Array = np.zeros((6, 3 * count))
    for foot, (x, y, z) in enumerate(arms_m):
        rows[:3, 3 * foot : 3 * foot + 3] = np.eye(3)
        rows[3:, 3 * foot : 3 * foot + 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    rows *= scale[:, None]
    gram = rows @ rows.T
    root = np.linalg.cholesky(gram + FLAT * np.trace(gram) * np.eye(6))
    rows, aim = np.asarray(np.linalg.solve(root, rows)), np.linalg.solve(root, scale * wanted)
    step = 1.0 / (1.0 + KEPT)  # rows are orthonormal now
    found = _coned(forces_n, normals, gains.cone * friction)
    ahead, pace, enough = found, 1.0, DONE * float(np.abs(forces_n).sum())
    for _ in range(ROUNDS):
        change = (ahead - forces_n).ravel()
        slope = rows.T @ (rows @ change - aim) + KEPT * change
        after = _coned(ahead - step * slope.reshape(-1, 3), normals, gains.cone * friction)
        if np.abs(after - found).max() < enough:
            return after
        faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace**2))
        ahead, found, pace = after + (pace - 1.0) / faster * (after - found), after, faster
    return found


def _coned(forces: Array, normals: Array, friction: Array) -> Array:
    """The nearest forces in friction cones, shape (n, 3)."""
    up = (forces * normals).sum(axis=1)
    along = forces - up[:, None] * normals
    size = np.linalg.norm(along, axis=1)
    outside, gone = size > friction * up, friction * size <= -up
    onto = np.maximum((up + friction * size) / (1.0 + friction**2), 0.0)
    way = along / np.maximum(size, 1e-12)[:, None]
    edge = onto[:, None] * (normals + friction[:, None] * way)
    return np.where((gone & outside)[:, None], 0.0, np.where(outside[:, None], edge, forces))
