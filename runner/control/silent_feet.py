"""Feet that should press and feel nothing for long: there is no ground, or nothing comes back from
their sensors.

A foot that seeks the ground is lowered until it feels something. One whose sensor is dead pushes,
and the others slide.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..log import TOUCH_N
from ..worlds.world import State
from .tracker import Target

BEARS, OF_WEIGHT = 8.0, 0.2
"""A foot that should press with so many times what a touch is, or with this share of a light
robot's weight,"""
SILENT_S = 0.3
"""for this time, in one stance or several, and felt nothing meanwhile, is silent."""


class SilentFeet:
    """Counts, for every foot, the time in which it should have pressed and felt nothing.

    Arguments:
        weight_n: of the robot.
        names: of its limbs.
    """

    def __init__(self, rate_hz: float, weight_n: float, names: Sequence[str]) -> None:
        self._periods, self._names = SILENT_S * rate_hz, names
        self._presses_n = min(BEARS * TOUCH_N, OF_WEIGHT * weight_n)
        self._silent = np.zeros(len(names))

    def found(
        self, target: Target, state: State, seeks: NDArray[np.bool_] | Literal[False] = False
    ) -> str:
        """Message about a silent foot, and since when it is known, in one line; empty where none
        is. One more period.

        Arguments:
            seeks: feet that are still being lowered to uncertain ground, shape (N,): their time
                does not count.
        """
        sample = target.sample
        wanted_n, felt_n = sample.along_n, np.vecdot(state.forces_n, sample.normals)
        presses = sample.stands & (wanted_n >= self._presses_n) & np.logical_not(seeks)
        self._silent = np.where(felt_n >= TOUCH_N, 0.0, self._silent + presses)
        limb = int(self._silent.argmax())
        if self._silent[limb] < self._periods:
            return ""
        return (
            f"foot of {self._names[limb]}: expected {wanted_n[limb]:.0f} N where it stands, felt "
            "none for "
            f"{SILENT_S:g} s: nothing is under it, or its sensor is dead"
        )
