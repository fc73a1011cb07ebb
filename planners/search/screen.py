"""Answers that cost less than a lift, for whoever only wants to know what a posture problem is not.

Nothing here is tried on behalf of a verdict: what is said is proved by a sum of supports, or by a
point that the conic solver is at, and a search (``cuts``) comes to the same at a higher price.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..equilibrium.batch import ScaledBatch
from ..equilibrium.layout import Layout
from ..equilibrium.programs import Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, Given, HeldToes
from ..files.arrays import Array
from ..projection.held import held_moments

CLEAR = 1e-3
"""Contacts have to lack this share of the weight, so that a solver's tolerance has no say."""
AZIMUTH = np.arange(8) * np.pi / 4.0
ELEVATION = 1.05
DIRECTIONS = np.column_stack(
    [
        np.cos(ELEVATION) * np.cos(AZIMUTH),
        np.cos(ELEVATION) * np.sin(AZIMUTH),
        np.full(8, np.sin(ELEVATION)),
    ]
)
"""Unit vectors d, steep: on walls it is friction that lacks, and a little to the side the normals
help least."""


def unsupported(scaled: ScaledBatch) -> NDArray[np.bool_]:
    """Tell which problems have not even P̄, since no forces carry the weight, shape (B,); others
    may not, either.

    For some d the contacts together push less along d than the weight, and what else is on the
    body, asks: Σ max d·C f < d·(w e_z − F) over f_n ≤ f_max and the friction cones (E5, E10), a
    certificate's bound with ν_F = −d alone.
    """
    along = np.matmul(DIRECTIONS, scaled.frames)  # (B, N, 8, 3), d in contact frames
    shear = np.hypot(along[..., 1], along[..., 2])
    most = np.maximum(along[..., 0] + scaled.friction[..., None] * shear, 0.0)
    pushed = np.matmul(np.maximum(scaled.like.force_max[:, 0], 0.0), most)
    like = scaled.like
    least = like.weight * (DIRECTIONS[:, 2] - CLEAR)
    if like.layout.wrench:
        least = least - DIRECTIONS @ like.wrench[0, :3]
    return np.asarray((pushed < least).any(axis=1))


class StandingTest:
    """Test for c, Θ and f with toes that are held: fix-toes (``held``), its moments zero, nothing
    to minimise.

    Arguments:
        implied: leave out the rows of the force box that the cones imply (``Scaled.box_implied``).
    """

    def __init__(self, layout: Layout, implied: bool) -> None:
        self._rows = rows = Rows[Given](keep=layout.frames == 1)
        body, forces = BodyVariables(rows, layout), Forces.of_contacts(rows, layout)
        forces.balance()
        held_moments(layout, body, forces).vanish(rows)
        forces.in_cones()
        forces.in_box(implied=implied)
        body.reach(HeldToes(rows), inner=True)
        body.limits()

    def admits(self, scaled: Scaled, toes: Array) -> bool:
        """Tell whether the solver met its own tolerances at a point with these toes, shape (N,
        3).
        """
        nothing = np.zeros((1, 3))
        held = Point(com=nothing, rotation=nothing, toes=toes, forces=toes, residual=float("inf"))
        solution = self._rows.solve(Given(scaled, held))
        return solution.solved and solution.exact


def stands(programs: Programs, scaled: Scaled, toes: Array) -> bool:
    """Tell whether a posture problem has a posture with these toes, shape (N, 3),
    non-dimensional.
    """
    return programs.get(StandingTest, scaled.layout, scaled.box_implied).admits(scaled, toes)
