"""Links clear of each other and of the ground, about postures that are known, in metres.

How deep a link is in something is a function of where the feet of the legs involved are in the
torso's frame, and of the torso's pose where that is the ground: each row is its tangent about the
posture of the last solve.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np
from scipy.sparse import csr_array

from ...files.arrays import Array
from ..charts.warped import Chart
from ..transcription.blocks import Block, Constraint, Kernel, Rows, VariableGroup
from ..transcription.taylor import ExpansionPoint
from ..variables import Structure


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps:
    """T pairs of things that are inside each other, each at a node of the program.

    Arguments:
        node: shape (T,).
        feet: the two that it depends on, shape (T, 2), twice the same where it is one.
        depth_m: shape (T,).
        feet_m: r₀ of both in the torso's frame, shape (T, 2, 3) [m].
        by_foot: the depth's derivatives, (T, 2, 3), the second 0 where it is one foot.
        torso_m, rotation: p₀ and R₀, (T, 3) [m], (T, 3, 3).
        by_torso: derivatives in p and in a turn about the torso's axes, shape (T, 6) [1, m/rad].
    """

    node: Rows
    feet: Rows
    depth_m: Array
    feet_m: Array
    by_foot: Array
    torso_m: Array
    rotation: Array
    by_torso: Array

    def __len__(self) -> int:
        """T."""
        return len(self.node)

    def joined(self, other: Overlaps) -> Overlaps:
        """Both: what came apart stays so while others do."""
        return Overlaps(
            **{
                name: np.concatenate([getattr(self, name), getattr(other, name)])
                for name in self.__annotations__
            }
        )


def apart(structure: Structure, overlaps: Overlaps, room_m: float) -> Constraint | None:
    """−depth ≥ room_m [m] of these pairs; None where there is none."""
    numbers = np.concatenate(
        [overlaps.depth_m[:, None]]
        + [
            getattr(overlaps, name).reshape(len(overlaps), -1)
            for name in ("by_foot", "feet_m", "by_torso", "torso_m", "rotation")
        ],
        axis=1,
    )
    blocks, count, no_variables = list[Block](), 0, csr_array((0, structure.layout.size))
    for one in structure.feet_at_nodes:
        first, rows = one.find(overlaps.feet[:, 0], overlaps.node)
        for other in structure.feet_at_nodes:
            second, columns = other.find(overlaps.feet[rows, 1], overlaps.node[rows])
            if not len(columns):
                continue
            known = VariableGroup(
                "overlaps", no_variables, 0, None, _constants, numbers[rows[columns]]
            )
            selections = (
                one.selection(first[columns]),
                other.selection(second),
                structure.torso_at(overlaps.node[rows[columns]]),
                (known, np.arange(len(columns))),
            )
            blocks.append(
                Block(gap(structure.chart), selections, count + np.arange(len(columns))[:, None])
            )
            count += len(columns)
    return (
        Constraint("bodies", np.full(count, room_m), np.full(count, np.inf), tuple(blocks))
        if count
        else None
    )


def gap(chart: Chart) -> Kernel:
    """−depth of two feet, a torso, and the numbers of ``Overlaps``."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (*feet, torso, known), (*at_feet, at_torso, _) = features, expansions
        depth, by_foot, feet_m, by_torso, torso_m, rotation = cs.vertsplit(
            known, [0, 1, 7, 13, 19, 22, 31]
        )
        p, r = chart.torso(torso, at_torso)
        value = depth + cs.dot(by_torso[:3], p - torso_m)
        turn = cs.reshape(rotation, 3, 3) @ r  # row by row, so that it is R₀ᵀ R
        value += 0.5 * cs.dot(
            by_torso[3:],
            cs.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]),
        )
        for k, (foot, at_foot) in enumerate(zip(feet, at_feet, strict=True)):
            of = slice(3 * k, 3 * k + 3)
            value += cs.dot(by_foot[of], r.T @ (chart.foot(foot[:3], at_foot) - p) - feet_m[of])
        return -value

    return kernel


def _constants(v: cs.SX, constants: cs.SX) -> cs.SX:
    return constants
