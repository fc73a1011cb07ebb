"""The multipliers of a certificate's leaves by group, in the order in which a row has them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..files.arrays import Array
from .half_spaces import half_space_pulls
from .stances import Schedule


@dataclass(frozen=True, kw_only=True, eq=False)
class Multipliers:
    """The multipliers of L leaves by group, in the order in which a row has them."""

    nu_F: Array  # (L, S, 3)
    nu_M: Array  # (L, S, 3)
    reach: Array  # (L, M, N, 3)
    com_step: Array  # (L, M − 1, 3)
    rotation_step: Array  # (L, M − 1, 3)
    progress: Array  # (L, M − 1)
    toe_step: Array  # (L, moves, 3)
    reach_rows: Array  # (L, M, H)
    relative_reach: Array  # (L, rows of ``relative_rows``)
    linear_step: Array  # (L, M − 1, rows of ``StepLimits.linear_rows``)

    @classmethod
    def of(cls, who: Schedule, rows: Array) -> Multipliers:
        """Rows of a certificate, shape (L, count), by group."""
        parts, begin = {}, 0
        for name, shape in multiplier_shapes(who).items():
            end = begin + math.prod(shape)
            parts[name] = rows[:, begin:end].reshape(len(rows), *shape)
            begin = end
        return cls(**parts)

    def gripped(self, who: Schedule, normals: Array) -> Array | None:
        """Part of r that half-spaces of reach add, shape (L, M, N, 3), or None.

        Arguments:
            normals: of each leaf's, (L, H, 3).
        """
        return half_space_pulls(who.row_limb, normals, self.reach_rows, self.reach.shape[2])


def multiplier_shapes(who: Schedule) -> dict[str, tuple[int, ...]]:
    """Shape of every group of a leaf's multipliers."""
    (frames, limbs), stances = who.holds.shape, len(who.frame)
    return {
        "nu_F": (stances, 3),
        "nu_M": (stances, 3),
        "reach": (frames, limbs, 3),
        "com_step": (frames - 1, 3),
        "rotation_step": (frames - 1, 3),
        "progress": (frames - 1,),
        "toe_step": (len(who.moves), 3),
        "reach_rows": (frames, len(who.row_limb)),
        "relative_reach": (len(who.apart),),
        "linear_step": (frames - 1, who.linear),
    }


def multiplier_count(who: Schedule) -> int:
    """Number of multipliers per leaf."""
    return sum(math.prod(shape) for shape in multiplier_shapes(who).values())
