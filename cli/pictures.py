"""Pictures, films and pages of what a command found or executed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import progress

if TYPE_CHECKING:
    from stancekit import Motion
    from stancekit.runner.report import Execution


def show(
    motion: Motion[Any],
    executed: Execution | None = None,
    *,
    picture: Path | None = None,
    video: Path | None = None,
    html: Path | None = None,
) -> list[Path]:
    """Write the picture, the film and the page that were asked for; their names.

    Arguments:
        executed: how a world had the motion, which is then shown.
    """
    written = [path for path in (picture, video, html) if path is not None]
    if not written:
        return []
    from stancekit import draw, film

    if picture is not None:
        draw(motion, executed=executed, out=picture)
    for path in (video, html):
        if path is not None:
            with progress(f"film {path}") as bar:
                film(motion, path, executed, progress=bar)
    return written
