"""Plots: a run's tracking, violation and time of solves by walking direction (Pan et al. Figs. 8, 9),
and selectors compared: grouped bars, and what the paper printed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, to_rgba
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.files.documents import shown
from stancekit.runner.control.foot_placement import touch_n
from stancekit.runner.log import TOPICS, Recorded, table

from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    MEASURE_COLOURS,
    PLOT_PX,
    QUIET,
    RULE,
    Size,
    headline,
    leg_colour,
    quiet_axes,
    sheet,
)

_AXIS_COLOURS = (MEASURE_COLOURS[0], MEASURE_COLOURS[1], MEASURE_COLOURS[4])
_SIZE_IN, _HEAD_IN = (12.0, 10.0), 0.9
_PLANNED: dict[str, Any] = {"linestyle": ":", "linewidth": 0.9}


def tracked(recorded: Recorded) -> dict[str, Array]:
    """Times, angles as planned, sent and measured, torques, and forces of a log; shape (T,), (T, J)
    and (T, N, 3).

    Raises InvalidInput for a log without a command, and for one whose messages do not go together.
    """
    commands, states = recorded.of("command"), recorded.of("measurement")[1:]
    rows = min(len(commands), len(states))
    if not rows:
        raise InvalidInput("log: expected commands, got none: nothing was sent")
    limbs = _limbs(recorded.of("plan")[0])
    joints = sum(map(len, limbs.values()))
    shapes: dict[str, tuple[int, ...]] = {
        "planned_rad": (joints,),
        "sent_rad": (joints,),
        "time_s": (),
        "angles_rad": (joints,),
        "torques_nm": (joints,),
        "forces_n": (len(limbs), 3),
        "position_m": (3,),
    }
    return {
        name: table(
            [
                each.get(name)
                for each in (
                    commands if name in TOPICS["command"] and name != "time_s" else states
                )[:rows]
            ],
            (rows, *shape),
            f"log: {name}",
        )
        for name, shape in shapes.items()
    }


def differences(tracks: dict[str, Array]) -> dict[str, float]:
    """Differences of measured joints from the plan: worst, root mean square [rad]."""
    away = tracks["angles_rad"] - tracks["planned_rad"]
    return {
        "joint_worst_rad": float(np.abs(away).max()),
        "joint_rms_rad": float(np.sqrt(np.mean(away**2))),
    }


@DEFAULT_STYLE
def draw_tracking(recorded: Recorded) -> Figure:
    """Draw a log.

    Raises InvalidInput for one without commands.
    """
    plan: dict[str, Any] = recorded.of("plan")[0]
    tracks = tracked(recorded)
    joints, time_s = _limbs(plan), tracks["time_s"]
    limbs, begins = list(joints), np.cumsum([0, *map(len, joints.values())])[:-1]
    figure = Figure(figsize=_SIZE_IN)
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - _HEAD_IN / _SIZE_IN[1]))
    aims = _targets(recorded, len(limbs))
    top, middle, low, *slid, bottom = figure.subplots(4 if aims is None else 5, 1, sharex=True)
    away = 1e3 * np.abs(tracks["angles_rad"] - tracks["planned_rad"])
    _limb_lines(top, time_s, np.maximum.reduceat(away, begins, axis=1), limbs)
    top.set_ylabel("joints off\nthe plan [mrad]")
    torque = np.maximum.reduceat(np.abs(tracks["torques_nm"]), begins, axis=1)
    _limb_lines(middle, time_s, torque, limbs)
    middle.set_ylabel("largest\ntorque [Nm]")
    if (limits := plan.get("torque_nm")) is not None:
        most = float(np.max(table(limits, (len(plan["joints"]),), "log: torque_nm")))
        middle.axhline(most, color="0.4", linestyle="--", linewidth=0.8)
        middle.text(
            time_s[0], most, "limit of the strongest joint", va="top", fontsize="small", color="0.4"
        )
    _limb_lines(low, time_s, np.linalg.norm(tracks["forces_n"], axis=2), limbs)
    low.set_ylabel("force on\nfoot [N]")
    if aims is not None:
        slid[0].set_ylabel("feet slid\n[mm]")
        _limb_lines(low, aims["time_s"], np.linalg.norm(aims["forces_n"], axis=2), limbs, _PLANNED)
        _limb_lines(slid[0], aims["time_s"], 1e3 * slips(recorded, aims), limbs)
        for axis in range(3):
            planned = 1e3 * (aims["origin_m"][:, axis] - tracks["position_m"][0, axis])
            bottom.plot(
                aims["time_s"],
                planned,
                color=_AXIS_COLOURS[axis],
                label="planned" if axis == 2 else None,
                **_PLANNED,
            )
    for each in recorded.of("decision"):
        if each["what"] in ("plan anew", "stand") and "time_s" in each:
            for axes in figure.axes:
                axes.axvline(each["time_s"], color="0.6", linewidth=0.6)
    for axis, name in enumerate("xyz"):
        moved = 1e3 * (tracks["position_m"][:, axis] - tracks["position_m"][0, axis])
        bottom.plot(time_s, moved, color=_AXIS_COLOURS[axis], label=name)
    bottom.set_ylabel("body moved\n[mm]")
    bottom.set_xlabel("time [s]")
    for axes in figure.axes:
        quiet_axes(axes)
    for axes in (top, bottom):
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.0,
            ncols=len(limbs),
            fontsize="small",
            frameon=False,
        )
    summary = differences(tracks)
    end = "" if recorded.whole else "; the log breaks off"
    headline(
        figure,
        f"{plan['course']} on {plan.get('world', '?')}",
        f"joints within {1e3 * summary['joint_worst_rad']:.1f} mrad of the plan, "
        f"{1e3 * summary['joint_rms_rad']:.1f} mrad "
        f"(RMS){end}",
    )
    return figure


def _limbs(plan: dict[str, Any]) -> dict[str, list[str]]:
    """Names of every limb's joints.

    Raises InvalidInput for limbs that are not those of the joints, in their order.
    """
    joints, limbs = plan["joints"], plan.get("limbs")
    parts: dict[str, list[str]] = limbs if isinstance(limbs, dict) else {}
    lists = parts and all(isinstance(part, list) and part for part in parts.values())
    if not lists or list(chain.from_iterable(parts.values())) != joints:
        raise InvalidInput(
            f"log: limbs: expected the names of {len(joints)} joints by limb, got {shown(limbs)}"
        )
    return parts


def _targets(recorded: Recorded, limbs: int) -> dict[str, Array] | None:
    """Times, planned body and forces, what feet stood on and should have rolled, as far as the log
    has them; shape (T,), (T, 3), (T, N, 3), (T, N), (T, N, 3). None of a log that does not say.
    """
    result = recorded.of("target")
    shapes = {
        "time_s": (),
        "origin_m": (3,),
        "forces_n": (limbs, 3),
        "foothold": (limbs,),
        "rolled_m": (limbs, 3),
    }
    if not result:
        return None
    return {
        name: table([each.get(name) for each in result], (len(result), *shape), f"log: {name}")
        for name, shape in shapes.items()
    }


def slips(recorded: Recorded, aims: dict[str, Array]) -> Array:
    """Slips of every foot from where it touched, 0 in the air, shape (T, N) [m]."""
    (rows, limbs), states = (
        aims["foothold"].shape,
        {each["time_s"]: each for each in recorded.of("measurement")},
    )
    felt, feet = (
        table(
            [states.get(time, {}).get(name) for time in aims["time_s"]],
            (rows, limbs, 3),
            f"log: {name}",
        )
        for name in ("forces_n", "feet_m")
    )
    weight_n = np.median(np.linalg.norm(aims["forces_n"].sum(axis=1), axis=1))
    feet, touches = feet - aims["rolled_m"], np.linalg.norm(felt, axis=2) > touch_n(weight_n)
    result, place = np.zeros(touches.shape), np.full((limbs, 3), np.nan)
    before = np.full(limbs, np.nan)
    for row, holds in enumerate(aims["foothold"]):
        place[(holds < 0) | (holds != before)] = np.nan
        lands = (holds >= 0) & touches[row] & np.isnan(place[:, 0])
        place[lands], before = feet[row, lands], holds
        result[row] = np.nan_to_num(np.linalg.norm(feet[row] - place, axis=1))
    return result


def _limb_lines(
    axes: Axes, time_s: Array, values: Array, limbs: list[str], style: dict[str, Any] | None = None
) -> None:
    """One line a limb.

    Arguments:
        values: shape (T, N).
        style: of planned ones, which no legend names.
    """
    for index, limb in enumerate(limbs):
        options: dict[str, Any] = {"linewidth": 0.9, "label": limb} if style is None else style
        axes.plot(time_s, values[:, index], color=leg_colour(index), **options)


_TOLERANCE = 1e-4
"""Pan et al. §V: a solve succeeds when its largest violation falls below this."""
LEAST = 1e-9
"""Violations below this are drawn as this."""
_TICKS = (1, 3, 10, 30, 100, 300, 1000)
_BAND = (0.25, 0.5, 0.75)
"""Quantiles of the times of several solves in one direction: a line, and the band about it."""
_SECONDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
_COMPASS = "0° = +y, clockwise"
_COLOURS = ("#27407f", "#e08a2b", "#2c8173", "#b8407a", "#9a86c4", "#c9a227")
"""Colours of methods in their order; they repeat after the sixth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitRun:
    """One solve.

    Arguments:
        violations: the largest one at every iterate, the first that of the guess, shape (iterations
            + 1,).
        direction_rad: the walk's, from the world's y towards x as in Pan et al. §V.
        seconds: CPU time.
    """

    method: str
    violations: Array
    direction_rad: float = 0.0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "violations", read_only(np.minimum(self.violations, 1e6), (None,), "violations")
        )
        if not len(self.violations):
            raise InvalidInput("violations: expected one or more, got none")

    @property
    def iterations(self) -> int:
        """Number of iterations that were taken: up to the first violation below the tolerance, or
        all.
        """
        below = np.flatnonzero(self.violations < _TOLERANCE)
        return int(below[0]) if below.size else len(self.violations) - 1

    @property
    def success(self) -> bool:
        """Tell whether the violation fell below the tolerance."""
        return bool(np.any(self.violations < _TOLERANCE))


@DEFAULT_STYLE
def draw_directions(
    runs: Sequence[GaitRun], *, caption: str = "", size_px: Size | None = None
) -> Figure:
    """Violation by walking direction (Pan et al. Fig. 8), a panel a method: iterations run outward
    in its colours.

    A solve that fails has a red mark at the rim.

    Arguments:
        size_px: ``PLOT_PX`` where there is none, taller for more than three methods.

    Raises:
        InvalidInput: without runs.
    """
    methods = _methods(runs)
    figure = sheet(size_px or (PLOT_PX if len(methods) < 4 else (1200, 980)), PLOT_PX)
    words = (
        "iterations from the centre outward, coloured by the largest violation; red: no success; "
        + _COMPASS
    )
    headline(figure, caption or "Violation by walking direction", words)
    most = max(run.iterations for run in runs)
    rim = float(_radius(max(most, 3)))
    colours = ScalarMappable(LogNorm(_TOLERANCE, 10.0), "magma_r")
    titles = [_label(method, [run for run in runs if run.method == method]) for method in methods]
    size = min(12.0, 12.0 * 38 / max(map(len, titles)))
    for axes, method, title in zip(_panels(figure, len(methods)), methods, titles, strict=True):
        runs_of_method = [run for run in runs if run.method == method]
        width = _wedge(runs_of_method)
        turns = 0.96 * width * np.linspace(-0.5, 0.5, 2 + int(np.rad2deg(width) / 3.0))
        axes.set_title(title, size=size, weight="bold", color=INK, pad=12, parse_math=False)
        _polar(axes, 1.12 * rim, [tick for tick in _TICKS if _radius(tick) <= rim], _radius)
        for run in runs_of_method:
            shown = np.clip(run.violations[: run.iterations + 1], LEAST, 1e6)
            edges = _radius(np.arange(len(shown) + 1))
            cells = np.repeat(shown[:, None], len(turns) - 1, axis=1)
            axes.pcolormesh(
                run.direction_rad + turns,
                edges,
                cells,
                norm=colours.norm,
                cmap=colours.cmap,
                zorder=1.5,
            )
            if not run.success:
                axes.plot(
                    [run.direction_rad],
                    [1.07 * rim],
                    "X",
                    color=ACCENT,
                    ms=6,
                    clip_on=False,
                    zorder=4,
                )
    middle, high = 0.36, figure.get_figheight()
    place = (middle, 0.35 / high, 1.0 - 2.0 * middle, 0.11 / high)
    bar = figure.colorbar(colours, cax=figure.add_axes(place), orientation="horizontal")
    bar.outline.set_visible(False)
    bar.ax.xaxis.set_major_formatter("{x:g}")  # the default one writes mathematics
    bar.ax.xaxis.set_minor_formatter(NullFormatter())
    bar.ax.tick_params(length=0, labelsize=10, labelcolor=QUIET)
    return figure


@DEFAULT_STYLE
def draw_times(
    runs: Sequence[GaitRun],
    *,
    caption: str = "",
    methods: Sequence[str] = (),
    size_px: Size = PLOT_PX,
) -> Figure:
    """CPU time by walking direction (Pan et al. Fig. 9), a line a method; solves that fail are
    crosses.

    Several runs of a method in one direction are shown by their median. Rings are closer together
    for longer times.

    Arguments:
        methods: in the order of their colours, the order of the runs where there are none.

    Raises:
        InvalidInput: without runs.
    """
    ran = _methods(runs)
    order = list(dict.fromkeys([*methods, *ran]))
    colours = {method: _COLOURS[order.index(method) % len(_COLOURS)] for method in ran}
    figure = sheet(size_px, PLOT_PX)
    words = f"median seconds a solve, within the quartiles; crosses: no success; {_COMPASS}"
    headline(figure, caption or "CPU time by walking direction", words)
    high, wide = figure.get_figheight(), figure.get_figwidth()
    side = high - 1.45
    axes = figure.add_axes(
        (0.47 - 0.85 * side / wide, 0.42 / high, side / wide, side / high), projection="polar"
    )
    longest = 0.0
    for method, colour in colours.items():
        runs_of_method = [run for run in runs if run.method == method]
        turns = sorted({run.direction_rad for run in runs_of_method})
        times = [
            np.quantile([run.seconds for run in runs_of_method if run.direction_rad == turn], _BAND)
            for turn in turns
        ]
        low, medians, high_s = np.array([*times, times[0]]).T
        shown, around = _radius_of_time(medians), [*turns, turns[0]]
        axes.fill_between(
            around, _radius_of_time(low), _radius_of_time(high_s), color=colour, alpha=0.15, lw=0
        )
        axes.plot(around, shown, color=colour, lw=2.0, label=_label(method, runs_of_method))
        failed = [run for run in runs_of_method if not run.success]
        at = _radius_of_time([run.seconds for run in failed])
        axes.plot([run.direction_rad for run in failed], at, "x", color=colour, ms=7, mew=2.0)
        longest = max(longest, *medians, *(run.seconds for run in failed))
    ticks = [tick for tick in _SECONDS if tick < longest]
    ticks.append(next((tick for tick in _SECONDS if tick >= longest), longest))
    _polar(axes, 1.02 * float(_radius_of_time(ticks[-1])), ticks, _radius_of_time, unit=" s")
    axes.legend(
        loc="center left",
        bbox_to_anchor=(1.12, 0.5),
        frameon=False,
        fontsize=11,
        labelcolor=INK,
        labelspacing=0.9,
    )
    return figure


def _methods(runs: Sequence[GaitRun]) -> list[str]:
    if not runs:
        raise InvalidInput("runs: expected one or more, got none")
    return list(dict.fromkeys(run.method for run in runs))


def _label(method: str, runs: Sequence[GaitRun]) -> str:
    """The method, how many of its solves succeed, and the median of their iterations."""
    done = [run.iterations for run in runs if run.success]
    words = f"{method}: {len(done)}/{len(runs)}" if len(runs) > 1 else method
    return f"{words}, {np.median(done):g} iterations" if done else f"{words}, no success"


def _radius(iterations: Any) -> Any:
    """Radius at which an iteration is drawn: logarithmic, with room for the first."""
    return np.log1p(np.asarray(iterations, dtype=np.float64) / 2.0)


def _radius_of_time(seconds: Any) -> Any:
    """Radius at which a time is drawn: logarithmic beyond half a second."""
    return np.log1p(np.asarray(seconds, dtype=np.float64) / 0.5)


def _wedge(runs: Sequence[GaitRun]) -> float:
    """Angle between neighbouring directions [rad]."""
    turns = np.unique(np.round(np.mod([run.direction_rad for run in runs], 2.0 * np.pi), 9))
    return (
        float(np.diff(turns, append=turns[0] + 2.0 * np.pi).min())
        if len(turns) > 1
        else 0.25 * np.pi
    )


def _panels(figure: Figure, count: int) -> list[Any]:
    """Polar axes side by side, in one row or two."""
    rows = 1 if count < 4 else 2
    columns = -(-count // rows)
    high, wide = figure.get_figheight(), figure.get_figwidth()
    side = min((wide - 0.5) / columns - 0.95, (high - 1.75) / rows - 0.45 - 0.25 * rows)
    panels = []
    for index in range(count):
        row, column = divmod(index, columns)
        x = (wide - 0.5) / columns * (column + 0.5) + 0.25 - 0.5 * side
        y = 0.85 + ((high - 1.75) / rows) * (rows - 1 - row) + 0.1
        panels.append(
            figure.add_axes((x / wide, y / high, side / wide, side / high), projection="polar")
        )
    return panels


def _polar(axes: Any, rim: float, ticks: Sequence[float], radius: Any, unit: str = "") -> None:
    """The look of polar axes: north up, clockwise, quiet rings."""
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_ylim(0.0, rim)
    axes.set_yticks([float(radius(tick)) for tick in ticks], [])
    for tick in ticks:
        place, words = (np.deg2rad(22.5), float(radius(tick))), f"{tick:g}{unit}"
        halo = [withStroke(linewidth=2.5, foreground="white")]
        axes.annotate(words, place, size=9.5, color=QUIET, path_effects=halo, ha="center")
    axes.set_xticks(
        np.deg2rad(np.arange(0, 360, 45)),
        [f"{turn}°" for turn in range(0, 360, 45)],
        size=10,
        color=QUIET,
    )
    axes.grid(color=RULE, lw=0.8)
    axes.set_axisbelow(True)
    axes.spines["polar"].set_color(RULE)


@dataclass(frozen=True, kw_only=True)
class ComparisonBar:
    """One row of a comparison table.

    Arguments:
        values: measure → share of problems in [0, 1], e.g. "P1 correct feasible", "fix-p". A
            measure that a selector does not have is left out.
        paper: what the paper printed for the same measures, where it did.
        intervals: ends of the interval of each value, where they are known.
    """

    selector: str
    values: Mapping[str, float]
    paper: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@DEFAULT_STYLE
def draw_comparison(
    rows: Sequence[ComparisonBar], *, caption: str = "", size_px: Size = PLOT_PX
) -> Figure:
    """Grouped bars: a group a selector, a bar a measure, in percent; hollow diamonds are the
    paper's values.

    Measures come in the order in which the rows name them. Raises InvalidInput without rows or
    values.
    """
    measures = list(dict.fromkeys(measure for row in rows for measure in (*row.values, *row.paper)))
    if not measures:
        raise InvalidInput("rows: expected one or more rows with values, got none")
    figure = sheet(size_px, PLOT_PX)
    high = figure.get_figheight()
    headline(figure, caption or "Selectors compared", "% of problems; the lines are 95 % intervals")
    axes = figure.add_axes((0.055, 0.62 / high, 0.925, 1.0 - 2.15 / high))
    axes.set(xlim=(-0.52, len(rows) - 0.48), ylim=(0.0, 104.0))
    names = [row.selector for row in rows]
    axes.set_xticks(range(len(rows)), names, size=12.5, color=INK, parse_math=False)
    axes.set_yticks(range(0, 101, 20), [str(tick) for tick in range(0, 101, 20)], size=11)
    quiet_axes(axes)
    width = 0.84 / len(measures)
    room = (
        92.5 * figure.get_figwidth() * width / len(rows)
    )  # width of a bar, in hundredths of an inch
    for position, measure in enumerate(measures):
        turns, place = divmod(position, len(MEASURE_COLOURS))
        colour, hatch = MEASURE_COLOURS[place], "//" * turns
        at = np.arange(len(rows)) - 0.42 + width * (position + 0.5)
        for x, row in zip(at, rows, strict=True):
            _bar(axes, float(x), width, row, measure, (colour, hatch), room)
        axes.bar([-9.0], [0.0], color=colour, hatch=hatch, ec="white", lw=0, label=measure)
    if any(row.paper for row in rows):
        axes.plot([-9.0], [0.0], "D", ms=6, mfc="white", mec=INK, mew=1.2, label="paper", ls="none")
    _name_measures(axes)
    return figure


def _name_measures(axes: Axes) -> None:
    """The legend above the plot, in one line or two, the paper's diamond last."""
    handles, names = axes.get_legend_handles_labels()
    pairs = sorted(zip(handles, names, strict=True), key=lambda pair: pair[1] == "paper")
    lines = 1 if sum(len(name) + 5 for name in names) < 125 else 2
    axes.legend(
        *zip(*pairs, strict=True),
        ncols=-(-len(names) // lines),
        loc="lower left",
        bbox_to_anchor=(-0.005, 1.02),
        frameon=False,
        fontsize=11,
        labelcolor=INK,
        handlelength=1.0,
        handleheight=1.0,
        columnspacing=1.5,
        handletextpad=0.5,
        borderpad=0.0,
    )


def _bar(
    axes: Axes,
    x: float,
    width: float,
    row: ComparisonBar,
    measure: str,
    look: tuple[str, str],
    room: float,
) -> None:
    value, paper, (colour, hatch) = row.values.get(measure), row.paper.get(measure), look
    if value is None:
        axes.text(x, 0.8, "–", size=11, color=QUIET, ha="center", va="bottom")
    else:
        height, ends = 100.0 * value, [100.0 * end for end in row.intervals.get(measure, ())]
        axes.bar([x], [height], 0.9 * width, color=colour, hatch=hatch, ec="white", lw=0, zorder=2)
        halo = [withStroke(linewidth=3.2, foreground="white")]
        axes.plot([x] * len(ends), ends, color=INK, lw=1.4, zorder=4, path_effects=halo)
        if room >= 13.0:
            _bar_number(axes, x, height, max([height, *ends]), colour, room)
    if paper is not None:
        axes.plot(
            [x], [100.0 * paper], "D", ms=6, mfc="white", mec=INK, mew=1.2, zorder=4, clip_on=False
        )


def _bar_number(axes: Axes, x: float, percent: float, top: float, colour: str, room: float) -> None:
    """The number at the foot of its bar, where no marker hides it, or above a short bar and its
    interval; upright in a narrow one.
    """
    dark = float(np.dot(to_rgba(colour)[:3], (0.299, 0.587, 0.114))) < 0.6
    tall = percent > 12.0
    axes.text(
        x,
        1.8 if tall else top + 1.2,
        f"{percent:.1f}",
        size=min(11.5, 0.5 * room),
        ha="center",
        va="bottom",
        rotation=0 if room > 42.0 else 90,
        color="white" if tall and dark else INK,
        zorder=5,
        path_effects=[withStroke(linewidth=2.5, foreground=colour if tall else "white")],
    )
