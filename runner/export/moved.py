"""A motion on its way out, and the scene that it is of."""

from __future__ import annotations

from dataclasses import dataclass

from stancekit.planners.answer.certificate import Crossing
from stancekit.planners.answer.plan import LeapPlan, MotionTable, Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.robot.model import Robot

from ..worlds.world import Ground, Terrain

Subject = Plan | Trajectory | LeapPlan | Crossing


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A motion on its way out: its table, who moves, over what, and at which moments key frames are
    reached [s].

    Arguments:
        without: why there are no joints, empty where there are.
    """

    table: MotionTable
    robot: Robot | None
    terrain: Terrain
    gravity_m_s2: float
    keys_s: tuple[float, ...] = ()
    without: str = ""


def scene_of(subject: Subject) -> tuple[Robot | None, tuple[str, ...], Terrain, float]:
    """Robot that moves, the names of its limbs, the terrain, and the mass of all."""
    match subject:
        case Plan():
            course = subject.problem
            chosen = tuple(course.patch(p, subject.choice) for p in range(len(course.footholds)))
            return (
                course.robot,
                course.robot.limb_names,
                course.terrain or chosen,
                course.gravity_m_s2,
            )
        case Trajectory():
            ground = Ground(heights=subject.terrain, friction=subject.friction)
            try:
                robot: Robot | None = walking_robot(subject.robot)
            except InvalidInput:
                robot = None
            return robot, subject.robot.limb_names, ground, GRAVITY_M_S2
        case LeapPlan():
            leap = subject.problem
            patches = tuple(leap.patch(j, subject.choice) for j in range(len(leap.footholds)))
            return leap.robot, leap.robot.limb_names, patches, GRAVITY_M_S2
        case Crossing():
            return (
                subject.robot,
                subject.robot.limb_names,
                subject.terrain,
                subject.first.gravity_m_s2,
            )
