"""What keeps a posture or a plan from being one at all: arrays that lack, of other shapes, or of no numbers."""

from __future__ import annotations

import numpy as np

from ..answer.plan import Plan
from ..answer.posture import Posture
from ..answer.report import OPTIONAL, plan_shapes
from ..files.arrays import LARGEST
from ..problem import Problem
from .soles import counts_of, forces_defect


def posture_defect(problem: Problem, posture: Posture) -> str:
    """What keeps the posture from being one at all; empty when nothing does.

    Looks at what there is, shapes and finiteness, of soles also whether forces at points add up. Nothing is raised.
    """
    rows, counts = len(problem.contacts), counts_of(problem.contacts)
    shapes: dict[str, tuple[int, ...]] = {
        "com_m": (3,), "rotation_rad": (3,), "toes_m": (rows, 3), "forces_n": (rows, 3)
    }  # fmt: skip
    if counts:
        shapes |= {name: (rows, max(counts), 3) for name in ("points_m", "point_forces_n")}
    for name, shape in shapes.items():
        array = getattr(posture, name)
        if array is None:
            return f"{name}: expected shape {shape}, got nothing"
        if array.shape != shape:
            return f"{name}: expected shape {shape}, got {array.shape}"
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers"
    if counts and posture.point_forces_n is not None:
        return forces_defect(posture.forces_n, posture.point_forces_n, counts)
    return _points_defect(posture)


def plan_defect(plan: Plan) -> tuple[str, int, str]:
    """What keeps the plan from being one at all, with its frame and limb; empty when nothing does."""
    course = plan.problem
    for name, shape in plan_shapes(course).items():
        array = getattr(plan, name)
        if array is None and name in OPTIONAL:
            continue
        if array is None:
            return f"{name}: expected shape {shape}, got nothing", -1, ""
        if array.shape != shape and shape[-1:] == (0,):
            return f"{name}: expected none of a robot whose legs are not known, got shape {array.shape}", -1, ""
        if array.shape != shape:
            return f"{name}: expected shape {shape}, got {array.shape}", -1, ""
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers", -1, ""
        if np.abs(array).max(initial=0) > LARGEST:
            return f"{name}: expected magnitudes up to {LARGEST:g}, got {np.abs(array).max():g}", -1, ""
    for put, chosen in zip(course.footholds, plan.choice, strict=True):
        if not 0 <= chosen < len(put.candidates):
            most = len(put.candidates) - 1
            return (
                f"choice: frame {put.frame}, limb {put.limb}: expected a candidate from 0 to {most}, got {chosen}",
                put.frame, put.limb,
            )  # fmt: skip
    if course.has_soles and plan.point_forces_n is not None:
        return forces_defect(plan.forces_n, plan.point_forces_n, counts_of(course.robot.limbs)), -1, ""
    return _points_defect(plan), -1, ""


def _points_defect(answer: Posture | Plan) -> str:
    """Points of feet that are none: nothing would judge them."""
    for name in ("points_m", "point_forces_n"):
        if getattr(answer, name) is not None:
            return f"{name}: expected none on point feet, got shape {getattr(answer, name).shape}"
    return ""
