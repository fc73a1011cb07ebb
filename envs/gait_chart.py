"""Charts of gait solves: violation per iteration, and by walking direction in polar form (paper W Figs. 8, 9, 11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from stancekit.planners.arrays import Array, frozen
from stancekit.planners.outcome import InvalidInput

from . import chart
from .chart import ACCENT, CHART_PX, DEFAULT_STYLE, INK, MEASURE_COLOURS, QUIET, RULE, Size

TOLERANCE = 1e-4
"""Paper W §V: a solve succeeds when its largest violation falls below this."""
LEAST = 1e-9
"""Violations below this are drawn as this."""
TICKS = (1, 3, 10, 30, 100, 300, 1000)


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitRun:
    """One solve. violations: the largest one at every iterate, the first that of the guess, shape (iterations + 1,).

    direction_rad: the walk's, from the world's y towards x as in paper W §V; seconds: CPU time.
    """

    method: str
    violations: Array
    direction_rad: float = 0.0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "violations", frozen(np.minimum(self.violations, 1e6), (None,), "violations"))
        if not len(self.violations):
            raise InvalidInput("violations: expected one or more, got none")

    @property
    def iterations(self) -> int:
        """How many were taken: up to the first violation below the tolerance, or all."""
        below = np.flatnonzero(self.violations < TOLERANCE)
        return int(below[0]) if below.size else len(self.violations) - 1

    @property
    def success(self) -> bool:
        """Whether the violation fell below the tolerance."""
        return bool(np.any(self.violations < TOLERANCE))


@DEFAULT_STYLE
def draw_convergence(runs: Sequence[GaitRun], *, caption: str = "", size_px: Size = CHART_PX) -> Figure:
    """Violation at every iteration, a line a solve, a colour a method; a dot where it succeeds, a cross where it ends.

    Raises InvalidInput without runs.
    """
    methods = _methods(runs)
    figure = chart.sheet(size_px, CHART_PX)
    chart.headline(figure, caption or "Convergence", f"largest constraint violation; success is below {TOLERANCE:g}")
    high = figure.get_figheight()
    axes = figure.add_axes((0.075, 0.72 / high, 0.9, 1.0 - 2.1 / high))
    most = max(len(run.violations) for run in runs) - 1
    top = max(float(run.violations.max()) for run in runs)
    axes.set(yscale="log", xlim=(-0.01 * most, max(1.02 * most, 1.0)), ylim=(0.1 * TOLERANCE, max(3.0 * top, 1.0)))
    axes.set_xlabel("iteration", size=11.5, color=INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.axhspan(0.1 * TOLERANCE, TOLERANCE, color="#e6f0ec", lw=0, zorder=0)
    axes.axhline(TOLERANCE, color="#58a695", lw=1.2, zorder=1)
    _quiet(axes)
    for index, method in enumerate(methods):
        own = [run for run in runs if run.method == method]
        colour = MEASURE_COLOURS[index % len(MEASURE_COLOURS)]
        for run in own:
            shown = np.maximum(run.violations[: run.iterations + 1], 0.15 * TOLERANCE)
            axes.plot(shown, color=colour, lw=2.0 if len(own) < 4 else 1.1, alpha=1.0 if len(own) < 4 else 0.55)
            end = {"marker": "o", "mec": "white"} if run.success else {"marker": "X", "mec": ACCENT, "mfc": ACCENT}
            axes.plot([len(shown) - 1], [shown[-1]], ms=8, color=colour, zorder=4, **end)  # type: ignore[arg-type]
        axes.plot([], [], color=colour, lw=2.5, label=_label(method, own))
    axes.legend(
        ncols=min(len(methods), 4), loc="lower left", bbox_to_anchor=(-0.005, 1.01), frameon=False, fontsize=11,
        labelcolor=INK, handlelength=1.4, columnspacing=1.6, borderpad=0.0,
    )  # fmt: skip
    return figure


@DEFAULT_STYLE
def draw_directions(runs: Sequence[GaitRun], *, caption: str = "", size_px: Size = CHART_PX) -> Figure:
    """Violation by walking direction (paper W Fig. 8), a panel a method: iterations run outward in its colours.

    A solve that fails has a red mark at the rim. Raises InvalidInput without runs.
    """
    methods = _methods(runs)
    figure = chart.sheet(size_px, CHART_PX)
    words = "iterations from the centre outward, coloured by the largest violation; red: no success"
    chart.headline(figure, caption or "Violation by walking direction", words)
    most = max(run.iterations for run in runs)
    rim = _radius(max(most, 3))
    colours = ScalarMappable(LogNorm(TOLERANCE, 10.0), "magma_r")
    for axes, method in zip(_panels(figure, len(methods)), methods, strict=True):
        own = [run for run in runs if run.method == method]
        width = _wedge(own)
        for run in own:
            shown = np.clip(run.violations[: run.iterations + 1], LEAST, 1e6)
            edges = _radius(np.arange(len(shown) + 1))
            for low, high, violation in zip(edges[:-1], edges[1:], shown, strict=True):
                axes.bar(run.direction_rad, high - low, 0.96 * width, low, color=colours.to_rgba(violation), lw=0)
            if not run.success:
                axes.plot([run.direction_rad], [1.07 * rim], "X", color=ACCENT, ms=7, clip_on=False)
        _polar(axes, _label(method, own), 1.12 * rim, [tick for tick in TICKS if _radius(tick) <= rim], _radius)
    bar = figure.colorbar(colours, cax=figure.add_axes((0.36, 0.055, 0.28, 0.018)), orientation="horizontal")
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, labelsize=10, labelcolor=QUIET)
    return figure


@DEFAULT_STYLE
def draw_times(runs: Sequence[GaitRun], *, caption: str = "", size_px: Size = CHART_PX) -> Figure:
    """CPU time by walking direction (paper W Fig. 9), a line a method; solves that fail are crosses.

    Several runs of a method in one direction are shown by their median. Raises InvalidInput without runs.
    """
    methods = _methods(runs)
    figure = chart.sheet(size_px, CHART_PX)
    chart.headline(figure, caption or "CPU time by walking direction", "seconds a solve; crosses: no success")
    high, wide = figure.get_figheight(), figure.get_figwidth()
    side = high - 1.45
    axes = figure.add_axes((0.5 - 0.62 * side / wide, 0.42 / high, side / wide, side / high), projection="polar")
    longest = max(run.seconds for run in runs)
    for index, method in enumerate(methods):
        own = [run for run in runs if run.method == method]
        colour = MEASURE_COLOURS[index % len(MEASURE_COLOURS)]
        turns = sorted({run.direction_rad for run in own})
        medians = [float(np.median([run.seconds for run in own if run.direction_rad == turn])) for turn in turns]
        axes.plot([*turns, turns[0]], [*medians, medians[0]], color=colour, lw=2.0, label=_label(method, own))
        failed = [run for run in own if not run.success]
        axes.plot([r.direction_rad for r in failed], [r.seconds for r in failed], "x", color=colour, ms=7, mew=2.0)
    ticks = np.linspace(0.0, _round_up(longest), 5)[1:].tolist()
    _polar(axes, "", 1.02 * _round_up(longest), ticks, np.asarray, unit=" s")
    axes.legend(loc="center left", bbox_to_anchor=(1.12, 0.5), frameon=False, fontsize=11, labelcolor=INK)
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
    """Where an iteration is drawn: logarithmic, with room for the first."""
    return np.log1p(np.asarray(iterations, dtype=np.float64) / 2.0)


def _wedge(runs: Sequence[GaitRun]) -> float:
    """Angle between neighbouring directions [rad]."""
    turns = np.unique(np.round(np.mod([run.direction_rad for run in runs], 2.0 * np.pi), 9))
    return float(np.diff(turns, append=turns[0] + 2.0 * np.pi).min()) if len(turns) > 1 else 0.25 * np.pi


def _panels(figure: Figure, count: int) -> list[Any]:
    """Polar axes side by side, in one row or two."""
    rows = 1 if count < 4 else 2
    columns = -(-count // rows)
    high, wide = figure.get_figheight(), figure.get_figwidth()
    side = min((wide - 0.5) / columns - 0.95, (high - 1.75) / rows - 0.55)
    found = []
    for index in range(count):
        row, column = divmod(index, columns)
        x = (wide - 0.5) / columns * (column + 0.5) + 0.25 - 0.5 * side
        y = 0.85 + ((high - 1.75) / rows) * (rows - 1 - row) + 0.1
        found.append(figure.add_axes((x / wide, y / high, side / wide, side / high), projection="polar"))
    return found


def _polar(axes: Any, title: str, rim: float, ticks: Sequence[float], radius: Any, unit: str = "") -> None:
    """The look of polar axes: north up, clockwise, quiet rings."""
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_ylim(0.0, rim)
    axes.set_yticks(
        [float(radius(tick)) for tick in ticks], [f"{tick:g}{unit}" for tick in ticks], size=9.5, color=QUIET
    )
    axes.set_xticks(np.deg2rad(np.arange(0, 360, 45)), [f"{turn}°" for turn in range(0, 360, 45)], size=10, color=QUIET)
    axes.set_rlabel_position(22.5)
    axes.grid(color=RULE, lw=0.8)
    axes.set_axisbelow(True)
    axes.spines["polar"].set_color(RULE)
    axes.set_title(title, size=12, weight="bold", color=INK, pad=12, parse_math=False)


def _quiet(axes: Axes) -> None:
    axes.tick_params(length=0, pad=6, labelsize=11, labelcolor=QUIET, which="both")
    axes.grid(axis="y", color=RULE, lw=0.8)
    axes.set_axisbelow(True)
    for name, side in axes.spines.items():
        side.set_visible(name == "bottom")
        side.set_color("#9aa5b1")


def _round_up(value: float) -> float:
    """The next of 1, 2, 4, 6, 8 or 10 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-3)))
    return float(next(step * power for step in (1.0, 2.0, 4.0, 6.0, 8.0, 10.0) if value <= step * power * (1.0 + 1e-9)))
