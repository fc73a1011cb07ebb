"""Joint angles for a robot as plans and walks have it, in the world: its centre of mass, its
rotation, and its toes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..files.arrays import Array
from .inverse_kinematics import InverseKinematics, LegPostures, seeds_of
from .robot_model import RobotModel


class ToeKinematics:
    """All legs of a robot whose body's origin is the centre of mass of the standing robot."""

    def __init__(self, model: RobotModel) -> None:
        self.model, self._solver = model, InverseKinematics(seeds_of(model.legs))

    def solve(
        self,
        com_m: ArrayLike,
        rotation: ArrayLike,
        toes_m: ArrayLike,
        normals: ArrayLike,
        near: ArrayLike | None = None,
    ) -> LegPostures:
        """Angles of K stances of N legs, each found from the standing posture, so that knees keep
        their bend.

        Arguments:
            com_m: p_WC, shape (K, 3) [m].
            rotation: R_WB, shape (K, 3, 3).
            toes_m: p_WF, and normals of the ground there, on which a foot is a sphere, shape (K, N,
                3).
            near: all joints in the model's order, shape (K, J) [rad], in place of those of the
                standing posture.
        """
        feet = self.centres(com_m, rotation, toes_m, normals)
        standing = np.concatenate([leg.stance_rad for leg in self.model.legs])
        start = (
            np.broadcast_to(standing, (len(feet), len(standing)))
            if near is None
            else np.asarray(near)
        )
        ends = np.cumsum([len(leg.joints) for leg in self.model.legs])[:-1]
        return self._solver.solve(feet, near=np.split(start, ends, axis=1))

    def centres(
        self, com_m: ArrayLike, rotation: ArrayLike, toes_m: ArrayLike, normals: ArrayLike
    ) -> Array:
        """Centres of the feet in the base's frame, shape (K, N, 3) [m]; arguments as of
        ``solve``.
        """
        radii = np.array([[leg.radius_m] for leg in self.model.legs])
        centres = np.asarray(toes_m) + radii * np.asarray(normals)
        arms = centres - np.asarray(com_m)[:, None]
        turned = np.einsum("kji,knj->kni", np.asarray(rotation), arms)
        return np.asarray(turned + self.model.body.com_m)


def base_of(model: RobotModel, com_m: Array, rotation: Array) -> Array:
    """p_WB of the base whose centre of mass is at p_WC, shape (3,) [m]."""
    return np.asarray(com_m - rotation @ model.body.com_m)
