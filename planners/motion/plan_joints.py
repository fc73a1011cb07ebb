"""Joint angles for every key frame of a plan: each near those of the frame before."""

from __future__ import annotations

import math

import numpy as np

from ..answer.plan import Plan
from ..errors import check_time
from ..files.arrays import Array
from ..robot.kinematics import JointAnswer, Kinematics
from ..terrain.patch import solids_of

JUMP_RAD = 0.5
"""A limb that stands, and one of whose joints would turn so far between two key frames, jumps to
another posture."""


def plan_angles(
    plan: Plan,
    kinematics: Kinematics | None = None,
    start_rad: Array | None = None,
    *,
    deadline: float = math.inf,
) -> list[JointAnswer]:
    """Angles of every key frame, rotations taken exactly.

    The torques are those of the mean force of the frame's stances.

    Arguments:
        start_rad: of a robot that stands already, shape (J,): no joint leaves them at the first key
            frame but to put feet where the plan has them, and no limb jumps to another posture
            before it lifts; None: comfortable ones. Where a foot is out of reach, those that bring
            it nearest.

    Raises:
        InvalidInput: without pinocchio, and TimeEnded after the deadline (``time.perf_counter()``).
    """
    course = plan.problem
    solver = kinematics or Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    solids = solids_of(course.terrain)
    answers = list[JointAnswer]()
    for k in range(course.frames):
        check_time(deadline)
        stands = course.holds[k] == course.holds[0] if start_rad is not None else False
        answer = solver.solve(
            plan.com_m[k],
            plan.rotation_rad[k],
            plan.toes_at(k),
            normals=normals_at(plan, k),
            forces_n=plan.forces_at(k),
            seed=answers[-1].angles if answers else start_rad,
            obstacles=solids,
            most_rad=np.where(stands, JUMP_RAD if answers else 0.0, np.inf),
        )
        answers.append(answer)
    return answers


def normals_at(plan: Plan, frame: int) -> Array:
    """Normals of the patches under all limbs at a key frame, shape (N, 3)."""
    return np.array(
        [plan.problem.patch(int(p), plan.choice).normal for p in plan.problem.holds[frame]]
    )
