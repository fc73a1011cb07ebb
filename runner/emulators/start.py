"""The joints of the robot that a plan is for, and where they are at its beginning: as an emulated
robot stands.
"""

from __future__ import annotations

from pathlib import Path

from stancekit.planners.files.arrays import Array
from stancekit.planners.formats.plan_file import read_plan
from stancekit.planners.motion.plan_joints import plan_angles
from stancekit.planners.robot.urdf import joint_names


def start_of(path: str | Path) -> tuple[tuple[str, ...], Array]:
    """Joint names, and angles [rad] of shape (J,) at the first key frame of a plan file.

    Raises InvalidInput for what is no plan file, and without pinocchio.
    """
    plan, _ = read_plan(path)
    return joint_names(plan.problem.robot), plan_angles(plan)[0].angles
