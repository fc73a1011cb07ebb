"""A simulated world in which the ground lets go: one foot that slips, or less friction everywhere,
from a time on.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stancekit.runner.worlds.mujoco import MujocoWorld
from stancekit.runner.worlds.world import State

FAULTS = ("foot slips", "friction differs")
SLIPPERY = 0.02
"""Friction of a foot that slips."""


class SlippingWorld(MujocoWorld):
    """MuJoCo with faults, ``inject(kind, at_s)`` in simulated seconds from the reset, before or
    after it.

    limb: whose foot slips, its index in the robot. share: of the friction that is left everywhere.
    ``happened_s``: when the fault came, NaN before.
    """

    def __init__(self, *arguments: Any, limb: int = 0, share: float = 0.5, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.limb, self.share, self.happened_s = limb, share, float("nan")
        self._due: list[tuple[float, str]] = []

    def inject(self, kind: str, at_s: float = 0.0) -> None:
        """Let a fault of ``FAULTS`` happen at this time."""
        if kind not in FAULTS:
            raise ValueError(f"kind: expected one of {', '.join(FAULTS)}, got {kind!r}")
        self._due.append((at_s, kind))

    def read(self) -> State:
        """The state after a control period."""
        now = float(self._data.time)
        for kind in [kind for at_s, kind in self._due if at_s <= now]:
            self._happen(kind)
            self.happened_s = now
        self._due = [item for item in self._due if item[0] > now]
        return super().read()

    def _happen(self, kind: str) -> None:
        bodies = self._model.geom_bodyid
        if kind == "friction differs":
            self._model.geom_friction[bodies == 0, 0] *= self.share
            return
        foot = self._model.body(self.robot.legs.legs[self.limb].foot).id
        for geom in np.flatnonzero(bodies == foot):
            self._model.geom_priority[geom] = (
                2  # above the terrain's: now the foot's own friction counts
            )
            self._model.geom_friction[geom, 0] = SLIPPERY
