"""``stancekit bench``: the papers' tables, made again."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.console import Console

from stancekit.planners.errors import InvalidInput

from .console import as_options, draw_to_file, emit, err, grid, out, say, stages
from .fit import score_table
from .options import (
    ROBOT,
    TERRAIN,
    OptionalFloat,
    OptionalInt,
    OptionalPath,
    OptionalText,
    check_unused,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit.learners.evaluation.gait_bench import GaitBenchSettings
    from stancekit.learners.evaluation.room import Room, Share


@dataclass
class _BenchEnvelopes:
    """Compare every method on held-out terrains, as in Lin et al.'s Table I, with 95 % intervals
    and the paper's own rows.

    Labels training, calibration and test terrains, learns a selector by every method of the
    configuration, and rolls all of them out on the same test terrains. Data sets, selectors, rows
    and pictures are kept in a folder. A run that was stopped goes on where it was, and files that
    were made with the same settings are used again.
    """

    config: OptionalPath = None
    """Experiment file (YAML); without one, configs/bench-envelopes.yaml."""
    quick: bool = False
    """Use the file's section quick: small data, short training."""
    problem: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Classes of problems, instead of the file's."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand, instead of the file's: a .urdf file, or a .yaml file that names
    one."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that scenes are cut from, instead of the file's."""
    out: OptionalPath = None
    """Folder for everything that is made; unless given, out/bench, or out/bench-quick."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Processes for labelling and rollouts."""
    executor: Literal["processes", "ray"] = "processes"
    """Where labelling and rollouts run: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """One JSON object per row."""

    def run(self) -> int:
        """Run the bench, and write the table, as numbers and as a page, and a picture per class."""
        from stancekit.configs import config_path
        from stancekit.learners.data.executors import executor
        from stancekit.learners.evaluation import evaluate
        from stancekit.learners.evaluation.evaluate import Experiment
        from stancekit.planners.files.writing import make_folder, write_text

        arguments = {
            "problems": list(self.problem) or None,
            "robot": self.robot,
            "terrain": None if self.terrain is None else str(self.terrain),
        }
        experiment = Experiment.from_yaml(
            self.config or config_path("bench-envelopes.yaml"),
            quick=self.quick,
            overrides={name: value for name, value in arguments.items() if value is not None},
        )
        where = executor(self.executor, workers=self.workers, address=self.address)
        folder = self.out or Path("out/bench-quick" if self.quick else "out/bench")
        make_folder(folder)
        minutes = evaluate.expected_s(experiment, self.workers) / 60.0
        err.print(
            f"about {minutes:.2g} minutes with {self.workers} idle core(s), less what {folder} has",
            highlight=False,
        )
        table: list[dict[str, Any]] = []
        with stages("bench") as on_progress:
            for result in evaluate.run(experiment, folder, executor=where, progress=on_progress):
                records = result.to_json()
                table += records
                write_text(folder / "table.json", json.dumps(table, indent=1) + "\n")
                write_text(folder / "table.md", evaluate.page(table, experiment))
                draw_to_file(result.picture(), folder / f"{result.problem_class}.png")
                if self.json:
                    for record in records:
                        emit(record)
                else:
                    out.print(score_table(result.problem_class, list(result.scores)))
                    out.print()
        if not self.json:
            out.print(f"table and pictures: {folder}")
        return 0


_WIDTH = 150
"""Width of the table, in letters, also where a terminal is narrower: it folds lines, and a file
keeps them."""


def _measured(
    title: str, measure: Callable[[Any], Iterable[dict[str, Any]]], *, as_json: bool
) -> list[dict[str, Any]]:
    """The rows of a measurement, each printed as it comes where JSON is asked for.

    Arguments:
        measure: called with what shows its progress.
    """
    rows = list[dict[str, Any]]()
    with stages(title) as on_progress:
        for row in measure(on_progress):
            rows.append(row)
            if as_json:
                emit(row)
    return rows


@dataclass
class _BenchPlanner:
    """Lin et al.'s Table II: how long planning two-wall climbs takes, and how large the programs
    are.

    One run and one thread each: the two-stage planners with compiling and re-solving apart, and
    MICP without and with an envelope under a time limit, the paper's own times beside them. A run
    that is stopped goes on with the next cell.
    """

    quick: bool = False
    """Few key frames and a short time limit."""
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    """Solver of the mixed-integer programs."""
    cap: OptionalFloat = None
    """Time limit of a mixed-integer program [s]; unless given, 120, or 20 with --quick."""
    out: OptionalPath = None
    """Folder for the cells and the table; unless given, out/bench-planner, or
    out/bench-planner-quick."""
    json: bool = False
    """One JSON object per cell."""

    def run(self) -> int:
        """Measure what is missing, and print the table."""
        from stancekit.learners.evaluation import planner_bench
        from stancekit.planners.files.arrays import checked
        from stancekit.planners.files.writing import make_folder, write_text

        settings = (
            planner_bench.PlannerBenchSettings.quick()
            if self.quick
            else planner_bench.PlannerBenchSettings()
        )
        settings = replace(settings, solver=self.solver)
        if self.cap is not None:
            settings = replace(settings, cap_s=checked(self.cap, "cap", above=0.0))
        folder = self.out or Path("out/bench-planner-quick" if self.quick else "out/bench-planner")
        make_folder(folder)
        measure = partial(planner_bench.run, settings, folder)
        rows = _measured("bench planner", measure, as_json=self.json)
        write_text(folder / "table.json", json.dumps(rows, indent=1) + "\n")
        if not self.json:
            Console(width=max(out.width, _WIDTH), soft_wrap=True).print(table(rows))
            for method in dict.fromkeys(row["method"] for row in rows if "over_solver" in row):
                out.print(f"{method}: CPU s ~ M^{planner_bench.growth(rows, method):.2f}")
            say(speed_ups(rows))
            out.print(f"cells and table: {folder}")
        return 0


def table(rows: list[dict[str, Any]]) -> Table:
    """The rows as a table."""
    names = (
        "method",
        "M",
        "columns",
        "binary",
        "rows",
        "compile s",
        "solve s",
        "CPU s",
        "/ solver",
        "|m-pf|",
        "moments",
        "answer",
        "paper s",
    )
    columns = {
        name: {"justify": "left" if name in ("method", "answer") else "right", "no_wrap": True}
        for name in names
    }
    return grid(
        columns,
        map(_cells, rows),
        title="Table II",
        caption="* to a relative gap, the others to the first point; / solver: planning, without verifying, over "
        "Clarabel's own time; |m-pf|: most in a cell of the grid; moments: what the grid's point "
        "leaves of them",
    )


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    """The cells of a row."""
    paper = row.get("paper", {})
    return (
        row["method"] + (" *" if row["optimised"] else ""),
        str(row["frames"]),
        str(row["variables"]),
        str(row["binaries"]),
        str(row["constraints"]),
        _figure(row["compile_s"]),
        ("> " if row.get("capped") else "") + _figure(row["seconds"]),
        _figure(row["cpu_s"]),
        _figure(row.get("over_solver")),
        _figure(row.get("cell_error")),
        _figure(row.get("claimed_residual")),
        row["status"],
        f"> {paper['more_than']}" if "more_than" in paper else _figure(paper.get("seconds")),
    )


def speed_ups(rows: list[dict[str, Any]]) -> list[str]:
    """Factor by which MICP takes less CPU time than over [−1, 1] with as many intervals, per number
    of key frames.
    """
    from stancekit.learners.evaluation.planner_bench import FORMS

    by_cell = {(row["method"], row["frames"], row["optimised"]): row for row in rows}
    lines = []
    for (method, frames, optimised), row in by_cell.items():
        plain = by_cell.get((method.rpartition(", ")[0], frames, optimised))
        if plain is None or plain["method"] not in (FORMS["unit-4"], FORMS["unit-2"]):
            continue
        sign = {(False, False): "", (True, False): "≥ ", (False, True): "≤ "}.get(
            (plain["capped"], row["capped"])
        )
        if sign is not None:
            message = " *" if optimised else ""
            lines.append(
                f"{method}{message}, M = {frames}: "
                f"{sign}{plain['cpu_s'] / max(row['cpu_s'], 1e-9):.1f} ×"
            )
    return lines


def _figure(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else f"{value:.3g}"


METHODS = ("random", "noise", "noise-again", "rule-tuned", "farkas", "finder", "finder-tuned")
_LEAPS = "LeapChoice-v0"
_OF_LEAPS = ("scorer", "method", "distribution", "solves", "cpu_s", "oracle_solves")
"""Options that other environments do not use."""
_QUICK = 40
"""Scenes of a quick look."""


@dataclass
class _BenchRoom:
    """Measure how much room for learning an environment leaves: what any method finds, less what
    the best unlearned one finds.

    One line per budget, one try and so many convex problems: random choices, the best unlearned
    control, the learned scores where files of them are given, and the oracle, which is the union of
    all methods at a larger budget. The oracle with another seed stands beside it: where both agree,
    room is no luck. Rows are kept in a folder, and a run that is stopped goes on. All shares have
    intervals of 95 %; the gain of learned scores is paired over the scenes.
    """

    scorer: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE ...")] = ()
    """Files of `stancekit fit` from labelled tries of leaps, or a name that ships; of several, as
    of training seeds, the mean is taken. Scenes that they learned from are refused."""
    method: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = METHODS
    """Methods that learn nothing: random, noise, rule-tuned, farkas, finder, finder-tuned; the best
    within a budget is its control. noise-again draws with another seed."""
    environment: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = (_LEAPS,)
    """Some of LeapChoice-v0, EnvelopeSelection-v0, EnvelopeRefinement-v0, Traverse-v0,
    WarpedGait-v0. Of all but the first the budget is that of an episode, and a planner beside the
    environment is a control, too. A walk takes a minute of the processor for all policies."""
    distribution: str = "leap-hard"
    """Class of leaps."""
    scenes: int = 300
    """Scenes, from number 0 on; fewer than 300 decide nothing."""
    seed: int = 4900
    """Seed of the scenes; data sets to learn from have another one."""
    solves: Annotated[tuple[int, ...], tyro.conf.arg(metavar="INT ...")] = (12, 25)
    """Budgets in convex problems, beside that of one try."""
    cpu_s: Annotated[tuple[float, ...], tyro.conf.arg(metavar="FLOAT ...")] = ()
    """Budgets in CPU time, the network's own counted [s]; one process alone on the computer
    measures them."""
    oracle_solves: int = 50
    """Convex problems of the oracle, per method and scene."""
    quick: bool = False
    """A look at 40 scenes, in a minute or two."""
    out: Path = Path("out/bench-room")
    """Folder for the rows."""
    json: bool = False
    """One JSON object per budget."""

    def run(self) -> int:
        """Measure what is missing, and print the table."""
        if not self.environment:
            raise InvalidInput("--environment: expected one or more, got none")
        if others := [name for name in self.environment if name != _LEAPS]:
            from stancekit.learners.evaluation.room import ENVIRONMENTS
            from stancekit.planners.files.arrays import checked_choice

            for name in others:
                checked_choice(name, "--environment", (_LEAPS, *ENVIRONMENTS))
        if _LEAPS not in self.environment:
            check_unused(self, _OF_LEAPS, ", ".join(self.environment))
        rooms = [
            line
            for name in self.environment
            for line in (self._leaps() if name == _LEAPS else [self._other(name)])
        ]
        if self.json:
            for line in rooms:
                emit(line.to_json())
            return 0
        Console(width=max(out.width, _WIDTH), soft_wrap=True).print(_table(rooms))
        out.print(f"rows: {self.out}")
        return 0

    def _other(self, name: str) -> Room:
        """Another environment."""
        from stancekit.learners.evaluation.room import environment_room

        with as_options("environment", "scenes", "seed"), stages("bench room") as on_progress:
            scenes = min(self.scenes, _QUICK) if self.quick else self.scenes
            return environment_room(
                name, self.out / name, scenes=scenes, seed=self.seed, on_progress=on_progress
            )

    def _leaps(self) -> list[Room]:
        """LeapChoice-v0, a line per budget."""
        from stancekit.learners.evaluation import room
        from stancekit.learners.evaluation.room import leap_room
        from stancekit.learners.zoo import shipped
        from stancekit.planners.files.arrays import checked, checked_int

        with as_options(
            "distribution",
            "scenes",
            "seed",
            "method",
            "scorer",
            "solves",
            "cpu_s",
            "oracle_solves",
        ):
            checked_int(self.oracle_solves, "oracle_solves", least=1)
            for path in self.scorer:
                if not room.is_scorer(path):
                    names = ", ".join(shipped("scorers"))
                    raise InvalidInput(
                        f"scorer: expected a file of leaps' scores, or one of {names}, got {path}"
                    )
            for solves in self.solves:
                checked_int(solves, "solves", least=1, most=self.oracle_solves)
            for seconds in self.cpu_s:
                checked(seconds, "cpu_s", above=0.0)
            settings = room.LeapBenchSettings(
                distribution=self.distribution,
                scenes=min(self.scenes, _QUICK) if self.quick else self.scenes,
                seed=self.seed,
                methods=(*self.method, *self.scorer),
                solves=self.oracle_solves,
            )
            if not {*room.FINDERS, *room.TUNED} & {*settings.methods}:
                raise InvalidInput(
                    f"method: expected a control among them, got {', '.join(self.method) or 'none'}"
                )
        with stages("bench room") as on_progress:
            rows = room.run(settings, self.out, on_progress)
        budgets: list[dict[str, Any]] = [{"tries": 1}, *({"solves": each} for each in self.solves)]
        budgets += [{"cpu_s": each} for each in self.cpu_s]
        return [
            leap_room(rows, self.distribution, self.oracle_solves, **budget) for budget in budgets
        ]


def _table(lines: list[Room]) -> Table:
    """The lines as a table, in percent and points, with 95 % intervals."""
    remarks = dict.fromkeys(
        f"{line.environment}: {line.scenes} scenes, oracle: {line.oracle_budget}" for line in lines
    )
    names = (
        "environment",
        "budget",
        "random",
        "control",
        "",
        "learned",
        "",
        "gain",
        "oracle",
        "again",
        "room",
    )
    left = ("environment", "budget", "")
    rows = (
        (
            line.environment,
            line.budget,
            _percent(line.random),
            _percent(line.control),
            line.controlled_by,
            _percent(line.learned),
            line.learned_by,
            _points(line.gain),
            _percent(line.oracle),
            _percent(line.again),
            f"{line.room:.0f}",
        )
        for line in lines
    )
    return grid(
        [(name, {"justify": "left" if name in left else "right"}) for name in names],
        rows,
        title="; ".join(remarks),
        caption="shares of all scenes in percent, gain and room in points",
        box=None,
    )


def _percent(value: Share | None) -> str:
    return (
        "–"
        if value is None
        else "{:.0f} [{:.0f}, {:.0f}]".format(*(100.0 * part for part in value))
    )


def _points(value: Share | None) -> str:
    return "–" if value is None else "{:+.1f} [{:+.1f}, {:+.1f}]".format(*value)


_WIDEST = 200
"""Width of tables where standard output is no terminal."""


@dataclass
class BenchGait:
    """Pan et al.'s benchmarks: 24 directions on ripple and cone, 15 targets on hill and pit, by
    every chart.

    Success is the paper's: a largest violation below 1e-4 within 200 iterations; verified success:
    the verifier accepts what the motion does between the knots. Each task from the
    terrain-following guess and from perturbed ones.

    All of it takes hours on one core. A run that is stopped goes on with the next cell.
    """

    quick: bool = False
    """One task per terrain by four methods: a few minutes on one core."""
    terrain: Annotated[str, tyro.conf.arg(metavar="NAMES")] = ""
    """Some of ripple, cone, hill, pit, pit-84, pit-87, with commas; unless given, the paper's
    four."""
    chart: Annotated[str, tyro.conf.arg(metavar="METHODS")] = ""
    """Some methods, with commas, e.g. ambient,warped,decoupled,portfolio,ambient-lbfgs; all
    unless given."""
    tasks: OptionalInt = None
    """Which tasks of a terrain: 1 for all of them, 4 for every fourth."""
    seeds: OptionalInt = None
    """Perturbed guesses per task, besides the guess itself; 3 unless given."""
    cap: OptionalFloat = None
    """CPU time at which a solve is cut off and counts as a failure [s]."""
    workers: int = 1
    """Processes."""
    out: OptionalPath = None
    """Folder for the cells and the tables; unless given, out/bench-gait, or
    out/bench-gait-quick."""
    kept: bool = False
    """Measure nothing: the tables of what the folder has."""
    json: bool = False
    """One JSON object per cell."""

    def run(self) -> int:
        """Measure what is missing, and print the tables."""
        from stancekit.learners.evaluation import gait_bench
        from stancekit.planners.files.arrays import checked_int
        from stancekit.planners.files.writing import make_folder, write_text

        settings = self._settings()
        checked_int(self.workers, "--workers", least=1)
        folder = self.out or Path("out/bench-gait-quick" if self.quick else "out/bench-gait")
        if not self.kept:
            make_folder(folder)
        elif not folder.is_dir():
            raise InvalidInput(
                f"{folder}: expected an existing folder with --kept, found none there"
            )
        measure = (
            (lambda _: gait_bench.kept(settings, folder))
            if self.kept
            else partial(gait_bench.run, settings, folder, workers=self.workers)
        )
        rows = _measured("bench gait", measure, as_json=self.json)
        if not rows:
            raise InvalidInput(f"{folder}: expected cells of this protocol, got none")
        records = gait_bench.table(rows)
        write_text(folder / "table.json", json.dumps(records, indent=1) + "\n")
        if not self.json:
            wide = out if out.is_terminal else Console(width=_WIDEST)
            for made in (success_table(records), _speed_table(records), _motion_table(records)):
                wide.print(made)
            say((*_comparisons(rows), *products(records)))
        drawings = gait_bench.draw(rows, folder)
        if not self.json:
            names = ", ".join(sorted({path.stem.partition("-")[0] for path in drawings}))
            out.print(
                f"{folder}: cells, table.json" + (f", pictures ({names})" if drawings else "")
            )
        return 0

    def _settings(self) -> GaitBenchSettings:

        from stancekit.learners.evaluation.gait_bench import GaitBenchSettings

        settings = GaitBenchSettings.quick() if self.quick else GaitBenchSettings()
        options: dict[str, Any] = {"every": self.tasks, "seeds": self.seeds, "cap_s": self.cap}
        options |= {"terrains": _names(self.terrain), "methods": _names(self.chart)}
        arguments = {name: value for name, value in options.items() if value not in (None, ())}
        with as_options(every="tasks", cap_s="cap", terrains="terrain", methods="chart"):
            return replace(settings, **arguments)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def success_table(records: list[dict[str, Any]]) -> Table:
    """Pan et al.'s Table I: success, and what the verifier accepts of it."""
    terrains = list(dict.fromkeys(record["terrain"] for record in records))
    cells = {(record["label"], record["terrain"]): record for record in records}
    labels = dict.fromkeys(record["label"] for record in records)
    return grid(
        {"method": {"no_wrap": True}, **{terrain: {"justify": "right"} for terrain in terrains}},
        (
            (label, *(_rates(cells.get((label, terrain))) for terrain in terrains))
            for label in labels
        ),
        title="Table I",
        caption="success % / verified %, each with its 95 % interval, of as many cells; "
        "(% of Pan et al.); ! n: n cells were cut off by --cap; "
        "–: not measured",
    )


def _rates(record: dict[str, Any] | None) -> str:
    if record is None:
        return "–"
    text = " / ".join(_rate(record, name) for name in ("success", "verified"))
    text += f" of {record['cells']}"
    text += "" if record["paper"] is None else f" ({100 * record['paper']:.0f})"
    return text + (f" ! {record['capped']}" if record["capped"] else "")


def _rate(record: dict[str, Any], name: str) -> str:
    """A share in percent with its interval."""
    low, high = (100 * max(end, 0.0) for end in record[f"{name}_interval"])
    return f"{100 * record[name]:.0f} [{low:.0f}, {high:.0f}]"


def _speed_table(records: list[dict[str, Any]]) -> Table:
    """Iterations and CPU time of what succeeded."""
    return _medians(
        records,
        "Iterations and CPU time",
        "of cells that succeeded: median, lower and upper quartile; solver: share of the CPU time "
        "in IPOPT and MUMPS, "
        "the rest is evaluation; a portfolio's time is of all its phases",
        {
            "iterations": "iterations",
            "cpu_s": "CPU s",
            "iteration_s": "s / iteration",
            "linear_share": "solver",
        },
        digits=3,
    )


def _motion_table(records: list[dict[str, Any]]) -> Table:
    """Table of what the motions do between the nodes."""
    return _medians(
        records,
        "Between the nodes",
        "of cells that succeeded: median, lower and upper quartile; left cone: cells with standing "
        "samples outside the "
        "true cone; outside: their share; before: a portfolio's first feasible point",
        {
            "left_cone": "left cone",
            "outside_cone": "outside",
            "force_rms": "force rms m·g",
            "reach_mm": "reach mm",
            "penetration_mm": "depth mm",
            "peak_before_g": "before g",
            "peak_g": "peak g",
        },
        digits=2,
    )


def _medians(
    records: list[dict[str, Any]], title: str, caption: str, columns: dict[str, str], digits: int
) -> Table:
    look = {"justify": "right", "overflow": "fold"}
    cells = (
        (
            record["label"],
            record["terrain"],
            *(_quartiles(record[name], digits) for name in columns),
        )
        for record in records
    )
    heads: dict[str, dict[str, Any]] = {"method": {"no_wrap": True}, "terrain": {"no_wrap": True}}
    return grid(heads | dict.fromkeys(columns.values(), look), cells, title=title, caption=caption)


def _quartiles(values: list[float] | float | None, digits: int) -> str:
    """Median and quartiles, or a share in percent."""
    if values is None:
        return ""
    if isinstance(values, float):
        return f"{100 * values:.0f} %"
    low, middle, high = (f"{value:.{digits}g}" if abs(value) >= 5e-4 else "0" for value in values)
    return f"{middle} ({low}–{high})" if low != high else middle


def _comparisons(rows: list[dict[str, Any]]) -> list[str]:
    """Iterations and times against the baseline, on the cells in which both succeeded."""
    from stancekit.learners.evaluation.gait_bench import BASELINE, METHODS, ratios

    lines = []
    for method in dict.fromkeys(row["method"] for row in rows):
        if method == BASELINE or METHODS[method].portfolio:
            continue
        shares = {name: ratios(rows, method, name) for name in ("iterations", "cpu_s")}
        message = [
            f"{terrain} {shares['iterations'][terrain]:.2f} × iterations, "
            f"{shares['cpu_s'][terrain]:.2f} × time"
            for terrain in shares["iterations"]
        ]
        if message:
            lines.append(
                f"{METHODS[method].label} over {METHODS[BASELINE].label}: " + "; ".join(message)
            )
    return lines


def products(records: list[dict[str, Any]]) -> list[str]:
    """Cost of a verified walk, how much it is smoothed, and how many points verified success is
    below success.
    """
    from stancekit.learners.evaluation.gait_bench import METHODS

    lines = []
    for method in dict.fromkeys(record["method"] for record in records):
        successes = [
            record for record in records if record["method"] == method and record["success"]
        ]
        below = [
            f"{one['terrain']} {100 * (one['success'] - one['verified']):.0f}" for one in successes
        ]
        if below:
            lines.append(
                f"{METHODS[method].label}, verified below success: " + ", ".join(below) + " points"
            )
        if METHODS[method].portfolio:
            message = [
                f"{one['terrain']} {one['verified_cpu_s'][1]:.1f} CPU-s, peak "
                f"{one['peak_before_g'][1]:.2f} → "
                f"{one['peak_g'][1]:.2f} g"
                for one in successes
                if one["verified_cpu_s"] and one["peak_before_g"]
            ]
            lines += (
                [f"{METHODS[method].label}, medians of a verified walk: " + "; ".join(message)]
                if message
                else []
            )
    return lines


@dataclass
class Bench:
    """The papers' tables made again, every method in one run: `stancekit bench WHAT --help` says
    more.
    """

    what: (
        Annotated[_BenchEnvelopes, tyro.conf.subcommand("envelopes", prefix_name=False)]
        | Annotated[_BenchPlanner, tyro.conf.subcommand("planner", prefix_name=False)]
        | Annotated[_BenchRoom, tyro.conf.subcommand("room", prefix_name=False)]
        | Annotated[BenchGait, tyro.conf.subcommand("gait", prefix_name=False)]
    )

    def run(self) -> int:
        """Run the one that was named."""
        return self.what.run()
