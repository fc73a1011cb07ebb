"""Checkpoint of an interrupted run: where every attempt stood, beside the file that the run was to
write.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...files.arrays import Array, read_archive
from ...files.writing import remove_leftovers, write_bytes
from ...problem.walk import Walk
from ..walk_table import GaitSettings
from .attempt import Attempt, Attempted

DONE, CUT, ROUND = "done", "cut", "round"
"""What became of a piece of a walk: it was planned, it was cut in two, or the walk goes another way
from there on."""
FAILED = -1
"""Stage of an attempt that came to its end without success."""


class Checkpoint:
    """Points that attempts reached, in NAME.partial.npz; it belongs to one task, its settings and
    attempts.

    A walk that is planned piece by piece keeps ``pieces``, what became of each (``DONE``, ``CUT``,
    ``ROUND``), and ``samples`` of all that are done as one walk, by name.

    Arguments:
        out: the file of the run, None keeps nothing.
        phases: what else is done with the points (``Caps.phases``). What stands there already is
            taken up if it is of the same task, settings, attempts and phases, and ignored if not.
    """

    def __init__(
        self,
        out: Path | None,
        task: Walk,
        settings: GaitSettings,
        attempts: Sequence[Attempt],
        phases: Mapping[str, Any] | None = None,
    ) -> None:
        self.path = None if out is None else out.with_suffix(".partial.npz")
        self._digest, self._own = _digest(task, settings, attempts, phases or {}), False
        self._points: dict[int, tuple[int, Array]] = {}
        self._done: set[int] = set()
        self.pieces: tuple[str, ...] = ()
        self.samples: Mapping[str, Array] = {}
        if self.path is not None and self.path.exists():
            self._read(self.path)

    @property
    def begun(self) -> bool:
        """Tell whether something is known of any attempt or piece."""
        return bool(self._points or self.pieces)

    def keep_pieces(self, pieces: Sequence[str], samples: Mapping[str, Array]) -> None:
        """Note what became of all pieces so far, and write it."""
        self.pieces, self.samples = tuple(pieces), samples
        self._write()

    def begin(self, index: int) -> tuple[Array | None, int]:
        """Beginning of this attempt: a point, None for its own guess, and the stage; ``FAILED`` for
        one that did.
        """
        stage, point = self._points.get(index, (0, np.zeros(0)))
        return (point if point.size else None), stage

    def done(self, index: int) -> bool:
        """Tell whether this attempt came to its end with success."""
        return index in self._done

    def keep(self, index: int, found: Attempted) -> None:
        """Note where an attempt was stopped, or how it ended, and write all of it."""
        if found.solution.success and not found.stopped:
            self._done.add(index)
        keeps = found.stopped or found.solution.success
        self.note(index, *((found.stage, found.solution.x) if keeps else (FAILED, np.zeros(0))))

    def note(self, index: int, stage: int, point: Array) -> None:
        """Note a point that an attempt came to on its way, and write all of it."""
        self._points[index] = stage, point
        self._write()

    def _write(self) -> None:
        if self.path is None:
            return
        packed = io.BytesIO()
        arrays: dict[str, Any] = {f"x_{k}": point for k, (_, point) in self._points.items()}
        arrays |= {f"stage_{k}": np.array(stage) for k, (stage, _) in self._points.items()}
        arrays |= {f"walk_{name}": array for name, array in self.samples.items()}
        arrays["pieces"] = np.array(self.pieces, dtype=np.str_)
        np.savez(
            packed,
            digest=np.array(self._digest),
            done=np.array(sorted(self._done), dtype=np.intp),
            **arrays,
        )
        write_bytes(self.path, packed.getvalue())
        self._own = True

    def remove(self) -> None:
        """The run is done: nothing is left of it here, and of killed writers; what others left
        whole stays.
        """
        if self.path is None:
            return
        if self._own:
            with suppress(OSError):
                self.path.unlink(missing_ok=True)
        remove_leftovers(self.path.parent, self.path.name.__eq__)

    def _read(self, path: Path) -> None:
        """Take up what a run of the same task left; a file that cannot be read counts for
        nothing.
        """
        with suppress(ValueError, KeyError, TypeError):
            packed = read_archive(path)
            if str(packed["digest"]) == self._digest:
                names = [int(name.removeprefix("x_")) for name in packed if name.startswith("x_")]
                self.pieces = tuple(str(each) for each in packed.get("pieces", ()))
                walk = {name: array for name, array in packed.items() if name.startswith("walk_")}
                self.samples = {name.removeprefix("walk_"): array for name, array in walk.items()}
                points = {k: (int(packed[f"stage_{k}"]), packed[f"x_{k}"]) for k in names}
                self._done, self._points, self._own = {int(k) for k in packed["done"]}, points, True


def _digest(
    task: Walk, settings: GaitSettings, attempts: Sequence[Attempt], phases: Mapping[str, Any]
) -> str:
    content = hashlib.sha256()
    for array in task.terrain.to_arrays().values():
        content.update(np.ascontiguousarray(array).tobytes())
    question = {
        "robot": task.robot.to_json(),
        "start": task.start_xy_m.tolist(),
        "goal": task.goal_xy_m.tolist(),
        "rest": [*task.yaws(), task.duration_s, task.friction, task.adhesive, task.timings],
        "gait": [task.gait, task.cycle_s],
        "suction_n": task.suction_n,
        "settings": asdict(settings),
        "attempts": [asdict(attempt) for attempt in attempts],
        "phases": dict(phases),
    }
    content.update(json.dumps(question, sort_keys=True).encode())
    return content.hexdigest()
