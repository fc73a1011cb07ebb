"""Half-spaces of reach, as the verifier works them out: (a + Θ × a)·(p_w − c) ≤ b, the rotation as
that of the ball.

*Of a certificate.* Multipliers σ ≥ 0 of a limb's half-spaces at a frame, α = Σ σ a, add to the left
side of ``lagrangian`` Σ σ ((a + Θ × a)·(q − c) − b) = (α + Θ × α)·(q − c) − Σ σ b. With d = q − c −
s that is

    α·(q − c) + Θ·(α × s) − Σ σ b + Θ·(α × d),

the first two of which have the form of those of r. By the ball ‖d‖ ≤ ρ + ‖Θ × s‖, so the last one
is at least −t(α) (ρ + t(s)), t(x) the largest ‖Θ × x‖ in the box of Θ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..problem import Contact
from ..robot.model import Limb, Robot
from .geometry import cross, length

_Limbs = Sequence[Limb | Contact]


def row_counts(limbs: _Limbs) -> tuple[int, ...]:
    """Number of half-spaces of reach that each limb has."""
    return tuple(0 if limb.reach_rows is None else len(limb.reach_rows.bounds_m) for limb in limbs)


def reach_rows(limbs: _Limbs) -> tuple[Array, Array] | None:
    """Half-spaces of reach, normals (N, R, 3) and bounds (N, R) [m], with such that hold always
    where one has fewer.

    None where there are none.
    """
    counts = row_counts(limbs)
    if not any(counts):
        return None
    normals, bounds = (
        np.zeros((len(limbs), max(counts), 3)),
        np.full((len(limbs), max(counts)), math.inf),
    )
    for i, limb in enumerate(limbs):
        if limb.reach_rows is not None:
            normals[i, : counts[i]], bounds[i, : counts[i]] = (
                limb.reach_rows.normals,
                limb.reach_rows.bounds_m,
            )
    return normals, bounds


def beyond(ball: Array, rotation: Array, legs: Array, rows: tuple[Array, Array] | None) -> Array:
    """Distances by which K toes are out of reach [m], shape (K,): of the ball, or of (a + Θ ×
    a)·(p_w − c) ≤ b.

    Arguments:
        ball: out of it.
        rotation: Θ.
        legs: p_w − c; shape (K, 3) each.
        rows: of each, as ``reach_rows`` has them.
    """
    if rows is None:
        return ball
    normals, bounds = rows
    turned = normals + cross(rotation[:, None], normals)
    return np.asarray(np.maximum(ball, (np.vecdot(turned, legs[:, None]) - bounds).max(axis=1)))


def bowed(rotation: Array, legs: Array, rows: tuple[Array, Array]) -> Array:
    """The most that toes which stay are beyond their half-spaces on a straight way of the body [m],
    shape (K,).

    A row at the share t is (1 − t) g₀ + t g₁ − q t (1 − t) with q = (ΔΘ × a)·Δ(p_w − c), largest
    between the ends where q is negative.

    Arguments:
        rotation: Θ at either end, (2, 3).
        legs: p_w − c, (2, K, 3).
        rows: as ``reach_rows`` has them.
    """
    normals, bounds = rows
    start, end = (
        np.vecdot(normals + cross(theta, normals), leg[:, None]) - bounds
        for theta, leg in zip(rotation, legs, strict=True)
    )
    q = np.minimum(
        np.vecdot(cross(rotation[1] - rotation[0], normals), (legs[1] - legs[0])[:, None]), -1e-300
    )
    with np.errstate(invalid="ignore"):  # half-spaces that hold always
        share = np.clip(0.5 - 0.5 * (end - start) / q, 0.0, 1.0)
        most = (1.0 - share) * start + share * end - q * share * (1.0 - share)
    return np.asarray(np.fmax(most, -math.inf).max(axis=1))


def scaled_half_spaces(limbs: Sequence[_Limbs], lengths: Array) -> dict[str, Array]:
    """The half-spaces of reach of Q problems.

    Arguments:
        lengths: their length scales.
    """
    rows = [
        [limb.reach_rows for limb in each_limb if limb.reach_rows is not None]
        for each_limb in limbs
    ]
    if not rows[0]:
        return {"row_normals": np.zeros((len(rows), 0, 3)), "row_bounds": np.zeros((len(rows), 0))}
    bounds = np.array([np.concatenate([part.bounds_m for part in each_limb]) for each_limb in rows])
    normals = np.array([np.concatenate([part.normals for part in each_limb]) for each_limb in rows])
    return {"row_normals": normals, "row_bounds": bounds / lengths[:, None]}


def relative_rows(robot: Robot, holds: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, Array]:
    """Half-spaces a·(p_other − p_limb) ≤ b of feet, wherever the limb has just been put down.

    Arguments:
        holds: the foothold under each limb at each frame, (M, N).

    Returns:
        Of each row the footholds of the limb and of the other, (L, 2), and a, (L, 3), and b, (L,)
        [m].
    """
    names, feet, normals, bounds = robot.limb_names, [], [np.zeros((0, 3))], [np.zeros(0)]
    for before, after in pairwise(holds):
        for pair in robot.relative_reach:
            limb, other = names.index(pair.limb), names.index(pair.other)
            if before[limb] != after[limb]:
                feet += [(after[limb], after[other])] * len(pair.rows.bounds_m)
                normals.append(pair.rows.normals)
                bounds.append(pair.rows.bounds_m)
    return (
        np.array(feet, dtype=np.intp).reshape(-1, 2),
        np.concatenate(normals),
        np.concatenate(bounds),
    )


def relative_pulls(feet: NDArray[np.intp], normals: Array, sigma: Array, footholds: int) -> Array:
    """Slope in every toe that multipliers σ of such half-spaces add, shape (L, P, 3).

    Arguments:
        normals: of each leaf's, (L, rows, 3).
        sigma: (L, rows).
    """
    signs = np.zeros((len(feet), footholds))
    signs[np.arange(len(feet)), feet[:, 1]] = 1.0
    signs[np.arange(len(feet)), feet[:, 0]] = -1.0
    return np.asarray(np.einsum("ij,ijk,jp->ipk", sigma, normals, signs, optimize=True))


def half_space_pulls(
    row_limb: NDArray[np.intp], normals: Array, sigma: Array, limbs: int
) -> Array | None:
    """α = Σ σ a of every limb at every frame of L leaves, shape (L, M, N, 3); None where there are
    no half-spaces.

    Arguments:
        row_limb: whose each is, (H,).
        normals: (L, H, 3).
        sigma: (L, M, H).
    """
    if not len(row_limb):
        return None
    owner = (np.arange(limbs)[:, None] == row_limb).astype(np.float64)
    return np.asarray(owner @ (sigma[..., None] * normals[:, None]))


def bending(pulls: Array, shoulders: Array, tilt: Array, reach: Array) -> Array:
    """Σ t(α) (ρ + t(s)) of L leaves, shape (W, L), at W tilts, (W, L), and reaches, (W, L, N).

    Arguments:
        pulls: α, (L, M, N, 3).
        shoulders: (L, N, 3).
    """
    corners = np.array(
        [[1.0, y, z] for y in (1.0, -1.0) for z in (1.0, -1.0)]
    )  # of the box, one of each opposite pair

    def turned(vectors: Array) -> Array:
        return np.asarray(length(cross(corners, vectors[..., None, :])).max(axis=-1))

    return np.asarray(
        tilt * np.vecdot(turned(pulls).sum(axis=1), reach + tilt[..., None] * turned(shoulders))
    )
