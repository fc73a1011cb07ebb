"""Pictures of an execution: the robot as the world had it, its joints, what its feet felt, and the way it went."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.urdf import FOOT_RADIUS_M
from stancekit.runner.execution import Execution

from . import plot as chart
from .painter import FORCE, Painter
from .plan_motion import Moment
from .plan_picture import VIDEO_PX, PlanStage
from .plot import DEFAULT_STYLE, SIZE_PX, Size
from .posture_picture import Scene

REAL = "#c2410c"
SPEED = 2.0
"""Videos run this much faster than the world."""
FPS = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Jointed(Scene):
    """The scene with the limbs as their joints have them. chains: shape (N, 4, 3) [m], world frame."""

    chains: Array

    def legs(self) -> list[Array]:
        """Shoulder, roll joint, knee and foot of every limb."""
        return list(self.chains)


class ExecutionStage(PlanStage):
    """A plan's stage on which its execution plays. Raises InvalidInput without pinocchio."""

    def __init__(self, plan: Plan, execution: Execution) -> None:
        super().__init__(plan)
        self.execution, self._row = execution, 0
        self._kinematics = Kinematics(plan.course.robot)

    def moment(self, row: int) -> Moment:
        """What the world had after a control period; it is what ``scene`` draws until another is asked for."""
        trace, self._row = self.execution.trace, row
        frame = min(round(float(trace.frame[row])), self.plan.course.frames - 1)
        course, choice = self.plan.course, self.plan.choice
        normals = np.array([course.patch(int(p), choice).normal for p in course.holds[frame]])
        return Moment(
            frame=frame,
            com_m=trace.origin_m[row],
            rotation_rad=Rotation.from_matrix(trace.rotation[row]).as_rotvec(),
            toes_m=trace.feet_m[row] - FOOT_RADIUS_M * normals,
            forces_n=trace.forces_n[row],
        )

    def scene(self, moment: Moment) -> Scene:
        """The robot at the moment that was asked for last."""
        trace, plain = self.execution.trace, super().scene(moment)
        chains = self._kinematics.chains(trace.angles_rad[self._row])
        chains = trace.origin_m[self._row] + chains @ trace.rotation[self._row].T
        return _Jointed(problem=plain.problem, posture=plain.posture, chains=chains)

    def draw_way(self, painter: Painter, row: int) -> None:
        """The way that the centre of mass went, over the planned one."""
        way = self.execution.trace.com_m[: row + 1 : 20]
        for pair in pairwise(way):
            painter.face(np.array(pair), "none", FORCE, edge=REAL, width=1.4, depth=65.0)

    def figure(self, row: int, caption: str, note: str, size_px: Size) -> Figure:
        """The sheet of one moment."""
        sheet, painter, moment = chart.sheet(size_px, SIZE_PX), self.painter(), self.moment(row)
        self.draw_ground(painter, moment.frame)
        self.draw_robot(painter, moment)
        self.draw_path(painter)
        self.draw_way(painter, row)
        painter.paint(chart.plain_axes(sheet, 10.0, 10.0, 92.0))
        chart.headline(sheet, caption, note)
        return sheet


@DEFAULT_STYLE
def draw_execution(
    plan: Plan, execution: Execution, *, time_s: float | None = None, caption: str = "", size_px: Size = SIZE_PX
) -> Figure:
    """Draw the robot as the world had it at a time, at the end unless one is named, and the way it went (red)."""
    trace = execution.trace
    last = len(trace.time_s) - 1
    row = last if time_s is None else min(int(np.searchsorted(trace.time_s, time_s)), last)
    title = caption or f"{plan.course.name} in {execution.world}: {'done' if execution.succeeded else 'failed'}"
    return ExecutionStage(plan, execution).figure(row, title, _note(execution, row), size_px)


def execution_frames(plan: Plan, execution: Execution, *, size_px: Size = VIDEO_PX) -> Iterator[NDArray[np.uint8]]:
    """The pictures of a video, uint8 of shape (H, W, 3), one by one, ``FPS`` a second at ``SPEED`` times the pace."""
    stage, times = ExecutionStage(plan, execution), execution.trace.time_s
    for time_s in np.arange(0.0, times[-1], SPEED / FPS):
        yield _pixels(stage, int(np.searchsorted(times, time_s)), size_px)


@DEFAULT_STYLE
def _pixels(stage: ExecutionStage, row: int, size_px: Size) -> NDArray[np.uint8]:
    plan, execution = stage.plan, stage.execution
    title = f"{plan.course.name} in {execution.world}"
    return chart.to_rgb(stage.figure(row, title, _note(execution, row), size_px))


def _note(execution: Execution, row: int) -> str:
    trace = execution.trace
    away = 1e3 * float(np.linalg.norm(trace.com_m[row] - trace.planned_com_m[row]))
    return (
        f"{trace.time_s[row]:.1f} s   ·   centre of mass {away:.1f} mm from the plan   ·   "
        f"largest torque so far {np.abs(trace.torques_nm[: row + 1]).max():.1f} of {execution.torque_limit_nm:g} Nm"
    )
