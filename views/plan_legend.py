"""The legend of a plan's picture: one line at the foot of the sheet."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgb as rgb
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyArrow, Rectangle

from stancekit.planners.problem.course import Course

from . import plot as chart
from .plan_terrain import ICE, ICE_EDGE, ICY
from .plot import ACCENT, INK, leg_colour


def draw_legend(figure: Figure, course: Course, friction: ScalarMappable, arrow: tuple[float, str]) -> None:
    """One line below the scene: forces, cones, the way of the centre of mass, chosen patches, and ice if there is."""
    width = 100.0 * figure.get_figwidth()
    axes = chart.plain_axes(figure, 0.0, 12.0, 100.0 * figure.get_figheight() - 62.0)
    axes.set(xlim=(0.0, width), ylim=(0.0, 50.0))
    length, force = arrow
    axes.add_patch(
        FancyArrow(30.0, 25.0, length - 15.0, 0.0, width=4.5, head_width=14.0, head_length=15.0, fc=ACCENT, lw=0)
    )
    x = 40.0 + length
    for mark, text in (
        ("", force),
        ("cone", "cone"),
        ("way", "centre of mass"),
        ("patch", "chosen"),
        ("ice", "ice, μ = 0"),
    ):
        if mark == "ice" and not any(patch.friction < ICY for patch in course.terrain):
            continue
        x += _draw_mark(axes, mark, x)
        axes.text(x, 25.0, text, size=10.5, color=INK, va="center_baseline")
        x += 7.9 * len(text) + 22.0
    chart.friction_bar(figure, width, 12.0, friction)


def _draw_mark(axes: Axes, mark: str, x: float) -> float:
    """A sign of the legend at x; returns the room that it takes."""
    if mark == "cone":
        axes.fill([x, x + 26.0, x + 26.0], [25.0, 37.0, 13.0], color=ACCENT, alpha=0.12, lw=0)
        axes.plot([x + 26.0, x, x + 26.0], [37.0, 25.0, 13.0], color=ACCENT, alpha=0.4, lw=0.9)
        axes.add_patch(Ellipse((x + 26.0, 25.0), 9.0, 24.0, fc=(*rgb(ACCENT), 0.15), ec=(*rgb(ACCENT), 0.6), lw=0.9))
        return 40.0
    if mark == "way":
        axes.plot([x, x + 30.0], [25.0, 25.0], "-o", color=INK, ms=5.0, lw=1.6, mec="white", mew=0.8)
        return 42.0
    if mark:
        colours = (ICE, ICE_EDGE) if mark == "ice" else ("#d6efd0", leg_colour(0))
        axes.add_patch(Rectangle((x, 16.0), 24.0, 18.0, fc=colours[0], ec=colours[1], lw=1.5))
        if mark == "ice":
            axes.plot([x + 7.0, x + 17.0], [18.5, 31.5], color="white", lw=2.0)
        return 33.0
    return 0.0
