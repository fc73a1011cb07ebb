"""Joint angles for every key frame of a plan: each near those of the frame before."""

from __future__ import annotations

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array
from ..terrain.prism import Solid
from .kinematics import JointAnswer, Kinematics


def plan_angles(plan: Plan, kinematics: Kinematics | None = None) -> list[JointAnswer]:
    """Angles of every key frame, rotations taken exactly. Raises InvalidInput without pinocchio.

    Where a foot is out of reach, those that bring it nearest. The torques are those of the mean force of the frame's
    stances.
    """
    course = plan.course
    solver = kinematics or Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    solids = [Solid.behind(patch) for patch in course.terrain]
    found = list[JointAnswer]()
    for k in range(course.frames):
        answer = solver.solve(
            plan.com_m[k], plan.rotation_rad[k], plan.toes_at(k), normals=normals_at(plan, k),
            forces_n=plan.forces_at(k), seed=found[-1].angles if found else None, obstacles=solids,
        )  # fmt: skip
        found.append(answer)
    return found


def normals_at(plan: Plan, frame: int) -> Array:
    """Of the patches under all limbs at a key frame, shape (N, 3)."""
    return np.array([plan.course.patch(int(p), plan.choice).normal for p in plan.course.holds[frame]])
