"""The legs of any robot: its own, from its file, or for one that is but balls of reach those that are drawn up here."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..files.arrays import Array
from .leg_ik import limb_posture
from .leg_sources import no_legs
from .model import Limb, Robot, hexapod
from .robot_model import RobotModel, model_of
from .servo import JOINTS, Servo
from .urdf import LINKS, hexapod_urdf

if TYPE_CHECKING:
    from .single_body import GaitRobot

OUTWARD, DOWN = 0.15 / 0.35, 0.2 / 0.35
"""Where the feet of legs that are drawn up stand, as shares of their reach."""


def legged_model(robot: Robot, servo: Servo | None = None) -> RobotModel:
    """The robot's own model, or that of ``hexapod_urdf`` for one whose legs are drawn up; everything else asks here.

    servo: drives joints that are drawn up, in place of the robot's own servo; what a robot's file says of its joints
    holds without it. Raises InvalidInput without pinocchio, for a robot whose legs are not known, and for one whose
    legs cannot be drawn up (soles, half-spaces).
    """
    return robot.source.legs(servo)


def drawn_model(robot: Robot, servo: Servo) -> RobotModel:
    """The model of ``hexapod_urdf``, every joint driven by this servo. Raises InvalidInput for limbs that are no balls
    with a point foot."""
    reaches = tuple((limb.name, limb.reach_m) for limb in robot.limbs)
    return _drawn_up(hexapod_urdf(robot, servo), robot.name, reaches, servo)


@lru_cache(maxsize=16)  # a run asks for the model of its robot half a dozen times
def _drawn_up(urdf: str, name: str, reaches: tuple[tuple[str, float], ...], servo: Servo) -> RobotModel:
    """Read from its text, standing as in paper E's ground problems: feet outward of their shoulders and below them.

    reaches: names of the limbs and how far they reach [m].
    """
    down, posture = np.array([0.0, 0.0, -1.0]), dict[str, float]()
    for limb, reach_m in reaches:
        angles = limb_posture(np.array(LINKS) * reach_m, reach_m * np.array([OUTWARD, 0.0, -DOWN]), down, Servo())
        posture |= {f"{limb}_{joint}": float(angle) for joint, angle in zip(JOINTS, angles, strict=True)}
    feet = {limb: f"{limb}_foot" for limb, _ in reaches}
    return model_of(urdf, where=name, feet=feet, posture_rad=posture, name=name).changed(servo=servo)


def robot_of(model: RobotModel) -> Robot:
    """A robot of this model's legs, each reaching as far as it is long, from the centre of mass as it stands."""
    limbs = tuple(
        Limb(name=leg.name, shoulder_m=leg.hip_m - model.body.com_m, reach_m=leg.chain.length_m + leg.radius_m)
        for leg in model.legs
    )
    return Robot(name=model.name, mass_kg=model.body.mass_kg, limbs=limbs, model=model)


def foot_radii(robot: Robot) -> Array:
    """Of every limb's foot, a sphere, shape (N,) [m]."""
    return robot.source.foot_radii_m


def walking_robot(robot: GaitRobot) -> Robot:
    """The robot with limbs and joints of a walk's robot. Raises InvalidInput where its joints are not known.

    The robot of a walk is a body with boxes of reach, which may have the model of its legs; of the robots that come
    with the package the hexapod has joints, too.
    """
    if robot.source.own:
        return robot_of(robot.source.own_model())
    known = hexapod()
    shoulders = {limb.name: limb.shoulder_m for limb in known.limbs}
    same = robot.foot_names == known.limb_names and np.isclose(robot.mass_kg, known.mass_kg)
    if not same or not all(np.allclose(foot.hip_m, shoulders[foot.name]) for foot in robot.feet):
        raise no_legs(robot.name)
    return known
