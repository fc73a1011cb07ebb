"""Exports: motions in the formats of other programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from stancekit import InvalidInput, Motion
from stancekit.planners.arguments import checked
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.documents import parse_json, read_text, shown
from stancekit.planners.files.writing import alone_in, check_writable, make_folder, write_text
from stancekit.planners.terrain.families import drawn_name, read_draw
from stancekit.runner.acceptance import report_on
from stancekit.runner.export.formats import FORMATS, beside, moved_of, played, write_moved
from stancekit.runner.motion.time_parametrization import RATE_HZ

from .walks import walk

Progress = Callable[[int, int], None]
_LEDGER = "motions.jsonl"
"""In a folder of drawn motions: a line per draw, and what was asked for before them."""
_GOAL_XY_M, _DURATION_S, _LIMIT_S = (0.8, 0.0), 6.0, 30.0
"""Numbers of drawn walks: where they end, how long they take, and the processor time of looking for
one."""
_MOST_DRAWS = 10
"""So many draws per motion that is asked for are tried at most, and a few more."""


@dataclass(frozen=True, kw_only=True)
class ExportedMotions:
    """Record of the motions that ``export`` wrote.

    Arguments:
        paths: the files.
        refused: number of draws that gave no motion, by reason.
        without: reason why a motion has no joints; empty if it has.
        open_loop: pace and gains at which it stood in MuJoCo without feedback of the body, or where
            it fell, as the file says, too; empty for many motions, and for one without joints.
    Source:
        None.

    Example:
        >>> import stancekit
        >>> plan = stancekit.plan("walls", frames=2).solution
        >>> stancekit.export(plan, "climb.csv").paths[0].name
        'climb.csv'
    """

    paths: tuple[Path, ...]
    refused: Mapping[str, int] = field(default_factory=dict)
    without: str = ""
    open_loop: str = ""


@checked
def export(
    subject: Motion[Any] | str | Path,
    out: str | Path | None = None,
    *,
    to: str | None = None,
    rate_hz: float = RATE_HZ,
    count: int | None = None,
    robot: str | Path = "anymal",
    progress: Progress | None = None,
) -> ExportedMotions:
    """Write a motion in the format of another program, or many of them over drawn terrain.

    The motion is the one that ``run`` streams: t, q, dq/dt, torques, contacts, forces and body,
    with names. A plan, a walk or a leap is judged before it is exported, a value as well as a file,
    whatever either says of itself.

    Arguments:
        subject: a plan, a walk, a leap or a crossing, or the file of one; a family's level as "rough:0.1" with
            ``count``.
        out: the file, or for drawn motions the folder; a name beside the input where it is None.
        to: "csv", "npz", "jointtrajectory" (ROS 2; JSON, or YAML by the name of ``out``), "mujoco"
            (MJCF with key frames), "reference" (mjlab's tracking task), "crocoddyl" (an
            .npz, and a script beside it) or "foxglove" (MCAP); None for what the ending of ``out``
            says.
        rate_hz: rows per second, 100 where it is not given; 30 to 200 are usual.
        count: number of walks, over grounds of seeds 0, 1, ...; walks that the folder has already
            are not made again.
        robot: the walker for these, as ``walk`` takes it.
        progress: function called with the number done and the number in all.

    Returns:
        ``ExportedMotions``.

    Raises:
        InvalidInput: for what the verifier does not accept, a format of joints where they are not
            known, a package that is not installed, and where nothing can be written.
    Source:
        docs/exports.md names the source of each format.

    Example:
        >>> import stancekit
        >>> plan = stancekit.plan("walls", frames=2).solution
        >>> stancekit.export(plan, "climb.csv", rate_hz=50.0).paths[0].stat().st_size > 10_000
        True
    """
    if to is not None and to not in FORMATS:
        raise InvalidInput(f"to: expected one of {', '.join(FORMATS)}, got {to!r:.40}")
    path = None if out is None else Path(out)
    is_draw = isinstance(subject, str) and drawn_name(subject) and not Path(subject).exists()
    if count is not None and not is_draw:
        raise InvalidInput(
            f"count: expected a family's level with it, as rough:0.1, got {_called(subject)}"
        )
    if robot != "anymal" and not is_draw:
        raise InvalidInput(f"robot: expected none with a motion, got {robot}")
    if is_draw:
        assert isinstance(subject, str)
        if count is None:
            raise InvalidInput(f"count: expected how many motions over {subject}, got none")
        return _drawn(subject, path, to or "reference", rate_hz, count, str(robot), progress)
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
    if progress is not None:
        progress(1, 1)
    return ExportedMotions(paths=(path,), without=moved.without, open_loop=moved.open_loop)


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


def _drawn(
    level: str,
    out: Path | None,
    to: str,
    rate_hz: float,
    count: int,
    robot: str,
    progress: Progress | None,
) -> ExportedMotions:
    """Accepted walks over drawn grounds, each a file of a folder; what its ledger says is done is
    not done again.
    """
    checked_int(count, "count", least=1)
    to = _format(to, out)
    family, height, first = read_draw(level, "export")
    if level.count(":") > f"{family}".count(":") + 1:
        raise InvalidInput(
            f"export: expected FAMILY:LEVEL with count, whose seeds are drawn, got {level} of seed "
            f"{first}"
        )
    folder = out or Path(f"{level.replace(':', '-').replace('/', '-')}-{to}")
    make_folder(folder)
    settings = {
        "format": "stancekit/motions/1",
        "level": level,
        "to": to,
        "rate_hz": rate_hz,
        "robot": robot,
    }
    ledger = folder / _LEDGER
    with alone_in(folder):
        lines = list(_ledger(ledger, settings))
        if not lines:  # before the first motion, so that whoever is killed in it can go on
            write_text(ledger, json.dumps(settings) + "\n")
        for seed in range(_MOST_DRAWS * (count + 1)):
            if sum("file" in line for line in lines) >= count:
                break
            if seed < len(lines):
                continue
            lines.append(_one(f"{family}:{height:g}:{seed}", folder, to, rate_hz, robot))
            write_text(ledger, "".join(json.dumps(line) + "\n" for line in [settings, *lines]))
            if progress is not None:
                progress(min(count, sum("file" in line for line in lines)), count)
    done = [folder / line["file"] for line in lines if "file" in line][:count]
    refused = Counter(line["refused"] for line in lines if "refused" in line)
    if len(done) < count:
        raise InvalidInput(
            f"{level}: expected {count} motions, got {len(done)} of {len(lines)} draws: "
            f"{dict(refused)}"
        )
    return ExportedMotions(paths=tuple(done), refused=dict(refused))


def _ledger(path: Path, asked: Mapping[str, object]) -> Iterator[dict[str, str]]:
    """Read what a folder's ledger says of each draw.

    Raises InvalidInput for one of other motions.
    """
    if not path.exists():
        if any(path.parent.iterdir()):
            raise InvalidInput(
                f"{path.parent}: expected a new folder, an empty one or one of drawn motions, "
                "found files in it"
            )
        return
    head, *rest = [parse_json(line, str(path)) for line in read_text(path).splitlines()] or [None]
    if head != asked:
        different = next(
            (name for name in asked if not isinstance(head, dict) or head.get(name) != asked[name]),
            "",
        )
        raise InvalidInput(
            f"{path}: {different}: expected {asked[different]!r}, found motions of another one "
            "there"
        )
    for number, line in enumerate(rest, 2):
        if not isinstance(line, dict) or not isinstance(line.get("file", line.get("refused")), str):
            raise InvalidInput(
                f"{path}: line {number}: expected a ground with its file or a reason, got "
                f"{shown(line)}"
            )
        if "file" in line and not (path.parent / line["file"]).exists():
            raise InvalidInput(
                f"{path.parent / line['file']}: expected the motion that {_LEDGER} names, found "
                "nothing"
            )
        yield line


def _one(ground: str, folder: Path, to: str, rate_hz: float, robot: str) -> dict[str, str]:
    """The walk over one ground: its line of the ledger."""
    record = {"ground": ground}
    try:
        attempts = walk(
            ground, _GOAL_XY_M, robot=robot, duration_s=_DURATION_S, time_limit_s=_LIMIT_S
        )
    except InvalidInput as error:
        if str(error).startswith("robot"):
            raise
        return {**record, "refused": "no walk can begin or end there", "why": str(error)}
    if attempts.solution is None or attempts.report is None or not attempts.report.accepted:
        return {**record, "refused": "no accepted walk was found", "why": attempts.message}
    path = folder / f"{ground.replace(':', '-').replace('/', '-')}{FORMATS[to].suffixes[0]}"
    try:
        moved = moved_of(attempts.solution, to, rate_hz, ground)
    except InvalidInput as error:
        return {**record, "refused": "run refuses the motion", "why": str(error)}
    write_moved(replace(moved, open_loop=played(moved)), to, path)
    return {**record, "file": path.name}
