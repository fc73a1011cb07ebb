"""A decision vector as a motion: torso, feet, forces and contacts at any times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...files.arrays import Array
from ..charts.pushforward import Pushforward
from .structure import Structure


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitSamples:
    """A motion at K times: torso p_WB (K, 3) [m], R_WB (K, 3, 3), feet p_WF (K, E, 3) [m], contact
    forces f_W (K, E, 3) [N], and which feet stand (K, E), bool.
    """

    times_s: Array
    torso_m: Array
    rotation: Array
    feet_m: Array
    forces_n: Array
    contact: NDArray[np.bool_]


def sampled(
    structure: Structure, x: Array, times_s: Array, height_factor: float = 1.0
) -> GaitSamples:
    """Evaluate a decision vector at times, shape (K,) [s]."""
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
    return GaitSamples(
        times_s=times_s,
        torso_m=torso_m,
        rotation=rotation,
        feet_m=np.stack(feet, axis=1),
        forces_n=np.stack(forces, axis=1),
        contact=np.stack(contact, axis=1),
    )
