"""An honest walk in closed form: a crawl on level ground whose forces balance its motion to the
last digit.
"""

from __future__ import annotations

import numpy as np

from stancekit import Motion
from stancekit.planners.answer.trajectory import STEP_S, WalkQuestion
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField

G = 9.81
STAND_S, SHIFT_S, SWING_S = 0.2, 1.0, 0.3
STRIDE_M, HEIGHT_M, LEAN = 0.06, 0.05, 0.2
ORDER = (2, 0, 3, 1)
"""LH, LF, RH, RF: one foot after the other."""


def crawl(friction: float = 0.75) -> Motion:
    """The body leans away from a foot, the foot steps, and so on; at last the body goes to the
    middle of the feet.
    """
    robot = anymal()
    nominal = np.array([foot.nominal_m for foot in robot.feet])
    feet, body = nominal[:, :2].copy(), np.zeros(2)
    bodies, places, stands = [body], [feet.copy()], [np.ones(4, dtype=bool)]
    heights = [np.zeros(4)]

    def stay(seconds: float, to: Array, foot: int = -1) -> None:
        nonlocal body
        count, start, home = round(seconds / STEP_S), body, feet.copy()
        for k in range(1, count + 1):
            share = k / count
            smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            bodies.append(start + smooth * (to - start))
            now, up, down = home.copy(), np.zeros(4), np.ones(4, dtype=bool)
            if foot >= 0:
                now[foot, 0] += smooth * STRIDE_M
                up[foot] = HEIGHT_M * 64.0 * (share * (1.0 - share)) ** 3
                down[foot] = k == count
            places.append(now)
            heights.append(up)
            stands.append(down)
        body = to

    stay(STAND_S, body)
    for foot in ORDER:
        middle = feet.mean(axis=0)
        stay(SHIFT_S, middle - LEAN * (feet[foot] - middle))
        stay(SWING_S, body, foot)
        feet[foot, 0] += STRIDE_M
    stay(SHIFT_S, feet.mean(axis=0))
    stay(STAND_S, body)
    torso = np.column_stack([np.array(bodies), np.full(len(bodies), robot.stand_height_m)])
    toes = np.concatenate([np.array(places), np.array(heights)[..., None]], axis=2)
    contact, count = np.array(stands), len(bodies)
    return Motion(
        times_s=STEP_S * np.arange(count),
        torso_m=torso,
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=toes,
        forces_n=balanced(robot, torso, toes, contact),
        contact=contact,
        problem=WalkQuestion(
            robot=robot,
            terrain=HeightField.from_function(lambda x, y: 0.0 * x, 2.0, 0.25, name="level"),
            friction=friction,
            adhesive=np.zeros(4, dtype=bool),
            start=torso[0, :2],
            goal=torso[-1, :2],
            heading_rad=0.0,
            still=(True, True),
            suction_n=2.0 * robot.weight_n,
        ),
    )


def balanced(robot: Robot, torso: Array, toes: Array, contact: Array) -> Array:
    """The smallest forces of the standing feet that the torso's motion needs, without turning,
    shape (K, 4, 3) [N].
    """
    felt = np.zeros_like(torso)
    felt[1:-1] = np.diff(torso, 2, axis=0) / STEP_S**2
    felt[:, 2] += G
    forces = np.zeros_like(toes)
    for k, down in enumerate(contact):
        at = np.flatnonzero(down)
        arms = [np.cross(arm, np.eye(3)).T for arm in toes[k, at] - torso[k]]
        rows = np.vstack([np.hstack([np.eye(3)] * len(at)), np.hstack(arms)])
        wanted = np.concatenate([robot.mass_kg * felt[k], np.zeros(3)])
        forces[k, at] = np.linalg.lstsq(rows, wanted, rcond=None)[0].reshape(-1, 3)
    return forces
