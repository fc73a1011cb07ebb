"""A robot's model in one picture: its links as it stands, its feet, and the set that each foot is planned in."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull, QhullError

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.leg import Leg
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.shapes import Shape
from stancekit.planners.robot.workspace import Workspace

from .painter import CIRCLE, ROBOT, Painter, unit
from .plot import DEFAULT_STYLE, INK, SIZE_PX, Size, headline, leg_colour, plain_axes, sheet

TRUNK = "#9aa5b1"
HEAVIEST_MESH = 3_000_000
"""Bytes of a mesh that is still loaded for its hull."""
MOST_POINTS = 4000


@DEFAULT_STYLE
def draw_robot(robot: RobotModel, workspaces: Sequence[Workspace] | None = None, *, size_px: Size = SIZE_PX) -> Figure:
    """The robot in its standing posture. Links are drawn as the hulls of their shapes, legs without shapes as bars.

    workspaces: of its legs; the inner polytopes are drawn in the legs' colours. Raises InvalidInput below 300 pixels.
    """
    stance = [leg.stance_rad for leg in robot.legs]
    feet = np.array([leg.nominal_m for leg in robot.legs])
    size = float(np.ptp(np.vstack([feet, [leg.hip_m for leg in robot.legs]]), axis=0).max())
    painter = Painter(feet.mean(axis=0) * [1.0, 1.0, 0.5], np.deg2rad(-58.0), np.deg2rad(20.0), 4.0 * size)
    frames, drawn = robot.link_frames(stance), set[str]()
    for shape in _chosen(robot):
        mount, (turn, place) = robot.mounts[shape.link], frames[shape.link]
        points = _points(shape)
        if points is not None:
            colour = TRUNK if mount.leg is None else leg_colour(mount.leg)
            drawn.add(shape.link)
            _hull(painter, place + (shape.origin_m + points @ shape.rotation.T) @ turn.T, colour)
    for index, leg in enumerate(robot.legs):
        if not any(robot.mounts[link].leg == index for link in drawn):
            _bars(painter, leg, leg_colour(index), size)
        painter.ball(leg.nominal_m, max(leg.radius_m, 0.012 * size), leg_colour(index), ROBOT, "white")
        painter.label(leg.nominal_m, leg.name, leg_colour(index))
    for index, workspace in enumerate(workspaces or ()):
        painter.veil(workspace.inner.vertices, leg_colour(index), 0.10, 0.35)
    ground = float(feet[:, 2].min()) - max(leg.radius_m for leg in robot.legs)
    low, high = feet.min(axis=0) - 0.4 * size, feet.max(axis=0) + 0.4 * size
    painter.plane(2, ground, low, high, 10.0 ** np.floor(np.log10(size)))
    painter.ball(robot.body.com_m, 0.018 * size, INK, ROBOT, "white")
    figure = sheet(size_px)
    joints = sum(len(leg.joints) for leg in robot.legs)
    words = f"{len(robot.legs)} legs, {joints} joints, {robot.body.mass_kg:.3g} kg"
    headline(figure, robot.name, words + ("; inside the veils every foot is reached" if workspaces else ""))
    painter.paint(plain_axes(figure, 20.0, 20.0, 90.0))
    return figure


def _chosen(robot: RobotModel) -> list[Shape]:
    """For each link the shapes that it collides with, or where there are none what it looks like."""
    bodies = {shape.link for shape in robot.shapes if shape.collides}
    return [shape for shape in robot.shapes if shape.collides or shape.link not in bodies]


def _points(shape: Shape) -> Array | None:
    """Points whose hull is the shape, in its own frame, shape (K, 3) [m]; None for a mesh that cannot be had."""
    if shape.kind == "box":
        return np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    if shape.kind == "mesh":
        return _mesh_points(shape)
    radius = float(shape.size_m[0])
    half = 0.5 * float(shape.size_m[1]) if len(shape.size_m) > 1 else 0.0
    rim = np.column_stack([radius * CIRCLE[::2], np.zeros(len(CIRCLE[::2]))])
    if shape.kind == "cylinder":
        return np.vstack([rim + np.array([0.0, 0.0, end]) for end in (-half, half)])
    rings = [
        rim * [np.cos(angle), np.cos(angle), 0.0] + np.array([0.0, 0.0, radius * np.sin(angle) + np.sign(angle) * half])
        for angle in np.linspace(-0.5 * np.pi, 0.5 * np.pi, 10)
    ]
    return np.vstack(rings)


def _mesh_points(shape: Shape) -> Array | None:
    if shape.mesh is None or shape.mesh.stat().st_size > HEAVIEST_MESH:
        return None
    try:
        import coal

        loaded = coal.MeshLoader().load(str(shape.mesh), np.array(shape.size_m))
        points = np.array(loaded.vertices(), dtype=np.float64)
    except Exception:  # what assimp meets
        return None
    return points[:: 1 + len(points) // MOST_POINTS] if len(points) > 3 else None


def _hull(painter: Painter, points: Array, colour: str) -> None:
    """The faces of the points' hull that the viewer sees."""
    try:
        hull = ConvexHull(points)
    except QhullError:  # a flat mesh
        return
    for simplex, equation in zip(hull.simplices, hull.equations, strict=True):
        corners, normal = points[simplex], equation[:3]
        if painter.facing(corners.mean(axis=0), normal) > 0.0:
            fill = painter.lit(colour, unit(normal))
            painter.face(corners, fill, ROBOT, width=0.3)


def _bars(painter: Painter, leg: Leg, colour: str, size: float) -> None:
    """A leg as bars from joint to joint."""
    places = leg.chain.frames(leg.stance_rad[None])[1][0]
    points = np.vstack([places, leg.nominal_m])
    for start, end in pairwise(points):
        painter.tube(start, end, (0.02 * size, 0.014 * size), colour, ROBOT, "white")
