"""The legs of any robot: its own, from its file, or for one that is but balls of reach those that are drawn up here."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .leg_ik import limb_posture
from .model import Robot
from .robot_model import RobotModel, model_of
from .urdf import FOOT_RADIUS_M, Servo, hexapod_urdf, joint_names, link_lengths

OUTWARD, DOWN = 0.15 / 0.35, 0.2 / 0.35
"""Where the feet of legs that are drawn up stand, as shares of their reach."""


def legged_model(robot: Robot, servo: Servo = Servo()) -> RobotModel:
    """The robot's own model; for one without, the model of ``hexapod_urdf``, so that everything else asks here.

    servo: drives joints that are drawn up; what a robot's own file says of its joints holds without it. Raises
    InvalidInput without pinocchio, and for a robot without a model whose legs cannot be drawn up (soles, half-spaces).
    """
    if robot.model is not None:
        return robot.model
    return model_of(
        hexapod_urdf(robot, servo),
        where=robot.name,
        feet={name: f"{name}_foot" for name in robot.limb_names},
        posture_rad=dict(zip(joint_names(robot), _stance(robot), strict=True)),
        name=robot.name,
    )


def foot_radii(robot: Robot) -> Array:
    """Of every limb's foot, a sphere, shape (N,) [m]."""
    if robot.model is not None:
        return np.array([leg.radius_m for leg in robot.model.legs])
    return np.full(len(robot.limbs), FOOT_RADIUS_M)


def _stance(robot: Robot) -> list[float]:
    """Feet outward of their shoulders and below them, as paper E's ground problems have them."""
    down, found = np.array([0.0, 0.0, -1.0]), list[float]()
    for limb in robot.limbs:
        target = limb.reach_m * np.array([OUTWARD, 0.0, -DOWN])
        found += limb_posture(link_lengths(limb), target, down, Servo()).tolist()
    return found
