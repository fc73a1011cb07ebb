"""Pan et al.'s benchmarks again: how often, how fast and how well charts find gaits that are
feasible, and that verify.

Every cell is one task of a terrain, one initial guess and one method, and a file of its own,
written when it is measured: a run that is stopped goes on with the next cell. Cells come in an
order that stays balanced wherever it stops: tasks far apart first, all terrains and methods of a
task together.
"""

from __future__ import annotations

import json
import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, NonNegativeFloat, NonNegativeInt, PositiveInt

from stancekit.planners.answer.report import Report, or_null
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import LARGEST
from stancekit.planners.files.documents import check_fields, read_json, shown, validated
from stancekit.planners.files.writing import write_text
from stancekit.planners.gait.charts import CHARTS
from stancekit.planners.gait.gait_program import formulate
from stancekit.planners.gait.method.attempt import SolveBudget
from stancekit.planners.gait.method.portfolio import Caps, default_attempts, plan_gait
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain import reference
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_tasks, reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.warp.spline_map import SplineMap
from stancekit.views.plots import GaitRun, draw_directions, draw_times

from ..data.executors import processes
from .evaluate import Share


class _Model(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)


class _Before(_Model):
    """A portfolio's first feasible point."""

    peak_acceleration_g: float | None


class _Failed(_Model):
    """Nothing was solved, e.g. for want of a map."""

    success: bool
    verified: bool
    refused: list[str] = []


class _Solved(_Failed):
    """A solve, or the solves of a portfolio, and the verifier's figures."""

    iterations: NonNegativeInt
    cpu_s: NonNegativeFloat
    linear_s: NonNegativeFloat
    phase_iterations: dict[str, int] = {}
    violations: list[float | None] = Field(default=[], min_length=1)
    before: _Before | None = None
    peak_acceleration_g: float | None = None
    force_rms: float | None = None
    force_peak: float | None = None
    reach: float | None = None
    penetration: float | None = None
    outside_cone: float | None = None
    friction_needed: float | None = None


def _checked_row(row: Any, cell: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The row as it is.

    Raises InvalidInput.

    Arguments:
        cell: terrain, task, seed and method that it is of.
    """
    if not isinstance(row, dict):
        raise InvalidInput(f"{where}: row: expected an object, got {type(row).__name__}")
    for name, value in cell.items():
        if row.get(name) != value:
            raise InvalidInput(
                f"{where}: row: {name}: expected {value!r} by the file's name, got "
                f"{shown(row.get(name))}"
            )
    solved = row.get("success") is not False or "violations" in row
    validated(_Solved if solved else _Failed, row, f"{where}: row")
    return row


@dataclass(frozen=True, kw_only=True)
class _GaitMethod:
    """A way to solve.

    Arguments:
        settings: those of ``GaitSettings`` that it sets.
        portfolio: the product, with all phases.
    """

    label: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    portfolio: bool = False


_PAPER = {"dynamics": "printed", "trunk_clearance_m": None}

_KNOWN: Mapping[str, _GaitMethod] = {
    "ambient": _GaitMethod(
        label="baseline: ambient, PCDM", settings={"chart": "ambient", **_PAPER}
    ),
    "warped": _GaitMethod(label="warped, as published", settings={"chart": "warped", **_PAPER}),
    "decoupled": _GaitMethod(label="ours: decoupled, centred", settings={"chart": "decoupled"}),
    "portfolio": _GaitMethod(label="ours: portfolio, smoothed", portfolio=True),
    "warped-exact": _GaitMethod(
        label="ours: warped-exact, centred", settings={"chart": "warped-exact"}
    ),
    "shear": _GaitMethod(label="shear, centred", settings={"chart": "shear"}),
    "ambient-centred": _GaitMethod(label="ambient, centred", settings={"chart": "ambient"}),
    "ambient-lbfgs": _GaitMethod(
        label="baseline, L-BFGS", settings={"chart": "ambient", "hessian": "lbfgs", **_PAPER}
    ),
    "warped-lbfgs": _GaitMethod(
        label="warped, as published, L-BFGS",
        settings={"chart": "warped", "hessian": "lbfgs", **_PAPER},
    ),
    "decoupled-lbfgs": _GaitMethod(
        label="ours: decoupled, L-BFGS", settings={"chart": "decoupled", "hessian": "lbfgs"}
    ),
}

METHODS: Mapping[str, _GaitMethod] = MappingProxyType(
    {
        **_KNOWN,
        **{
            chart: _GaitMethod(label=f"{chart}, centred", settings={"chart": chart})
            for chart in CHARTS.names()
            if chart not in _KNOWN
        },
    }
)
"""By name, and every further chart by its own. The paper's own methods have its dynamics and no
term for the trunk."""

PAPER: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "ambient-lbfgs": {"ripple": 0.48, "cone": 0.0, "hill": 0.0, "pit": 0.0},
        "warped-lbfgs": {"ripple": 0.92, "cone": 1.0, "hill": 1.0, "pit": 0.13},
    }
)
"""Success of Pan et al.'s Table I (Knitro, 200 iterations)."""


_Seconds = Annotated[float, Field(gt=0.0, le=LARGEST)]
TERRAINS = ("ripple", "cone", "hill", "pit")


_JUDGED = ("reach", "penetration", "trunk", "cone", "slip", "contact_gap")
"""Groups of the verifier whose values a cell keeps."""


@dataclass(frozen=True, kw_only=True)
class GaitBenchSettings:
    """Settings of the measurement.

    Arguments:
        every: each how manieth task of a terrain.
        seeds: perturbed guesses a task, besides the guess itself.
        noise: their deviation on every variable [m, rad, m·g].
        iterations: of a solve.
        cap_s: CPU time at which a solve is cut off and counts as a failure [s].
        total_s: of a portfolio.
    """

    terrains: tuple[str, ...] = TERRAINS
    methods: tuple[str, ...] = tuple(METHODS)
    every: PositiveInt = 1
    seeds: NonNegativeInt = 3
    noise: Annotated[float, Field(gt=0.0, le=1.0)] = 0.02
    iterations: PositiveInt = 200
    cap_s: _Seconds = 120.0
    total_s: _Seconds = 240.0

    def __post_init__(self) -> None:
        for name, known in (("terrains", reference.TERRAINS.names()), ("methods", tuple(METHODS))):
            unknown = sorted(set(getattr(self, name)) - set(known))
            if unknown or not getattr(self, name):
                raise InvalidInput(
                    f"{name}: expected some of {', '.join(known)}, got "
                    f"{', '.join(unknown) or 'none'}"
                )
        check_fields(self)

    @classmethod
    def quick(cls) -> GaitBenchSettings:
        """Minutes on one core: one task a terrain, as it is, by the methods that matter most."""
        methods = ("ambient", "warped", "decoupled", "portfolio")
        return cls(methods=methods, every=24, seeds=0, cap_s=15.0, total_s=45.0)

    def protocol(self) -> dict[str, Any]:
        """Settings on which a cell's figures depend."""
        return {name: getattr(self, name) for name in ("noise", "iterations", "cap_s", "total_s")}


@dataclass(frozen=True)
class GaitCell:
    """One task, one guess (0: the terrain-following one, else perturbed with this seed), one
    method.
    """

    terrain: str
    task: int
    seed: int
    method: str

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.terrain}-{self.task:02d}-{self.seed}-{self.method}.json"


def cells(settings: GaitBenchSettings) -> list[GaitCell]:
    """Every cell, in the order in which they are measured."""
    result: list[GaitCell] = []
    for seed in range(settings.seeds + 1):
        turns = {
            name: _spread(len(reference_tasks(name)), settings.every) for name in settings.terrains
        }
        for k in range(max(len(tasks) for tasks in turns.values())):
            result += [
                GaitCell(name, turns[name][k], seed, method)
                for name in settings.terrains
                if k < len(turns[name])
                for method in settings.methods
            ]
    return result


def _spread(count: int, every: int) -> list[int]:
    """0, every, 2 every, …, those far from the ones before first (van der Corput)."""
    return sorted(range(0, count, every), key=lambda k: int(f"{k // every:016b}"[::-1], 2))


def run(
    settings: GaitBenchSettings,
    folder: Path,
    on_progress: Callable[[str, int, int], None] | None = None,
    workers: int = 1,
) -> Iterator[dict[str, Any]]:
    """Measure the cells that the folder does not have by this protocol; yield the row of every
    cell, as they come.
    """
    every, missing = cells(settings), []
    for cell in every:
        row = _kept(cell, settings, folder)
        if row is None:
            missing.append(cell)
        else:
            yield row
    done = len(every) - len(missing)
    for row in processes(workers)([partial(measured, cell, settings, folder) for cell in missing]):
        done += 1
        if on_progress is not None:
            on_progress(
                f"{row['terrain']} {row['task']}, {METHODS[row['method']].label}", done, len(every)
            )
        yield row


def kept(settings: GaitBenchSettings, folder: Path) -> list[dict[str, Any]]:
    """The rows that the folder has by this protocol.

    Raises InvalidInput for a file that is no cell.
    """
    rows = (_kept(cell, settings, folder) for cell in cells(settings))
    return [row for row in rows if row is not None]


def _kept(cell: GaitCell, settings: GaitBenchSettings, folder: Path) -> dict[str, Any] | None:
    path = folder / cell.file
    if not path.exists():
        return None
    content = read_json(path)
    if not isinstance(content, dict):
        raise InvalidInput(
            f"{path}: expected an object with protocol and row, got {type(content).__name__}"
        )
    same = content.get("protocol") == settings.protocol()
    return _checked_row(content.get("row"), asdict(cell), str(path)) if same else None


def measured(cell: GaitCell, settings: GaitBenchSettings, folder: Path) -> dict[str, Any]:
    """The row of one cell, and its file."""
    row = {**asdict(cell), **measure(cell, settings, folder)}
    content = json.dumps({"protocol": settings.protocol(), "row": row}, indent=1, allow_nan=False)
    write_text(folder / cell.file, content + "\n")
    return row


def measure(cell: GaitCell, settings: GaitBenchSettings, folder: Path) -> dict[str, Any]:
    """The figures of one cell; times are CPU time [s]."""
    method, task = METHODS[cell.method], gait_task(cell.terrain, cell.task)
    try:
        if method.portfolio:
            return _planned(cell, settings, task)
        settings_of_method = GaitSettings(max_iterations=settings.iterations, **method.settings)
        program = formulate(task, settings_of_method, lambda: _map(cell.terrain, folder))
    except PlanningFailed as error:
        return {"success": False, "verified": False, "status": str(error), "message": str(error)}
    guess = program.perturbed(_rng(cell), settings.noise) if cell.seed else program.guess
    budget = SolveBudget(solve_s=settings.cap_s, total_s=settings.cap_s)
    solution = budget(program, guess)
    report = check_trajectory(solution.trajectory())
    (record,) = budget.solves
    return {
        "success": record.success,
        "verified": record.success and report.accepted,
        "status": record.status,
        "iterations": record.iterations,
        "cpu_s": record.seconds,
        "evaluating_s": record.seconds_evaluating,
        "linear_s": record.seconds_linear,
        "violations": [or_null(value) for value in record.violations],
        "capped": not record.success and record.seconds >= settings.cap_s,
        **figures(report),
    }


def _planned(cell: GaitCell, settings: GaitBenchSettings, task: Walk) -> dict[str, Any]:
    """The product: all phases, from a guess that is perturbed alike in every chart."""
    caps = Caps(solve_s=settings.cap_s, total_s=settings.total_s)
    attempts = [
        one.perturbed(cell.seed, settings.noise) if cell.seed else one
        for one in default_attempts(task)
    ]
    plan = plan_gait(
        task, GaitSettings(max_iterations=settings.iterations), caps=caps, attempts=attempts
    )
    if not plan.attempts:
        raise PlanningFailed(plan.message)
    best = plan.attempts[-1]
    phases = {
        name: [one for one in plan.solves if one.phase == name]
        for name in ("feasible", "smooth", "densify")
    }
    before = plan.feasible[-1]
    return {
        "success": any(report is not None for report in plan.feasible),
        "verified": plan.verified,
        "status": best.solution.status,
        "chart": best.attempt.chart,
        "iterations": sum(one.iterations for one in phases["feasible"]),
        "cpu_s": plan.seconds,
        "evaluating_s": sum(one.seconds_evaluating for one in plan.solves),
        "linear_s": sum(one.seconds_linear for one in plan.solves),
        "phase_s": {name: sum(one.seconds for one in solves) for name, solves in phases.items()},
        "phase_iterations": {
            name: sum(one.iterations for one in solves) for name, solves in phases.items()
        },
        "capped": not plan.verified and plan.seconds >= settings.total_s,
        "before": None if before is None else figures(before),
        **figures(best.report),
    }


def figures(report: Report[Trajectory]) -> dict[str, Any]:
    """Figures that the verifier measured: its figures, the values of some groups [SI], and what it
    refuses.
    """
    values = {group.name: group.value for group in report.groups if group.name in _JUDGED}
    return {
        "message": report.message,
        "refused": [group.name for group in report.refused],
        **{name: or_null(value) for name, value in {**values, **report.figures}.items()},
    }


def gait_task(terrain: str, number: int) -> Walk:
    """A task of Pan et al.'s benchmark for ANYmal.

    In pits the robot faces its goal, for its suckers are in front; elsewhere it faces x and walks
    in all directions.
    """
    task = reference_tasks(terrain)[number]
    way = task.goal - task.start
    return Walk(
        robot=anymal(),
        terrain=_terrain(terrain),
        start=task.start,
        goal=task.goal,
        adhesive=task.adhesive,
        start_yaw_rad=math.atan2(way[1], way[0]) if terrain.startswith("pit") else 0.0,
    )


@lru_cache(maxsize=4)
def _terrain(name: str) -> HeightField:
    return reference_terrain(name)


@lru_cache(maxsize=4)
def _map(terrain: str, folder: Path) -> SplineMap:
    """The terrain's map, from the folder where it was made before.

    Raises PlanningFailed for one that folds.
    """
    from stancekit.planners.warp.conformal import flatten

    path = folder / f"map-{terrain}.npz"
    if path.exists():
        return SplineMap.from_file(path)
    made = flatten(_terrain(terrain))
    made.to_file(path)
    return made


def _rng(cell: GaitCell) -> np.random.Generator:
    """Random generator, the same for all methods of a task and a seed."""
    return np.random.default_rng([zlib.crc32(cell.terrain.encode()), cell.task, cell.seed])


Row = Mapping[str, Any]
BASELINE = "ambient"
"""Baseline of iterations and times: the exact Hessian in the world's coordinates, in the same
run."""
_QUARTILES = (25.0, 50.0, 75.0)


def table(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """One record a method and terrain, in the order of ``METHODS`` and of the rows.

    cells; success, verified: shares, each with its Wilson 95 % interval (success_interval,
    verified_interval); left_cone: share of those that succeeded whose feet leave the
    true cone; paper: the success that Pan et al. print for it, if any; capped: how many were cut
    off. verified_cpu_s: quartiles over what the verifier accepts. Quartiles over the cells that
    succeeded: iterations, cpu_s, iteration_s, linear_share (of the CPU time in the solver and its
    linear algebra), peak_g, peak_before_g (of a portfolio's first feasible point), force_rms,
    force_peak, reach_mm, penetration_mm, and outside_cone, the share of standing samples outside
    the cone.
    """
    every = list(rows)
    terrains = list(dict.fromkeys(row["terrain"] for row in every))
    lines: list[dict[str, Any]] = []
    for method in METHODS:
        for terrain in terrains:
            rows_of_method = [
                row for row in every if row["method"] == method and row["terrain"] == terrain
            ]
            if rows_of_method:
                lines.append(_record(method, terrain, rows_of_method))
    return lines


def _record(method: str, terrain: str, rows: Sequence[Row]) -> dict[str, Any]:
    good = [row for row in rows if row["success"]]
    return {
        "method": method,
        "label": METHODS[method].label,
        "terrain": terrain,
        "cells": len(rows),
        "success": _share(row["success"] for row in rows),
        "verified": _share(row["verified"] for row in rows),
        "success_interval": list(Share(hits=len(good), of=len(rows)).interval),
        "verified_interval": list(
            Share(hits=sum(row["verified"] for row in rows), of=len(rows)).interval
        ),
        "left_cone": _share(
            row["outside_cone"] > 0.0 for row in good if row.get("outside_cone") is not None
        ),
        "paper": PAPER.get(method, {}).get(terrain),
        "capped": sum(bool(row.get("capped")) for row in rows),
        "refused": dict(
            Counter(group for row in good for group in row.get("refused", ())).most_common()
        ),
        **{name: quartiles([read(row) for row in good]) for name, read in _MEASURES.items()},
        "verified_cpu_s": quartiles([row.get("cpu_s") for row in rows if row["verified"]]),
    }


def _of(name: str, scale: float = 1.0) -> Callable[[Row], float | None]:
    return lambda row: None if row.get(name) is None else scale * float(row[name])


def _before(row: Row) -> float | None:
    return row["before"]["peak_acceleration_g"] if row.get("before") else None


def _shares(row: Row) -> float | None:
    return row["linear_s"] / row["cpu_s"] if row.get("cpu_s") else None


def _iteration(row: Row) -> float | None:
    steps = (
        sum(row["phase_iterations"].values())
        if "phase_iterations" in row
        else row.get("iterations", 0)
    )
    return row["cpu_s"] / steps if steps else None


_MEASURES: Mapping[str, Callable[[Row], float | None]] = {
    "iterations": _of("iterations"),
    "cpu_s": _of("cpu_s"),
    "iteration_s": _iteration,
    "linear_share": _shares,
    "peak_g": _of("peak_acceleration_g"),
    "peak_before_g": _before,
    "force_rms": _of("force_rms"),
    "force_peak": _of("force_peak"),
    "reach_mm": _of("reach", 1e3),
    "penetration_mm": _of("penetration", 1e3),
    "outside_cone": _of("outside_cone"),
    "friction_needed": _of("friction_needed"),
}


def quartiles(values: Iterable[float | None]) -> list[float] | None:
    """25, 50 and 75 % of what is there; None of nothing."""
    known = [value for value in values if value is not None]
    return [float(value) for value in np.percentile(known, _QUARTILES)] if known else None


def ratios(
    rows: Iterable[Row], method: str, name: str = "iterations", against: str = BASELINE
) -> dict[str, float]:
    """Ratios by terrain: the median of a measure over the median of ``against``, on the cells in
    which both succeeded.

    Terrains without such a cell are missing.
    """
    cells = {
        (row["terrain"], row["task"], row["seed"], row["method"]): row
        for row in rows
        if row["success"]
    }
    pairs: dict[str, list[tuple[float, float]]] = {}
    for (terrain, task, seed, name_of_method), row in cells.items():
        other = cells.get((terrain, task, seed, against))
        if name_of_method == method and other is not None:
            pairs.setdefault(terrain, []).append((float(row[name]), float(other[name])))
    medians = {
        terrain: np.median(np.array(cells_of_pair), axis=0)
        for terrain, cells_of_pair in pairs.items()
    }
    return {
        terrain: float(name_of_method / max(theirs, 1e-9))
        for terrain, (name_of_method, theirs) in medians.items()
    }


def _share(flags: Iterable[bool]) -> float | None:
    """Share of true flags; None without flags."""
    values = list(flags)
    return sum(values) / len(values) if values else None


_DRAWN = ("ambient-lbfgs", "warped-lbfgs", "decoupled-lbfgs", "ambient", "warped", "decoupled")
_COLOURED = tuple(METHODS[method].label for method in _DRAWN)
"""A method has the same colour in every picture, whatever was measured."""
_AROUND = ("ripple", "cone", "pit", "pit-84", "pit-87")
"""Terrains whose tasks go all around."""


def draw(rows: Iterable[Row], folder: Path) -> list[Path]:
    """Write directions-TERRAIN.png and times-TERRAIN.png where tasks go all around; what was
    written.

    Cells without a single iterate, e.g. for want of a map, are left out.
    """
    from stancekit.views.sheet import save

    every, written = (
        [row for row in rows if row["method"] in _DRAWN and row.get("violations")],
        list[Path](),
    )
    for terrain in dict.fromkeys(row["terrain"] for row in every if row["terrain"] in _AROUND):
        rows_of_method = [
            row
            for method in _DRAWN
            for row in every
            if (row["method"], row["terrain"]) == (method, terrain)
        ]
        for name, figure in _figures(terrain, rows_of_method):
            written.append(folder / f"{name}-{terrain}.png")
            save(figure, written[-1])
    return written


def _figures(terrain: str, rows: Sequence[Row]) -> Iterator[tuple[str, Any]]:
    seeds = sorted({row["seed"] for row in rows})
    wedge = 2.0 * math.pi / len(reference_tasks(terrain)) / len(seeds)
    beside = [
        _run(row, wedge * (seeds.index(row["seed"]) - 0.5 * (len(seeds) - 1))) for row in rows
    ]
    guesses = (
        f"up to {len(seeds)} guesses a direction" if len(seeds) > 1 else "one guess a direction"
    )
    yield (
        "directions",
        draw_directions(beside, caption=f"Violation by walking direction on {terrain}, {guesses}"),
    )
    caption = f"CPU time by walking direction on {terrain}, {guesses}"
    yield "times", draw_times([_run(row) for row in rows], caption=caption, methods=_COLOURED)


def _run(row: Row, beside_rad: float = 0.0) -> GaitRun:
    task = reference_tasks(row["terrain"])[row["task"]]
    way = task.goal - task.start
    return GaitRun(
        method=METHODS[row["method"]].label,
        violations=np.array([math.inf if value is None else value for value in row["violations"]]),
        direction_rad=math.atan2(way[0], way[1]) + beside_rad,
        seconds=row["cpu_s"],
    )
