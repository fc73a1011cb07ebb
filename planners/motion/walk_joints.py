"""Joint angles for every sample of a walk, by the robot's own model: is every foot where the walk
has it?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..answer.trajectory import Trajectory
from ..files.arrays import Array
from ..robot.inverse_kinematics import LegPostures, descend
from ..robot.kinematics import Kinematics
from ..robot.legged import robot_of
from ..robot.robot_model import RobotModel
from ..robot.toes import ToeKinematics

ROUNDS = 6
"""The centre of mass moves in the body as legs do, which moves the legs: every round leaves a fifth
of it."""


def walk_joints(trajectory: Trajectory, samples: slice = slice(None)) -> LegPostures:
    """Angles at every sample, or some, each found from the standing posture; feet face the ground
    below them, also in the air.

    Raises InvalidInput for a robot that is but boxes.
    """
    model, normals = _model(trajectory), _normals(trajectory)[samples]
    torso, rotation, feet = (
        trajectory.torso_m[samples],
        trajectory.rotation[samples],
        trajectory.feet_m[samples],
    )
    return ToeKinematics(model).solve(torso, rotation, feet, normals)


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkPostures:
    """A walk of K samples as a robot of N legs and J joints has it, whose legs weigh something.

    Arguments:
        angles: shape (K, J) [rad].
        origin_m: p_WB of the base's frame, shape (K, 3): it is where the whole robot's centre of
            mass is at the walk's.
        normals: of the ground under every foot, shape (K, N, 3).
        kinematics: of the robot.
    """

    angles: Array
    origin_m: Array
    normals: Array
    kinematics: Kinematics


class MovingBody:
    """The robot of a model along a motion of its centre of mass and its toes; it is kept for
    several motions.
    """

    def __init__(self, model: RobotModel) -> None:
        self.model, self.kinematics = model, Kinematics(robot_of(model))
        self._solver = ToeKinematics(model)

    def postures(
        self,
        com_m: Array,
        rotation: Array,
        toes_m: Array,
        normals: Array,
        *,
        near: Array | None = None,
        rounds: int = ROUNDS,
        steps: int = 0,
    ) -> WalkPostures:
        """Postures of K samples, each found from the standing posture or from one that is near.

        Arguments:
            com_m: of the whole robot, shape (K, 3) [m].
            rotation: R_WB, shape (K, 3, 3).
            toes_m, normals: where feet touch or would, and of the surface there, shape (K, N, 3).
            near: angles to begin with, shape (K, J) [rad].
            rounds: as ``ROUNDS``.
            steps: of inverse kinematics at most, from ``near`` alone; 0 for as many as it takes.
        """
        body_m, angles = self.model.body.com_m, near
        origin = com_m - rotation @ body_m
        if near is not None:
            origin = com_m - np.einsum("kij,kj->ki", rotation, self._shifts(near))
        for _ in range(rounds):
            standing = origin + rotation @ body_m
            if steps and angles is not None:
                feet = self._solver.centres(standing, rotation, toes_m, normals)
                angles = self._descended(feet, angles, steps)
            else:
                postures = self._solver.solve(standing, rotation, toes_m, normals, near=angles)
                angles = np.concatenate(postures.angles, axis=1)
            origin = com_m - np.einsum("kij,kj->ki", rotation, self._shifts(angles))
        assert angles is not None
        return WalkPostures(
            angles=angles, origin_m=origin, normals=normals, kinematics=self.kinematics
        )

    def _descended(self, feet: Array, near: Array, steps: int) -> Array:
        """Angles from those that are near, shape (K, J)."""
        ends = np.cumsum([len(leg.joints) for leg in self.model.legs])[:-1]
        parts = np.split(near, ends, axis=1)
        return np.concatenate(
            [
                descend(leg, feet[:, i], part, steps=steps)[0]
                for i, (leg, part) in enumerate(zip(self.model.legs, parts, strict=True))
            ],
            axis=1,
        )

    def _shifts(self, angles: Array) -> Array:
        return np.array([self.kinematics.com_offset(posture) for posture in angles])


def walk_postures(trajectory: Trajectory) -> WalkPostures:
    """The posture at every sample, found as ``walk_joints`` finds it.

    Raises InvalidInput as that does.
    """
    return MovingBody(_model(trajectory)).postures(
        trajectory.torso_m, trajectory.rotation, trajectory.feet_m, _normals(trajectory)
    )


def _model(trajectory: Trajectory) -> RobotModel:
    return trajectory.robot.source.own_model()


def _normals(trajectory: Trajectory) -> Array:
    toes = trajectory.feet_m
    return np.asarray(trajectory.terrain.normal(toes[..., :2].reshape(-1, 2)).reshape(toes.shape))
