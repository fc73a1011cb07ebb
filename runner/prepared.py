"""Motions that are ready to go on a world: checked, timed, and with a tracker that has not begun."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.robot.kinematics import Kinematics

from .acceptance import Accepted, proven
from .control.force_distribution import shared_forces
from .control.tracker import Feel, Target, Tracker
from .execution import Execution, Tolerance, judged, traced
from .motion.time_parametrization import BLIND, expected, paced
from .motion.timeline import Followed, Motion, Timing
from .report import Rows
from .safety.guard import SafeWorld
from .worlds.world import Solids, Terrain


@dataclass(frozen=True, kw_only=True, eq=False)
class Playable(ABC):
    """What the runner plays. first: the target before the first period. sees: the world feels its feet.

    pace: of that asked for, 1 where it was slow enough; bound_by: what slowed it down. clearance_m: how far feet are
    lifted where the way to the first pose is not clear. total: the last ``Instant.frame``; counted: what that counts.
    """

    digest: str
    source: str
    name: str
    motion: Followed
    kinematics: Kinematics
    tracker: Tracker
    first: Target
    sees: bool
    pace: float
    bound_by: str
    clearance_m: float
    total: float
    counted: ClassVar[Literal["key frames", "seconds"]] = "key frames"

    @property
    @abstractmethod
    def content(self) -> Plan | Trajectory:
        """What its motion plays."""

    @property
    @abstractmethod
    def terrain(self) -> Terrain:
        """What it was made for."""

    @property
    @abstractmethod
    def surfaces(self) -> Solids:
        """What feet stay out of."""

    @abstractmethod
    def execution(self, world: SafeWorld, rows: Rows, wall_s: float) -> Execution:
        """What was measured against what was planned."""

    @abstractmethod
    def logged(self) -> dict[str, Any]:
        """What a log keeps of it, beside what all have."""

    def next(self, felt: Array, time_s: float) -> Target | None:
        """The target of the period that ends at a time, None at the end. felt: by the feet just now, (N, 3) [N]."""
        return self.tracker.next(felt if self.sees else expected(self.motion.at(time_s)))

    def sendable(self, target: Target) -> Array:
        """What is sent of a target, shape (J,): where nothing is felt nothing is pressed, either."""
        return target.targets_rad if self.sees else target.angles_rad


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared(Playable):
    """A plan of key frames."""

    motion: Motion
    plan: Plan
    solids: Solids

    @property
    def content(self) -> Plan:
        """Its motion's plan."""
        return self.motion.plan

    @property
    def terrain(self) -> Terrain:
        """The course's patches."""
        return self.plan.course.terrain

    @property
    def surfaces(self) -> Solids:
        """Its solids."""
        return self.solids

    def execution(self, world: SafeWorld, rows: Rows, wall_s: float) -> Execution:
        """By the placements of the course."""
        return judged(self.plan, world, rows.pairs, traced(rows.pairs, self.kinematics), Tolerance(), None, wall_s)

    def logged(self) -> dict[str, Any]:
        """The key frames."""
        plan = self.plan
        return {"com_m": plan.com_m, "toes_m": plan.toes_m, "holds": plan.course.holds}


def prepared_plan(
    accepted: Accepted, world: SafeWorld, timing: Timing, feel: Feel, *, hung: bool, kinematics: Kinematics | None
) -> Prepared:
    """A plan, timed for a world that it fits. Raises InvalidInput where it does not, or is not what was accepted."""
    plan, sees = proven(accepted.plan, accepted.digest, accepted.source), sees_feet(world)
    accepted = Accepted(plan=plan, digest=accepted.digest, source=accepted.source)
    accepted.check_fits(world)
    course = plan.course
    kinematics = kinematics or Kinematics(course.robot, world.servo, gravity_m_s2=course.gravity_m_s2)
    timed = paced(plan, kinematics, world.capabilities, timing, forces_n=shared_forces(plan), hung=hung)
    tracker = Tracker(timed.motion, kinematics, world.rate_hz, feel if sees else BLIND)
    return Prepared(
        digest=accepted.digest, source=accepted.source, name=course.name, motion=timed.motion, kinematics=kinematics,
        tracker=tracker, first=tracker.start(), sees=sees, pace=timed.pace, bound_by=timed.bound_by,
        clearance_m=timed.motion.timing.clearance_m, total=course.frames - 1, plan=plan, solids=timed.motion.solids,
    )  # fmt: skip


def sees_feet(world: SafeWorld) -> bool:
    """Whether what feet feel comes back."""
    return world.capabilities.has_contact_forces and not world.dry


def check_hung(hung: bool, world: SafeWorld) -> None:
    """Raise InvalidInput for a robot that should hang where none can."""
    if hung and not world.real:
        raise InvalidInput(f"hung: expected a robot that can hang in a stand, world {world.name} has none")
