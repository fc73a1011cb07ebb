"""Robots of a model's legs, of its own file or of a walk."""

from __future__ import annotations

import numpy as np

from .leg_sources import no_legs
from .model import Limb, Robot, hexapod
from .robot_model import RobotModel


def robot_of(model: RobotModel) -> Robot:
    """A robot of this model's legs, each reaching as far as it is long, from the centre of mass as
    it stands.
    """
    limbs = tuple(
        Limb(
            name=leg.name,
            shoulder_m=leg.hip_m - model.body.com_m,
            reach_m=leg.chain.length_m + leg.radius_m,
        )
        for leg in model.legs
    )
    return Robot(name=model.name, mass_kg=model.body.mass_kg, limbs=limbs, model=model)


def walking_robot(robot: Robot) -> Robot:
    """The robot with limbs and joints of a walk's robot.

    Raises InvalidInput where its joints are not known.

    The robot of a walk is a body with boxes of reach, which may have the model of its legs; of the
    robots that come with the package the hexapod has joints, too.
    """
    if robot.source.own:
        return robot_of(robot.source.own_model())
    known = hexapod()
    shoulders = {limb.name: limb.shoulder_m for limb in known.limbs}
    same = robot.limb_names == known.limb_names and np.isclose(robot.mass_kg, known.mass_kg)
    if not same or not all(np.allclose(foot.hip_m, shoulders[foot.name]) for foot in robot.feet):
        raise no_legs(robot.name)
    return known
