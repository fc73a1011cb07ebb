"""Gaits that may be run: trajectories that the verifier accepted, for a robot whose joints are known, at their pace."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.gait.trajectory_file import read_trajectory
from stancekit.planners.robot import Robot, hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.single_body import GRAVITY_M_S2, GaitRobot
from stancekit.planners.verify.trajectories import check_trajectory

from .acceptance import check_joints, proven
from .control.tracker import Feel, Tracker
from .execution import Execution, Tolerance, compared, traced
from .motion.gait_motion import GaitMotion
from .motion.time_parametrization import ACCELERATION_RAD_S2, BLIND, Look, check_still, look, uses_of
from .motion.timeline import Timing
from .prepared import Playable, sees_feet
from .report import Rows
from .safety.guard import SafeWorld
from .worlds.world import Ground, Solids, Terrain

SHARE = 0.9
"""Of the limits of velocity and torque that may be used."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AcceptedGait:
    """A trajectory that may be run, and the robot that walks it. digest: the verifier's; source: for messages."""

    trajectory: Trajectory
    robot: Robot
    digest: str
    source: str
    gravity_m_s2: float = GRAVITY_M_S2

    @classmethod
    def from_file(cls, path: str | Path) -> AcceptedGait:
        """Read a gait. Raises InvalidInput for one that was edited since, that the verifier rejected, or that it
        rejects now, and for a robot whose joints are not known."""
        record = read_trajectory(path)
        if not record.verified:
            raise InvalidInput(f"{path}: expected a gait that the verifier accepted, this one it rejected")
        report = check_trajectory(record.trajectory)
        if not report.accepted or report.digest != record.verdict.get("digest"):
            raise InvalidInput(f"{path}: expected a gait that the verifier accepts as its file says: {report.message}")
        try:
            robot = walker(record.trajectory.robot)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None
        return cls(trajectory=record.trajectory, robot=robot, digest=report.digest, source=str(path))

    @property
    def name(self) -> str:
        """Of its terrain."""
        return self.trajectory.terrain.name or "gait"

    def ground(self, friction_share: float = 1.0) -> Ground:
        """The terrain of a world, with this share of the friction that the gait counts on."""
        return Ground(heights=self.trajectory.terrain, friction=friction_share * self.trajectory.friction)


def walker(robot: GaitRobot) -> Robot:
    """The robot with limbs and joints that a gait was planned for. Raises InvalidInput where none is known.

    A gait's robot is a body with reach boxes; of the robots that come with the package the hexapod has joints, too.
    """
    known = hexapod()
    shoulders = {limb.name: limb.shoulder_m for limb in known.limbs}
    same = robot.foot_names == known.limb_names and np.isclose(robot.mass_kg, known.mass_kg)
    if not same or not all(np.allclose(foot.hip_m, shoulders[foot.name]) for foot in robot.feet):
        raise InvalidInput(
            f"expected a gait of the {known.name}, whose joints are known, got one of {robot.name}, "
            f"{robot.mass_kg:g} kg on {len(robot.feet)} feet"
        )
    return known


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedGait(Playable):
    """A gait."""

    counted = "seconds"
    trajectory: Trajectory
    ground: Ground
    walked: GaitMotion

    @property
    def content(self) -> Trajectory:
        """Its motion's trajectory."""
        return self.walked.trajectory

    @property
    def terrain(self) -> Terrain:
        """Heights."""
        return self.ground

    @property
    def surfaces(self) -> Solids:
        """The same."""
        return (self.ground,)

    def execution(self, world: SafeWorld, rows: Rows, wall_s: float) -> Execution:
        """By the stances of every foot."""
        trace = traced(rows.pairs, self.kinematics)
        goal = self.trajectory.torso_m[-1]
        return compared(goal, self.walked.stances, world, rows.pairs, trace, Tolerance(), None, wall_s)

    def logged(self) -> dict[str, Any]:
        """Where it goes."""
        return {"start_m": self.trajectory.torso_m[0], "goal_m": self.trajectory.torso_m[-1]}


def prepared_gait(accepted: AcceptedGait, world: SafeWorld, timing: Timing, feel: Feel, *, hung: bool) -> PreparedGait:
    """A gait for a world that it fits. Raises InvalidInput for one whose joints cannot do it, before anything moves."""
    trajectory = proven(accepted.trajectory, accepted.digest, accepted.source)
    accepted = AcceptedGait(
        trajectory=trajectory, robot=walker(trajectory.robot), digest=accepted.digest, source=accepted.source,
        gravity_m_s2=accepted.gravity_m_s2,
    )  # fmt: skip
    check_joints(accepted.source, accepted.robot, world)
    motion, sees = GaitMotion(trajectory), sees_feet(world)
    kinematics = Kinematics(accepted.robot, world.servo, gravity_m_s2=accepted.gravity_m_s2)
    seen = look(motion, kinematics, hung=hung)
    check_still(seen, kinematics, world.capabilities, SHARE)
    _check_pace(seen, world)
    moving = replace(feel, seek_m=0.0)  # it waits for no foot: its body moves on
    tracker = Tracker(motion, kinematics, world.rate_hz, moving if sees else BLIND)
    return PreparedGait(
        digest=accepted.digest, source=accepted.source, name=accepted.name, motion=motion, kinematics=kinematics,
        tracker=tracker, first=tracker.start(), sees=sees, pace=1.0, bound_by="", clearance_m=timing.clearance_m,
        total=motion.seconds, trajectory=trajectory, ground=accepted.ground(), walked=motion,
    )  # fmt: skip


def _check_pace(seen: Look, world: SafeWorld) -> None:
    """Raise InvalidInput where joints would have to move faster than they can: a gait cannot be slowed down."""
    can = world.capabilities
    for name, (use, joint) in uses_of(seen, can, ACCELERATION_RAD_S2, SHARE).items():
        if use > 1.0:
            raise InvalidInput(
                f"gait: joint {can.joints[joint]}: it would take {use:.2g} times the {name} that it may have; a gait "
                "runs as planned, or not at all: plan one that steps less high or less far"
            )
