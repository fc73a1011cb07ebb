"""Options that several commands have: those that may be left out, of a planner, and files of pictures.

tyro knows ``Optional``; for ``X | None`` it imports typeguard, which takes .1 s.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional, TypeAlias

import tyro

from stancekit.planners.errors import InvalidInput

if TYPE_CHECKING:
    from stancekit.planners.search.answer import Kind

OptionalPath: TypeAlias = Annotated[Optional[Path], tyro.conf.arg(metavar="PATH")]  # noqa: UP045
OptionalInt: TypeAlias = Annotated[Optional[int], tyro.conf.arg(metavar="INT")]  # noqa: UP045
OptionalFloat: TypeAlias = Annotated[Optional[float], tyro.conf.arg(metavar="FLOAT")]  # noqa: UP045
OptionalWrench: TypeAlias = Annotated[Optional[str], tyro.conf.arg(metavar="FX,FY,FZ[,MX,MY,MZ]")]  # noqa: UP045
OptionalText: TypeAlias = Annotated[Optional[str], tyro.conf.arg(metavar="TEXT")]  # noqa: UP045
LONGEST_S = 1e6


def check_planner(command: Any, by: str, known: Sequence[str], of: Kind) -> None:
    """Raise InvalidInput for a limit that is out of range, or an option that the planner does not
    know.

    Arguments:
        command: has time_limit_s, intervals, and under ``by`` its planner.
        known: the names of the package's own.
        of: the kind of question that it will be asked.
    """
    from stancekit.planners.search.methods import MOST_INTERVALS, settings_of

    if command.time_limit_s is not None and not 0.0 < command.time_limit_s <= LONGEST_S:
        got = f"got {command.time_limit_s:g}"
        raise InvalidInput(f"--time-limit-s: expected a number above 0, up to {LONGEST_S:g}, {got}")
    if command.intervals > MOST_INTERVALS:
        raise InvalidInput(
            f"--intervals: expected {MOST_INTERVALS} or less, got {command.intervals}"
        )
    chosen = getattr(command, by)
    if chosen not in known:
        return
    takes = {name: settings_of(name, of) for name in known}
    every = {one for names in takes.values() for one in names}
    for field in fields(command):
        setting = "envelopes" if field.name == "envelope" else field.name
        if (
            setting in every
            and setting not in takes[chosen]
            and getattr(command, field.name) != field.default
        ):
            fitting = " or ".join(name for name in known if setting in takes[name])
            raise InvalidInput(
                f"--{field.name.replace('_', '-')}: expected --{by} {fitting} with it, got {chosen}"
            )


def check_drawn(
    picture: Path | None = None, video: Path | None = None, html: Path | None = None
) -> None:
    """Raise InvalidInput for a picture, film or page that cannot be written, or lacks a package."""
    if picture is not None:
        from stancekit.views.sheet import check_picture

        check_picture(picture)
    if video is not None:
        from stancekit.views.film import check_film

        check_film(video)
    if html is not None:
        from stancekit.views.page import check_page

        check_page(html)


def check_log(log: Path, others: Mapping[str, Path | str | None]) -> None:
    """Raise InvalidInput for a log that is none by its name, or that would be written over another
    file of the command.
    """
    if log.suffix != ".mcap":
        raise InvalidInput(f"--log: expected a name that ends in .mcap, got {log}")
    for name, other in others.items():
        if other is not None and os.path.realpath(other) == os.path.realpath(log):
            raise InvalidInput(f"--log: expected a file of its own, got that of {name}: {log}")


def wrench_numbers(text: str | None) -> tuple[float, ...] | None:
    """The numbers of a force and a moment on the body; None where the option was not given.

    Raises InvalidInput.
    """
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InvalidInput(
            f"wrench: expected FX,FY,FZ or FX,FY,FZ,MX,MY,MZ, got {text!r:.80}"
        ) from None
