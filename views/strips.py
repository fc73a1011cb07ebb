"""Pictures of plans with strips below: what a plan has in hand along its motion, and how far an
execution was from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Played
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.verify.margins import stance_margins, verdict_yields_m
from stancekit.planners.verify.postures import shares_on_the_way
from stancekit.runner.report import Execution
from stancekit.runner.settings import Tolerance

from .scene import Camera, Scene
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    QUIET,
    SIZE_PX,
    Size,
    encoded,
    plain_axes,
    quiet_axes,
    sheet,
)
from .still import Still
from .terrain import Entry, draw_legend, force_entry


@dataclass(frozen=True, kw_only=True, eq=False)
class Strip:
    """A quantity along a motion.

    Arguments:
        title, unit: what it is, and its unit.
        along: what it is drawn over, "key frame" or "time [s]".
        at, values: where it is asked for, and what it is there, shape (T,), nan where it is not
            known; empty where it is known nowhere.
        planned: the same as planned, where it is drawn beside.
        limit: drawn as a dashed line; None where there is none.
        least: tell whether the least value is the worst one.
        why: why it is not known.
    """

    title: str
    unit: str
    along: str = "key frame"
    at: Array = field(default_factory=lambda: np.zeros(0))
    values: Array = field(default_factory=lambda: np.zeros(0))
    planned: Array | None = None
    limit: float | None = None
    least: bool = False
    why: str = ""

    @property
    def worst(self) -> int:
        """The row of the worst value."""
        return int(np.nanargmin(self.values) if self.least else np.nanargmax(self.values))

    @property
    def words(self) -> str:
        """The worst value and where it is, or why nothing is known."""
        unknown = np.isnan(self.values)
        if unknown.all():
            return shorten(f"not measured: {self.why or 'not known'}", 56, placeholder=" …")
        what = "least" if self.least else "most"
        at, value = self.at[self.worst], self.values[self.worst]
        where = f"at key frame {at:.3g}" if self.along == "key frame" else f"at {at:.1f} s"
        lacks = f", not known of {unknown.sum()} stances" if unknown.any() else ""
        return f"{what} {value:.3g} {self.unit} {where}{lacks}"


def plan_strips(plan: Plan, motion: Played) -> list[Strip]:
    """The push that every stance bears as the verifier measures it, and the largest shares of
    friction cones and of joints' torques that the planned forces use.

    Arguments:
        motion: the plan's, through its key frames.
    """
    pushes_n = stance_margins(plan, ("push_n",), yields_m=verdict_yields_m(plan), unknown=np.nan)[
        "push_n"
    ]
    frames = np.array([float(stance.frame) for stance in plan.problem.stances])
    push = Strip(title="push margin", unit="N", at=frames, values=pushes_n, least=True)
    return [push, cone_strip(plan, motion), torque_strip(plan)]


def cone_strip(plan: Plan, motion: Played) -> Strip:
    """The largest share of a friction cone that the planned forces use; of a plan's motion, as
    above.
    """
    now = motion.at(np.linspace(0.0, motion.duration_s, 400))
    light_n = 1e-3 * plan.problem.weight_n  # a foot that presses with less is not loaded
    cone_n = np.maximum(now.friction * now.along_n, light_n)
    loaded = now.stands & (now.along_n > light_n)
    used = np.where(loaded, now.across_n / cone_n, 0.0).max(axis=1)
    return Strip(
        title="friction cone used", unit="%", at=now.frame, values=100.0 * used, limit=100.0
    )


def torque_strip(plan: Plan) -> Strip:
    """The largest share of a joint's torque, at rest, while the body moves."""
    strip = Strip(title="joint torque used", unit="%", limit=100.0)
    if plan.joints_rad is None:
        return replace(strip, why="joints are not known")
    try:
        solver = Kinematics(plan.problem.robot, gravity_m_s2=plan.problem.gravity_m_s2)
        frames, _, shares = shares_on_the_way(plan, solver)
    except InvalidInput as error:
        return replace(strip, why=str(error))
    if doubts := solver.model.lines_of(solver.model.torque_doubts):
        return replace(strip, why=doubts[0])
    return replace(strip, at=frames, values=100.0 * shares.max(axis=1))


def run_strips(execution: Execution) -> list[Strip]:
    """How far the body and the forces on the feet were from the plan, and the torques beside those
    that were planned.
    """
    trace = execution.trace
    away = 1e3 * np.linalg.norm(trace.com_m - trace.planned_com_m, axis=1)
    wrong = np.linalg.norm(trace.forces_n - trace.planned_forces_n, axis=2).max(axis=1)
    over: dict[str, Any] = {"along": "time [s]", "at": trace.time_s}
    return [
        Strip(
            title="centre of mass off plan",
            unit="mm",
            values=away,
            limit=1e3 * Tolerance.com_m,
            **over,
        ),
        Strip(title="force on a foot off plan", unit="N", values=wrong, **over),
        Strip(
            title="largest torque, dotted: planned",
            unit="Nm",
            values=np.abs(trace.torques_nm).max(axis=1),
            planned=np.abs(trace.planned_torques_nm).max(axis=1),
            limit=execution.torque_limit_nm,
            **over,
        ),
    ]


def parted(execution: Execution) -> tuple[int, str]:
    """The row of an execution at which its centre of mass leaves the plan's by as much as it may be off
    at the end, or else is farthest from it, and words for that.
    """
    trace = execution.trace
    away = np.linalg.norm(trace.com_m - trace.planned_com_m, axis=1)
    left = bool(away.max() > Tolerance.com_m)
    row = int(np.argmax(away > Tolerance.com_m if left else away))
    what = "parts from the plan" if left else f"farthest from the plan, {1e3 * away[row]:.1f} mm,"
    return row, f"{what} at {trace.time_s[row]:.1f} s"


def picture(
    scene: Scene,
    camera: Camera,
    friction: ScalarMappable | None,
    entries: Sequence[Entry],
    strips: Sequence[Strip] = (),
    *,
    metres_a_newton: float | None = None,
    size_px: Size | None = None,
) -> Figure:
    """A scene on a sheet, its legend and its strips below it, with room for a headline above.

    Arguments:
        metres_a_newton: length of the arrow of a force, which the legend then has first.
        size_px: width and height; as high as the scene asks for at the usual width where it is
            None.
    """
    still, below = Still(scene, camera), 185.0 * bool(strips)
    low, high = still.frame()
    tall = (SIZE_PX[0] - 48.0) * (high - low)[1] / (high - low)[0] + 162.0
    usual = (SIZE_PX[0], int(np.clip(tall, 560.0, 1100.0) + below))
    figure = sheet(size_px or usual, usual)
    scale = still.paint(plain_axes(figure, 24.0, below + 70.0, 92.0))
    force = [] if metres_a_newton is None else [force_entry(scale / metres_a_newton, 120.0)]
    draw_legend(figure, below + 12.0, [*force, *entries], friction)
    share, inches = 1.0 / max(len(strips), 1), figure.get_figheight()
    for place, strip in enumerate(strips):
        left, wide = share * (place + 0.16) - 0.005, 0.8 * share
        _draw(figure.add_axes((left, 0.46 / inches, wide, 0.88 / inches)), strip)
    return figure


@DEFAULT_STYLE
def strip_svg(strip: Strip) -> str:
    """One strip as SVG, for a page."""
    figure = Figure(figsize=(3.8, 1.75), facecolor="none")
    _draw(figure.add_axes((0.135, 0.26, 0.83, 0.48)), strip)
    return "<svg" + encoded(figure, ".svg").decode().partition("<svg")[2]


def _draw(axes: Axes, strip: Strip) -> None:
    axes.set_title(
        f"{strip.title} [{strip.unit}]", size=10.5, weight="bold", color=INK, loc="left", pad=21
    )
    axes.text(0.0, 1.07, strip.words, size=9.5, color=QUIET, transform=axes.transAxes)
    quiet_axes(axes)
    if np.isnan(strip.values).all():
        axes.set(xticks=[], yticks=[])
        return
    if strip.planned is not None:
        axes.plot(strip.at, strip.planned, color=QUIET, lw=1.2, ls=":")
    axes.plot(strip.at, strip.values, ".-" if len(strip.at) < 60 else "-", color=INK, lw=1.4, ms=4)
    axes.plot(strip.at[strip.worst], strip.values[strip.worst], "o", color=ACCENT, ms=5)
    if strip.limit is not None:
        axes.axhline(strip.limit, color=ACCENT, lw=1.0, ls="--")
    highest = max(float(np.nanmax(strip.values)), strip.limit or 1e-9)
    axes.set(xlim=strip.at[[0, -1]], ylim=(0.0, 1.08 * highest), xlabel=strip.along)
    axes.locator_params("x", nbins=8, integer=strip.along == "key frame")
    axes.locator_params("y", nbins=3)
