"""Calibrations that are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stancekit.runner.worlds.dynamixel.control_table import RAD, TICKS, Calibration


def spoiled(calibration: Calibration, rng: np.random.Generator) -> tuple[Calibration, str]:
    """A valid calibration with one joint that turns the other way or has its zero elsewhere, and
    which that is.
    """
    joint = str(rng.choice(list(calibration.joints)))
    right = calibration.joints[joint]
    turned = rng.random() < 0.5
    direction = -right.direction if turned else right.direction
    shift = 0 if turned else int(rng.choice([-1, 1]) * rng.integers(300, 900))
    zero = right.zero_tick + shift
    room = sorted(direction * (tick - zero) * RAD for tick in (1, TICKS - 2))
    wrong = replace(
        right,
        direction=direction,
        zero_tick=zero,
        lower_rad=max(right.lower_rad, room[0]),
        upper_rad=min(right.upper_rad, room[1]),
    )
    return replace(calibration, joints=calibration.joints | {joint: wrong}), joint
