"""Ranges of the joints of a plan: from one key frame to the next, and towards the posture in which
two are one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..equilibrium.layout import Index, Layout
from ..equilibrium.rows import Rows
from ..files.arrays import Array, locked
from ..robot.kinematics import Kinematics
from ..robot.urdf import JOINTS

TURN_RAD = 0.5
"""A joint of a leg that stands turns by no more from one key frame to the next: on the way from a
posture to its mirror image torques are not those of either."""
UPRIGHT_RAD = 1.3
"""A hip of a leg that is drawn up stays below this: near π/2 its yaw and its roll turn one way, and
at any speed."""
SLACK_RAD = 0.2
"""What is restored may be so far beyond what a step kept to."""


@lru_cache(maxsize=16)
def standing(layout: Layout, leg_of: tuple[int, ...]) -> tuple[Index, Index]:
    """(frame, joint) of every joint of a leg that stands where it stood at the frame before, (K,)
    each.

    Arguments:
        leg_of: the leg of every joint.
    """
    holds = np.array(layout.holds)
    frame, joint = np.nonzero((holds[1:] == holds[:-1])[:, np.array(leg_of)])
    return locked((frame + 1, joint))


def keep_turns(rows: Rows[Any], of: tuple[Index, Index], joints: Index) -> None:
    """Rows that keep steps of these joints, columns of shape (M, J), within ``turn_room``, which
    the problem tells.
    """
    frame, joint = of
    for name, sign in (("on", 1.0), ("back", -1.0)):
        turn = rows.at_most(f"turn_{name}", len(frame))
        rows.put(turn, joints[frame, joint], sign)
        rows.put(turn, joints[frame - 1, joint], -sign)
        rows.right(turn, lambda given, sign=sign: given.turn_room(sign))  # type: ignore[misc]


def turn_room(angles: Array, of: tuple[Index, Index], sign: float) -> Array:
    """Angle by which these joints may still turn one way since the frame before, (K,) [rad]: what
    is beyond ``TURN_RAD`` already gets no farther.

    Arguments:
        angles: shape (M, J).
        of: as of ``standing``.
    """
    frame, joint = of
    turned = angles[frame, joint] - angles[frame - 1, joint]
    return np.asarray(np.maximum(TURN_RAD, np.abs(turned)) - sign * turned)


def joint_ranges(solver: Kinematics, angles: Array) -> tuple[Array, Array]:
    """Ranges of the joints, shape (M, J) each: within their limits, and legs that are drawn up no
    nearer to the posture in which thigh and axis of yaw are one than ``UPRIGHT_RAD``, or than they
    are.

    Arguments:
        angles: shape (M, J) [rad].
    """
    lower, upper = (
        np.tile(limit, (len(angles), 1)) for limit in (solver.lowest_rad, solver.highest_rad)
    )
    if solver.drawn:
        hips = slice(JOINTS.index("hip"), None, len(JOINTS))
        lower[:, hips] = np.maximum(lower[:, hips], np.minimum(-UPRIGHT_RAD, angles[:, hips]))
        upper[:, hips] = np.minimum(upper[:, hips], np.maximum(UPRIGHT_RAD, angles[:, hips]))
    return lower, upper


def keeps_to(solver: Kinematics, layout: Layout, before: Array, after: Array) -> bool:
    """Tell whether the joint angles ``after`` a step are as close to those ``before`` it as a step
    allows. Angles that inverse kinematics found again may have jumped.

    Arguments:
        before, after: joint angles, shape (M, J) [rad].
    """
    frame, joint = standing(layout, tuple(solver.legs.tolist()))
    first, then = (
        np.abs(angles[frame, joint] - angles[frame - 1, joint]) for angles in (before, after)
    )
    lower, upper = joint_ranges(solver, before)
    inside = np.all((after >= lower - SLACK_RAD) & (after <= upper + SLACK_RAD))
    return bool(inside and np.all(then <= np.maximum(TURN_RAD, first) + SLACK_RAD))
