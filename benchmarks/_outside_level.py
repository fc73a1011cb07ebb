"""Walks to forge with: slow ones on level ground, made of nothing, and finer samples of those that
are there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from _outside_files import Array, Opened
from scipy.interpolate import CubicSpline, PchipInterpolator

G_M_S2 = 9.81


def level(
    walk: Opened,
    *,
    duration_s: float,
    speed_m_s: float = 0.0,
    turn_rad: float = 0.0,
    friction: float = 0.0,
) -> None:
    """Make it a slow walk of pairs of feet on level ground, with vertical forces alone."""
    step, robot = 0.005, walk.robot
    times = step * np.arange(round(duration_s / step) + 1)
    speed = speed_m_s * (eased((times - 0.2) / 0.1) - eased((times - duration_s + 0.3) / 0.1))
    way = np.r_[0.0, np.cumsum(0.5 * step * (speed[1:] + speed[:-1]))]
    turn = turn_rad * eased((times - 0.2) / (duration_s - 0.5))
    c, s, o = np.cos(turn), np.sin(turn), np.zeros_like(turn)
    rotation = np.stack(
        [np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)], -2
    )
    nominal = np.array([foot["nominal_m"] for foot in robot["feet"]])
    torso = np.stack([way, o, o - nominal[0, 2]], axis=1)
    wanted = torso[:, None] + np.einsum("kij,ej->kei", rotation, nominal)
    feet, contact = _steps(wanted, times, duration_s)
    weight = robot["mass_kg"] * G_M_S2
    forces = np.zeros_like(feet)
    for row in range(len(times)):
        stands = contact[row]
        arms = feet[row, stands] - torso[row]
        rows = np.stack([np.ones(stands.sum()), 10.0 * arms[:, 1], 10.0 * arms[:, 0]])
        shares = np.linalg.lstsq(rows, [1.0, 0.0, 0.0], rcond=None)[0]
        forces[row, stands, 2] = weight * shares / shares.sum()
    x = np.arange(-1.5, way[-1] + 1.55, 0.05)
    y = np.arange(-1.5, 1.55, 0.05)
    walk.arrays |= {
        "times_s": times,
        "torso_m": torso,
        "rotation": rotation,
        "feet_m": feet,
        "forces_n": forces,
        "contact": contact,
        "terrain_x_m": x,
        "terrain_y_m": y,
        "terrain_heights_m": np.zeros((x.size, y.size)),
    }
    walk.head |= {
        "friction": friction,
        "terrain": "level",
        "start": torso[0, :2].tolist(),
        "goal": torso[-1, :2].tolist(),
    }


def refined(walk: Opened, times: int) -> None:
    """The same between its samples, this many times as many."""
    old = walk.arrays["times_s"]
    new = np.linspace(old[0], old[-1], (len(old) - 1) * times + 1)
    for name in ("torso_m", "feet_m", "forces_n", "rotation"):
        values: Array = walk.arrays[name].reshape(len(old), -1)
        between = PchipInterpolator if name in ("forces_n", "feet_m") else CubicSpline
        smooth = between(old, values)(new)
        walk.arrays[name] = smooth.reshape(len(new), *walk.arrays[name].shape[1:])
    u, _, v = np.linalg.svd(walk.arrays["rotation"])
    walk.arrays["rotation"] = u @ v
    near = np.minimum((np.arange(len(new)) + times // 2) // times, len(old) - 1)
    walk.arrays["contact"] = walk.arrays["contact"][near]
    walk.arrays["times_s"] = new


def _steps(wanted: Array, times: Array, duration_s: float) -> tuple[Array, Any]:
    """Feet that follow where they are wanted by steps of two at a time; and which stand."""
    feet = np.repeat(wanted[:1], len(times), axis=0)
    feet[..., 2] = 0.0
    contact = np.ones(feet.shape[:2], dtype=bool)
    begin, count, swing, period = 0.5, 0, 0.2, 0.4
    while begin + swing < duration_s - 0.3:
        first, last = (round(at / 0.005) for at in (begin, begin + swing))
        aim = wanted[min(len(times) - 1, last + int(0.5 * period / 0.005))]
        for foot in ((0, 3), (1, 2))[count % 2]:
            u = np.linspace(0.0, 1.0, last - first + 1)
            goal = np.array([aim[foot, 0], aim[foot, 1], 0.0])
            feet[first : last + 1, foot] += eased(u)[:, None] * (goal - feet[first, foot])
            feet[first : last + 1, foot, 2] += 3.2 * (u * (1.0 - u)) ** 3
            feet[last + 1 :, foot] = goal
            contact[first + 1 : last, foot] = False
        begin, count = begin + period, count + 1
    return feet, contact


def eased(share: Array) -> Array:
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))
