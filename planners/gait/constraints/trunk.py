"""The trunk clear of the terrain: points of its lower face above h(x, y), in metres.

Pan et al. have no such term; without it a torso dips into the edges of pits and the tops of hills.
Rows are written only where the terrain-following guess comes near the ground, so that level ground
costs nothing: elsewhere the reach boxes hold the trunk up.
"""

from __future__ import annotations

from itertools import product

import casadi as cs
import numpy as np

from ...files.arrays import Array
from ..method.guess import GuessedWalk
from ..transcription.blocks import Block, Constraint, Rows, VariableGroup
from ..transcription.taylor import ExpansionPoint, TaylorMap
from ..variables import Structure

SPACING_M = 0.09
"""Points of the lower face are at most this far apart along the trunk, and twice as far across."""
NEAR_M = 0.15
"""A point that stays higher over the ground than this in the guess, and all about it, gets no
row."""
SINKING = 0.8
"""Share of the height which the guess gains on slopes, where it stands off along the normal, that
walks may give up."""
AROUND_M = 0.2
"""Distance about a point of the guess at which the ground is looked at: a solution moves about as
far."""


def trunk(structure: Structure) -> Constraint | None:
    """Rows of points of the lower face near the ground at nodes, by turns; None where there is
    none, or no clearance is asked for.
    """
    margin = structure.settings.trunk_clearance_m
    if margin is None:
        return None
    points = lower_face(structure.task.robot.trunk_half_m)
    node, point = near(structure, points)
    if not len(node):
        return None
    chart = structure.chart

    def place(feature: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        p, r = chart.torso(feature[:6], expansion)
        return p + r @ feature[6:9]

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        return cs.vertcat(v, constants)

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        corner, below = (
            place(features[0], expansions[0] if len(expansions) > 1 else None),
            expansions[-1],
        )
        assert below is not None
        return corner[2] - below.here[0]

    rows = structure.layout.torso_rows(structure.times_s[node])
    ground = TaylorMap.of_heights(structure.task.terrain)
    variables = VariableGroup(
        "trunk", rows, 6, ground, features, points[point], chart.torso_map, place
    )
    every = np.arange(variables.count)
    block = Block(kernel, ((variables, every),), every[:, None])
    return Constraint(
        "trunk", np.full(variables.count, margin), np.full(variables.count, np.inf), (block,)
    )


def lower_face(half_m: Array) -> Array:
    """Points of the lower face of a box with these half sides, shape (P, 3) [m]."""
    along, across = (
        np.linspace(-side, side, max(2, 1 + int(np.ceil(2.0 * side / spacing))))
        for side, spacing in zip(half_m, (SPACING_M, 2.0 * SPACING_M), strict=False)
    )
    return np.array([(x, y, -half_m[2]) for x, y in product(along, across)])


def near(structure: Structure, points: Array) -> tuple[Rows, Rows]:
    """Nodes and points, each of shape (K,), at which the guess's lower face, and the plane that it
    goes on as within AROUND_M, comes nearer than NEAR_M to the ground, or a little more on slopes;
    of these every other one, as on a chessboard, since neighbours in time and place know nearly the
    same.
    """
    p, rotation = GuessedWalk(structure).torso(structure.times_s)
    face = p[:, None] + np.einsum("kij,nj->kni", rotation, points)
    turns = np.arange(8) * np.pi / 4.0
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    about = AROUND_M * np.concatenate([np.zeros((1, 2)), 0.5 * ring, ring])
    normal = rotation[:, :, 2]
    rise = -(normal[:, :2] @ about.T) / normal[:, 2:]
    above = (
        face[:, :, None, 2]
        + rise[:, None]
        - structure.task.terrain.height(face[:, :, None, :2] + about)
    )
    gap = above.min(axis=2) * normal[:, None, 2]
    row, column = np.divmod(np.arange(len(points)), len(np.unique(points[:, 1])))
    turn = (np.arange(len(p))[:, None] + row + column) % 2 == 0
    sinking = SINKING * structure.task.robot.stand_height_m * (1.0 / normal[:, 2:] - 1.0)
    node, point = np.nonzero((gap < NEAR_M + sinking) & turn)
    return node, point
