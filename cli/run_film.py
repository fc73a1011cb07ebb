"""The film of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .console import complain

if TYPE_CHECKING:
    from stancekit.runner.acceptance import Accepted, AcceptedGait
    from stancekit.runner.report import RunReport


def film(path: Path | None, request: Accepted | AcceptedGait, report: RunReport) -> None:
    """Write it, where it was asked for and the robot moved."""
    if path is None:
        return
    if report.execution is None:
        complain(f"stancekit: no film: {report.message or 'nothing was measured'}")
        return
    from stancekit.runner.acceptance import Accepted
    from stancekit.views.executions import FPS, execution_frames, walk_frames
    from stancekit.views.video import write_video

    if isinstance(request, Accepted):
        write_video(path, execution_frames(request.plan, report.execution), FPS)
    else:
        write_video(path, walk_frames(request.trajectory, report.execution))
