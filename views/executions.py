"""Pictures and films of an execution: the robot as the world had it, its joints, what its feet
felt, and its path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.motion.motion import Samples
from stancekit.runner.execution import Execution
from stancekit.runner.record import TOUCH_N

from .contact_strip import FILM_PX as WALK_PX
from .film import film_frames
from .gaits import GRID_M, motion_frames
from .plans import FILM_PX, PlanView
from .scene import UP, Animation, Layer, Path, Scene
from .shapes import polyline
from .sheet import DEFAULT_STYLE, SIZE_PX, Size, headline, plain_axes, sheet
from .still import Still
from .terrain import SCALE
from .video import Frame

REAL = "#c2410c"
SPEED = 2.0
"""Films run this much faster than the world."""
FPS, WALK_FPS = 20.0, 30.0
"""Pictures per second of films of plans, and of walks, which are as fast as the world."""


@dataclass(frozen=True, eq=False)
class ExecutionView(PlanView):
    """A plan on which its execution plays.

    Raises InvalidInput without pinocchio.
    """

    execution: Execution

    def instant(self, row: int) -> Samples:
        """Sample of the world after a control period, with the footholds of the nearest key
        frame.
        """
        trace = self.execution.trace
        key = self.keys.key(min(round(float(trace.frame[row])), self.plan.problem.frames - 1))
        return replace(
            key,
            com_m=trace.com_m[row],
            rotation_rad=Rotation.from_matrix(trace.rotation[row]).as_rotvec(),
            feet_m=trace.feet_m[row],
            forces_n=trace.forces_n[row],
            origin_m=trace.origin_m[row],
            angles_rad=trace.angles_rad[row],
            torques_nm=trace.torques_nm[row],
        )

    def row(self, row: int, *, cone_m: float | None = None) -> Scene:
        """The robot after a control period, on the patches that it stands on."""
        return self.at(self.instant(row), cone_m=cone_m)

    def path(self, row: int) -> Scene:
        """The path that the centre of mass went, over the planned one."""
        went = self.execution.trace.com_m[: row + 1 : 20]
        return Scene(
            paths=[
                Path(pieces_m=polyline(went), colour=REAL, width=1.4, layer=Layer.TOP, lift_m=65.0)
            ]
        )

    def note(self, row: int) -> str:
        """Note on the distance from the plan."""
        trace = self.execution.trace
        away = 1e3 * float(np.linalg.norm(trace.com_m[row] - trace.planned_com_m[row]))
        most = np.abs(trace.torques_nm[: row + 1]).max()
        return (
            f"{trace.time_s[row]:.1f} s   ·   centre of mass {away:.1f} mm from the plan   ·   "
            f"largest torque so far {most:.1f} of {self.execution.torque_limit_nm:g} Nm   ·   {SCALE}"
        )

    def played(self) -> Animation:
        """The execution as a motion, ``FPS`` moments a second at ``SPEED`` times the pace."""
        times = self.execution.trace.time_s
        shown = np.arange(frame_count(self.execution)) * SPEED / FPS
        rows = np.searchsorted(times, shown).tolist()
        return Animation(
            fixed=self.fixed + self.path(len(times) - 1),
            moments=[self.row(row, cone_m=0.3 * self.shape.size_m) for row in rows],
            step_s=1.0 / FPS,
            camera=self.camera,
            title=f"{self.plan.problem.name} in {self.execution.world}, at {SPEED:g} times its pace",
            notes=[self.note(row) for row in rows],
            legend=[*self.legend, (REAL, "path that was gone")],
        )


@DEFAULT_STYLE
def draw_execution(
    plan: Plan,
    execution: Execution,
    *,
    time_s: float | None = None,
    caption: str = "",
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw the robot as the world had it at a time, at the end unless one is named, and the path it
    went (red).
    """
    view, trace = ExecutionView(plan, execution), execution.trace
    last = len(trace.time_s) - 1
    row = last if time_s is None else min(int(np.searchsorted(trace.time_s, time_s)), last)
    figure = sheet(size_px, SIZE_PX)
    Still(view.fixed + view.row(row) + view.path(row), view.camera).paint(
        plain_axes(figure, 10.0, 10.0, 92.0)
    )
    title = (
        caption
        or f"{plan.problem.name} in {execution.world}: {'done' if execution.succeeded else 'failed'}"
    )
    headline(figure, title, view.note(row))
    return figure


def execution_frames(
    plan: Plan, execution: Execution, *, size_px: Size = FILM_PX
) -> Iterator[Frame]:
    """The frames of a film, uint8 of shape (H, W, 3), one by one, ``FPS`` a second at ``SPEED``
    times the pace.
    """
    return film_frames(ExecutionView(plan, execution).played(), size_px)


def frame_count(execution: Execution) -> int:
    """Pictures of a film of an executed plan."""
    return int(np.ceil(execution.trace.time_s[-1] * FPS / SPEED))


def walked(trajectory: Trajectory, execution: Execution) -> Trajectory:
    """A trajectory as the world had it: the body, the feet and what they felt, a sample a control
    period.
    """
    trace, legs = execution.trace, trajectory.robot.source
    centre, radii = legs.origin_m, legs.foot_radii_m
    return replace(
        trajectory,
        times_s=trace.time_s,
        torso_m=trace.origin_m + trace.rotation @ centre,
        rotation=trace.rotation,
        feet_m=trace.feet_m - radii[:, None] * UP,
        forces_n=trace.forces_n,
        contact=np.linalg.norm(trace.forces_n, axis=2) > TOUCH_N,
    )


def walk_frames(
    trajectory: Trajectory, execution: Execution, *, size_px: Size = WALK_PX
) -> Iterator[Frame]:
    """The frames of an executed walk's film, ``WALK_FPS`` a second at its own pace; below, which
    feet felt forces.
    """
    done = "to its end" if execution.fallen_s is None else f"fell after {execution.fallen_s:.1f} s"
    note = (
        f"body {1e3 * execution.body_rms_m:.1f} mm from the plan (RMS)   ·   "
        f"feet slid {1e3 * execution.slip_m.max():.1f} mm at most   ·   "
        f"{execution.torque_share.max():.0%} of a joint's torque at most   ·   grid {GRID_M:g} m"
    )
    return motion_frames(
        walked(trajectory, execution),
        caption=f"{trajectory.robot.name} in {execution.world}: {done}",
        note=note,
        joints_rad=execution.trace.angles_rad,
        fps=WALK_FPS,
        size_px=size_px,
    )
