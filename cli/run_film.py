"""Films of what was executed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .console import complain, progress

if TYPE_CHECKING:
    from stancekit.runner.acceptance import Accepted, AcceptedCrossing, AcceptedGait, AcceptedLeap
    from stancekit.runner.report import RunReport


def film(
    path: Path | None,
    request: Accepted | AcceptedGait | AcceptedLeap | AcceptedCrossing,
    report: RunReport,
) -> None:
    """Write it, where it was asked for and the robot moved."""
    if path is None:
        return
    if report.execution is None:
        complain(f"stancekit: no film: {report.message or 'nothing was measured'}")
        return
    from stancekit.pictures import film as write
    from stancekit.runner.acceptance import AcceptedGait

    motion = request.trajectory if isinstance(request, AcceptedGait) else request.plan
    with progress(f"film {path}") as bar:
        write(motion, path, report.execution, progress=bar)
