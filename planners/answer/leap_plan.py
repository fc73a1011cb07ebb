"""A plan of a leap: which patches, where the toes are, and what every limb pushes with in every
interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.validation import shown
from ..problem.leap import Leap

NUMBERS = ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad", "toes_m", "forces_n")
LATER = ("legs_turn_rad", "gather")
"""The numbers that a plan may be without."""
LEAST_GATHER, MOST_GATHER = np.array([0.05, 0.1]), np.array([0.49, 1.0])
"""Least and largest share of a flight after which legs are drawn up, and of a fold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapPlan:
    """One answer to a leap, in the world frame and SI units.

    Nothing is checked here: ``check_leap`` does it.

    Arguments:
        problem: the leap that was answered.
        timing: which of its timings.
        choice: a candidate per foothold, shape (P,).
        toes_m: shape (P, 3) [m].
        forces_n: of every limb in every interval, in which they are constant, shape (M, N, 3) [N].
        com_m, velocity_m_s, momentum_m2_s, rotation_rad: c, v, L per mass and Θ at the ends of the
            intervals, which follow from the forces; shape (M + 1, 3) each.
        legs_turn_rad: by how much legs that swing turn the body in every interval, beside L, as far
            as that is known, shape (M, 3) [rad]; None where legs are taken to weigh nothing, as
            those of a robot that has limbs alone are.
        gather: how legs are drawn up in flight, shape (2,): after which share of it, 0.05 to 0.49,
            and how long they are then as a share of the shorter of their lengths at both ends, 0.1
            to 1; None for (0.3, 0.8).
        provenance: what made it, names to texts or numbers.

    Source:
        Newton and Euler for one rigid body; docs/concepts/leaps.md.

    Example:
        >>> import numpy as np, stancekit
        >>> from stancekit.planners.problem.leap_json import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
        >>> from stancekit.planners.motion.feet_motion import feet_motion
        >>> feet_motion(stancekit.plan(leap).solution).at(np.array([0.0, 0.5])).com_m.shape
        (2, 3)
    """

    problem: Leap
    timing: int
    choice: NDArray[np.int_]
    com_m: Array
    velocity_m_s: Array
    momentum_m2_s: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array
    legs_turn_rad: Array | None = None
    gather: Array | None = None
    provenance: Mapping[str, str | float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in (*NUMBERS, "choice", *LATER):
            if name in LATER and getattr(self, name) is None:
                continue
            try:
                kind = np.int_ if name == "choice" else np.float64
                array: NDArray[Any] = np.array(getattr(self, name), dtype=kind)
            except (TypeError, ValueError, OverflowError):
                came = shown(getattr(self, name))
                raise InvalidInput(f"{name}: expected an array of numbers, got {came}") from None
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        count, legs = len(self.forces_n), ", ".join(self.problem.robot.limb_names)
        return f"LeapPlan({self.problem.name}: {count} intervals of {legs})"

    @property
    def later(self) -> dict[str, Array]:
        """The numbers of ``LATER`` that there are, by name."""
        known = {name: getattr(self, name) for name in LATER}
        return {name: value for name, value in known.items() if value is not None}

    @property
    def turned_rad(self) -> Array:
        """``legs_turn_rad``, 0 where it is not known, shape (M, 3) [rad]."""
        return (
            np.zeros((len(self.forces_n), 3)) if self.legs_turn_rad is None else self.legs_turn_rad
        )

    @property
    def times_s(self) -> Array:
        """Times at which the M intervals begin and end, shape (M + 1,) [s]."""
        return self.problem.times_s(self.timing)
