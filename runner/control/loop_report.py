"""Report on a closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..safety.ending import Ended
from .friction import FrictionInterval


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopReport:
    """Report on the run of a policy.

    Arguments:
        succeeded: to its end, with the centre of mass where it should be.
        message: why not.
        ended: how the robot was left.
        plans: made and run.
        replans: of these, because of a deviation.
        frames: key frames reached, of all but the first.
        friction: as feet felt it.
        planned_share: of the course's friction, that the last plan counts on.
        surfaces: what feet found otherwise than planned, empty for nothing.
        com_final_m: distance of the centre of mass from the last plan's end [m].
        deviation_m: farthest that body or feet were off the plan [m].
        seconds: of motion [s].
        plan_s: spent on planning [s].
        wall_s: by the clock [s].
    Source:
        None: planned against measured.

    Example:
        >>> import stancekit
        >>> report = stancekit.run("walls", policy="lift")  # doctest: +SKIP
        >>> stancekit.LoopReport.__name__
        'LoopReport'
    """

    succeeded: bool
    message: str
    ended: Ended
    plans: int
    replans: int
    frames: int
    friction: FrictionInterval
    planned_share: float
    surfaces: str
    com_final_m: float
    deviation_m: float
    seconds: float
    plan_s: float
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON-ready values; a number that is not finite becomes None."""
        numbers = {
            n: None if isinstance(v, float) and not np.isfinite(v) else v
            for n, v in self.__dict__.items()
        }
        return numbers | {"ended": self.ended.to_json(), "friction": self.friction.to_json()}
