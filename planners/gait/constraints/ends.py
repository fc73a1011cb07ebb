"""Start and goal: at rest at the start (y₋₁ = y₋₂ = y₀), with the torso over the given point and
heading; over the goal at the end, with the heading asked for there, if one is (Pan et al. §V: "the
target position is added as a hard constraint on the X-Y plane").
"""

from __future__ import annotations

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ...files.arrays import Array
from ..charts.warped import Chart
from ..transcription.blocks import Block, Constraint, Kernel
from ..transcription.taylor import ExpansionPoint
from ..variables import NOTHING, Index, Structure


def still_start(structure: Structure) -> Constraint:
    """The first three coefficients of the torso's spline are equal: velocity and acceleration are 0
    at the start.
    """
    return _still(structure, "still start", structure.layout.torso[:3])


def still_end(structure: Structure) -> Constraint | None:
    """The last three coefficients of the torso's spline are equal: velocity and acceleration are 0
    at the end. None where the settings do not ask for an end at rest.
    """
    return (
        _still(structure, "still end", structure.layout.torso[-3:])
        if structure.settings.still_end
        else None
    )


def start(structure: Structure) -> tuple[Constraint, Constraint]:
    """p_xy = start (metres) and heading = start yaw (radians) at t = 0."""
    yaw = structure.layout.entry_rows(structure.layout.torso[0, 5:])
    heading = np.array([structure.task.start_yaw_rad])
    return over(structure, "start", 0, structure.task.start_xy_m), Constraint(
        "heading", heading, heading, (), yaw
    )


def goal(structure: Structure) -> Constraint:
    """p_xy = goal at t = T, in metres: a hard constraint (Pan et al. §V)."""
    return over(structure, "goal", structure.nodes - 1, structure.task.goal_xy_m)


def heading_end(structure: Structure) -> Constraint | None:
    """heading = end yaw (radians) at t = T, where the task asks for one."""
    if structure.task.end_yaw_rad is None:
        return None
    heading = np.array([structure.task.end_yaw_rad])
    yaw = csr_array(structure.layout.torso_rows(structure.times_s[-1:])[[5]])
    return Constraint("heading end", heading, heading, (), yaw)


def poised(structure: Structure) -> Constraint | None:
    """Height, roll and pitch of the torso and every foot at t = 0 and t = T are those of the
    standing robot, where the settings ask for it. Where rows of other terms say so already, they
    are left out.
    """
    if not structure.settings.poised:
        return None
    task, layout, chart = structure.task, structure.layout, structure.chart
    rows, values = list[csr_array](), list[Array]()
    for xy, yaw, knot, stance in zip(
        (task.start_xy_m, task.goal_xy_m),
        task.yaws(),
        (layout.torso[0], layout.torso[-1]),
        (0, -1),
        strict=True,
    ):
        feet = task.stance_m(xy, yaw)
        torso = np.array([[*xy, feet[:, 2].mean() + task.robot.stand_height_m]])
        rows.append(layout.entry_rows(knot[2:5]))
        values.append(np.array([chart.torso_bar(torso)[0, 2], 0.0, 0.0]))
        for foot, place in zip(layout.feet, feet, strict=True):
            entries = foot.stances[stance]
            known = entries != NOTHING
            rows.append(layout.entry_rows(entries[known]))
            values.append(chart.foot_bar(place[None])[0][known])
    target = np.concatenate(values)
    return Constraint("poised", target, target, (), csr_array(vstack(rows)))


def over(structure: Structure, name: str, node: int, xy_m: Array) -> Constraint:
    """The torso over a point at a node."""
    block = Block(
        horizontal(structure.chart), (structure.torso_at(np.array([node])),), np.array([[0, 1]])
    )
    return Constraint(name, xy_m, xy_m, (block,))


def horizontal(chart: Chart) -> Kernel:
    """p_xy of the torso."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        return chart.torso(features[0], expansions[0])[0][:2]

    return kernel


def _still(structure: Structure, name: str, coefficients: Index) -> Constraint:
    rows = [
        structure.layout.entry_rows(coefficients[k]) - structure.layout.entry_rows(coefficients[1])
        for k in (0, 2)
    ]
    zeros = np.zeros(12)
    return Constraint(name, zeros, zeros, (), csr_array(vstack(rows)))
