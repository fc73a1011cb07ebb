"""A robot's model as the contact planner sees it: a mass, and for each leg a ball that its toe is in.

Plans take inner sets, proofs outer ones. The inner ball is the largest one in the leg's polytope, so that a foot
planned in it is one that the leg reaches; that no plan exists within inner balls proves nothing of the robot. The outer
ball holds all that the leg reaches, so that a proof over outer balls is one. The toe is on the foot's surface, a radius
away from the foot's centre in a direction that the terrain decides: the inner ball is that much smaller, the outer one
that much larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from .model import Limb, Robot
from .robot_model import RobotModel
from .workspace import Workspace

Sets = Literal["inner", "outer"]


def contact_robot(robot: RobotModel, workspaces: Sequence[Workspace], sets: Sets = "inner") -> Robot:
    """The robot with its body's origin at its centre of mass, which is taken to stay where it is as it stands.

    Raises InvalidInput for a leg whose foot is larger than its inner ball.
    """
    limbs = []
    for leg, workspace in zip(robot.legs, workspaces, strict=True):
        if sets == "outer":
            centre, reach = workspace.outer.centre_m, workspace.outer.radius_m + leg.radius_m
        else:
            centre, reach = workspace.ball_m[:3], float(workspace.ball_m[3]) - leg.radius_m
        if not reach > 0.0:
            raise InvalidInput(f"leg {leg.name}: expected a workspace larger than its foot of {leg.radius_m:g} m")
        limbs.append(Limb(name=leg.name, shoulder_m=centre - robot.body.com_m, reach_m=reach))
    return Robot(name=robot.name, mass_kg=robot.body.mass_kg, limbs=tuple(limbs))


def standing_toes(robot: RobotModel) -> Array:
    """Where the toes are as the robot stands on level ground, from its centre of mass, shape (N, 3) [m]."""
    down = np.array([0.0, 0.0, 1.0])
    return np.array([leg.nominal_m - leg.radius_m * down - robot.body.com_m for leg in robot.legs])
