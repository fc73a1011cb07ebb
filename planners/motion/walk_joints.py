"""Joint angles for every sample of a walk, by the robot's own model: is every foot where the walk
has it?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..answer.trajectory import Trajectory
from ..files.arrays import Array
from ..robot.inverse_kinematics import LegPostures
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


def walk_postures(trajectory: Trajectory) -> WalkPostures:
    """The posture at every sample, found as ``walk_joints`` finds it.

    Raises InvalidInput as that does.
    """
    model, normals = _model(trajectory), _normals(trajectory)
    kinematics, solver = Kinematics(robot_of(model)), ToeKinematics(model)
    rotation, angles = trajectory.rotation, None
    origin = trajectory.torso_m - rotation @ model.body.com_m
    for _ in range(ROUNDS):
        standing = origin + rotation @ model.body.com_m
        postures = solver.solve(standing, rotation, trajectory.feet_m, normals, near=angles)
        angles = np.concatenate(postures.angles, axis=1)
        shift = np.array([kinematics.com_offset(posture) for posture in angles])
        origin = trajectory.torso_m - np.einsum("kij,kj->ki", rotation, shift)
    assert angles is not None
    return WalkPostures(angles=angles, origin_m=origin, normals=normals, kinematics=kinematics)


def _model(trajectory: Trajectory) -> RobotModel:
    return trajectory.robot.source.own_model()


def _normals(trajectory: Trajectory) -> Array:
    toes = trajectory.feet_m
    return np.asarray(trajectory.terrain.normal(toes[..., :2].reshape(-1, 2)).reshape(toes.shape))
