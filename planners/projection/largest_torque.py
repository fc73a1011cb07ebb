"""The largest torque that a plan with joints asks for, as a share of its joint's limit: at key
frames and between.
"""

from __future__ import annotations

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array
from ..motion.torques import path_torques
from ..robot.kinematics import Kinematics, rotation_of


def largest(plan: Plan, solver: Kinematics, limit_nm: Array) -> tuple[float, float]:
    """Largest torque of a plan with joints, as a share of its limit: (share, Nm)."""
    assert plan.joints_rad is not None
    rows = zip(plan.problem.stances, plan.forces_n, strict=True)
    torques = np.abs(
        [
            solver.torques(
                plan.joints_rad[of.frame], rotation_of(plan.rotation_rad[of.frame]), forces
            )
            for of, forces in rows
        ]
    )
    at = np.unravel_index(int(np.argmax(torques / limit_nm)), torques.shape)
    return float((torques / limit_nm)[at]), float(torques[at])


def on_the_way(plan: Plan, solver: Kinematics, limit_nm: Array) -> float:
    """Along the plan's path, where the robot is as it is executed: a share of the limit."""
    return float((np.abs(path_torques(plan, solver)) / limit_nm).max(initial=0.0))
