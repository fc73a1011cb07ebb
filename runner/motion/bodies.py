"""A plan's motion judged by bodies: what links go through on the way, postures as the runner has them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.robot.bodies import Bodies
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.robot.overlaps import WholeBody
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.verify.bodies import BodyReport, motion_report
from stancekit.planners.verify.bodies import spaced as rows_apart

from ..control.tracker import Target


def motion_bodies(plan: Plan, targets: Sequence[Target], kinematics: Kinematics) -> BodyReport:
    """Judge the postures of a plan's motion, ``APART_M`` apart. Raises InvalidInput without coal.

    targets: of the whole motion, as ``joint_profile`` has them.
    """
    bodies = Bodies(kinematics, Obstacles.of(plan.course.terrain))
    return motion_report(bodies, ((target.sample.frame, posture(target, kinematics)) for target in spaced(targets)))


def posture(target: Target, kinematics: Kinematics) -> WholeBody:
    """Where the whole robot should be at the end of a control period."""
    sample = target.sample
    return WholeBody(
        rotation=rotation_of(sample.rotation_rad), origin_m=target.origin_m, angles=target.angles_rad,
        toes_m=sample.feet_m - kinematics.radii_m[:, None] * sample.normals, normals=sample.normals,
        stands=np.array(sample.foothold) >= 0,
    )  # fmt: skip


def spaced(targets: Sequence[Target]) -> Iterator[Target]:
    """As few of a motion's targets as are not farther apart than ``APART_M`` and ``TURN_RAD``, with the first and the
    last."""
    points = [np.concatenate([target.sample.feet_m, target.origin_m[None]]) for target in targets]
    for row in rows_apart(np.array(points), np.array([target.angles_rad for target in targets])):
        yield targets[row]
