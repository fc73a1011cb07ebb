"""Walks that are drawn once for ``stancekit/WarpedGait-v0``, and what every attempt at them came
to.

A solve takes seconds, a look at what came of it nothing. A pool solves an attempt when it is first
asked for, and can be solved as a whole and kept in a file.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.archive import read_archive
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.comparison import first_difference
from stancekit.planners.files.writing import write_bytes
from stancekit.planners.gait.method.attempt import Attempt, Attempted, Workbench
from stancekit.planners.gait.task import GaitSettings
from stancekit.planners.problem.walk import Walk

from .distributions.walks import SampledTasks, Tasks

HEIGHTS = ((1.0,), (0.5, 1.0), (0.25, 0.5, 0.75, 1.0))
"""Homotopies to choose from: factors on the terrain's heights."""
NOISES = (0.0, 0.01, 0.02)
"""Initial guesses to choose from: what is added to the terrain-following one [m, rad, m·g]."""
FORMAT = "stancekit/walk-pool/1"
LARGEST = 1e6
MOST_WALKS = 100_000
Action = tuple[int, int, int]
"""Indices of a chart, a homotopy and a noise."""


class Outcome(NamedTuple):
    """Outcome of an attempt, all numbers finite: the verifier's word and figures, and the
    solver's.
    """

    verified: float = 0.0
    feasible: float = 0.0
    iterations: float = 0.0
    violation: float = LARGEST
    refused: float = 0.0
    force_rms: float = 0.0
    moment_rms: float = 0.0
    peak_acceleration_g: float = 0.0
    outside_cone: float = 0.0
    footing_friction: float = 0.0
    seconds: float = 0.0

    @classmethod
    def of(cls, found: Attempted | None, limit: int) -> Self:
        """The numbers of an attempt; of None, where a terrain has no map, the limit of iterations
        was taken.
        """
        if found is None:
            return cls(iterations=limit)
        figures = found.report.figures
        names = (
            "force_rms",
            "moment_rms",
            "peak_acceleration_g",
            "outside_cone",
            "footing_friction",
        )
        return cls(
            verified=float(found.verified),
            feasible=float(found.solution.success),
            iterations=float(found.iterations),
            violation=_number(found.solution.violation),
            refused=float(len(found.report.refused)),
            seconds=found.seconds,
            **{name: _number(figures.get(name, 0.0)) for name in names},
        )


class WalkPool:
    """Pool of walks, and the outcomes of attempts at them.

    Arguments:
        tasks: function that draws a walk from a generator.
        size: number of walks.
        charts: coordinates to choose from.
        settings: settings of the optimiser.
        seed: seed of the walks, and of the guesses with noise.

    Raises:
        InvalidInput: for no walk, or too many.
    """

    def __init__(
        self,
        tasks: Tasks,
        size: int,
        charts: tuple[str, ...],
        settings: GaitSettings,
        seed: int = 0,
    ) -> None:
        if not 1 <= size <= MOST_WALKS:
            raise InvalidInput(f"pool: expected 1 to {MOST_WALKS} walks, got {size}")
        self.tasks, self.size, self.charts, self.settings, self.seed = (
            tasks,
            size,
            charts,
            settings,
            seed,
        )
        self._walks: dict[int, Walk] = {}
        self._table = np.full(
            (size, len(charts), len(HEIGHTS), len(NOISES), len(Outcome._fields)), np.nan
        )
        self._bench: Workbench | None = None

    def __len__(self) -> int:
        return self.size

    @property
    def solved(self) -> int:
        """Number of attempts that have an outcome."""
        return int(np.isfinite(self._table[..., 0]).sum())

    def walk(self, index: int) -> Walk:
        """A walk by its number; it is drawn once."""
        if index not in self._walks:
            self._walks[index] = self.tasks(np.random.default_rng([self.seed, index]))
        return self._walks[index]

    def outcome(self, index: int, action: Action) -> Outcome:
        """Outcome of an attempt at a walk; it is solved where nobody asked before."""
        row = self._table[(index, *action)]
        if np.isnan(row[0]):
            row[:] = self._solved(index, action)
        return Outcome(*row.tolist())

    def solve(self, progress: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Solve every attempt that has no outcome.

        Arguments:
            progress: called with how many have one, and all.
        """
        total = int(np.prod(self._table.shape[:-1]))
        for index in range(self.size):
            for action in product(*map(range, self._table.shape[1:4])):
                self.outcome(index, (action[0], action[1], action[2]))
                progress(self.solved, total)

    def write(self, path: str | Path) -> None:
        """Write the outcomes, and what the walks are drawn from, to an .npz file."""
        content = io.BytesIO()
        np.savez_compressed(
            content, header=np.array(json.dumps(self._header())), outcomes=self._table
        )
        write_bytes(path, content.getvalue())

    @classmethod
    def read(
        cls, path: str | Path, tasks: Tasks, charts: tuple[str, ...], settings: GaitSettings
    ) -> Self:
        """A pool of these tasks, charts and settings from the file that ``write`` made.

        Raises InvalidInput for another file, and for a pool of other walks, charts or settings.
        """
        arrays = read_archive(path)
        try:
            header = json.loads(str(arrays["header"]))
            table, size, seed = arrays["outcomes"], int(header["size"]), int(header["seed"])
        except (KeyError, ValueError, TypeError):
            raise InvalidInput(f"{path}: expected a pool of walks, got another file") from None
        pool = cls(tasks, size, charts, settings, seed)
        if other := first_difference(header, pool._header()):
            raise InvalidInput(
                f"{path}: expected a pool of the environment's walks, charts and settings: {other}"
            )
        if table.shape != pool._table.shape:
            raise InvalidInput(
                f"{path}: expected outcomes of shape {pool._table.shape}, got {table.shape}"
            )
        pool._table = np.array(table, dtype=np.float64)
        return pool

    def _solved(self, index: int, action: Action) -> Outcome:
        walk = self.walk(index)
        if self._bench is None or self._bench.task is not walk:
            self._bench = Workbench(walk, self.settings)
        chart, heights, noise = action
        attempt = Attempt(
            chart=self.charts[chart], heights=HEIGHTS[heights], noise=NOISES[noise], seed=index
        )
        return Outcome.of(
            attempted(self._bench, attempt), self.settings.max_iterations * len(attempt.heights)
        )

    def _header(self) -> dict[str, Any]:
        """Origin of the outcomes, JSON-ready."""
        tasks = self.tasks
        if isinstance(tasks, SampledTasks):
            task = {
                name: getattr(tasks, name)
                for name in ("terrain", "difficulty", "distance_m", "duration_s")
            } | {
                "robot": hashlib.sha256(
                    json.dumps(tasks.robot.to_json(), sort_keys=True).encode()
                ).hexdigest()
            }
        else:
            task = {
                "drawn_by": f"{tasks.__module__}:{getattr(tasks, '__qualname__', type(tasks).__qualname__)}"
            }
        first = self.walk(0)
        ends = np.concatenate(
            [first.start_xy_m, first.goal_xy_m, first.terrain.height(_PLACES).ravel()]
        )
        content = {
            "format": FORMAT,
            "size": self.size,
            "seed": self.seed,
            "charts": ", ".join(self.charts),
            "heights": HEIGHTS,
            "noises": NOISES,
            "settings": asdict(self.settings),
            "tasks": task,
            "first": ends.round(9).tolist(),
        }
        known: dict[str, Any] = json.loads(json.dumps(content))
        return known


def attempted(bench: Workbench, attempt: Attempt) -> Attempted | None:
    """Result of an attempt; None where the terrain has no map."""
    try:
        return bench.run(attempt)
    except PlanningFailed:
        return None


_PLACES: NDArray[np.float64] = np.stack(
    np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"), axis=-1
)


def _number(value: float | Array) -> float:
    """A finite number."""
    return float(np.clip(np.nan_to_num(value, nan=LARGEST), 0.0, LARGEST))
