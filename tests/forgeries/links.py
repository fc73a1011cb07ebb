"""Links inside each other, from twice the verifier's tolerance on, in plans and walks whose
contacts are honest.

A ball is put on each of two links of the robot, so that they graze each other at one moment. The
judge knows the balls, places them by pinocchio at a thousand moments, and has their depth in closed
form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio

from stancekit import Motion
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.joints import JointPath
from stancekit.planners.motion.path import PlanPath
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.meshes import Shape
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.bodies import WholeBodyMeasurements
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.verify.trajectory_measurements import TrajectoryMeasurements

from .stepping import dressed, stepping

TOLERANCE_M = 1e-4
"""The verifier's, of one link inside another."""
RADIUS_M = 3e-3
FINER = 20
"""Moments that the judge looks at for one of the motion's."""
COURSE = """
name: flat
robot: dog.urdf
frames: 3
gait: [[LH], [LF], [RH], [RF]]
start_m: [0.0, 0.0]
goal_m: [0.1, 0.0, 0.45]
steps: {com_m: 0.12, toe_m: 0.4}
terrain: {kind: flat, friction: 0.7}
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Strung:
    """A plan or a walk whose robot has two balls: links they are of, their centres in them [m], and
    the joints at the moments of its motion, shape (T, J) [rad].
    """

    answer: Motion
    links: tuple[str, str]
    centres_m: tuple[Array, Array]
    angles: Array


@cache
def honest_plan() -> Motion:
    """A quadruped of a file of its own walks on level ground."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "dog.urdf").write_text(dressed())
        (Path(folder) / "flat.yaml").write_text(COURSE)
        plan = TwoStage().solve(read_course(Path(folder) / "flat.yaml")).solution
    assert plan is not None
    return with_joints(plan)


def strung(answer: Motion, when: float, size: float, rng: np.random.Generator) -> Strung:
    """Two balls that are ``size`` tolerances inside each other at most. when: how far from one
    moment that the verifier looks at to the next, 0 at the first of them.
    """
    model, angles = _motion(answer)
    leg = model.legs[rng.integers(len(model.legs))]
    shank = leg.foot.replace("FOOT", "SHANK")
    at = np.array([0.0, 0.1, -0.1 - 0.15 * rng.random()])
    centres = np.array([_placed(model, each, shank, at) for each in angles])
    moved = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    row = int(rng.choice(np.argsort(moved)[-5:])) if when else 0
    middle = _placed(model, angles[row] + when * (angles[row + 1] - angles[row]), shank, at)
    aside = np.cross(
        centres[row + 1] - centres[row] if when else [1.0, 0.0, 0.0], rng.normal(size=3)
    )
    apart = 2.0 * RADIUS_M - size * TOLERANCE_M
    links, places = ("base", shank), (middle + apart * aside / np.linalg.norm(aside), at)
    balls = tuple(
        Shape(
            link=link,
            kind="sphere",
            size_m=np.array([RADIUS_M]),
            rotation=np.eye(3),
            origin_m=at,
            collides=True,
        )
        for link, at in zip(links, places, strict=True)
    )
    return Strung(
        answer=_with_model(answer, replace(model, shapes=(*model.shapes, *balls))),
        links=links,
        centres_m=places,
        angles=angles,
    )


def fault(forged: Strung) -> str:
    """Why no robot does that; empty where the judge does not know."""
    model, _ = _motion(forged.answer)
    shares = np.arange(FINER + 1)[:, None] / FINER
    for before, after in pairwise(forged.angles):
        for angles in before + shares * (after - before):
            one, other = (
                _placed(model, angles, *each)
                for each in zip(forged.links, forged.centres_m, strict=True)
            )
            if 2.0 * RADIUS_M - np.linalg.norm(one - other) > 1.5 * TOLERANCE_M:
                return "two links are inside each other"
    return ""


def verdict(forged: Strung) -> tuple[bool, str]:
    """The verifier's, and the group that refused it."""
    if forged.answer.has("times_s"):
        walk = check_trajectory(forged.answer)
        return walk.accepted, walk.refused[0].name if walk.refused else walk.defect
    report = check_plan(forged.answer, joints=True)
    broken = [group.name for group in report.refused if group.name in ("bodies", "motion")]
    return report.accepted, broken[0] if broken else report.message


KINDS: dict[str, Callable[[float, np.random.Generator], Strung]] = {
    f"{'walk' if walks else 'plan'}, {name}": (
        lambda size, rng, walks=walks, when=when: strung(
            stepping() if walks else honest_plan(), when, size, rng
        )
    )
    for walks in (False, True)
    for name, when in (
        ("at its beginning", 0.0),
        ("on the way", 0.5),
        ("shortly after a moment", 0.2),
    )
}


def _motion(answer: Motion) -> tuple[RobotModel, Array]:
    """The robot's model, and its joints at the moments that the verifier looks at."""
    if answer.keyed:
        assert answer.problem.robot.model is not None
        solver = Kinematics(answer.problem.robot, gravity_m_s2=answer.problem.gravity_m_s2)
        return answer.problem.robot.model, JointPath(PlanPath(answer), solver).judged()[1].angles
    assert answer.robot.model is not None
    body = WholeBodyMeasurements(TrajectoryMeasurements(answer))
    return answer.robot.model, body.spaced()[1].angles


def _with_model(answer: Motion, model: RobotModel) -> Any:
    if answer.has("times_s"):
        return answer.asked(robot=replace(answer.robot, model=model))
    return replace(
        answer, problem=replace(answer.problem, robot=replace(answer.problem.robot, model=model))
    )


@cache
def _built(urdf: str) -> tuple[Any, Any]:
    model = pinocchio.buildModelFromXML(urdf, pinocchio.JointModelFreeFlyer())
    return model, model.createData()


def _placed(model: RobotModel, angles: Array, link: str, at: Array) -> Array:
    """Where a point of a link is in the base [m]."""
    known, data = _built(model.urdf)
    state = pinocchio.neutral(known)
    names = [name for leg in model.legs for name in leg.joint_names]
    for name, angle in zip(names, angles, strict=True):
        state[known.joints[known.getJointId(name)].idx_q] = angle
    pinocchio.framesForwardKinematics(known, data, state)
    base, frame = (
        data.oMf[known.getFrameId(name, pinocchio.FrameType.BODY)] for name in ("base", link)
    )
    return np.asarray(base.actInv(frame.act(at)))
