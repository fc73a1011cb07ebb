"""A page with a motion in 3D that opens without a network: one file, everything in it."""

from __future__ import annotations

import base64
import html
import json
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, write_text
from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.verify.trajectories import GaitReport

from .gait_scene import GRID_M, Warp, check_drawable, view
from .page_script import PAGE
from .plot import leg_colour

FRAME_S = 0.02
"""Time between the poses that a page holds; it shows the nearest."""


def check_page(path: str | Path) -> Path:
    """The file behind the name of a page, asked for before the work whose result goes there. Raises InvalidInput."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InvalidInput(f"{path}: expected a name that ends in .html, got {Path(path).suffix or 'no suffix'}")
    return check_writable(path)


def write_page(
    path: str | Path,
    trajectory: Trajectory,
    report: GaitReport | None = None,
    *,
    warp: Warp | None = None,
    caption: str = "",
) -> None:
    """Write a trajectory as a page: terrain, robot, contact forces and footholds, to be turned, zoomed and played.

    Arguments as in ``gait_picture.draw_motion``. Raises InvalidInput, also for a name that does not end in .html.
    """
    check_page(path)
    scene = check_drawable(trajectory)
    name = trajectory.terrain.name or "a terrain"
    title = caption or f"{trajectory.robot.name} over {name}"
    verdict = "not verified" if report is None else report.message
    x, y, heights, _ = scene.surface
    nodes = np.stack([*np.meshgrid(x, y, indexing="ij"), heights], axis=-1)
    lines = list(scene.lines(warp))
    stride = max(1, round(FRAME_S / max(trajectory.step_s, 1e-9)))
    samples = list(range(0, trajectory.samples, stride))
    painter = view(scene)
    towards = painter.axes[2]
    data = {
        "size": scene.size_m,
        "target": painter.target.tolist(),
        "distance": 0.48 * painter.distance_m,
        "azimuth": float(np.arctan2(towards[1], towards[0])),
        "elevation": float(np.arcsin(towards[2])),
        "columns": len(y),
        "nodes": _packed(nodes),
        "normals": _packed(trajectory.terrain.normal(nodes[..., :2])),
        "tints": _packed(scene.colours(heights)),
        "lines": _packed(np.array(lines).reshape(-1, 3)),
        "sides": _packed(_side_triangles(scene.sides(), scene.floor_m)),
        "half": trajectory.robot.trunk_half_m.tolist(),
        "colours": [leg_colour(k) for k in range(len(trajectory.robot.feet))],
        "names": [foot.name for foot in trajectory.robot.feet],
        "newton": scene.metres_a_newton,
        "times": _packed(trajectory.times_s[samples] - trajectory.times_s[0]),
        "torso": _packed(trajectory.torso_m[samples]),
        "turn": _packed(trajectory.rotation[samples]),
        "legs": _packed(np.array([scene.legs(sample) for sample in samples])),
        "forces": _packed(trajectory.forces_n[samples] * trajectory.contact[samples][..., None]),
        "footholds": [[k, foot, *place.tolist()] for k, foot, place in scene.footholds()],
        "stride": stride,
        "grid": GRID_M,
    }
    text = PAGE.replace("@TITLE@", html.escape(title)).replace("@VERDICT@", html.escape(verdict))
    text = text.replace("@COLOUR@", "#d1233b" if report is not None and not report.accepted else "#66717e")
    write_text(path, text.replace("@DATA@", json.dumps(data, allow_nan=False).replace("</", "<\\/")))


def _packed(array: Any) -> str:
    """Numbers as single-precision bytes in base64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")


def _side_triangles(sides: list[tuple[Array, Array]], floor_m: float) -> Array:
    """The block's sides: corners and their normals, shape (triangles, 3, 2, 3)."""
    found = []
    for border, outward in sides:
        foot = border.copy()
        foot[:, 2] = floor_m
        corners = [np.stack(three, axis=1) for three in (
            (border[:-1], border[1:], foot[1:]), (border[:-1], foot[1:], foot[:-1])
        )]  # fmt: skip
        triangles = np.concatenate(corners)
        found.append(np.stack([triangles, np.broadcast_to(outward, triangles.shape)], axis=2))
    return np.concatenate(found)
