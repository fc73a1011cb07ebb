"""A decision vector as a motion: torso, feet, forces and contacts at any times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...answer.trajectory import Trajectory
from ...files.arrays import Array
from ..charts.warped import Pushforward
from .structure import Structure


def sampled(
    structure: Structure, x: Array, times_s: Array, height_factor: float = 1.0
) -> Trajectory:
    """Evaluate a decision vector at times, shape (K,) [s]: a trajectory of the task, on its terrain
    with heights by this factor.
    """
    layout, push = structure.layout.timed(x), Pushforward(structure.chart, height_factor)
    torso_m, rotation = push.torso((layout.torso_rows(times_s) @ x).reshape(-1, 6))
    feet: list[Array] = []
    forces: list[Array] = []
    contact: list[NDArray[np.bool_]] = []
    for foot, entries in enumerate(layout.feet):
        place = (layout.foot_rows(foot, times_s) @ x).reshape(-1, 3)
        force = (layout.force_rows(foot, times_s) @ x).reshape(-1, 3)
        p_i, f_i = push.foot(place, force)
        feet, forces = [*feet, p_i], [*forces, f_i * structure.task.robot.weight_n]
        contact.append(entries.phases.stands(times_s))
    task = structure.task
    return Trajectory(
        times_s=times_s,
        torso_m=torso_m,
        rotation=rotation,
        feet_m=np.stack(feet, axis=1),
        forces_n=np.stack(forces, axis=1),
        contact=np.stack(contact, axis=1),
        robot=task.robot,
        terrain=task.terrain if height_factor == 1.0 else task.terrain.scaled(height_factor),
        friction=task.friction,
        adhesive=np.array(task.adhesive),
        start_xy_m=task.start_xy_m,
        goal_xy_m=task.goal_xy_m,
        heading_rad=task.start_yaw_rad,
        heading_end_rad=task.end_yaw_rad,
        suction_n=task.suction_n,
    )
