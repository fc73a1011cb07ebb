"""Defects of arrays that are no trajectory at all, so that nothing of them can be measured."""

from __future__ import annotations

import math

import numpy as np

from ..answer.trajectory import Trajectory
from ..files.arrays import LARGEST


def defect_of(trajectory: Trajectory, step_s: float) -> str:
    """Defect that keeps a trajectory from being one at all, so that nothing can be measured; empty
    when nothing does.

    Arguments:
        step_s: the coarsest grid that is believed [s].
    """
    count, feet = trajectory.samples, len(trajectory.robot.feet)
    if count < 4:  # the acceleration at either end is on a line through two
        return f"times_s: expected four samples or more, got {count}"
    shapes = {
        "times_s": (count,),
        "torso_m": (count, 3),
        "rotation": (count, 3, 3),
        "feet_m": (count, feet, 3),
        "forces_n": (count, feet, 3),
        "contact": (count, feet),
        "adhesive": (feet,),
        "start_xy_m": (2,),
        "goal_xy_m": (2,),
    }
    for name, shape in shapes.items():
        array = getattr(trajectory, name)
        if array.shape != shape:
            return f"{name}: expected shape {shape}, got {array.shape}"
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers, got {array[~np.isfinite(array)][0]}"
        if not float(np.abs(array).max()) <= LARGEST:
            return f"{name}: expected magnitudes up to {LARGEST:g}, got {np.abs(array).max():g}"
    steps = np.diff(trajectory.times_s)
    if not float(steps.min()) > 0.0:
        return f"times_s: expected increasing times, got a step of {steps.min():g} s"
    if float(np.ptp(steps)) > 1e-6 * float(steps.max()):
        return (
            f"times_s: expected a uniform grid, got steps from {steps.min():g} to {steps.max():g} s"
        )
    if float(steps.max()) > step_s * (1.0 + 1e-6):
        return (
            f"times_s: expected samples every {step_s:g} s or less, got a step of {steps.max():g} s"
        )
    if not (math.isfinite(trajectory.friction) and 0.0 <= trajectory.friction <= LARGEST):
        return f"friction: expected a number of at least 0, got {trajectory.friction:g}"
    if trajectory.suction_n is not None and not 0.0 <= trajectory.suction_n <= LARGEST:
        return f"suction_n: expected a number of at least 0, got {trajectory.suction_n:g}"
    for name in ("heading_rad", "heading_end_rad"):
        heading = getattr(trajectory, name)
        if heading is not None and not abs(heading) <= LARGEST:
            return f"{name}: expected a finite number, got {heading:g}"
    return ""
