"""Answers that cost less than a lift, for whoever only wants to know what a posture problem is not.

Nothing here is tried on behalf of a verdict: what is said is proved by a sum of supports, or by a point that the conic
solver is at, and a search (``cuts``) comes to the same at a higher price.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..equilibrium.batch import ScaledBatch
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import Array
from ..projection.held import FixToes
from ..projection.project import SURFACE

CLEAR = 1e-3
"""Contacts have to lack this share of the weight, so that a solver's tolerance has no say."""
AZIMUTH = np.arange(8) * np.pi / 4.0
ELEVATION = 1.05
DIRECTIONS = np.column_stack([
    np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.full(8, np.sin(ELEVATION))
])  # fmt: skip
"""Unit vectors d, steep: on walls it is friction that lacks, and a little to the side the normals help least."""


def unsupported(scaled: ScaledBatch) -> NDArray[np.bool_]:
    """Which problems have not even P̄, since no forces carry the weight, shape (B,); others may not, either.

    For some d the contacts together push less along d than the weight asks: Σ max d·C f < w d_z over f_n ≤ f_max and
    the friction cones (E5, E10), a certificate's bound with ν_F = −d alone.
    """
    along = np.matmul(DIRECTIONS, scaled.frames)  # (B, N, 8, 3), d in contact frames
    shear = np.hypot(along[..., 1], along[..., 2])
    most = np.maximum(along[..., 0] + scaled.friction[..., None] * shear, 0.0)
    pushed = np.matmul(np.maximum(scaled.like.force_max[:, 0], 0.0), most)
    return np.asarray((pushed < scaled.like.weight * (DIRECTIONS[:, 2] - CLEAR)).any(axis=1))


def stands(programs: Programs, scaled: Scaled, toes: Array) -> bool:
    """Whether a posture problem has a posture with these toes, shape (N, 3), non-dimensional."""
    nothing = np.zeros((1, 3))
    start = Point(com=nothing, rotation=nothing, toes=toes, forces=toes, residual=float("inf"))
    return programs.get(FixToes, scaled.layout, False, True).solve(scaled, start).residual <= SURFACE
