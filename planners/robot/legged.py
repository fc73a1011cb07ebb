"""The legs of any robot: its own, from its file, or for one that is but balls of reach those that are drawn up here."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..files.arrays import Array
from ..physics import GRAVITY_M_S2
from .leg_ik import limb_posture
from .model import Limb, Robot, hexapod, no_legs
from .robot_model import RobotModel, model_of
from .servo import JOINTS, Servo
from .urdf import FOOT_RADIUS_M, LINKS, hexapod_urdf

if TYPE_CHECKING:
    from .single_body import GaitRobot

ROTOR_S2 = 2e-4
"""A rotor's inertia behind its gears, of joints that a robot's file says nothing of [kg m²], in units of what holds the
robot's weight at a leg's length [Nm]."""
OUTWARD, DOWN = 0.15 / 0.35, 0.2 / 0.35
"""Where the feet of legs that are drawn up stand, as shares of their reach."""


def legged_model(robot: Robot, servo: Servo | None = None) -> RobotModel:
    """The robot's own model, or that of ``hexapod_urdf`` for one whose legs are drawn up; everything else asks here.

    servo: drives joints that are drawn up, in place of the robot's own servo; what a robot's file says of its joints
    holds without it. Raises InvalidInput without pinocchio, for a robot whose legs are not known, and for one whose
    legs cannot be drawn up (soles, half-spaces).
    """
    if robot.model is not None:
        return robot.model
    robot.check_legs()
    servo = servo or robot.servo
    reaches = tuple((limb.name, limb.reach_m) for limb in robot.limbs)
    return _drawn_up(hexapod_urdf(robot, servo), robot.name, reaches)


@lru_cache(maxsize=16)  # a run asks for the model of its robot half a dozen times
def _drawn_up(urdf: str, name: str, reaches: tuple[tuple[str, float], ...]) -> RobotModel:
    """Read from its text, standing as in paper E's ground problems: feet outward of their shoulders and below them.

    reaches: names of the limbs and how far they reach [m].
    """
    down, posture = np.array([0.0, 0.0, -1.0]), dict[str, float]()
    for limb, reach_m in reaches:
        angles = limb_posture(np.array(LINKS) * reach_m, reach_m * np.array([OUTWARD, 0.0, -DOWN]), down, Servo())
        posture |= {f"{limb}_{joint}": float(angle) for joint, angle in zip(JOINTS, angles, strict=True)}
    feet = {limb: f"{limb}_foot" for limb, _ in reaches}
    return model_of(urdf, where=name, feet=feet, posture_rad=posture, name=name)


def carried_nm(model: RobotModel) -> float:
    """What holds the robot's weight at the length of a leg: the unit of what its joints' drives are guessed by."""
    length_m = float(np.mean([leg.chain.length_m for leg in model.legs]))
    return model.body.mass_kg * GRAVITY_M_S2 * length_m


def rotor_kg_m2(robot: Robot, servo: Servo, model: RobotModel) -> float:
    """Inertia of every rotor, seen behind its gears, where no file of actuators says it: the servo's at joints that are
    drawn up, else ``ROTOR_S2``. The verifier, the runner and the worlds of simulation have it from here."""
    return servo.rotor_kg_m2 if robot.model is None else ROTOR_S2 * carried_nm(model)


def robot_of(model: RobotModel) -> Robot:
    """A robot of this model's legs, each reaching as far as it is long, from the centre of mass as it stands."""
    limbs = tuple(
        Limb(name=leg.name, shoulder_m=leg.hip_m - model.body.com_m, reach_m=leg.chain.length_m + leg.radius_m)
        for leg in model.legs
    )
    return Robot(name=model.name, mass_kg=model.body.mass_kg, limbs=limbs, model=model)


def foot_radii(robot: Robot) -> Array:
    """Of every limb's foot, a sphere, shape (N,) [m]."""
    if robot.model is not None:
        return np.array([leg.radius_m for leg in robot.model.legs])
    return np.full(len(robot.limbs), FOOT_RADIUS_M)


def walking_robot(robot: GaitRobot) -> Robot:
    """The robot with limbs and joints of a walk's robot. Raises InvalidInput where its joints are not known.

    The robot of a walk is a body with boxes of reach, which may have the model of its legs; of the robots that come
    with the package the hexapod has joints, too.
    """
    if (model := robot.model) is not None:
        return robot_of(model)
    known = hexapod()
    shoulders = {limb.name: limb.shoulder_m for limb in known.limbs}
    same = robot.foot_names == known.limb_names and np.isclose(robot.mass_kg, known.mass_kg)
    if not same or not all(np.allclose(foot.hip_m, shoulders[foot.name]) for foot in robot.feet):
        raise no_legs(robot.name)
    return known
