"""A plan's motion judged by bodies: what links go through on the way, postures as the runner has
them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import Group
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.bodies import Bodies
from stancekit.planners.robot.inverse_kinematics import WholeBody
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import rotations_of
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.verify.bodies import bodies_group, spaced as rows_apart


def motion_bodies(plan: Plan, rows: Samples, kinematics: Kinematics) -> Group:
    """Judge the postures of a plan's motion, ``APART_M`` apart.

    Raises InvalidInput without coal.

    Arguments:
        rows: of the whole motion, as ``joint_profile`` has them.
    """
    bodies, some = Bodies(kinematics, Obstacles.of(plan.problem.terrain)), spaced(rows)
    found = postures(rows, kinematics).at(some)
    return bodies_group("motion", bodies, rows.frame[some], found, between=True)


def postures(rows: Samples, kinematics: Kinematics) -> WholeBody:
    """Postures that the whole robot should have at the ends of control periods."""
    assert rows.origin_m is not None
    assert rows.angles_rad is not None
    return WholeBody(
        rotation=rotations_of(rows.rotation_rad),
        origin_m=rows.origin_m,
        angles=rows.angles_rad,
        toes_m=rows.feet_m - kinematics.radii_m[:, None] * rows.normals,
        normals=rows.normals,
        stands=rows.stands,
    )


def spaced(rows: Samples) -> NDArray[np.intp]:
    """Numbers of the first row of a motion, of the last, and of as few in between as keep
    neighbours within ``APART_M`` and ``TURN_RAD`` of each other.
    """
    assert rows.origin_m is not None
    assert rows.angles_rad is not None
    return rows_apart(
        np.concatenate([rows.feet_m, rows.origin_m[:, None]], axis=1), rows.angles_rad
    )
