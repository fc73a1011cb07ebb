"""A plan of a leap: which patches, where the toes are, and what every limb pushes with in every interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.validation import shown
from ..physics import GRAVITY_M_S2
from ..problem.leap import Leap

NUMBERS = ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad", "toes_m", "forces_n")


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapPlan:
    """One answer to a leap, in the world frame and SI units. Nothing is checked here: ``check_leap`` does it.

    Arguments:
        leap: that was answered.
        timing: which of its timings.
        choice: a candidate per foothold, shape (P,).
        toes_m: shape (P, 3) [m].
        forces_n: of every limb in every interval, in which they are constant, shape (M, N, 3) [N].
        com_m, velocity_m_s, momentum_m2_s, rotation_rad: c, v, L per mass and Θ at the ends of the intervals, which
            follow from the forces; shape (M + 1, 3) each.
        provenance: what made it, names to texts or numbers.
    Source:
        Newton and Euler for one rigid body; docs/concepts/leaps.md.
    Example:
        >>> import numpy as np, stancekit
        >>> from stancekit.planners.problem.leap_json import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
        >>> stancekit.plan(leap).plan.at(np.array([0.0, 0.5]))["com_m"].shape
        (2, 3)
    """

    leap: Leap
    timing: int
    choice: NDArray[np.int_]
    com_m: Array
    velocity_m_s: Array
    momentum_m2_s: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array
    provenance: Mapping[str, str | float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in (*NUMBERS, "choice"):
            try:
                kind = np.int_ if name == "choice" else np.float64
                array: NDArray[Any] = np.array(getattr(self, name), dtype=kind)
            except (TypeError, ValueError, OverflowError):
                came = shown(getattr(self, name))
                raise InvalidInput(f"{name}: expected an array of numbers, got {came}") from None
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def times_s(self) -> Array:
        """Ends of the intervals, shape (M + 1,) [s]."""
        return self.leap.times_s(self.timing)

    def at(self, times_s: Array) -> dict[str, Array]:
        """Body, toes and forces at some times: com_m, velocity_m_s, rotation_rad (K, 3), forces_n (K, N, 3), toes_m.

        times_s: shape (K,), within the leap [s]. toes_m, shape (K, N, 3), are NaN where a limb is lifted. c and v are
        exact; Θ lies between its ends as of a cubic.
        """
        ends, when = self.times_s, np.asarray(times_s, dtype=np.float64)
        k = np.clip(np.searchsorted(ends, when, side="right") - 1, 0, len(ends) - 2)
        t, last = (when - ends[k])[:, None], (ends[k + 1] - ends[k])[:, None]
        fall = np.array([0.0, 0.0, -GRAVITY_M_S2])
        push = self.forces_n[k].sum(axis=1) / self.leap.robot.mass_kg + fall
        inertia = self.leap.robot.inertia
        assert inertia is not None
        rates = self.momentum_m2_s @ np.linalg.inv(inertia / self.leap.robot.mass_kg).T
        s = t / last
        first, second = self.rotation_rad[k], self.rotation_rad[k + 1]
        rotation = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * second
        rotation += last * ((s**3 - 2 * s**2 + s) * rates[k] + (s**3 - s**2) * rates[k + 1])
        holds = self.leap.holds[self.leap.interval_phases[k]]
        toes = np.where(holds[..., None] >= 0, self.toes_m[np.maximum(holds, 0)], np.nan)
        return {
            "com_m": self.com_m[k] + t * self.velocity_m_s[k] + 0.5 * t**2 * push,
            "velocity_m_s": self.velocity_m_s[k] + t * push,
            "rotation_rad": rotation,
            "toes_m": toes,
            "forces_n": self.forces_n[k],
        }
