"""A plan's motion judged by bodies: what links go through on the way, postures as the runner has
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.robot.bodies import Bodies
from stancekit.planners.robot.chain import rotations_of
from stancekit.planners.robot.inverse_kinematics import WholeBody
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.verify.bodies import BodyReport, bodies_report
from stancekit.planners.verify.bodies import spaced as rows_apart

from ..control.tracker import Target


def motion_bodies(plan: Plan, targets: Sequence[Target], kinematics: Kinematics) -> BodyReport:
    """Judge the postures of a plan's motion, ``APART_M`` apart.

    Raises InvalidInput without coal.

    Arguments:
        targets: of the whole motion, as ``joint_profile`` has them.
    """
    bodies, some = Bodies(kinematics, Obstacles.of(plan.problem.terrain)), list(spaced(targets))
    frames = np.array([target.sample.frame for target in some])
    return bodies_report(bodies, frames, postures(some, kinematics), between=True)


def postures(targets: Sequence[Target], kinematics: Kinematics) -> WholeBody:
    """Postures that the whole robot should have at the ends of control periods."""
    samples = [target.sample for target in targets]
    feet, normals = (
        np.array([each.feet_m for each in samples]),
        np.array([each.normals for each in samples]),
    )
    return WholeBody(
        rotation=rotations_of(np.array([each.rotation_rad for each in samples])),
        origin_m=np.array([target.origin_m for target in targets]),
        angles=np.array([target.angles_rad for target in targets]),
        toes_m=feet - kinematics.radii_m[:, None] * normals,
        normals=normals,
        stands=np.array([each.foothold for each in samples]) >= 0,
    )


def spaced(targets: Sequence[Target]) -> Iterator[Target]:
    """Thin out the targets of a motion: yield the first, the last, and as few in between as keep
    neighbours within ``APART_M`` and ``TURN_RAD`` of each other.
    """
    points = [np.concatenate([target.sample.feet_m, target.origin_m[None]]) for target in targets]
    for row in rows_apart(np.array(points), np.array([target.angles_rad for target in targets])):
        yield targets[row]
