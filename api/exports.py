"""Exports: motions in the formats of other programs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from stancekit import InvalidInput, Motion
from stancekit.planners.arguments import checked
from stancekit.planners.files.writing import check_writable
from stancekit.runner.acceptance import report_on
from stancekit.runner.export.formats import FORMATS, beside, moved_of, played, write_moved
from stancekit.runner.motion.time_parametrization import RATE_HZ


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Record of the motion that ``export`` wrote.

    Arguments:
        path: the file.
        without: reason why it has no joints; empty if it has.
        open_loop: pace and gains at which it stood in MuJoCo without feedback of the body, or where
            it fell, as the file says, too; empty without joints.
        doubts: those about its robot and its ground, one line each.
    Source:
        None.

    Example:
        >>> import stancekit
        >>> plan = stancekit.plan("walls", frames=2).solution
        >>> stancekit.export(plan, "climb.csv").path.name
        'climb.csv'
    """

    path: Path
    without: str = ""
    open_loop: str = ""
    doubts: tuple[str, ...] = ()


@checked
def export(
    subject: Motion[Any] | str | Path,
    out: str | Path | None = None,
    *,
    to: str | None = None,
    rate_hz: float = RATE_HZ,
) -> Exported:
    """Write a motion in the format of another program.

    The motion is the one that ``run`` streams: t, q, dq/dt, torques, contacts, forces and body,
    with names. A plan, a walk or a leap is judged before it is exported, a value as well as a file,
    whatever either says of itself.

    Arguments:
        subject: a plan, a walk, a leap or a crossing, or the file of one.
        out: the file; a name beside the input where it is None.
        to: "csv", "npz", "jointtrajectory" (ROS 2; JSON, or YAML by the name of ``out``), "mujoco"
            (MJCF with key frames), "reference" (mjlab's tracking task), "crocoddyl" (an
            .npz, and a script beside it) or "foxglove" (MCAP); None for what the ending of ``out``
            says.
        rate_hz: rows per second, 100 where it is not given; 30 to 200 are usual.

    Returns:
        ``Exported``.

    Raises:
        InvalidInput: for what the verifier does not accept, a format of joints where they are not
            known, a package that is not installed, and where nothing can be written.
    Source:
        docs/exports.md names the source of each format.

    Example:
        >>> import stancekit
        >>> plan = stancekit.plan("walls", frames=2).solution
        >>> stancekit.export(plan, "climb.csv", rate_hz=50.0).path.stat().st_size > 10_000
        True
    """
    if to is not None and to not in FORMATS:
        raise InvalidInput(f"to: expected one of {', '.join(FORMATS)}, got {to!r:.40}")
    path = None if out is None else Path(out)
    source = _called(subject)
    chosen = _format(to, path)
    if path is None:
        if not isinstance(subject, str | Path):
            raise InvalidInput(f"out: expected a file for {source}, got none")
        path = beside(Path(subject), chosen)
    if path.suffix not in FORMATS[chosen].suffixes:
        raise InvalidInput(
            f"out: expected a name that ends in {' or '.join(FORMATS[chosen].suffixes)}, got {path}"
        )
    check_writable(path)
    if isinstance(subject, str | Path):
        motion = read_accepted(Path(subject))
    else:
        report_on(motion := subject, source)
    moved = moved_of(motion, chosen, rate_hz, source)
    moved = replace(moved, open_loop=played(moved))
    write_moved(moved, chosen, path)
    return Exported(
        path=path, without=moved.without, open_loop=moved.open_loop, doubts=motion.doubts
    )


def read_accepted(path: Path) -> Motion[Any]:
    """The motion of a file, if the verifier accepts it now, whatever the file says.

    Raises InvalidInput.
    """
    from stancekit.planners.formats.motion_file import read_motion

    subject, _ = read_motion(path)
    report_on(subject, str(path))
    return subject


def _called(subject: object) -> str:
    return str(subject) if isinstance(subject, str | Path) else f"a {getattr(subject, 'word', '')}"


def _format(to: str | None, out: Path | None) -> str:
    """The format that was asked for, or that the file's ending says.

    Raises InvalidInput.
    """
    if to is not None:
        return to
    fitting = (
        []
        if out is None
        else [name for name, each in FORMATS.items() if out.suffix in each.suffixes]
    )
    if not fitting:
        raise InvalidInput(f"to: expected one of {', '.join(FORMATS)}, got none")
    return fitting[0]
