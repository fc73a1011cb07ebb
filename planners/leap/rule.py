"""The hand rule: a number per candidate that adds up over the toes, from friction and reach on the
nominal motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..files.arrays import Array, check_numbers
from .features import OF_CANDIDATE, LeapFeatures
from .numbers import LeapNumbers


class Scorer(Protocol):
    """Whatever gives every candidate a score before anything is tried: the hand rule, or a learned
    one.
    """

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there
        is none.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Rule:
    """The four constants of the hand rule, chosen on training scenes by
    ``benchmarks/leap_rule.py``.

    Arguments:
        grip, room: weights of the friction that is left over and of the reach; grip_cap, room_cap
            [m]: more than this of either is worth nothing.
    """

    grip: float = 3.0
    grip_cap: float = 0.3
    room: float = 14.0
    room_cap: float = -0.06

    def __post_init__(self) -> None:
        check_numbers(self, least=("grip", "room"), finite=("grip_cap", "room_cap"))

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there
        is none.
        """
        seen = LeapFeatures.of(numbers)
        grip, room = (
            seen.candidates[:, :, OF_CANDIDATE.index(name)] for name in ("grip", "room_m")
        )
        score = self.grip * np.minimum(grip, self.grip_cap) + self.room * np.minimum(
            room, self.room_cap
        )
        return np.where(seen.mask > 0.0, score, -np.inf)
