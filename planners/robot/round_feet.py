"""Feet that are meshes of balls: read as the balls they are, so that plans and worlds touch the ground where they do.

A sphere is fitted to the corners of the mesh's convex hull by least squares, ‖x‖² = 2 x·m + (r² − ‖m‖²), and made as
large as the farthest of them is away. It is taken where nearly all corners, and the planes of half of the hull's
surface, are no farther from it than a part of its radius: balls that are cut off on their sides, or have a neck, are
balls, boxes and cylinders not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from ..files.arrays import Array
from .leg import Leg
from .meshes import read_mesh
from .shapes import Shape

ROUND = 0.15
"""Of a ball's radius: as far as a mesh that is taken for one may be from it."""
NECK = 0.05
"""Of the corners of a ball: as many may be farther from it, where a shank ends in it."""
HALF = 0.5
"""Of the surface of a ball: as much of it is round, the rest may be cut off."""


def round_feet(root: Element, legs: Sequence[Leg], shapes: Sequence[Shape]) -> tuple[str, tuple[str, ...]]:
    """The URDF with spheres in place of the meshes that are balls under the legs, and the links that have them now.

    Its text is empty where there is none. A foot's own radius, other shapes of it, and meshes that cannot be had are
    left as they are.
    """
    found = dict(_balls(legs, shapes))
    for link in root.findall("link"):
        if (ball := found.get(link.get("name", ""))) is None:
            continue
        for collision in link.findall("collision"):
            link.remove(collision)
        middle, radius_m = ball
        collision = SubElement(link, "collision")
        SubElement(collision, "origin", {"xyz": " ".join(repr(round(float(x), 9)) for x in middle)})
        SubElement(SubElement(collision, "geometry"), "sphere", {"radius": repr(round(radius_m, 9))})
    return ElementTree.tostring(root, encoding="unicode") if found else "", tuple(found)


def _balls(legs: Sequence[Leg], shapes: Sequence[Shape]) -> Iterator[tuple[str, tuple[Array, float]]]:
    """Link, centre in it, shape (3,), and radius [m] of every foot that is one mesh of a ball."""
    own: Mapping[str, list[Shape]] = {
        leg.foot: [shape for shape in shapes if shape.collides and shape.link == leg.foot]
        for leg in legs
        if leg.radius_m <= 0.0
    }
    for foot, its in own.items():
        if len(its) != 1 or its[0].mesh is None:
            continue
        mesh = read_mesh(its[0].mesh, its[0].size_m)
        ball = None if mesh is None else fitted_ball(mesh.vertices_m)
        if ball is not None:
            yield foot, (its[0].origin_m + its[0].rotation @ ball[0], ball[1])


def fitted_ball(points_m: Array) -> tuple[Array, float] | None:
    """Centre, shape (3,), and radius [m] of the ball that points, shape (V, 3), are the surface of; None where they
    are that of none."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points_m)
    except (QhullError, ValueError):
        return None
    outer = points_m[hull.vertices]
    shift = outer.mean(axis=0)
    rows = np.column_stack([2.0 * (outer - shift), np.ones(len(outer))])
    middle = np.linalg.lstsq(rows, np.sum((outer - shift) ** 2, axis=1), rcond=None)[0][:3] + shift
    away = np.linalg.norm(outer - middle, axis=1)
    radius_m, least = float(away.max()), (1.0 - ROUND) * float(away.max())
    a, b, c = (points_m[hull.simplices[:, corner]] for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    near = -(hull.equations[:, :3] @ middle + hull.equations[:, 3]) >= least
    round_all_over = float(np.quantile(away, NECK)) >= least
    return (middle, radius_m) if round_all_over and areas[near].sum() >= HALF * areas.sum() else None
