"""A plan's motion judged by bodies: what links go through on the way, postures as the runner has them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.robot.bodies import Bodies, WholeBody
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.verify.bodies import BodyReport, bodies_report

from ..control.tracker import Target
from .time_parametrization import undisturbed
from .timeline import PlanMotion

APART_M = 0.01
"""Between two postures that are judged no foot and no body's origin goes farther."""


def motion_bodies(plan: Plan, targets: Sequence[Target], kinematics: Kinematics) -> BodyReport:
    """Judge the postures of a plan's motion, ``APART_M`` apart. Raises InvalidInput without coal.

    targets: of the whole motion, as ``joint_profile`` has them.
    """
    bodies = Bodies(kinematics, Obstacles.of(plan.course.terrain))
    return bodies_report(bodies, ((target.sample.frame, posture(target, kinematics)) for target in spaced(targets)))


def along(plan: Plan, kinematics: Kinematics) -> Iterator[tuple[float, WholeBody]]:
    """The postures of a plan's motion at the runner's own pace, ``APART_M`` apart, each with its progress in key
    frames: what ``check_plan`` takes as the way between them. Raises InvalidInput where all limbs lift at once."""
    for target in spaced(undisturbed(PlanMotion(plan), kinematics)):
        yield target.sample.frame, posture(target, kinematics)


def posture(target: Target, kinematics: Kinematics) -> WholeBody:
    """Where the whole robot should be at the end of a control period."""
    sample = target.sample
    return WholeBody(
        rotation=rotation_of(sample.rotation_rad), origin_m=target.origin_m, angles=target.angles_rad,
        toes_m=sample.feet_m - kinematics.radii_m[:, None] * sample.normals, normals=sample.normals,
        stands=np.array(sample.foothold) >= 0,
    )  # fmt: skip


def spaced(targets: Sequence[Target]) -> Iterator[Target]:
    """As few of a motion's targets as are not farther apart than ``APART_M``, with the first and the last."""
    before = targets[0]
    yield before
    for target, after in pairwise(targets):
        if _moved(before, after) > APART_M:
            before = target
            yield before
    yield targets[-1]


def _moved(one: Target, other: Target) -> float:
    """How far the foot, or body's origin, has gone that has gone farthest [m]."""
    feet = np.linalg.norm(other.sample.feet_m - one.sample.feet_m, axis=1)
    return max(float(feet.max()), float(np.linalg.norm(other.origin_m - one.origin_m)))
