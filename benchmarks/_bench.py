"""What the tables share: options, rows that are printed, figures of many runs, other checkouts,
kept cells.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tyro
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from stancekit.planners.files.documents import read_json
from stancekit.planners.files.writing import write_text
from stancekit.runner.worlds.dynamixel.calibration import Calibration, nominal

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # tests.emulators
Row = dict[str, Any]
Given = TypeVar("Given", bound="Options")


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every table can be asked."""

    seed: int = 0
    json: bool = False
    """One object a line on standard output."""

    def say(self, row: Mapping[str, Any], line: Callable[[Any], str] | None = None) -> None:
        """Print a row: as JSON, or as ``line`` has it for people, names and values where there is
        none.
        """
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
        for name, value in record.items():
            print(f"{name:44} {value:.4g}")


def launch(main: Callable[[Given], None], options: type[Given], doc: str | None) -> None:
    """Run a table with the options of the command line, one thread a solver."""
    with threadpool_limits(1):
        main(tyro.cli(options, description=doc, config=(tyro.conf.OmitArgPrefixes,)))


def realtime(wanted: bool) -> None:
    """A real-time priority (SCHED_FIFO, as root), as a robot's host has."""
    if wanted:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))


class Lines:
    """Results by key, one JSON object per line; what a kill left of a last line is dropped."""

    def __init__(self, path: Path) -> None:
        self.path, self.rows = path, dict[str, dict[str, Any]]()
        if not path.exists():
            return
        text = path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        for line in whole.splitlines():
            row = json.loads(line)
            self.rows[row["key"]] = row
        if whole != text:
            path.write_text(whole, encoding="utf-8")

    def add(self, key: str, row: Mapping[str, Any]) -> dict[str, Any]:
        """Write a line, on the disk when this returns."""
        self.rows[key] = {"key": key, **row}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(self.rows[key]) + "\n")
            file.flush()
            os.fsync(file.fileno())
        return self.rows[key]


def kept(path: Path, measure: Callable[[], Row]) -> Row:
    """The cell of this file; measured, and written, where it is not there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(measure()))
    found: Row = read_json(path)
    return found


def spread(values: ArrayLike) -> str:
    """Median, least and most."""
    some = np.asarray(values)
    return f"{np.median(some):.3f} ({some.min():.3f} to {some.max():.3f})"


def bootstrapped(values: ArrayLike) -> str:
    """Mean and its bootstrapped 95 % interval."""
    some = np.asarray(values)
    chosen = np.random.default_rng(0).integers(len(some), size=(4000, len(some)))
    low, high = np.quantile(some[chosen].mean(axis=1), [0.025, 0.975])
    return f"{some.mean():.3f} [{low:.3f}, {high:.3f}]"


def tally(words: Iterable[str]) -> str:
    """How often each, in order."""
    return ", ".join(f"{count} × {word}" for word, count in sorted(Counter(words).items()))


def checkouts(against: Path | None) -> dict[str, Path]:
    """This tree, and another before it, in which `python setup.py links` was run."""
    return {"after": ROOT} if against is None else {"before": against.resolve(), "after": ROOT}


def of_checkout(folder: Path) -> dict[str, str]:
    """The environment of a process that runs a checkout's packages, compiled modules kept as a
    user's are; typings: in older ones.
    """
    paths = f"{folder / '.editable'}{os.pathsep}{folder / 'typings'}"
    own = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**own, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def resting(joints: Iterable[str], start: ArrayLike, port: str, **settings: Any) -> Calibration:
    """A calibration of servos that rest at these angles [rad]."""
    found = nominal(tuple(joints), port=port, **settings)
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
