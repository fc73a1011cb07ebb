"""Answers, reports and plans in notebooks: a line, a picture of the stance as SVG, and a table of
groups.

Pictures are text that is made here, so that a notebook needs no other package; ``stancekit.draw``
makes better ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from ..files.arrays import Array

WIDTH_PX, HEIGHT_PX, MARGIN_PX = 480, 300, 16
MOST_ROWS = 60
"""Most rows of a table."""
COLOURS = {"holds": "#2a7f62", "violated": "#b3261e"}
AZIMUTH_RAD, ELEVATION_RAD = -1.1, 0.45
"""From where a stance is seen."""
LONGEST = 0.25
"""Length of the arrow of the largest force, as a share of the picture."""


def groups_html(message: str, groups: Iterable[tuple[str, str, str, str, str]]) -> str:
    """A verdict, and a row per group: its name, its verdict, what was measured, where, and what is
    said of it.
    """
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td style="color:{COLOURS.get(verdict, "#777")}">{verdict}</td>'
        f"<td>{escape(measured)}</td><td>{escape(where)}</td><td>{escape(text)}</td></tr>"
        for name, verdict, measured, where, text in groups
    )
    return f"<p><b>{escape(message)}</b></p><table>{rows}</table>"


def status_html(status: str, method: str, message: str) -> str:
    """The first line of an answer."""
    return f"<p><b>{status}</b> by {escape(method)}{escape(f': {message}' if message else '')}</p>"


def stance_html(
    title: str, polygons: Sequence[Array], toes: Array, forces: Array, way: Array
) -> str:
    """A line, and a picture of a stance over what its feet stand on.

    Arguments:
        title: the line.
        polygons: corners of patches, shape (C, 3) each [m].
        toes, forces: of the limbs that stand, shape (N, 3) [m], [N].
        way: of the body, from which the stance's legs begin, shape (K, 3) [m].
    """
    return f"<p>{escape(title)}</p>" + _svg(polygons, toes, forces, way)


def mark(place: Array) -> Array:
    """Corners of a small square about a point, shape (4, 3) [m]."""
    return np.asarray(place + 0.01 * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]))


def _svg(polygons: Sequence[Array], toes: Array, forces: Array, way: Array) -> str:
    """Polygons from behind, legs from the body to its toes, forces, and the way of the body."""
    points = np.concatenate([*polygons, toes, way])
    flat, _ = _seen(points)
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([WIDTH_PX, HEIGHT_PX]) - 2.0 * MARGIN_PX
    scale = float((room / np.maximum(high - low, 1e-9)).min())

    def drawn(places: Array) -> str:
        across = (_seen(places)[0] - low) * scale + MARGIN_PX
        return " ".join(f"{x:.1f},{HEIGHT_PX - y:.1f}" for x, y in across)

    order = sorted(range(len(polygons)), key=lambda k: -float(_seen(polygons[k])[1].mean()))
    parts = [
        f'<polygon points="{drawn(polygons[k])}" fill="#d9d4c7" stroke="#8a8577"/>' for k in order
    ]
    parts.append(
        f'<polyline points="{drawn(way)}" fill="none" stroke="#e8a317" stroke-dasharray="4 3"/>'
    )
    most = max(float(np.linalg.norm(forces, axis=1).max(initial=0.0)), 1e-9)
    longest = LONGEST * float(room.min()) / scale
    for toe, force in zip(toes, forces, strict=True):
        parts.append(
            f'<polyline points="{drawn(np.array([way[0], toe]))}" stroke="#444" stroke-width="2"/>'
        )
        arrow = np.array([toe, toe + longest / most * force])
        parts.append(f'<polyline points="{drawn(arrow)}" stroke="#b3261e" stroke-width="2"/>')
    body = drawn(way[:1]).split(",")
    parts.append(f'<circle cx="{body[0]}" cy="{body[1]}" r="6" fill="#2a5d9f"/>')
    size = f'width="{WIDTH_PX}" height="{HEIGHT_PX}" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>'


def _seen(points: Array) -> tuple[Array, Array]:
    """Places of points in the picture, shape (K, 2), and their distances from the eye, shape
    (K,).
    """
    ca, sa, ce, se = (
        np.cos(AZIMUTH_RAD),
        np.sin(AZIMUTH_RAD),
        np.cos(ELEVATION_RAD),
        np.sin(ELEVATION_RAD),
    )
    x, y, z = points.T
    right, ahead = -sa * x + ca * y, ca * x + sa * y
    return np.stack([right, ce * z - se * ahead], axis=1), -(ce * ahead + se * z)
