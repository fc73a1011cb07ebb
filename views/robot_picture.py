"""A robot's model in one picture: its links as it stands, its feet, and the set that each foot is
planned in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.workspace import Workspace

from .camera import Camera
from .links import Links
from .scene import DrawnBody, Facet, Label, Layer, Scene
from .shapes import Sphere, hull
from .sheet import DEFAULT_STYLE, INK, SIZE_PX, Size, headline, leg_colour, plain_axes, sheet
from .still import Still


@DEFAULT_STYLE
def draw_robot(
    robot: RobotModel, workspaces: Sequence[Workspace] | None = None, *, size_px: Size = SIZE_PX
) -> Figure:
    """The robot in its standing posture, its own links.

    Arguments:
        workspaces: of its legs; the inner polytopes are drawn in the legs' colours.

    Raises:
        InvalidInput: below 300 pixels.
    """
    stance = [leg.stance_rad for leg in robot.legs]
    feet = np.array([leg.nominal_m for leg in robot.legs])
    size = float(np.ptp(np.vstack([feet, [leg.hip_m for leg in robot.legs]]), axis=0).max())
    bodies = Links(robot).bodies(robot.body.com_m, np.eye(3), stance)
    bodies.append(
        DrawnBody(name="com", shape=Sphere(0.018 * size), position_m=robot.body.com_m, colour=INK)
    )
    for index, workspace in enumerate(workspaces or ()):
        bodies.append(
            DrawnBody(
                name="",
                shape=hull(workspace.inner.vertices),
                position_m=np.zeros(3),
                colour=leg_colour(index),
                opacity=0.1,
                layer=Layer.GLASS,
                edge=leg_colour(index),
            )
        )
    ground = float(feet[:, 2].min()) - max(leg.radius_m for leg in robot.legs)
    (x0, y0), (x1, y1) = feet[:, :2].min(axis=0) - 0.4 * size, feet[:, :2].max(axis=0) + 0.4 * size
    corners = np.array([[x0, y0, ground], [x1, y0, ground], [x1, y1, ground], [x0, y1, ground]])
    floor = Facet(
        corners_m=corners, normal=np.array([0.0, 0.0, 1.0]), colour="#f3f5f7", edge="#c3cad2"
    )
    labels = [
        Label(name=leg.name, position_m=leg.nominal_m, text=leg.name, colour=leg_colour(index))
        for index, leg in enumerate(robot.legs)
    ]
    camera = Camera(
        target_m=feet.mean(axis=0) * [1.0, 1.0, 0.5],
        azimuth_rad=np.deg2rad(-58.0),
        elevation_rad=np.deg2rad(20.0),
        distance_m=4.0 * size,
    )
    figure = sheet(size_px)
    joints = sum(len(leg.joints) for leg in robot.legs)
    words = f"{len(robot.legs)} legs, {joints} joints, {robot.body.mass_kg:.3g} kg"
    headline(
        figure,
        robot.name,
        words + ("; inside the veils every foot is reached" if workspaces else ""),
    )
    Still(Scene(bodies=bodies, facets=[floor], labels=labels), camera).paint(
        plain_axes(figure, 20.0, 20.0, 90.0)
    )
    return figure
