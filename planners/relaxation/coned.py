"""P1 with the friction cone times the bounds of the box, "coned": tighter than McCormick's
envelope, in the same box.

McCormick's rows multiply bounds of p by bounds of f. The friction cone ‖f_t‖ ≤ μ f_n (E10) is a
bound of f, too, and times p_j − l_j ≥ 0 and h_j − p_j ≥ 0 it gives, with m_jk for p_j f_k,

    ‖m_jt − l_j f_t‖ ≤ μ (m_jn − l_j f_n),    ‖h_j f_t − m_jt‖ ≤ μ (h_j f_n − m_jn),

two second-order cones per axis j and contact. Both hold at every point of the box with m = p f, so
that nothing that P admits is lost. The signed margin t widens them as it widens the envelope.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from ..equilibrium.layout import Layout
from ..equilibrium.scaled import Scaled
from ..equilibrium.terms import Given
from ..files.arrays import Array
from .envelope import Boxed, Envelope
from .mccormick import Axes, McCormick, margin_gradient
from .relaxed import RelaxationAnswer

_BELOW, _ABOVE = 0, 1
"""Numbers of the cones with p_j − l_j and with h_j − p_j."""
_SIGNS = np.array([1.0, -1.0])[:, None, None, None]
"""Signs of m in those cones, shape (2, 1, 1, 1)."""


class Coned(McCormick):
    """McCormick's P1 over one box, with the friction cones times the box's bounds of positions.

    The rows are left out of contacts with several candidates, of boxes in world axes, and where a
    stance chooses among boxes: forces have no one cone in the axes of the box there, or the box is
    not known yet.
    """

    own_rows: ClassVar[tuple[str, ...]] = ("box_cones",)

    def __init__(
        self, layout: Layout, axes: Axes = "contact", soft: bool = True, boxes: int = 1
    ) -> None:
        super().__init__(layout, axes, soft, boxes)
        counts = np.bincount(layout.candidate_footholds, minlength=layout.footholds)
        foothold = layout.contacts[2]
        alone = counts[foothold] == 1 if axes == "contact" and boxes == 1 else counts[foothold] < 0
        self._coned = np.flatnonzero(alone)
        self._candidate = np.searchsorted(layout.candidate_footholds, foothold)[self._coned]
        rows, shape = (
            self.rows,
            (2, len(self._coned), 3, 3),
        )  # side, contact, axis j, row of the cone
        cone = rows.cones("box_cones", int(np.prod(shape[:3])), 3).reshape(shape)
        moments = self._moments.reshape(-1, 3, 3)[self._coned]
        forces = self._box_forces[self._coned][:, None, :]
        rows.put(cone, moments, lambda given: -_SIGNS * self._sides(given.scaled))
        rows.put(cone, forces, self._moved)
        if soft:
            rows.put(cone[..., 0], rows.columns["margin"], -1.0)

    def solve(self, scaled: Scaled, box: Envelope, *, gradient: bool = False) -> RelaxationAnswer:
        """P1 over one box; the gradient has the part of the cones, too."""
        program_data = Boxed(scaled, boxes=(box,))
        solution = self.rows.solve(program_data)
        answer = self._answer(solution, scaled)
        if not gradient or answer.at is None:
            return answer
        force = answer.at[self._coned, None, 3:] * self._sides(scaled)
        multipliers = solution.dual("box_cones").reshape(2, -1, 3, 3)
        by_end = _SIGNS[..., 0] * np.sum(multipliers * force, axis=3)
        low, high = margin_gradient(solution, answer.at, box)
        low[self._coned, :3] += by_end[_BELOW]
        high[self._coned, :3] += by_end[_ABOVE]
        return replace(answer, gradient=(low, high))

    def _sides(self, scaled: Scaled) -> Array:
        """Factors of (f_n, f_y, f_z) in a cone's rows: μ, 1, 1, shape (C, 1, 3)."""
        friction = scaled.friction[self._candidate]
        return np.stack([friction, np.ones_like(friction), np.ones_like(friction)], axis=-1)[
            :, None, :
        ]

    def _moved(self, given: Given) -> Array:
        """Factors of the forces: l and −h of the contacts with cones, times the factors, (2, C, 3,
        3).
        """
        assert isinstance(given, Boxed)
        ends = np.stack(given.boxes[0].position)[:, self._coned, :, None]
        return np.asarray(_SIGNS * ends * self._sides(given.scaled))
