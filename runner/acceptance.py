"""Motions that may be run: plans, gaits, leaps and crossings that the verifier accepted, for the
robot that the world has.

They are judged once, when they come in: ``Accepted.from_file`` and ``Accepted.verified`` are the
border. Behind it frozen values pass by reference (docs/SECURITY.md says what that
trusts).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from stancekit.planners.answer.certificate import Crossing
from stancekit.planners.answer.plan import LeapPlan, Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.codec import to_json
from stancekit.planners.files.documents import read_json
from stancekit.planners.formats.crossing_file import is_crossing_file, read_crossing
from stancekit.planners.formats.leap_file import read_leap
from stancekit.planners.formats.plan_file import read_plan
from stancekit.planners.formats.trajectory_file import is_trajectory, read_trajectory
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.problem.leap import is_leap_file
from stancekit.planners.robot import Robot
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.robot.robot_file import joint_names
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import Report, check_plan
from stancekit.planners.verify.crossings import check_crossing
from stancekit.planners.verify.geometry import tipping
from stancekit.planners.verify.leaps import check_leap
from stancekit.planners.verify.postures import joint_report
from stancekit.planners.verify.trajectories import check_trajectory

from .worlds.world import Ground, World

S = TypeVar("S", bound=Plan | Trajectory | LeapPlan | Crossing)


@dataclass(frozen=True, kw_only=True, eq=False)
class Accepted(Generic[S]):
    """A motion that may be run: a plan of a course, a gait, a leap or a crossing.

    Arguments:
        plan: the motion; of a gait its trajectory.
        digest: the verifier's.
        source: where it comes from, for messages.
    """

    plan: S
    digest: str
    source: str

    @classmethod
    def from_file(cls, path: str | Path) -> Accepted[Any]:
        """Read a file of any of these.

        Raises InvalidInput for one that was edited since, that the verifier rejected, or that it
        rejects now (a digest shows that a file is whole, not that it is right), for one without a
        motion, and for a robot whose joints are not known.
        """
        source = str(path)
        if is_leap_file(path):
            leap = read_leap(path).plan
            if leap is None:
                raise InvalidInput(f"{path}: expected a leap with a plan, got none")
            return Accepted.verified(leap, source)
        if is_crossing_file(path):
            return Accepted.verified(read_crossing(path), source)
        if Path(path).suffix == ".json" and is_trajectory(read_json(path)):
            record = read_trajectory(path)
            if not record.verified:
                raise InvalidInput(
                    f"{path}: expected a gait that the verifier accepted, this one it rejected"
                )
            gait = Accepted.verified(record.trajectory, source)
            if gait.digest != record.verdict.get("digest"):
                raise InvalidInput(
                    f"{path}: expected the gait that its verdict is of, got one edited or judged "
                    "otherwise"
                )
            return gait
        plan, header = read_plan(path)
        if not (header["verified"] and header["verdict"]["accepted"]):
            raise InvalidInput(
                f"{path}: expected a plan that the verifier accepted, this one it rejected"
            )
        return Accepted.verified(plan, source)

    @classmethod
    def verified(cls, plan: S, source: str) -> Accepted[S]:
        """Verify a motion now.

        Raises InvalidInput for one that is rejected, that no runner executes, or whose robot's
        joints are not known; a leap has to begin and end at rest, and to be judged with its legs.
        """
        if isinstance(plan, LeapPlan):
            digest = _leap(plan, source)
        elif isinstance(plan, Crossing):
            digest = _crossing(plan, source)
        elif isinstance(plan, Plan):
            digest = _plan(plan, source)
        else:
            digest = _gait(plan, source)
        return Accepted(plan=plan, digest=digest, source=source)

    @cached_property
    def robot(self) -> Robot:
        """The robot that moves."""
        if isinstance(self.plan, Trajectory):
            return walking_robot(self.plan.robot)
        return self.plan.robot if isinstance(self.plan, Crossing) else self.plan.problem.robot

    @property
    def name(self) -> str:
        """Name of the course or the leap; of a gait that of its terrain."""
        if isinstance(self.plan, Trajectory):
            return self.plan.terrain.name or "gait"
        return self.plan.name if isinstance(self.plan, Crossing) else self.plan.problem.name

    @property
    def gravity_m_s2(self) -> float:
        """Gravity that it counts on [m/s²]."""
        if isinstance(self.plan, Trajectory | LeapPlan):
            return GRAVITY_M_S2
        course = self.plan.first if isinstance(self.plan, Crossing) else self.plan.problem
        return course.gravity_m_s2

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...] | Ground:
        """The terrain of a world, with this share of the friction that it counts on; of a leap the
        surfaces that are taken.
        """
        plan: Plan | Trajectory | LeapPlan | Crossing = self.plan
        if isinstance(plan, Trajectory):
            return Ground(heights=plan.terrain, friction=friction_share * plan.friction)
        if isinstance(plan, Plan):
            return slippery(plan.problem, friction_share).terrain
        if isinstance(plan, Crossing):
            patches = plan.terrain
        else:
            feet = range(len(plan.problem.footholds))
            patches = tuple(plan.problem.patch(j, plan.choice) for j in feet)
        return tuple(replace(patch, friction=friction_share * patch.friction) for patch in patches)


def check_stands(accepted: Accepted[Plan], least_push: float) -> None:
    """Raise InvalidInput for a plan that is about to tip.

    Arguments:
        least_push: that every stance has to bear, as a share of the weight.
    """
    if tips := tipping(accepted.plan, least_push):
        raise InvalidInput(f"{accepted.source}: {tips}; least_push 0 runs it all the same")


def check_fits(accepted: Accepted[Plan], world: World) -> None:
    """Raise InvalidInput unless the world has the plan's robot, and its joints can take every pose
    of the plan.
    """
    check_joints(accepted.source, accepted.robot, world, accepted.gravity_m_s2)
    report = joint_report(accepted.plan, world.servo)
    if not report.accepted:
        raise InvalidInput(
            f"{accepted.source}: expected joints that can do it, they cannot: {report.message}"
        )


def _plan(plan: Plan, source: str) -> str:
    """Digest of the verdict on a plan.

    Raises InvalidInput for one that is rejected.
    """
    if plan.problem.is_posture:
        raise InvalidInput(
            f"{source}: expected the plan of a course, got that of a posture problem"
        )
    plan.problem.check_whole()
    report = judged(plan)
    if not report.accepted:
        raise InvalidInput(f"{source}: expected a plan that the verifier accepts, {_said(report)}")
    _check_hindrance(report, source)
    return report.digest


def _gait(trajectory: Trajectory, source: str) -> str:
    """Digest of the verdict on a gait.

    Raises InvalidInput for one that is rejected, or whose robot's joints are not known.
    """
    report = check_trajectory(trajectory)
    if not report.accepted:
        raise InvalidInput(
            f"{source}: expected a gait that the verifier accepts, it says: {report.message}"
        )
    _check_hindrance(report, source)
    walking_robot(trajectory.robot)
    return report.digest


def _leap(plan: LeapPlan, source: str) -> str:
    """Digest of the verdict on a leap.

    Raises InvalidInput for one that is rejected, whose whole body was not judged, or that begins or
    ends in motion.
    """
    if not all(plan.problem.still):
        raise InvalidInput(
            f"{source}: expected a leap that begins and ends at rest, got one in motion"
        )
    report = check_leap(plan, body=True)
    if not report.accepted:
        raise InvalidInput(f"{source}: expected a leap that the verifier accepts, {_said(report)}")
    if report.unchecked:
        left = ", ".join(report.unchecked)
        raise InvalidInput(
            f"{source}: expected a leap that was judged with legs, {left} not checked: plan it "
            "with --robot FILE"
        )
    return report.digest


def _crossing(crossing: Crossing, source: str) -> str:
    """Digest of the verdict on a crossing.

    Raises InvalidInput for one that is rejected, or of which something was not judged.
    """
    if not any(isinstance(part, LeapPlan) for part in crossing.parts):
        raise InvalidInput(f"{source}: expected a leap among its parts, got climbs alone")
    report = check_crossing(crossing)
    if not report.accepted or report.unchecked:
        raise InvalidInput(
            f"{source}: expected a crossing that the verifier accepts, {report.message}"
        )
    for k, part in enumerate(crossing.parts, 1):
        if isinstance(part, Plan):
            _plan(part, f"{source}: part {k}")
    return report.digest


def _check_hindrance(report: Report[Plan | Trajectory], source: str) -> None:
    """Raise InvalidInput for what is accepted and no runner executes."""
    if report.hindrance:
        what = "plan" if isinstance(report.answer, Plan) else "gait"
        raise InvalidInput(
            f"{source}: expected a {what} that can be executed, this one cannot: {report.hindrance}"
        )


def judged(plan: Plan) -> Report[Plan]:
    """The verifier on a plan; on joints and motion, too, where it has angles or the robot has legs
    of its own.
    """
    return check_plan(plan, joints=plan.joints_rad is not None or plan.problem.robot.source.own)


def _said(report: Report[Plan] | Report[LeapPlan]) -> str:
    return f"{report.message}; {report.body_message}" if report.body_message else report.message


def check_joints(source: str, robot: Robot, world: World, gravity_m_s2: float) -> None:
    """Raise InvalidInput unless the world has the robot's joints, in their order, is for such a
    robot, and pulls as it is planned for, where it says how it pulls.
    """
    wanted, there = joint_names(robot), world.joints
    if tuple(there) != wanted:
        lack, more = sorted(set(wanted) - set(there)), sorted(set(there) - set(wanted))
        differences = "; ".join(
            f"{word} {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
            for word, names in (("it lacks", lack), ("it has besides", more))
            if names
        )
        raise InvalidInput(
            f"{source}: expected world {world.name} to have the robot's {len(wanted)} joints in "
            "their order" + (f": {differences}" if differences else ", it has them in another")
        )
    wrong = _differs(robot, world.robot)
    if wrong:
        raise InvalidInput(
            f"{source}: expected the world's robot, the plan is for another: {wrong}"
        )
    pulls = getattr(world, "gravity_m_s2", None)
    if pulls is not None and not np.isclose(pulls, gravity_m_s2, rtol=1e-6):
        raise InvalidInput(
            f"{source}: expected the world's gravity, {pulls:g} m/s², the plan is for another: "
            f"{gravity_m_s2:g} m/s²"
        )


def _differs(plan: Robot, world: Robot) -> str:
    """The first number in which two robots differ; empty where there is none."""
    if not np.isclose(plan.mass_kg, world.mass_kg, rtol=1e-6):
        return f"{plan.mass_kg:g} kg and {world.mass_kg:g} kg"
    models = [robot.source.digest for robot in (plan, world)]
    if models[0] != models[1]:
        return (
            "their legs are of different files"
            if all(models)
            else "only one of them has legs of its own"
        )
    for mine, other in zip(plan.limbs, world.limbs, strict=True):
        if not np.isclose(mine.reach_m, other.reach_m, rtol=1e-6):
            return f"limb {mine.name} reaches {mine.reach_m:g} m and {other.reach_m:g} m"
        if not np.allclose(mine.shoulder_m, other.shoulder_m, atol=1e-6):
            return f"limb {mine.name} begins at {mine.shoulder_m.tolist()} and {other.shoulder_m.tolist()}"
        sets = [to_json(limb.reach_rows) for limb in (mine, other)]
        if sets[0] != sets[1]:
            return f"limb {mine.name} has other half-spaces of reach"
    return ""
