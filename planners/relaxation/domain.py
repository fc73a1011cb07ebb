"""Boxes over [p, f] of the stance contacts that a problem itself implies: what a grid divides, and a box must meet."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..arrays import Array
from ..equilibrium.scaled import Scaled
from .envelope import Envelope

Axes = Literal["contact", "world"]
"""Of forces: the frame that all candidates under a contact share, or the world's."""


def axes_of(scaled: Scaled) -> Axes:
    """The contact frames where the candidates under every stance contact share one, else the world's axes."""
    return "world" if len(of_several_frames(scaled)) else "contact"


def of_several_frames(scaled: Scaled) -> Array:
    """The stance contacts under which candidates of several frames are open, in order."""
    contact, candidate = scaled.layout.contact_candidates
    first = np.searchsorted(scaled.layout.candidate_footholds, scaled.layout.contacts[2])
    off = np.abs(scaled.frames[candidate] - scaled.frames[first[contact]]).max(axis=(1, 2))
    return np.unique(contact[off > 1e-6])


def domain_of(scaled: Scaled, axes: Axes) -> Envelope:
    """Bounds on [p, f] of every stance contact, shape (B, 6).

    p: candidates against the ball of the centre of mass, met with the shoulder's reach at any tilt. f: the force box
    met with the cone's, over the candidates; in world axes the box around those boxes. Bounds that exclude each other
    change places: the problem's own rows are infeasible then.
    """
    layout = scaled.layout
    stance, limb, _ = layout.contacts
    frame = layout.stance_frames[stance]
    contact, vertex = layout.contact_vertices
    p_low, p_high = _extent(scaled.vertices[vertex], scaled.vertices[vertex], contact, len(stance))
    radius, shoulders = scaled.com_radius[frame][:, None], scaled.shoulders[limb]
    size = np.abs(shoulders)
    reach = scaled.reach[limb][:, None]
    reach = reach + scaled.tilt * (size.sum(axis=1, keepdims=True) - size)  # |(Θ × v)_j| ≤ tilt Σ |v_k|
    p_low = np.maximum(p_low - scaled.com[frame] - radius, shoulders - reach)
    p_high = np.minimum(p_high - scaled.com[frame] + radius, shoulders + reach)
    f_low, f_high = _force_domain(scaled, axes)
    return Envelope.from_vector(np.concatenate([np.hstack([p_low, f_low]), np.hstack([p_high, f_high])], axis=None))


def unit_domain(scaled: Scaled) -> Envelope:
    """[−1, 1] for every p and f of every stance contact (paper E §II), f_n included."""
    ends = np.ones((len(scaled.layout.contacts[0]), 6))
    return Envelope(low=-ends, high=ends)


def meet(first: Envelope, second: Envelope) -> Envelope:
    """The common part of two boxes; on a side where they have none, the gap between them."""
    ends = (np.maximum(first.low, second.low), np.minimum(first.high, second.high))
    return Envelope.from_vector(np.concatenate(ends, axis=None))


def _force_domain(scaled: Scaled, axes: Axes) -> tuple[Array, Array]:
    """Bounds on the force of every stance contact, (B, 3) each."""
    contact, candidate = scaled.layout.contact_candidates
    normal, friction = np.maximum(scaled.force_max[contact, 0], 0.0), scaled.friction[candidate]
    cone = normal[:, None] * np.column_stack([np.ones_like(friction), friction, friction])
    low = np.maximum(scaled.force_min[contact], cone * [0.0, -1.0, -1.0])
    high = np.minimum(scaled.force_max[contact], cone)
    if axes == "world":
        turn = scaled.frames[candidate]
        middle = np.matmul(turn, 0.5 * (low + high)[..., None])[..., 0]
        half = np.matmul(np.abs(turn), 0.5 * (high - low)[..., None])[..., 0]
        low, high = middle - half, middle + half
    return _extent(low, high, contact, len(scaled.layout.contacts[0]))


def _extent(low: Array, high: Array, groups: Array, count: int) -> tuple[Array, Array]:
    """Least of the rows of every group, and most."""
    least, most = np.full((count, low.shape[1]), np.inf), np.full((count, low.shape[1]), -np.inf)
    np.minimum.at(least, groups, low)
    np.maximum.at(most, groups, high)
    return least, most
