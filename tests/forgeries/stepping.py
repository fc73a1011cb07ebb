"""An honest walk of a robot with legs of its own: it lifts one foot and puts it down where it
was.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from stancekit import Motion, WalkQuestion
from stancekit.planners.robot.model import Foot, Robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.terrain.heightfield import HeightField
from tests.planners.robot.small_urdfs import quadruped

from .crawl import balanced

STEP_S, COUNT = 0.005, 121
BONE = '<collision><origin xyz="0 0 -.15"/><geometry><cylinder radius=".015" length=".26"/></geometry></collision>'


def dressed(effort: float = 60.0) -> str:
    """The small quadruped with shapes of its thighs and shanks."""
    text = quadruped(effort=effort)
    for leg in ("LF", "RF", "LH", "RH"):
        for part in ("THIGH", "SHANK"):
            text = text.replace(f'<link name="{leg}_{part}">', f'<link name="{leg}_{part}">{BONE}')
    return text


@cache
def stepping(effort: float = 60.0, swing_s: float = 0.3) -> Motion:
    """On level ground, the body shifts away from LF, which swings and comes down where it was, and
    back.
    """
    model = model_of(dressed(effort))
    toes = (
        np.array([leg.nominal_m - leg.radius_m * np.array([0.0, 0.0, 1.0]) for leg in model.legs])
        - model.com_m
    )
    feet = [
        Foot(
            name=leg.name,
            nominal_m=toe,
            reach_min_m=toe - 0.2,
            reach_max_m=toe + 0.2,
            hip_m=leg.hip_m,
        )
        for leg, toe in zip(model.legs, toes, strict=True)
    ]
    robot = Robot(
        name="quadruped",
        mass_kg=model.mass_kg,
        inertia_kgm2=model.inertia_kgm2,
        feet=tuple(feet),
        stand_height_m=model.stand_height_m,
        trunk_half_m=np.array([0.3, 0.125, 0.05]),
        model=model,
    )
    times = STEP_S * np.arange(COUNT)
    begin = 0.5 * (times[-1] - swing_s)
    air = np.clip((times - begin) / swing_s, 0.0, 1.0)
    contact = np.ones((COUNT, 4), dtype=bool)
    contact[(air > 0.0) & (air < 1.0), model.leg_names.index("LF")] = False
    torso = np.tile([-0.06, -0.05, model.stand_height_m], (COUNT, 1))
    places = np.tile(np.column_stack([toes[:, :2], np.zeros(4)]), (COUNT, 1, 1))
    places[:, model.leg_names.index("LF"), 2] = 0.05 * 64.0 * (air * (1.0 - air)) ** 3
    line = np.linspace(-2.0, 2.0, 17)
    return Motion(
        times_s=times,
        torso_m=torso,
        rotation=np.tile(np.eye(3), (COUNT, 1, 1)),
        feet_m=places,
        forces_n=balanced(robot, torso, places, contact),
        contact=contact,
        problem=WalkQuestion(
            robot=robot,
            terrain=HeightField(line, line, np.zeros((17, 17)), "level"),
            friction=0.7,
            adhesive=np.zeros(4, dtype=bool),
            start=torso[0, :2],
            goal=torso[-1, :2],
            heading_rad=0.0,
            still=(True, True),
        ),
    )
