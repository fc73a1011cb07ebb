"""Features of posture problems of one class: numbers per contact and per corner of its patch, in the
body's axes, the same for scenes that a symmetry of the robot maps onto each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import PostureBatch, Problem

TOKEN = 19
"""Numbers per contact: the patch's middle, also from the shoulder, its normal, shoulder, reach,
friction, the vertical force per unit normal force, and the room in reach of the middle and of the
nearest corner."""
CORNER = 7
"""Numbers per corner: from the patch's middle, from the shoulder, and the room in reach."""
_TURNS = 12
"""Symmetries are looked for among the turns by a twelfth about the vertical, and their mirrors."""
_SAME = 1e-6
_GENERIC = np.array([0.83, 0.56, 0.0])
"""Of all symmetric copies of a scene the one that leans farthest this way stands for all."""


class Features(NamedTuple):
    """Features of a batch of problems, in single precision.

    Arguments:
        tokens: shape (B, N, ``TOKEN``).
        corners: shape (B, N, U, ``CORNER``).
    """

    tokens: NDArray[np.float32]
    corners: NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Seer:
    """Numbers that all problems of a class share, and the features of any.

    Arguments:
        scaled: a problem of the class.
        half_spaces: of reach, normals (K, 3) and bounds (K,) per limb.
        turns: its symmetries, shape (G, 3, 3), the identity first.
    """

    scaled: Scaled
    half_spaces: tuple[tuple[Array, Array], ...]
    turns: Array

    @classmethod
    def of(cls, problem: Problem) -> Seer:
        """The features of problems that differ from this one in their patches alone."""
        scaled, rows = Scaled.of(problem), tuple(half_spaces(problem))
        return cls(scaled=scaled, half_spaces=rows, turns=symmetries(scaled, rows))

    def features(self, batch: PostureBatch) -> Features:
        """Features of these problems, which are of the class."""
        one = self.scaled
        com = one.com[0]
        vertices, normals = batch.vertices_m / one.length_m - com, batch.normals
        shoulders = np.broadcast_to(one.shoulders, normals.shape)
        middle = vertices.mean(axis=2)
        room = self._room(vertices)
        if len(self.turns) > 1:
            lean = (middle * (1.0 + batch.friction[..., None])).sum(axis=1)
            turn = self.turns[
                (lean @ np.einsum("gij,i->gj", self.turns, _GENERIC).T).argmax(axis=1)
            ]
            back = turn.swapaxes(1, 2)
            vertices = vertices @ back[:, None]
            normals, shoulders, middle = normals @ back, shoulders @ back, middle @ back
        upright = normals[..., 2]
        friction = batch.friction
        vertical = upright + friction * np.sqrt(np.maximum(1.0 - upright**2, 0.0))
        reach = np.broadcast_to(one.reach, friction.shape)
        rooms = [room.mean(axis=2), room.max(axis=2), room.min(axis=2)]
        each = np.stack([reach, friction, friction * upright, vertical, *rooms], axis=-1)
        tokens = np.concatenate([middle, middle - shoulders, normals, shoulders, each], axis=-1)
        corners = np.concatenate(
            [
                vertices - middle[:, :, None],
                vertices - shoulders[:, :, None],
                room[..., None],
            ],
            axis=-1,
        )
        return Features(tokens.astype(np.float32), corners.astype(np.float32))

    def _room(self, vertices: Array) -> Array:
        """Distance of every corner inside its limb's reach, c and Θ nominal, shape (B, N, U)."""
        one = self.scaled
        away = vertices - one.shoulders[:, None]
        room = one.reach[:, None] - np.sqrt(np.vecdot(away, away))
        for limb, (normals, bounds) in enumerate(self.half_spaces):
            if len(bounds):
                inside = bounds - vertices[:, limb] @ normals.T
                room[:, limb] = np.minimum(room[:, limb], inside.min(axis=-1))
        return np.asarray(room)


def half_spaces(problem: Problem) -> list[tuple[Array, Array]]:
    """Normals, shape (R, 3), and bounds, non-dimensional, of where each toe may be; of none where
    its reach is a ball alone.
    """
    none = np.zeros((0, 3)), np.zeros(0)
    rows = [contact.reach_rows for contact in problem.contacts]
    length_m = problem.length_scale_m
    return [none if each is None else (each.normals, each.bounds_m / length_m) for each in rows]


def symmetries(scaled: Scaled, half_spaces: Sequence[tuple[Array, Array]]) -> Array:
    """The turns about the vertical and mirrors that map the limbs of a problem onto each other,
    shape (G, 3, 3), the identity first.

    Gravity, friction cones and reach are the same in the copy. The bounds of a tilt are a box along
    the axes: where there is a tilt, turns by less than a quarter are none.
    """
    rows = []
    for mirror in (1.0, -1.0):
        for k in range(_TURNS):
            if scaled.tilt > 0.0 and k % (_TURNS // 4):
                continue
            angle = 2.0 * np.pi * k / _TURNS
            c, s = np.cos(angle), np.sin(angle)
            turn = np.array([[c, -s * mirror, 0.0], [s, c * mirror, 0.0], [0.0, 0.0, 1.0]])
            if _maps(scaled, half_spaces, turn):
                rows.append(turn)
    return np.array(rows)


def _maps(scaled: Scaled, half_spaces: Sequence[tuple[Array, Array]], turn: Array) -> bool:
    """Tell whether the copy has the same limbs, each with the same reach and forces."""
    turned = scaled.shoulders @ turn.T
    apart = np.abs(turned[:, None] - scaled.shoulders[None]).max(axis=-1)
    twin = apart.argmin(axis=1)
    if apart.min(axis=1).max() > _SAME or len(set(twin.tolist())) < len(twin):
        return False
    same = (scaled.reach, scaled.force_min, scaled.force_max)
    if any(np.abs(values[twin] - values).max() > _SAME for values in same):
        return False
    for limb, other in enumerate(twin.tolist()):
        (mine, bounds), (theirs, others) = half_spaces[limb], half_spaces[other]
        if len(mine) != len(theirs):
            return False
        if len(mine):
            copies = np.column_stack([mine @ turn.T, bounds])
            gaps = np.abs(copies[:, None] - np.column_stack([theirs, others])[None]).max(axis=-1)
            if gaps.min(axis=1).max() > _SAME or gaps.min(axis=0).max() > _SAME:
                return False
    return True
