"""Defects that keep a posture or a plan from being one at all: arrays that lack, of other shapes,
or of no numbers.
"""

from __future__ import annotations

import numpy as np

from ..answer.plan import PER_FRAME, Plan
from ..answer.report import OPTIONAL, plan_shapes
from ..files.arrays import LARGEST
from .soles import counts_of, forces_defect


def plan_defect(plan: Plan) -> tuple[str, int, str]:
    """Defect that keeps the plan from being one at all, with its frame and limb; empty when nothing
    does.

    Looks at what there is, shapes and finiteness, of soles also whether forces at points add up.
    Nothing is raised. Shapes of a posture are said as files have them, without the axis of frames.
    """
    course = plan.problem
    for name, shape in plan_shapes(course).items():
        array = getattr(plan, name)
        if array is None and name in OPTIONAL:
            continue
        if array is None or array.shape != shape:
            return _misshapen(plan, name, shape), -1, ""
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers, got others", -1, ""
        if not course.is_posture and np.abs(array).max(initial=0) > LARGEST:
            return (
                f"{name}: expected magnitudes up to {LARGEST:g}, got {np.abs(array).max():g}",
                -1,
                "",
            )
    for foothold, chosen in (
        zip(course.footholds, plan.choice, strict=True) if plan.choice.any() else ()
    ):
        if not 0 <= chosen < len(foothold.candidates):
            most = len(foothold.candidates) - 1
            return (
                f"choice: frame {foothold.frame}, limb {foothold.limb}: expected a candidate from "
                f"0 to {most}, got {chosen}",
                foothold.frame,
                foothold.limb,
            )
    if course.has_soles and plan.point_forces_n is not None:
        return (
            forces_defect(plan.forces_n, plan.point_forces_n, counts_of(course.robot.limbs)),
            -1,
            "",
        )
    return _points_defect(plan), -1, ""


def _misshapen(plan: Plan, name: str, shape: tuple[int, ...]) -> str:
    """Defect of an array that lacks or has another shape than it should."""
    array = getattr(plan, name)
    if array is None:
        return f"{name}: expected shape {_said(plan, name, shape, shape)}, got nothing"
    got = _said(plan, name, array.shape, array.shape)
    if shape[-1:] == (0,):
        return f"{name}: expected none of a robot whose legs are not known, got shape {got}"
    return f"{name}: expected shape {_said(plan, name, shape, array.shape)}, got {got}"


def _said(plan: Plan, name: str, shape: tuple[int, ...], got: tuple[int, ...]) -> tuple[int, ...]:
    """A shape as it is said, of a posture's array with one row a frame without its axis."""
    return shape[1:] if plan.problem.is_posture and name in PER_FRAME and got[:1] == (1,) else shape


def _points_defect(plan: Plan) -> str:
    """Points of feet that are none: nothing would judge them."""
    for name in ("points_m", "point_forces_n"):
        array = getattr(plan, name)
        if array is not None:
            return f"{name}: expected none on point feet, got shape {_said(plan, name, array.shape, array.shape)}"
    return ""
