"""Limits on a plan of the whole body: the torques of its joints, and how far bodies are apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..files.arrays import Array, checked, checked_int
from ..robot.model import Robot

if TYPE_CHECKING:
    from ..robot.kinematics import Kinematics


@dataclass(frozen=True, kw_only=True)
class WholeBodyLimits:
    """Limits on a plan of the whole body.

    Arguments:
        torque_nm: no joint may take more, whatever it has itself [Nm]; None: what it has.
        share: of that, steps aim at it; a plan within its limits is left as it is.
        clearance_m: where links go through the terrain, or come too near to each other, steps aim
            at this distance [m].
        steps: most steps of the whole plan; 0: forces alone.

    Raises:
        InvalidInput: for a torque that is not positive, a share outside of (0, 1], a negative
            number of steps or distance.
    Source:
        None: joint limits of the robot's file, and those that are asked for.

    Example:
        >>> from stancekit import WholeBodyLimits
        >>> WholeBodyLimits(torque_nm=8.0).share
        0.9
    """

    torque_nm: float | None = None
    share: float = 0.9
    clearance_m: float = 0.005
    steps: int = 20

    def __post_init__(self) -> None:
        if self.torque_nm is not None:
            checked(self.torque_nm, "torque_nm", above=0.0)
        checked(self.share, "torque_share", above=0.0, most=1.0)
        checked(self.clearance_m, "clearance_m", least=0.0)
        checked_int(self.steps, "steps", least=0)

    def concern(self, robot: Robot) -> bool:
        """Tell whether a plan for the robot has to have joints: its file has legs, or torques are
        asked for.
        """
        return robot.source.own or self.torque_nm is not None

    def of(self, solver: Kinematics) -> Array:
        """Torque limit of every joint, shape (J,) [Nm]; inf where nothing is known and nothing
        asked for.
        """
        return np.asarray(
            np.minimum(solver.torque_nm, np.inf if self.torque_nm is None else self.torque_nm)
        )
