"""Torques at rest along a plan's path, where its joints are on their way from one key frame to the
next.

A robot is drawn in its plan as if its legs weighed nothing (``joints``): where it is executed its
body is a little elsewhere, and its joints take something else than those of the drawing, at key
frames, too.
"""

from __future__ import annotations

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array
from ..robot.kinematics import Kinematics
from .joints import JointPath
from .path import PlanPath


def path_torques(plan: Plan, solver: Kinematics) -> Array:
    """Torques of all joints at the moments in which the body moves, the first and the last of every
    step among them, shape (T, J) [Nm]. Forces run along the straight line between those of a step's
    two stances.
    """
    path = PlanPath(plan)
    moments, postures = JointPath(path, solver).judged()
    rows = np.flatnonzero((moments.part == 1) | ((moments.part == 0) & (moments.passed == 1.0)))
    torques = list[Array]()
    for t in rows.tolist():
        frames = int(moments.step[t]) - 1, int(moments.step[t])
        before, after = (
            support_forces(plan, plan.forces_n, k, path.support(frames[1])) for k in frames
        )
        share = moments.passed[t] if moments.part[t] == 1 else 0.0
        torques.append(
            solver.torques(
                postures.angles[t], postures.rotations[t], before + share * (after - before)
            )
        )
    return np.array(torques).reshape(-1, len(solver.joints))


def support_forces(plan: Plan, forces_n: Array, frame: int, support: tuple[int, ...]) -> Array:
    """Forces at a frame while only these limbs stand, shape (N, 3) [N]. Where the plan has no stance
    of just these limbs, the mean over all stances of the frame.

    Arguments:
        forces_n: of the plan's stances, shape (S, N, 3).
    """
    course = plan.problem
    at = [i for i, stance in enumerate(course.stances) if stance.frame == frame]
    rows = [i for i in at if tuple(course.stances[i].limbs) == support] or at
    return np.asarray(forces_n[rows].mean(axis=0))
