"""Bounds on [p, f] of every stance contact that a problem implies: no answer of it leaves this
box.
"""

from __future__ import annotations

import numpy as np

from ..equilibrium.layout import Layout
from ..equilibrium.scaled import Scaled, cones_met
from ..files.arrays import Array
from .envelope import Envelope
from .mccormick import Axes


def domain_of(scaled: Scaled, axes: Axes = "contact", *, reach: bool = True) -> Envelope:
    """The box over the contacts.

    p: open patches against the ball of the centre of mass.

    Arguments:
        reach: met with the shoulder's reach at any tilt. f: the force box met with the cone's, over
            the open patches; in world axes the box around those boxes.
    """
    layout = scaled.layout
    stance, limb, foothold = layout.contacts
    frame = layout.stance_frames[stance]
    low, high = toe_ranges(scaled)
    radius = scaled.com_radius[frame][:, None]
    p_low, p_high = (
        low[foothold] - scaled.com[frame] - radius,
        high[foothold] - scaled.com[frame] + radius,
    )
    if reach:
        shoulders, size = scaled.shoulders[limb], np.abs(scaled.shoulders[limb])
        far = scaled.reach[limb][:, None] + scaled.tilt * (
            size.sum(axis=1, keepdims=True) - size
        )  # |(Θ × v)_j|
        p_low, p_high = np.maximum(p_low, shoulders - far), np.minimum(p_high, shoulders + far)
    f_low, f_high = _forces(scaled, layout, axes)
    return Envelope.from_vector(
        np.concatenate([np.hstack([p_low, f_low]), np.hstack([p_high, f_high])], axis=None)
    )


def toe_ranges(scaled: Scaled) -> tuple[Array, Array]:
    """Lowest and highest coordinates of every foothold's open patches, shape (P, 3) each."""
    starts = np.searchsorted(scaled.layout.vertex_footholds, np.arange(scaled.layout.footholds))
    return np.minimum.reduceat(scaled.vertices, starts), np.maximum.reduceat(
        scaled.vertices, starts
    )


def _forces(scaled: Scaled, layout: Layout, axes: Axes) -> tuple[Array, Array]:
    """Bounds on the forces of every contact in its box's axes, (B, 3) each."""
    contact, candidate = layout.contact_candidates
    low, high = cones_met(
        scaled.force_min[contact], scaled.force_max[contact], scaled.friction[candidate]
    )
    if axes == "world":
        turn = scaled.frames[candidate]
        middle = np.matmul(turn, 0.5 * (low + high)[..., None])[..., 0]
        half = np.matmul(np.abs(turn), 0.5 * (high - low)[..., None])[..., 0]
        low, high = middle - half, middle + half
    starts = np.searchsorted(contact, np.arange(len(scaled.force_min)))
    return np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
