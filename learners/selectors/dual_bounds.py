"""Proofs for other boxes from one solve of P1: checks of many witnesses and certificates over many
boxes at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import domain_of

BAND = 1e-6
"""A witness must have this margin to spare, a certificate must exclude this margin: ten times what
P1 forgives."""
_ROUNDS = 8
"""Number of times that the moments of a witness are tried again with the largest held at their
bounds."""
Bools = NDArray[np.bool_]
Index = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class DualBounds:
    """P boxes.

    Arguments:
        low, high: shape (P, N, 6).
        products: p_j f_k of the ends, in the order of the envelope rows and with their signs in the
            Lagrangian, shape (36 N, P).
    """

    low: Array
    high: Array
    products: Array

    @classmethod
    def of(cls, boxes: Sequence[Envelope]) -> DualBounds:
        """Stack some boxes."""
        low, high = np.stack([box.low for box in boxes]), np.stack([box.high for box in boxes])
        p_low, p_high = low[..., :3, None], high[..., :3, None]
        f_low, f_high = low[..., None, 3:], high[..., None, 3:]
        signed = np.stack([-p_low * f_low, -p_high * f_high, p_low * f_high, p_high * f_low])
        products = np.moveaxis(signed, 1, -1).reshape(-1, len(low))
        return cls(low=low, high=high, products=np.ascontiguousarray(products))

    def take(self, which: Index) -> DualBounds:
        """Some of the boxes."""
        return DualBounds(
            low=self.low[which], high=self.high[which], products=self.products[:, which]
        )


def witnessed(point: Array, excess: Array, axes: Array, bounds: DualBounds, open_: Bools) -> Bools:
    """Tell whether points settle P1 over boxes with BAND to spare, shape (K, W, P), False where not
    open, shape (K, P).

    A point [p, f] in the box is one of P1 if some moments m = p f + e balance there under the
    envelope rows, which read −(p − p_low)(f − f_low) ≤ e, −(p_high − p)(f_high − f) ≤ e, e ≤ (p −
    p_low)(f_high − f) and e ≤ (p_high − p)(f − f_low).

    Arguments:
        point, excess: of K × W witnesses (``DualBound``).
        axes: E9 is axes · m = 0, shape (K, 3, 9N).
    """
    at = point[:, :, None]
    inside = np.all((at >= bounds.low + BAND) & (at <= bounds.high - BAND), axis=(3, 4))
    hits: Bools = np.asarray(inside & open_[:, None])
    k, w, b = np.nonzero(hits)
    if not len(k):
        return hits
    above, below = point[k, w] - bounds.low[b], bounds.high[b] - point[k, w]
    (p_above, f_above), (p_below, f_below) = (
        (side[..., :3, None], side[..., None, 3:]) for side in (above, below)
    )
    bottom = BAND - np.minimum(p_above * f_above, p_below * f_below).reshape(len(k), -1)
    top = np.minimum(p_above * f_below, p_below * f_above).reshape(len(k), -1) - BAND
    hits[k, w, b] = balanced(axes[k], excess[k, w].reshape(len(k), -1), bottom, top)
    return hits


def balanced(axes: Array, excess: Array, bottom: Array, top: Array) -> Bools:
    """Tell whether some e in [bottom, top] has the same axes · e as ``excess``; a False may be
    wrong. Shapes (T, 9N).

    Scaled to |s| ≤ 1 about the middle, the smallest s is tried, then what is too large in it is
    held at ±1 and the rest solved again, ROUNDS times.
    """
    middle, half = 0.5 * (top + bottom), 0.5 * (top - bottom)
    flags = np.zeros(len(axes), dtype=bool)
    rows = np.flatnonzero(np.all(half > 0.0, axis=1))
    scaled = axes[rows] * half[rows][:, None]
    target = np.einsum("trc,tc->tr", axes[rows], excess[rows] - middle[rows])
    held = np.zeros((len(rows), axes.shape[2]))
    for _ in range(_ROUNDS):
        free = scaled * (held == 0.0)[:, None]
        gram = free @ scaled.swapaxes(1, 2) + 1e-14 * np.eye(3)
        rest = target - np.einsum("trc,tc->tr", scaled, held)
        s = held + np.einsum("trc,tr->tc", free, np.linalg.solve(gram, rest[..., None])[..., 0])
        off = np.abs(target - np.einsum("trc,tc->tr", scaled, s)).max(axis=1)
        done = np.all(np.abs(s) <= 1.0, axis=1) & (off < 1e-10)
        flags[rows[done]] = True
        held = np.where(np.abs(s) > 1.0, np.sign(s), held)
        rows, scaled, target, held = rows[~done], scaled[~done], target[~done], held[~done]
        if not len(rows):
            break
    return flags


def least(
    rows: Array, slope: Array, constant: Array, bounds: DualBounds, low: Array, high: Array
) -> Array:
    """Least value of the Lagrangian over [p, f] in the overlap at a margin of BAND, shape (K, C,
    P).

    Where it is positive, P1's margin is larger than BAND.

    Arguments:
        rows, slope, constant: of K × C certificates (``DualBound``).
        low, high: the overlap, shape (K, P, N, 6).
    """
    k, c = rows.shape[:2]
    value = (rows.reshape(k * c, -1) @ bounds.products).reshape(k, c, -1)
    value += (constant - BAND * rows.sum(axis=(2, 3, 4, 5)))[..., None]
    (p_low, f_low), (p_high, f_high) = (
        (np.moveaxis(side[..., :3], 0, -1), np.moveaxis(side[..., 3:], 0, -1))
        for side in (bounds.low, bounds.high)
    )  # each of shape (N, 3, P)
    u = np.moveaxis(rows, 2, 0)
    by_p = (
        (u[0] - u[3]) @ f_low + (u[1] - u[2]) @ f_high + slope[..., :3, None]
    )  # shape (K, C, N, 3, P)
    turned = u.swapaxes(-1, -2)
    by_f = (turned[0] - turned[2]) @ p_low + (turned[1] - turned[3]) @ p_high + slope[..., 3:, None]
    middle, half = (
        np.moveaxis(side, 1, -1)[:, None] for side in (0.5 * (high + low), 0.5 * (high - low))
    )
    for by, part in ((by_p, slice(0, 3)), (by_f, slice(3, 6))):
        value = value + np.sum(
            by * middle[..., part, :] - np.abs(by) * half[..., part, :], axis=(2, 3)
        )
    return np.asarray(value)


def ranges(problem: Scaled) -> tuple[Array, Array]:
    """Bounds of [p, f] in any answer, each of shape (N, 6).

    That is, the patches as seen from the ball of the centre of mass, and the forces in their boxes
    and cones.
    """
    whole = domain_of(problem, reach=False)
    room = 1e-7  # what the solver forgives
    return whole.low - room, whole.high + room
