"""The hand rule: a number per candidate that adds up over the toes, from friction and reach on the nominal motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array, check_numbers
from .numbers import LeapNumbers
from .scp import FRICTION_SHARE


@dataclass(frozen=True, kw_only=True)
class Rule:
    """The four constants of the hand rule, chosen on training scenes by ``benchmarks/leap_rule.py``.

    grip, room: weights of the friction that is left over and of the reach; grip_cap, room_cap [m]: more than this of
    either is worth nothing.
    """

    grip: float = 3.0
    grip_cap: float = 0.3
    room: float = 14.0
    room_cap: float = -0.06

    def __post_init__(self) -> None:
        check_numbers(self, least=("grip", "room"), finite=("grip_cap", "room_cap"))

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there is none."""
        scaled, layout, nominal = numbers.scaled, numbers.layout, numbers.nominal
        contacts = layout.contacts[2]
        pushes = np.zeros((layout.footholds, 3))
        np.add.at(pushes, contacts, nominal.forces)
        along = (pushes / np.linalg.norm(pushes, axis=1, keepdims=True))[layout.candidate_footholds]
        own = np.matmul(along[:, None], scaled.frames)[:, 0]
        grip = FRICTION_SHARE * scaled.friction * own[:, 0] - np.hypot(own[:, 1], own[:, 2])
        room = self._room(numbers)
        score = self.grip * np.minimum(grip, self.grip_cap) + self.room * np.minimum(room, self.room_cap)
        return scaled.by_candidate(score, -np.inf)

    def _room(self, numbers: LeapNumbers) -> Array:
        """The least of what is left of reach and height where the limb stands, at a patch's middle, shape (K,) [m]."""
        scaled, layout = numbers.scaled, numbers.layout
        frame, limb, foothold = layout.standing
        middles = np.array([piece.mean(axis=0) for piece in scaled.pieces])
        com = numbers.nominal.com[frame]
        room = np.full(len(middles), np.inf)
        height = numbers.leap.limits.height_m
        for j in range(layout.footholds):
            mine = np.flatnonzero(foothold == j)
            own = np.flatnonzero(layout.candidate_footholds == j)
            away = middles[own][:, None] - com[mine]
            left = scaled.reach[limb[mine]] - np.linalg.norm(away - scaled.shoulders[limb[mine]], axis=2)
            left = np.minimum(left, -height - away[:, :, 2])
            if layout.reach_rows:
                half = np.flatnonzero(layout.row_limbs == limb[mine[0]])
                inside = scaled.half_spaces.bounds[half] - away @ scaled.half_spaces.normals[half].T
                left = np.minimum(left, inside.min(axis=2))
            room[own] = left.min(axis=1)
        return room
