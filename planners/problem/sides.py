"""Sides of least steps: ‖Δ‖ ≥ δ is not convex, so that planners and proofs branch over directions.

A side is a spherical triangle of three unit vectors d. The Δ in its cone with ‖Δ‖ ≥ δ are Σ λ d
with λ ≥ 0 and Σ λ ≥ ‖Δ‖ ≥ δ, and with n the normal of the plane through the three, n·d = h for
each, they have n·Δ = h Σ λ ≥ h δ: a half-space for each side, which is the hull of what it holds.
Eight octants cover all directions, and four parts of a triangle cover it; h goes to 1, by a factor
of about four nearer each time. Planners and the verifier read them here.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..files.arrays import Array

ROUNDED = 1e-9
"""Share of δ by which a half-space is widened: corners of parts are rounded."""
SMALLEST = 0.02
"""A side whose corners are nearer to each other is not parted again: h is within a few parts in ten
thousand of 1."""
OPEN = (0.0, 0.0, 0.0, -1.0)
"""The row n·Δ ≥ b of a step whose side is open: it holds always."""


def parts(side: Array | None) -> list[Array]:
    """The sides, shape (3, 3) each, that cover a side: of all directions, where None, the octants.

    Arguments:
        side: shape (3, 3), its corners.
    """
    if side is None:
        return [np.diag(signs) for signs in itertools.product((1.0, -1.0), repeat=3)]
    a, b, c = side
    ab, bc, ca = (_unit(first + second) for first, second in ((a, b), (b, c), (c, a)))
    return [np.array(corners) for corners in ((ab, bc, ca), (a, ab, ca), (b, bc, ab), (c, ca, bc))]


def too_small(side: Array | None) -> bool:
    """Tell whether a side is not parted again."""
    return side is not None and bool(np.linalg.norm(side[0] - side[1]) < SMALLEST)


def half_space(side: Array, least: float) -> Array:
    """The row (n, b) with n·Δ ≥ b for all Δ of this side that are as long as ``least``, shape
    (4,).
    """
    a, b, c = side
    normal = np.cross(b - a, c - a)
    normal = _unit(normal if normal @ a > 0.0 else -normal)
    return np.append(normal, (float((side @ normal).min()) - ROUNDED) * least)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
