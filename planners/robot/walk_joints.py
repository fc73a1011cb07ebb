"""Joint angles for every sample of a walk, by the robot's own model: is every foot where the walk has it?"""

from __future__ import annotations

from ..errors import InvalidInput
from ..gait.trajectory import Trajectory
from .inverse_kinematics import LegPostures
from .toes import ToeKinematics


def walk_joints(trajectory: Trajectory) -> LegPostures:
    """Angles at every sample, each found from the standing posture; feet face the ground below them, also in the air.

    Raises InvalidInput for a robot that is but boxes.
    """
    model, toes = trajectory.robot.model, trajectory.feet_m
    if model is None:
        raise InvalidInput(f"robot {trajectory.robot.name}: expected one that has a model of its legs, got boxes")
    normals = trajectory.terrain.normal(toes[..., :2].reshape(-1, 2)).reshape(toes.shape)
    return ToeKinematics(model).solve(trajectory.torso_m, trajectory.rotation, toes, normals)
