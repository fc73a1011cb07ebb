"""The model of legs that are drawn up for a robot's limbs, standing as in the paper's ground
problems.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from .actuators import JOINTS, Servo
from .drawn_legs import LINKS, drawn_urdf
from .leg_ik import limb_posture
from .limb import Limb
from .robot_model import RobotModel, model_of

_OUTWARD, _DOWN = 0.15 / 0.35, 0.2 / 0.35
"""Where the feet of legs that are drawn up stand, as shares of their reach."""


def drawn_model(name: str, mass_kg: float, limbs: Sequence[Limb], servo: Servo) -> RobotModel:
    """The model of ``drawn_urdf``, every joint driven by this servo.

    Raises InvalidInput for limbs that are no balls with a point foot.
    """
    reaches = tuple((limb.name, limb.reach_m) for limb in limbs)
    return _drawn_up(drawn_urdf(name, mass_kg, limbs, servo), name, reaches, servo)


@lru_cache(maxsize=16)  # a run asks for the model of its robot half a dozen times
def _drawn_up(
    urdf: str, name: str, reaches: tuple[tuple[str, float], ...], servo: Servo
) -> RobotModel:
    """Read from its text, standing as in Lin et al.'s ground problems: feet outward of their
    shoulders and below them.

    Arguments:
        reaches: names of the limbs and how far they reach [m].
    """
    down, posture = np.array([0.0, 0.0, -1.0]), dict[str, float]()
    for limb, reach_m in reaches:
        angles = limb_posture(
            np.array(LINKS) * reach_m, reach_m * np.array([_OUTWARD, 0.0, -_DOWN]), down, Servo()
        )
        posture |= {
            f"{limb}_{joint}": float(angle) for joint, angle in zip(JOINTS, angles, strict=True)
        }
    feet = {limb: f"{limb}_foot" for limb, _ in reaches}
    return model_of(urdf, where=name, feet=feet, posture_rad=posture, name=name).changed(
        servo=servo
    )
