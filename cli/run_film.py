"""Films of what was executed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .console import complain, counted

if TYPE_CHECKING:
    from stancekit.planners.answer.plan import Plan
    from stancekit.runner.acceptance import Accepted, AcceptedGait
    from stancekit.runner.execution import Execution
    from stancekit.runner.report import RunReport


def film(path: Path | None, request: Accepted | AcceptedGait, report: RunReport) -> None:
    """Write it, where it was asked for and the robot moved."""
    if path is None:
        return
    if report.execution is None:
        complain(f"stancekit: no film: {report.message or 'nothing was measured'}")
        return
    from stancekit.runner.acceptance import Accepted
    from stancekit.views.executions import WALK_FPS, walk_frames
    from stancekit.views.video import write_video

    if isinstance(request, Accepted):
        film_plan(path, request.plan, report.execution)
        return
    frames, total = walk_frames(request.trajectory, report.execution), round(WALK_FPS * request.trajectory.duration_s)
    write_video(path, counted(frames, total, f"film {path}"), WALK_FPS)


def film_plan(path: Path, plan: Plan, execution: Execution) -> None:
    """Write the film of a plan's execution."""
    from stancekit.views.executions import FPS, execution_frames, frame_count
    from stancekit.views.video import write_video

    write_video(path, counted(execution_frames(plan, execution), frame_count(execution), f"film {path}"), FPS)
