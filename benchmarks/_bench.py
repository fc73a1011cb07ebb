"""What the tables share: options, rows as text, JSON or Markdown, the pages' tables of rows that are
kept, intervals, kept cells.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tyro
from numpy.typing import ArrayLike
from scipy.stats import beta
from threadpoolctl import threadpool_limits

from stancekit.envs.data.ledger import software
from stancekit.planners.files.documents import read_json
from stancekit.planners.files.writing import write_text
from stancekit.planners.robot import Robot
from stancekit.runner.worlds.dynamixel.control_table import Calibration, nominal

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # tests.emulators
Row = dict[str, Any]
Table = Callable[[list[Row]], Iterable[str]]
"""Lines of Markdown, of the rows of a run."""
Given = TypeVar("Given", bound="Options")


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every table can be asked."""

    seed: int = 0
    json: bool = False
    """One object a line on standard output."""
    markdown: bool = False
    """A row a line, and a head where names are others."""
    kept: Path | None = None
    """Print the tables of a page, of the rows that this file keeps; where there is none, measure,
    and keep them there with the options and versions that made them."""
    section: str = ""
    """One of the page's tables alone, where it has several."""
    _said: Any = field(default_factory=lambda: [], init=False, repr=False)
    _heads: Any = field(default_factory=lambda: [], init=False, repr=False)

    def say(self, row: Mapping[str, Any], line: Callable[[Any], str] | None = None) -> None:
        """Print a row: as JSON, as Markdown, or as ``line`` has it for people, names and values
        where there is none.
        """
        self._said.append(dict(row))
        if self.markdown:
            self._write(row)
            return
        text = (
            json.dumps(row)
            if self.json
            else line(row)
            if line
            else "  ".join(f"{k} {v}" for k, v in row.items())
        )
        print(text, flush=True)

    def list(self, record: Mapping[str, Any], **head: Any) -> None:
        """Print a record, a figure a line for people; head: what only JSON has before it."""
        if self.json:
            print(json.dumps(head | dict(record)))
            return
        if self.markdown:
            for name, value in record.items():
                self._write({**head, "figure": name, "value": value})
            return
        for name, value in record.items():
            print(f"{name:44} {value:.4g}")

    def _write(self, row: Mapping[str, Any]) -> None:
        """Print a row of a Markdown table."""
        names = tuple(map(str, row))
        if self._heads[-1:] != [names]:
            lines = ["", f"| {' | '.join(names)} |", "|" + "---|" * len(names)]
            print("\n".join(lines[not self._heads :]))
            self._heads.append(names)
        print(f"| {' | '.join(map(cell, row.values()))} |", flush=True)


def cell(value: Any) -> str:
    """A value of a table: numbers to four digits, lists with commas."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(cell, value))
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {cell(each)}" for name, each in value.items())
    return str(value).replace("|", "\\|").replace("\n", " ")


def launch(
    main: Callable[[Given], int | None], options: type[Given], doc: str | None, **tables: Table
) -> None:
    """Run a table with the options of the command line, one thread a solver.

    Arguments:
        tables: of a page, by name; a row a line where there is none.
    """
    given = tyro.cli(options, description=doc, config=(tyro.conf.OmitArgPrefixes,))
    if given.section and given.section not in tables:
        sys.exit(f"--section: expected one of {', '.join(tables) or 'none'}, got {given.section}")
    code = None
    if given.kept is None or not given.kept.exists():
        with threadpool_limits(1):
            code = main(given)
        if given.kept is not None and not code:
            _keep(given.kept, given)
    if given.kept is not None and not code:
        rows = _kept_rows(given.kept, given)
        chosen = [tables[given.section]] if given.section else [*tables.values()] or [_plainly]
        print("\n\n".join("\n".join(each(rows)) for each in chosen))
    if code:
        sys.exit(code)


def _options(given: Options) -> dict[str, str]:
    """What rows depend on."""
    free = {"json", "markdown", "kept", "section"}
    named = [each.name for each in fields(given) if each.init and each.name not in free]
    return {name: str(getattr(given, name)) for name in named}


def _keep(path: Path, given: Options) -> None:
    """Write the rows of a run, under what made them."""
    head = {"script": Path(sys.argv[0]).name, "options": _options(given), "software": software()}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, "".join(f"{json.dumps(row)}\n" for row in (head, *given._said)))


def _kept_rows(path: Path, given: Options) -> list[Row]:
    """The rows of a file, which has to be this script's with these options."""
    head, *rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    script = Path(sys.argv[0]).name
    if head["script"] != script:
        sys.exit(f"{path}: expected rows of {script}, got {head['script']}'s")
    for name, value in _options(given).items():
        if head["options"].get(name, value) != value:
            sys.exit(f"{path}: expected {name} {value}, got {head['options'][name]}")
    return rows


def _plainly(rows: list[Row]) -> Iterable[str]:
    """A row a line, under the names of the first."""
    return markdown(list(map(str, rows[0])), (row.values() for row in rows))


def markdown(head: Sequence[str], rows: Iterable[Iterable[Any]]) -> Iterator[str]:
    """A table: its head, and its rows."""
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield f"| {' | '.join(map(cell, row))} |"


def realtime(wanted: bool) -> None:
    """A real-time priority (SCHED_FIFO, as root), as a robot's host has."""
    if wanted:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))


class Lines:
    """Results by key, one JSON object per line; what a kill left of a last line is dropped.

    Arguments:
        name: of the value that is the key.
    """

    def __init__(self, path: Path, name: str = "key") -> None:
        self.path, self.name, self.rows = path, name, dict[Any, Row]()
        if not path.exists():
            return
        text = path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        for line in whole.splitlines():
            row = json.loads(line)
            self.rows[row[name]] = row
        if whole != text:
            path.write_text(whole, encoding="utf-8")

    def add(self, key: str | int, row: Mapping[str, Any]) -> Row:
        """Write a line, on the disk when this returns."""
        self.rows[key] = {self.name: key, **row}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(self.rows[key]) + "\n")
            file.flush()
            os.fsync(file.fileno())
        return self.rows[key]


def kept(path: Path, measure: Callable[[], Row]) -> Row:
    """The cell of this file; measured, and written, where it is not there: null for a number that
    is not finite.
    """
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        cell = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in measure().items()
        }
        write_text(path, json.dumps(cell))
    found: Row = read_json(path)
    return found


def spread(values: ArrayLike) -> str:
    """Median, least and most."""
    some = np.asarray(values)
    return f"{np.median(some):.3f} ({some.min():.3f} to {some.max():.3f})"


def share(count: int, of: int) -> str:
    """A count of so many with the share and its 95 % interval (Wilson), in percent."""
    from stancekit.learners.evaluation.evaluate import Share  # slow to import

    if not of:
        return "0 of 0"
    counted = Share(hits=count, of=of)
    low, high = counted.interval
    return f"{count} of {of}, {100 * counted.value:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def upper_end(count: int, of: int) -> float:
    """The upper end of the 95 % interval of a share (Clopper and Pearson)."""
    return 1.0 if count == of else float(beta.ppf(0.975, count + 1, of - count))


def bootstrapped(values: ArrayLike) -> str:
    """Mean and its bootstrapped 95 % interval."""
    some = np.asarray(values)
    chosen = np.random.default_rng(0).integers(len(some), size=(4000, len(some)))
    low, high = np.quantile(some[chosen].mean(axis=1), [0.025, 0.975])
    return f"{some.mean():.3f} [{low:.3f}, {high:.3f}]"


def tally(words: Iterable[str]) -> str:
    """How often each, in order."""
    return ", ".join(f"{count} × {word}" for word, count in sorted(Counter(words).items()))


def resting(robot: Robot, start: ArrayLike, port: str, **settings: Any) -> Calibration:
    """A calibration of servos that rest at these angles [rad]."""
    found = nominal(robot, port=port, **settings)
    pairs = zip(found.joints.items(), np.asarray(start).tolist(), strict=True)
    return replace(
        found, joints={name: replace(each, rest_rad=angle) for (name, each), angle in pairs}
    )


def servos(state: Mapping[str, Any], still_rad_s: float = 0.02) -> str:
    """The state of emulated servos in a few words."""
    kinds = Counter[str]()
    columns = (state[name] for name in ("torque", "watchdog", "hardware_error", "powered"))
    for torque, watchdog, error, powered in zip(*columns, strict=True):
        if not powered:
            kinds["no power"] += 1
        elif error:
            kinds["shut down"] += 1
        elif not torque:
            kinds["torque off"] += 1
        else:
            kinds["held by its watchdog" if watchdog == 255 else "held"] += 1
    moving = max(abs(rate) for rate in state["rate_rad_s"]) > still_rad_s
    return ", ".join(f"{count} {what}" for what, count in sorted(kinds.items())) + (
        ", MOVING" if moving else ""
    )
