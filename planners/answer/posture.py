"""A posture: what the planners of a posture problem answer, in the world frame and SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..files.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Posture:
    """One answer to a posture problem, in the world frame and SI units. Nothing is checked here: ``verify`` does it.

    Arguments:
        com_m: centre of mass c, shape (3,) [m].
        rotation_rad: small body rotation Θ, shape (3,) [rad].
        toes_m: a toe a contact, shape (N, 3) [m].
        forces_n: contact forces on the robot, shape (N, 3) [N].
        points_m, point_forces_n: where feet are soles, whose centres are the toes: where the points of every foot are,
            and the forces at them, which add up to forces_n, shape (N, K, 3) each [m], [N]. K is that of the foot of
            most points; one with fewer has its centre, and no force, in the places left.
    Source:
        Paper E §II.
    Example:
        >>> import numpy as np, stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> nothing = np.zeros((3, 3))
        >>> floating = stancekit.Posture(com_m=np.zeros(3), rotation_rad=np.zeros(3), toes_m=nothing, forces_n=nothing)
        >>> stancekit.verify(problem, floating).accepted
        False
    """

    com_m: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array
    points_m: Array | None = None
    point_forces_n: Array | None = None

    def __post_init__(self) -> None:
        for name in self._names:
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def to_json(self) -> dict[str, Any]:
        """Return the posture as JSON-ready lists."""
        return {name: getattr(self, name).tolist() for name in self._names}

    @property
    def _names(self) -> tuple[str, ...]:
        """The arrays that there are."""
        soles = [name for name in ("points_m", "point_forces_n") if getattr(self, name) is not None]
        return ("com_m", "rotation_rad", "toes_m", "forces_n", *soles)
