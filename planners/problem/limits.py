"""Limits on the steps of a course, and weights of its objective."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import LATER, Within, check_limits

LINEAR: Mapping[str, tuple[str, str, tuple[tuple[float, ...], ...]]] = MappingProxyType(
    {
        "yaw_rad": (
            "yaw_step",
            "rad",
            ((0.0, 0.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0, 0.0, -1.0)),
        )
    }
)
"""Further limits of a step of the body, by the field of ``StepLimits`` that has the limit, None
where there is none: a name for reports, the unit, and slopes a of (c′ − c, Θ′ − Θ), each of six
numbers, with a·step ≤ limit. Planners, their reference, the verifier, proofs and explanations read
them here."""


NotNegative = Annotated[float, Within(least=0.0)]


@dataclass(frozen=True, kw_only=True)
class StepLimits:
    """Largest and least steps between neighbouring key frames (E11), and the least progress.

    Arguments:
        com_m, toe_m, rotation_rad: Δp_max of the COM and of a toe, ΔΘ_max.
        progress_m: the paper's least step is not convex; in its place the COM moves at least this
            far along the straight line of its nominal path, where that moves.
        yaw_rad: largest turn about the vertical, |Θ_z' − Θ_z|; None for no such limit.
        least_toe_m: Δp_min of a toe that is put down anew; 0 for none. A toe that stays takes no
            step. Not convex: planners branch over directions (``problem.sides``).
        least_rotation_rad: ΔΘ_min, likewise.
    """

    com_m: Annotated[float, Within(above=0.0)] = 0.15
    toe_m: Annotated[float, Within(above=0.0)] = 0.30
    rotation_rad: NotNegative = 0.15
    progress_m: NotNegative = 0.0
    yaw_rad: NotNegative | None = field(default=None, metadata=LATER)
    least_toe_m: NotNegative = field(default=0.0, metadata=LATER)
    least_rotation_rad: NotNegative = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        check_limits(self)
        for least, most in (
            ("progress_m", "com_m"),
            ("least_toe_m", "toe_m"),
            ("least_rotation_rad", "rotation_rad"),
        ):
            came, limit = getattr(self, least), getattr(self, most)
            if came > limit:
                raise InvalidInput(
                    f"{least}: expected at most steps.{most} = {limit:g}, the largest step, got "
                    f"{came:g}"
                )

    @property
    def linear(self) -> dict[str, float]:
        """The limits of ``LINEAR`` that there are, by field."""
        return {name: getattr(self, name) for name in LINEAR if getattr(self, name) is not None}

    def linear_rows(self, length_m: float) -> Array:
        """The rows (a, limit) of these limits, lengths in units of ``length_m``, shape (R, 7)."""
        rows = list[Array]()
        for name, limit in self.linear.items():
            _, unit, slopes = LINEAR[name]
            one = length_m if unit == "m" else 1.0
            scales = np.array([length_m] * 3 + [1.0] * 3) / one
            rows += [np.append(np.array(slope) * scales, limit / one) for slope in slopes]
        return np.array(rows).reshape(-1, 7)


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the objective: squared distance of the last COM from the goal, of every COM from
    the nominal path, squared steps, squared tilt, squared distance of every toe from where it is as
    the robot stands; lengths in m.

    The paper: "minimizes the distance of the planned final configuration to the goal and penalizes
    the step size".
    """

    goal: NotNegative = 1.0
    com_path: NotNegative = field(default=0.0, metadata=LATER)
    com_step: NotNegative = 0.2
    toe_step: NotNegative = 0.05
    tilt: NotNegative = 0.05
    stance: NotNegative = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        check_limits(self)
