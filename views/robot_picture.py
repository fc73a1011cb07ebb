"""A robot's model in one picture: its links as it stands, its feet, and the set that each foot is planned in."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import QhullError

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.leg import Leg
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.solids import shape_points, solid_shapes
from stancekit.planners.robot.workspace import Workspace

from .camera import Camera
from .scene import Body, Facet, Label, Layer, Scene
from .shapes import Capsule, Sphere, along, hull
from .sheet import DEFAULT_STYLE, INK, SIZE_PX, Size, headline, leg_colour, plain_axes, sheet
from .still import Still

TRUNK = "#9aa5b1"


@DEFAULT_STYLE
def draw_robot(robot: RobotModel, workspaces: Sequence[Workspace] | None = None, *, size_px: Size = SIZE_PX) -> Figure:
    """The robot in its standing posture. Links are drawn as the hulls of their shapes, legs without shapes as bars.

    workspaces: of its legs; the inner polytopes are drawn in the legs' colours. Raises InvalidInput below 300 pixels.
    """
    stance = [leg.stance_rad for leg in robot.legs]
    feet = np.array([leg.nominal_m for leg in robot.legs])
    size = float(np.ptp(np.vstack([feet, [leg.hip_m for leg in robot.legs]]), axis=0).max())
    frames, bodies, drawn = robot.link_frames(stance), list[Body](), set[str]()
    for shape in solid_shapes(robot.shapes):
        mount, (turn, place) = robot.mounts[shape.link], frames[shape.link]
        points = shape_points(shape)
        if points is not None:
            colour = TRUNK if mount.leg is None else leg_colour(mount.leg)
            solid = _solid(shape.link, place + (shape.origin_m + points @ shape.rotation.T) @ turn.T, colour)
            bodies += solid
            drawn |= {body.name for body in solid}
    for index, leg in enumerate(robot.legs):
        colour = leg_colour(index)
        if not any(robot.mounts[link].leg == index for link in drawn):
            bodies += _bars(leg, colour, size)
        ball = Sphere(max(leg.radius_m, 0.012 * size))
        bodies.append(Body(name=leg.foot, shape=ball, position_m=leg.nominal_m, colour=colour))
    bodies.append(Body(name="com", shape=Sphere(0.018 * size), position_m=robot.body.com_m, colour=INK))
    for index, workspace in enumerate(workspaces or ()):
        colour = leg_colour(index)
        bodies += _solid("", workspace.inner.vertices, colour, opacity=0.1, layer=Layer.GLASS, edge=colour)
    ground = float(feet[:, 2].min()) - max(leg.radius_m for leg in robot.legs)
    (x0, y0), (x1, y1) = feet[:, :2].min(axis=0) - 0.4 * size, feet[:, :2].max(axis=0) + 0.4 * size
    corners = np.array([[x0, y0, ground], [x1, y0, ground], [x1, y1, ground], [x0, y1, ground]])
    floor = Facet(corners_m=corners, normal=np.array([0.0, 0.0, 1.0]), colour="#f3f5f7", edge="#c3cad2")
    labels = [
        Label(name=leg.name, position_m=leg.nominal_m, text=leg.name, colour=leg_colour(index))
        for index, leg in enumerate(robot.legs)
    ]
    camera = Camera(
        target_m=feet.mean(axis=0) * [1.0, 1.0, 0.5], azimuth_rad=np.deg2rad(-58.0), elevation_rad=np.deg2rad(20.0),
        distance_m=4.0 * size,
    )  # fmt: skip
    figure = sheet(size_px)
    joints = sum(len(leg.joints) for leg in robot.legs)
    words = f"{len(robot.legs)} legs, {joints} joints, {robot.body.mass_kg:.3g} kg"
    headline(figure, robot.name, words + ("; inside the veils every foot is reached" if workspaces else ""))
    Still(Scene(bodies=bodies, facets=[floor], labels=labels), camera).paint(plain_axes(figure, 20.0, 20.0, 90.0))
    return figure


def _solid(name: str, points: Array, colour: str, **options: Any) -> list[Body]:
    """The hull of points in the base's frame; nothing for a flat mesh."""
    try:
        return [Body(name=name, shape=hull(points), position_m=np.zeros(3), colour=colour, **options)]
    except QhullError:
        return []


def _bars(leg: Leg, colour: str, size: float) -> list[Body]:
    """A leg as bars from joint to joint."""
    points = np.vstack([leg.chain.frames(leg.stance_rad[None])[1][0], leg.nominal_m])
    return [
        Body(
            name="", shape=Capsule(float(np.linalg.norm(end - start)), (0.02 * size, 0.014 * size)),
            position_m=0.5 * (start + end), rotation=along(end - start), colour=colour,
        )
        for start, end in pairwise(points) if np.linalg.norm(end - start) > 1e-9
    ]  # fmt: skip
