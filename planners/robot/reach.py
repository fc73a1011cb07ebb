"""A limb's workspace as half-spaces, beside the ball about its shoulder: the polytopes of kinematic
planners.

Rows a·R(Θ)ᵀ(p − c) ≤ b, p the toe, c the centre of mass, R(Θ) = I + [Θ]× as in E11, so that they
are (a + Θ × a)·d ≤ b with d = p − c, bilinear in Θ and d. Convex sets stand in for them, exact
where the tilt limit is 0 (s the shoulder, ρ the ball's radius, z any point, and t(x) the largest ‖Θ
× x‖ within the tilt limit):

* inner, for plans:              a·d + Θ·(a × z) + t(a) ‖a × (d − z)‖ ≤ b;
* outer, for bounds and proofs:  a·d + Θ·(a × s) ≤ b + t(a) (ρ + t(s)).

The inner one leaves out Θ·(a × (d − z)), at most t(a) ‖a × (d − z)‖: z is in the middle of the
half-spaces. The outer one leaves out Θ·(a × (d − s)), and ‖d − s‖ ≤ ρ + t(s) by the ball.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from ..terrain.frame import Frame

MOST_ROWS = 256
ROOM_M = 1e-9
"""A place so far inside of all half-spaces shows that they leave room, without a linear program
[m]."""
_CORNERS = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [1.0, -1.0, -1.0]])
"""Corners of the box |Θ_i| ≤ 1, one of each opposite pair."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReachRows:
    """Half-spaces normals · (p − c) ≤ bounds_m in the body frame, where the body is not turned.

    Arguments:
        normals: outward normals, shape (K, 3), of any length but 0; they are made unit, and
            bounds_m with them. The set may be unbounded, since the ball about the shoulder holds,
            too, and need not hold the origin.
        bounds_m: shape (K,) [m].

    Raises:
        InvalidInput: for a normal of no length, and for rows that leave no room.
    """

    normals: Array
    bounds_m: Array

    def __post_init__(self) -> None:
        normals = read_only(self.normals, (None, 3), "normals")
        bounds = read_only(self.bounds_m, (len(normals),), "bounds_m")
        if not 1 <= len(normals) <= MOST_ROWS:
            raise InvalidInput(
                f"normals: expected 1 to {MOST_ROWS} half-spaces, got {len(normals)}"
            )
        length = np.linalg.norm(normals, axis=1)
        if length.min() < 1e-9:
            raise InvalidInput(
                f"normals[{int(length.argmin())}]: expected a non-zero vector, got none"
            )
        scaled = (
            np.abs(length - 1.0) > 1e-12
        )  # rows that are unit stay as they are, to the last bit
        normals = np.where(scaled[:, None], normals / length[:, None], normals)
        bounds = np.where(scaled, bounds / length, bounds)
        object.__setattr__(self, "normals", read_only(normals, (None, 3), "normals"))
        object.__setattr__(self, "bounds_m", read_only(bounds, (len(normals),), "bounds_m"))
        middle = np.linalg.lstsq(normals, bounds, rcond=None)[0]
        if (bounds - normals @ middle).min() < ROOM_M:
            _ = self.centre_m  # is there any place?

    def turned(self, frame: Frame) -> ReachRows:
        """The half-spaces of a body that is turned like this."""
        return ReachRows(normals=frame.vectors(self.normals), bounds_m=self.bounds_m)

    @cached_property
    def centre_m(self) -> Array:
        """Centre of a largest ball inside, up to 1 m wide, shape (3,) [m].

        Raises InvalidInput where there is none.
        """
        return np.array(_centre(self.normals.tobytes(), self.bounds_m.tobytes()))


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeReach:
    """Set of places of one foot relative to another: normals · (p_other − p_limb) ≤ bounds_m, the
    toes in the world's axes.

    It holds where ``limb`` has just been put down, for the other where it then stands; of a stance
    that is given it says nothing. Raises InvalidInput for one limb twice. Source: Tonneau et al.,
    "SL1M: Sparse L1-norm Minimization for contact planning on uneven terrain" (2020), §IV.
    """

    limb: str
    other: str
    rows: ReachRows

    def __post_init__(self) -> None:
        if self.limb == self.other:
            raise InvalidInput(f"relative_reach: expected two limbs, got {self.limb} twice")


@lru_cache(maxsize=256)
def _centre(normals: bytes, bounds: bytes) -> tuple[float, ...]:
    """``ReachRows.centre_m``, remembered: the rows of a data set's problems are those of one robot
    again and again.
    """
    from scipy.optimize import linprog  # slow to import

    rows, free = np.frombuffer(normals).reshape(-1, 3), (None, None)
    rows = np.column_stack([rows, np.ones(len(rows))])
    right, bounds_m = np.frombuffer(bounds), [free, free, free, (None, 0.5)]
    result = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=right, bounds=bounds_m)
    if result.x is None or result.x[3] <= 0.0:
        raise InvalidInput(
            "bounds_m: expected half-spaces that leave room for a toe, got an empty set"
        )
    return tuple(result.x[:3].tolist())


def turned_most(vectors: Array, tilt_rad: float) -> Array:
    """Largest ‖Θ × x‖ of vectors of shape (..., 3) over |Θ_i| ≤ tilt; convex, so at a corner.

    Shape (...).
    """
    return np.asarray(
        tilt_rad * np.linalg.norm(np.cross(_CORNERS, vectors[..., None, :]), axis=-1).max(axis=-1)
    )
