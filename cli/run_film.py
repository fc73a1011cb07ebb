"""Films of what was executed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import complain, progress

if TYPE_CHECKING:
    from stancekit.runner.acceptance import Accepted
    from stancekit.runner.report import RunReport


def film(
    path: Path | None,
    request: Accepted[Any],
    report: RunReport,
) -> None:
    """Write it, where it was asked for and the robot moved."""
    if path is None:
        return
    if report.execution is None:
        complain(f"stancekit: no film: {report.message or 'nothing was measured'}")
        return
    from stancekit.pictures import film as write

    with progress(f"film {path}") as bar:
        write(request.plan, path, report.execution, progress=bar)
