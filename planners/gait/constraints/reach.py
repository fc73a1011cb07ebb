"""Every foot within its box (W4 and W10): Rᵀ (p_i − p) ∈ R_i at all nodes, in metres."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..charts.warped import Chart
from ..transcription.blocks import Block, Constraint, Kernel, Rows
from ..transcription.taylor import ExpansionPoint
from ..variables import Structure


def reach(structure: Structure) -> Constraint:
    """Rᵀ (p_i − p) ∈ R_i at all nodes [m] (W4, W10), of standing and swinging feet, with a margin
    in hand.
    """
    margin, feet = structure.settings.reach_margin_m, structure.task.robot.feet
    low = np.array([foot.reach_min_m + margin for foot in feet])
    high = np.array([foot.reach_max_m - margin for foot in feet])
    count = 0
    order: list[Rows] = []
    blocks: list[Block] = []
    for group in structure.feet_at_nodes:
        scatter = 3 * (count + np.arange(len(group.foot)))[:, None] + np.arange(3)
        blocks.append(
            Block(
                within(structure.chart),
                (group.selection(), structure.torso_at(group.node)),
                scatter,
            )
        )
        count, order = count + len(group.foot), [*order, group.foot]
    foot = np.concatenate(order)
    return Constraint("reach", low[foot].ravel(), high[foot].ravel(), tuple(blocks))


def within(chart: Chart) -> Kernel:
    """Rᵀ (p_i − p) of a foot, in the torso's frame."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot, torso), (at_foot, at_torso) = features, expansions
        p, r = chart.torso(torso, at_torso)
        return r.T @ (chart.foot(foot[:3], at_foot) - p)

    return kernel
