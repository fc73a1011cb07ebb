"""Joint torques within limits, about postures that are known: τ_j = rest_j − J_j(r)ᵀ Rᵀ f, r = Rᵀ
(p_i − p).

What a joint gives depends on where its foot is in the torso's frame and on the force there. J_j is
the foot's derivative in joint j, along a line about the posture of the last solve, J_j(r₀) + ∂J_j
(r − r₀), so that a row is wrong to the second order of what the leg moves alone, and right for
whatever the force does; rest_j, what the leg's own weight and motion take, stays what it was.
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
class LegLoads:
    """T joints of standing legs, each at a node of the program.

    Arguments:
        foot, node: shape (T,).
        at_m: r₀, the foot in the torso's frame, shape (T, 3) [m].
        levers_m: J_j(r₀), (T, 3) [m or m/rad].
        slopes: ∂J_j, (T, 3, 3).
        rest_nm: shape (T,).
        most_nm: what the joint may give, shape (T,) [Nm].
    """

    foot: Rows
    node: Rows
    at_m: Array
    levers_m: Array
    slopes: Array
    rest_nm: Array
    most_nm: Array

    def __len__(self) -> int:
        """T."""
        return len(self.foot)


def torque(structure: Structure, loads: LegLoads) -> Constraint | None:
    """−1 ≤ τ_j / most_j ≤ 1 of these joints; None where there is none."""
    blocks, count = list[Block](), 0
    weight = structure.task.robot.weight_n
    numbers = (
        np.concatenate(
            [loads.rest_nm[:, None], weight * loads.levers_m, weight * loads.slopes.reshape(-1, 9)],
            axis=1,
        )
        / loads.most_nm[:, None]
    )
    numbers = np.concatenate([numbers, loads.at_m], axis=1)
    no_variables = csr_array((0, structure.layout.size))
    for group in structure.feet_at_nodes:
        chosen, rows = group.find(loads.foot, loads.node)
        if not (group.pushes and len(rows)):
            continue
        known = VariableGroup("leg loads", no_variables, 0, None, _constants, numbers[rows])
        selections = (
            group.selection(chosen),
            structure.torso_at(group.node[chosen]),
            (known, np.arange(len(rows))),
        )
        scatter = count + np.arange(len(rows))[:, None]
        blocks.append(Block(given(structure.chart), selections, scatter))
        count += len(rows)
    return Constraint("torque", -np.ones(count), np.ones(count), tuple(blocks)) if count else None


def given(chart: Chart) -> Kernel:
    """τ_j / most_j of a foot, a torso, and (rest, J, ∂J, r₀), the first three by most_j."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot, torso, known), (at_foot, at_torso, _) = features, expansions
        p, r = chart.torso(torso, at_torso)
        moved = r.T @ (chart.foot(foot[:3], at_foot) - p) - known[13:]
        lever = known[1:4] + cs.reshape(known[4:13], 3, 3).T @ moved
        return known[0] - cs.dot(lever, r.T @ chart.force(foot[3:], foot[:3], at_foot))

    return kernel


def _constants(v: cs.SX, constants: cs.SX) -> cs.SX:
    return constants
