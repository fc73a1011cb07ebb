"""Stiffness of joint loops, by how they yield to the forces that feet feel.

A loop τ = Kp (q* − q) − Kd q̇ that is sent q + Kp⁻¹ τ presses with τ if Kp is the one that was
counted on; at .7 of it a leg presses with .7 of that, and sags. Legs that stand say what share s it
is, over the past, which fades:

    s = argmin Σ ‖τ̂ + Kd q̇ − s Kp (q* − q)‖² + w (s − 1)²,    τ̂ = g(q) − Σ Jᵀ f_felt.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array

from ..worlds.drives import Drives
from ..worlds.world import State

PRIOR_S = 0.2
"""The stiffness that is counted on has the weight of so much time in the first pose."""
FARTHEST = 2.0
"""The share is between the inverse of this and this."""


class LoopStiffness:
    """Stiffness of all loops of a robot together.

    Attributes:
        share: of the stiffness that loops have, s; 1 until something is known.
    """

    def __init__(self, drives: Drives, period_s: float, memory_s: float) -> None:
        self._drives, self._period_s = drives, period_s
        self._kept = np.exp(-period_s / memory_s) if memory_s > 0.0 else 0.0
        self._asks = memory_s > 0.0 and drives.yields
        self._prior = self._square = self._along = 0.0
        self.share = 1.0

    def see(self, state: State, torques_nm: Array, stand: NDArray[np.bool_]) -> None:
        """One more period.

        Arguments:
            torques_nm: what joints give by the forces that feet felt.
            stand: which joints are of legs that stand, shape (J,) both.
        """
        if not self._asks:
            return
        yielded = np.where(
            stand, self._drives.stiffness_nm_rad * (state.sent_rad - state.angles_rad), 0.0
        )
        torques = np.where(
            stand, torques_nm + self._drives.damping_nms_rad * state.rates_rad_s, 0.0
        )
        self._prior = self._prior or PRIOR_S * float(max(torques @ torques, yielded @ yielded))
        self._square = self._kept * self._square + self._period_s * float(yielded @ yielded)
        self._along = self._kept * self._along + self._period_s * float(yielded @ torques)
        share = (self._along + self._prior) / max(self._square + self._prior, 1e-12)
        self.share = min(max(share, 1.0 / FARTHEST), FARTHEST)
