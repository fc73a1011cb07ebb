"""Motions that may be run: plans and gaits that the verifier accepted, for the robot that the world
has.

They are judged once, when they come in: ``Accepted.from_file`` and ``Accepted.verified``, and those
of gaits, are the border. Behind it frozen values pass by reference (SECURITY.md says what that
trusts).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stancekit.planners.answer.crossing import Crossing
from stancekit.planners.answer.leap_plan import LeapPlan
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.codec import to_json
from stancekit.planners.formats.crossing_file import read_crossing
from stancekit.planners.formats.leap_file import read_leap
from stancekit.planners.formats.plan_file import read_plan
from stancekit.planners.formats.trajectory_file import read_trajectory
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.robot.urdf import joint_names
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import Report, check_plan
from stancekit.planners.verify.crossings import check_crossing
from stancekit.planners.verify.joints import joint_report
from stancekit.planners.verify.leaps import check_leap
from stancekit.planners.verify.tipping import tipping
from stancekit.planners.verify.trajectories import check_trajectory

from .worlds.world import Ground, World


@dataclass(frozen=True, kw_only=True, eq=False)
class Accepted:
    """A plan that may be run.

    Arguments:
        digest: the verifier's.
        source: where it comes from, for messages.
    """

    plan: Plan
    digest: str
    source: str

    @classmethod
    def from_file(cls, path: str | Path) -> Accepted:
        """Read a plan file.

        Raises InvalidInput for one that was edited since, that the verifier rejected, or that it
        rejects now: a digest shows that a file is whole, not that it is right.
        """
        plan, header = read_plan(path)
        if not (header["verified"] and header["verdict"]["accepted"]):
            raise InvalidInput(
                f"{path}: expected a plan that the verifier accepted, this one it rejected"
            )
        return cls.verified(plan, str(path))

    @classmethod
    def verified(cls, plan: Plan, source: str) -> Accepted:
        """Verify a plan now.

        Raises InvalidInput for one that is rejected.
        """
        if plan.problem.is_posture:
            raise InvalidInput(
                f"{source}: expected the plan of a course, got that of a posture problem"
            )
        plan.problem.check_whole()
        report = judged(plan)
        if not report.accepted:
            raise InvalidInput(
                f"{source}: expected a plan that the verifier accepts, {_said(report)}"
            )
        _check_hindrance(report, source)
        return cls(plan=plan, digest=report.digest, source=source)

    def check_stands(self, least_push: float) -> None:
        """Raise InvalidInput for a plan that is about to tip.

        Arguments:
            least_push: that every stance has to bear, as a share of the weight.
        """
        if tips := tipping(self.plan, least_push):
            raise InvalidInput(f"{self.source}: {tips}; least_push 0 runs it all the same")

    def check_fits(self, world: World) -> None:
        """Raise InvalidInput unless the world has the plan's robot, and its joints can take every
        pose of the plan.
        """
        check_joints(self.source, self.plan.problem.robot, world, self.plan.problem.gravity_m_s2)
        report = joint_report(self.plan, world.servo)
        if not report.accepted:
            raise InvalidInput(
                f"{self.source}: expected joints that can do it, they cannot: {report.message}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class AcceptedGait:
    """A trajectory that may be run, and the robot that walks it.

    Arguments:
        digest: the verifier's.
        source: for messages.
    """

    trajectory: Trajectory
    robot: Robot
    digest: str
    source: str
    gravity_m_s2: float = GRAVITY_M_S2

    @classmethod
    def from_file(cls, path: str | Path) -> AcceptedGait:
        """Read a gait.

        Raises InvalidInput for one that was edited since, that the verifier rejected, or that it
        rejects now, and for a robot whose joints are not known.
        """
        record = read_trajectory(path)
        if not record.verified:
            raise InvalidInput(
                f"{path}: expected a gait that the verifier accepted, this one it rejected"
            )
        accepted = cls.verified(record.trajectory, str(path))
        if accepted.digest != record.verdict.get("digest"):
            raise InvalidInput(
                f"{path}: expected the gait that its verdict is of, got one edited or judged otherwise"
            )
        return accepted

    @classmethod
    def verified(cls, trajectory: Trajectory, source: str) -> AcceptedGait:
        """Verify a gait now.

        Raises InvalidInput for one that is rejected, or whose robot's joints are not known.
        """
        report = check_trajectory(trajectory)
        if not report.accepted:
            raise InvalidInput(
                f"{source}: expected a gait that the verifier accepts, it says: {report.message}"
            )
        _check_hindrance(report, source)
        robot = walking_robot(trajectory.robot)
        return cls(trajectory=trajectory, robot=robot, digest=report.digest, source=source)

    @property
    def name(self) -> str:
        """Name of its terrain."""
        return self.trajectory.terrain.name or "gait"

    def ground(self, friction_share: float = 1.0) -> Ground:
        """The terrain of a world, with this share of the friction that the gait counts on."""
        return Ground(
            heights=self.trajectory.terrain, friction=friction_share * self.trajectory.friction
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class AcceptedLeap:
    """A leap that may be run.

    Arguments:
        digest: the verifier's.
        source: for messages.
    """

    plan: LeapPlan
    digest: str
    source: str
    gravity_m_s2: float = GRAVITY_M_S2

    @property
    def robot(self) -> Robot:
        """The robot that leaps."""
        return self.plan.problem.robot

    @property
    def name(self) -> str:
        """Name of the leap."""
        return self.plan.problem.name

    @classmethod
    def from_file(cls, path: str | Path) -> AcceptedLeap:
        """Read a leap's file.

        Raises InvalidInput for one without a plan, or whose plan the verifier rejects.
        """
        plan = read_leap(path).plan
        if plan is None:
            raise InvalidInput(f"{path}: expected a leap with a plan, got none")
        return cls.verified(plan, str(path))

    @classmethod
    def verified(cls, plan: LeapPlan, source: str) -> AcceptedLeap:
        """Verify a leap now.

        Raises InvalidInput for one that is rejected, whose whole body was not judged, or that begins
        or ends in motion.
        """
        if not all(plan.problem.still):
            raise InvalidInput(f"{source}: expected a leap that begins and ends at rest")
        report = check_leap(plan, body=True)
        if not report.accepted:
            raise InvalidInput(
                f"{source}: expected a leap that the verifier accepts, {_said(report)}"
            )
        if report.unchecked:
            left = ", ".join(report.unchecked)
            raise InvalidInput(
                f"{source}: expected a leap that was judged with legs, {left} not checked: plan it with --robot FILE"
            )
        return cls(plan=plan, digest=report.digest, source=source)

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...]:
        """The surfaces that are taken, with this share of their friction."""
        leap = self.plan.problem
        patches = [leap.patch(j, self.plan.choice) for j in range(len(leap.footholds))]
        return tuple(replace(patch, friction=friction_share * patch.friction) for patch in patches)


@dataclass(frozen=True, kw_only=True, eq=False)
class AcceptedCrossing:
    """A crossing that may be run.

    Arguments:
        digest: the verifier's.
        source: for messages.
    """

    plan: Crossing
    digest: str
    source: str

    @property
    def robot(self) -> Robot:
        """The robot that crosses."""
        return self.plan.robot

    @property
    def name(self) -> str:
        """Name of the course."""
        return self.plan.name

    @property
    def gravity_m_s2(self) -> float:
        """Gravity of its course [m/s²]."""
        return self.plan.first.gravity_m_s2

    @classmethod
    def from_file(cls, path: str | Path) -> AcceptedCrossing:
        """Read a crossing's file.

        Raises InvalidInput for one that was edited since, or that the verifier rejects.
        """
        return cls.verified(read_crossing(path), str(path))

    @classmethod
    def verified(cls, crossing: Crossing, source: str) -> AcceptedCrossing:
        """Verify a crossing now.

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
                Accepted.verified(part, f"{source}: part {k}")
        return cls(plan=crossing, digest=report.digest, source=source)

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...]:
        """All of the terrain, with this share of its friction."""
        return tuple(
            replace(patch, friction=friction_share * patch.friction) for patch in self.plan.terrain
        )


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
            f"{source}: expected world {world.name} to have the robot's {len(wanted)} joints in their order"
            + (f": {differences}" if differences else ", it has them in another")
        )
    wrong = _differs(robot, world.robot)
    if wrong:
        raise InvalidInput(
            f"{source}: expected the world's robot, the plan is for another: {wrong}"
        )
    pulls = getattr(world, "gravity_m_s2", None)
    if pulls is not None and not np.isclose(pulls, gravity_m_s2, rtol=1e-6):
        raise InvalidInput(
            f"{source}: expected the world's gravity, {pulls:g} m/s², the plan is for another: {gravity_m_s2:g} m/s²"
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
