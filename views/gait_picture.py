"""The picture of a motion: terrain with a map's grid, the robot at a few moments, its contact forces and footholds."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb as rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrow
from matplotlib.patheffects import withStroke

from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.verify.trajectories import GaitReport

from . import plot as chart
from .gait_scene import BONE, CELLS, EARTH, GRID, GRID_M, RIM, SHELL, STEEL, MotionScene, Warp, check_drawable, view
from .painter import CIRCLE, ROBOT, UP, Painter
from .plot import ACCENT, DEFAULT_STYLE, INK, QUIET, SIZE_PX, Size, leg_colour


@DEFAULT_STYLE
def draw_motion(
    trajectory: Trajectory,
    report: GaitReport | None = None,
    *,
    warp: Warp | None = None,
    caption: str = "",
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw a trajectory over its terrain: the robot at a few moments with its contact forces, and every foothold.

    warp: the map of a warped space, whose lines of constant x̄ and ȳ are drawn on the terrain (paper W Fig. 3); without
    one they are those of x and y. report: what the verifier says, put below the title. size_px: width and height.
    Raises InvalidInput for a trajectory of no samples or with values that are not finite.
    """
    scene = check_drawable(trajectory)
    painter = view(scene)
    _draw_surface(painter, scene)
    _draw_grid(painter, scene, warp)
    _draw_way(painter, scene)
    for place, sample in enumerate(scene.moments):
        strength = 0.35 + 0.65 * place / max(len(scene.moments) - 1, 1)
        _draw_robot(painter, scene, sample, strength)
        _draw_forces(painter, scene, sample)
    figure = chart.sheet(size_px)
    axes = chart.plain_axes(figure, 18.0, 66.0, 88.0)
    scale = painter.paint(axes)
    for sample, text in ((0, "start"), (-1, f"goal, {trajectory.duration_s:g} s")):
        x, y = painter.project(trajectory.torso_m[sample] + 0.62 * scene.size_m * UP)[0][0]
        axes.text(x, y, text, size=12, weight="bold", color=INK, ha="center", va="bottom", zorder=9,
                  path_effects=[withStroke(linewidth=3.0, foreground="white")])  # fmt: skip
    _draw_legend(figure, trajectory, scale / scene.metres_a_newton, warped=warp is not None)
    refused = report is not None and not report.accepted
    chart.headline(figure, *_words(trajectory, report, caption), alarm=refused)
    return figure


def _words(trajectory: Trajectory, report: GaitReport | None, caption: str) -> tuple[str, str]:
    """Title and the line below it."""
    name = trajectory.terrain.name or "a terrain"
    made = trajectory.provenance.get("chart", "")
    title = caption or f"{trajectory.robot.name} over {name}" + (f", {made}" if made else "")
    way = float(np.linalg.norm(np.diff(trajectory.torso_m, axis=0), axis=1).sum())
    verdict = "not verified" if report is None else report.message
    return title, f"{way:.2f} m in {trajectory.duration_s:g} s   ·   friction {trajectory.friction:g}   ·   {verdict}"


def _draw_surface(painter: Painter, scene: MotionScene) -> None:
    """Facets in the colour of their height, in one layer with the robot, so that each hides what is behind it."""
    x, y, heights, normals = scene.surface
    tints = scene.colours(0.25 * (heights[1:, 1:] + heights[1:, :-1] + heights[:-1, 1:] + heights[:-1, :-1]))
    for i, j in product(range(len(x) - 1), range(len(y) - 1)):
        at = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
        quad = np.array([(x[a], y[b], heights[a, b]) for a, b in at])
        painter.face(quad, painter.lit(tuple(tints[i, j]), normals[i, j]), ROBOT, width=0.4)
    for border, outward in scene.sides():
        if painter.facing(border.mean(axis=0), outward) > 0.0:
            fill = painter.lit(EARTH, outward)
            for a, b in pairwise(border):
                foot = np.array([b, a]) * [1.0, 1.0, 0.0] + scene.floor_m * UP
                painter.face(np.vstack([a, b, foot]), fill, ROBOT, width=0.4, depth=painter.near(0.5 * (a + b)) - 0.01)


def _draw_grid(painter: Painter, scene: MotionScene, warp: Warp | None) -> None:
    """Lines of constant x̄ and ȳ on the terrain."""
    cell = float(np.max(scene.bounds[1] - scene.bounds[0])) / CELLS
    for line in scene.lines(warp):
        depth = painter.near(line.mean(axis=0)) + 0.8 * cell
        painter.face(line, "none", ROBOT, edge=(*rgb(GRID), 0.35), width=0.6, depth=depth)


def _draw_way(painter: Painter, scene: MotionScene) -> None:
    """The torso's way, and a disc at every foothold."""
    for a, b in scene.way():
        painter.face(np.array([a, b]), "none", ROBOT, edge=INK, width=2.0, depth=painter.near(0.5 * (a + b)) + 0.02)
    terrain = scene.trajectory.terrain
    for _, foot, place in scene.footholds():
        frame = terrain.frame(place[:2])
        for size, colour in ((1.25, "white"), (1.0, leg_colour(foot))):
            ring = place + 0.004 * frame[:, 2] + 0.055 * scene.size_m * size * CIRCLE @ frame[:, :2].T
            painter.face(ring, colour, ROBOT, depth=painter.near(place) + (0.14 - 0.04 * size) * scene.size_m)


def _draw_robot(painter: Painter, scene: MotionScene, sample: int, strength: float) -> None:
    """Trunk and legs at one moment; the earlier, the paler."""
    trajectory = scene.trajectory
    robot, torso, turn = trajectory.robot, trajectory.torso_m[sample], trajectory.rotation[sample]

    def tone(colour: str) -> tuple[float, ...]:
        return tuple(np.array(rgb(colour)) * strength + np.array(rgb("#f4f1ea")) * (1.0 - strength))

    half = robot.trunk_half_m
    ring = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    top, bottom = (
        torso + np.column_stack([ring * half[:2], np.full(4, height)]) @ turn.T for height in (half[2], -half[2])
    )
    painter.prism(top, bottom, tone(SHELL), ROBOT, tone(STEEL))
    for face, normal in ((top, turn[:, 2]), (bottom, -turn[:, 2])):
        if painter.facing(face.mean(axis=0), normal) > 0.0:
            painter.face(face, painter.lit(tone(SHELL), normal), ROBOT, edge=tone(STEEL), width=0.8)
    nose = (
        torso + (np.array([[0.9, 0.0], [0.55, 0.45], [0.55, -0.45]]) * half[:2]) @ turn[:, :2].T + half[2] * turn[:, 2]
    )
    if painter.facing(nose.mean(axis=0), turn[:, 2]) > 0.0:
        painter.face(nose, tone(STEEL), ROBOT, depth=painter.near(top.mean(axis=0)) + 0.05)
    bone = BONE * scene.size_m
    for k, (hip, knee, toe) in enumerate(scene.legs(sample)):
        painter.tube(hip, knee, (1.2 * bone, 0.9 * bone), tone(STEEL), ROBOT, tone(RIM))
        painter.tube(knee, toe, (0.9 * bone, 0.5 * bone), tone(STEEL), ROBOT, tone(RIM))
        painter.ball(toe, 0.9 * bone, tone(leg_colour(k)), ROBOT, tone(RIM))


def _draw_forces(painter: Painter, scene: MotionScene, sample: int) -> None:
    trajectory = scene.trajectory
    for k in np.flatnonzero(trajectory.contact[sample]):
        toe, force = trajectory.feet_m[sample, k], trajectory.forces_n[sample, k]
        painter.arrow(toe, scene.metres_a_newton * force, ACCENT, 0.022 * scene.size_m)


def _draw_legend(figure: Figure, trajectory: Trajectory, newtons_a_unit: float, *, warped: bool) -> None:
    """One line below the scene. newtons_a_unit: of an arrow of 0.01 inch of paper."""
    width = 100.0 * figure.get_figwidth()
    axes = chart.plain_axes(figure, 0.0, 12.0, 100.0 * figure.get_figheight() - 62.0)
    axes.set(xlim=(0.0, width), ylim=(0.0, 50.0))
    power = 10.0 ** np.floor(np.log10(150.0 * newtons_a_unit))
    newtons = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 150.0 * newtons_a_unit)
    length = newtons / newtons_a_unit
    head = min(13.0, 0.6 * length)
    axes.add_patch(
        FancyArrow(30.0, 25.0, length - head, 0.0, width=4.0, head_width=12.0, head_length=head, fc=ACCENT, lw=0)
    )
    x = _word(axes, 40.0 + length, f"contact force, {newtons:g} N")
    for k, foot in enumerate(trajectory.robot.feet):
        axes.add_patch(Circle((x + 6.0, 25.0), 6.0, fc=leg_colour(k), ec="white", lw=1.0))
        sticky = "*" if trajectory.adhesive[k] else ""
        x = _word(axes, x + 18.0, f"{foot.name}{sticky}")
    if trajectory.adhesive.any():
        x = _word(axes, x, "* adhesive", QUIET)
    axes.plot([x, x + 24.0], [25.0, 25.0], color=GRID, alpha=0.6, lw=1.0)
    _word(axes, x + 32.0, f"{'lines of the map' if warped else 'grid'}, {GRID_M:g} m")


def _word(axes: Axes, x: float, text: str, colour: str = INK) -> float:
    """Write a text; returns where the next may begin."""
    axes.text(x, 25.0, text, size=10.5, color=colour, va="center_baseline", parse_math=False)
    return x + 7.6 * len(text) + 20.0
