"""Rungs of meshes: connected triangles that turn about one axis and lie on one circle about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from .facets import FlatPiece, Plane, connected, edge_pairs, shapely_module
from .rung import Rung
from .triangle_mesh import TriangleMesh

SLIMMEST_M, WIDEST_M = 4e-3, 0.25
"""Radii of rungs [m]."""
TURN_RAD = 1.1
"""Neighbouring triangles of a rung turn by less: six sides are round, ends are apart [rad]."""
FEWEST = 4
"""Triangles of a rung."""
STRAIGHT, BENT, ROUND = 1e-5, 0.02, 0.02
"""The share that normals of a rung have along its axis, and the least that they have across, of
their squares; and how far corners may be off the circle, in radii."""
ARC_RAD = 0.3
"""A rung's surface goes on to both sides of its highest line by this or more [rad]."""
COARSE_RAD = 0.2
"""Sides of a mesh that lean by more where the line is are taken as they are; sixteen sides are
round [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshRung:
    """A rung, the numbers of its triangles, and how far those at its highest line lean [rad]."""

    rung: Rung
    triangles: NDArray[np.int_]
    lean_rad: float

    @property
    def turn_rad(self) -> float:
        """Angle by which its surface turns from the middle of the line to the border."""
        return max(self.rung.turn_rad, self.lean_rad if self.lean_rad > COARSE_RAD else 0.0)

    def line(self, corners_m: Array) -> FlatPiece:
        """Highest line of the rung as a strip, where triangles of it, with corners of shape (K, 3,
        3), are below.
        """
        shapely, rung = shapely_module(), self.rung
        axes = np.stack([rung.axis, np.cross(rung.upright, rung.axis)], axis=1)
        plane = Plane(origin_m=rung.middle_m, normal=rung.upright, axes=axes)
        doubles = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
        flat = plane.flat(corners_m[doubles @ rung.upright > 0.0])
        half = rung.half_width_m
        strip = shapely.box(flat[..., 0].min(), -half, flat[..., 0].max(), half)
        on_it = strip.intersection(
            shapely.union_all(shapely.polygons(flat), grid_size=1e-7), grid_size=1e-7
        )
        sag = rung.radius_m * (1.0 - float(np.cos(rung.turn_rad)))
        return FlatPiece(plane=plane, polygon=on_it, triangles=self.triangles, rms_m=sag)

    def areas(self, corners_m: Array, steepest_rad: float) -> tuple[float, float]:
        """The area of its triangles, with corners of shape (K, 3, 3), that are steeper than this,
        and of the others.
        """
        doubles = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
        area = 0.5 * np.linalg.norm(doubles, axis=1)
        steep = 0.5 * doubles[:, 2] < np.cos(steepest_rad) * area - 1e-12
        return float(area[steep].sum()), float(area[~steep].sum())


def rungs_of(mesh: TriangleMesh, steepest_rad: float, flat_m: float) -> list[MeshRung]:
    """The round bars of a mesh whose axes are no steeper than this, and none of whose flat sides is
    wider than that.
    """
    corners = mesh.spread_m
    doubles = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(doubles, axis=1)
    normals = doubles / size[:, None]
    pairs = edge_pairs(mesh.triangles)
    smooth = np.vecdot(normals[pairs[:, 0]], normals[pairs[:, 1]]) > np.cos(TURN_RAD)
    count, label = connected(pairs[smooth], len(corners))
    spread = np.array(
        [
            [
                np.bincount(label, weights=size * normals[:, i] * normals[:, j], minlength=count)
                for i in range(3)
            ]
            for j in range(3)
        ]
    )
    values, vectors = np.linalg.eigh(np.moveaxis(spread, -1, 0))
    total = values.sum(axis=1)
    bent = (np.bincount(label, minlength=count) >= FEWEST) & (values[:, 1] > BENT * total)
    bent &= (values[:, 0] <= STRAIGHT * total) & (np.abs(vectors[:, 2, 0]) <= np.sin(steepest_rad))
    order = np.argsort(label, kind="stable")
    first = np.searchsorted(label[order], np.arange(count + 1))
    groups = [
        (order[first[k] : first[k + 1]], vectors[k, :, 0]) for k in np.flatnonzero(bent).tolist()
    ]
    rungs = [(group, _rung(corners[group], normals[group], axis, flat_m)) for group, axis in groups]
    return [
        MeshRung(rung=rung, triangles=group, lean_rad=_lean(rung, corners[group], normals[group]))
        for group, rung in rungs
        if rung is not None
    ]


def _lean(rung: Rung, corners: Array, normals: Array) -> float:
    """Angle by which triangles, shapes (K, 3, 3) and (K, 3), lean that are under a rung's line [rad]."""
    upward = normals @ rung.upright
    aside = (corners - rung.middle_m) @ np.cross(rung.upright, rung.axis)
    under = (
        (upward > 0.0)
        & (aside.min(axis=1) < rung.half_width_m)
        & (aside.max(axis=1) > -rung.half_width_m)
    )
    return float(np.arccos(np.clip(upward[under].min(initial=1.0), -1.0, 1.0)))


def _rung(corners: Array, normals: Array, axis: Array, flat_m: float) -> Rung | None:
    """The rung of triangles, shapes (K, 3, 3) and (K, 3), with normals across an axis; None where
    they are none.
    """
    upright = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    upright /= np.linalg.norm(upright)
    across = np.stack([np.cross(upright, axis), upright], axis=1)
    about = corners.mean(axis=(0, 1))
    points = (corners - about) @ across
    if np.linalg.norm(np.ptp(points, axis=1), axis=1).max() > flat_m:
        return None
    flat = points.reshape(-1, 2)
    table = np.column_stack([2.0 * flat, np.ones(len(flat))])
    (*middle, rest), *_ = np.linalg.lstsq(table, (flat**2).sum(axis=1), rcond=None)
    radius = float(np.sqrt(max(rest + np.dot(middle, middle), 0.0)))
    off = np.abs(np.linalg.norm(flat - middle, axis=1) - radius).max()
    if not (SLIMMEST_M <= radius <= WIDEST_M and off <= ROUND * radius):
        return None
    outward = np.vecdot(points.mean(axis=1) - middle, normals @ across)
    angle = np.arctan2(flat[:, 0] - middle[0], flat[:, 1] - middle[1])
    about_top = [
        np.any((way * angle >= ARC_RAD) & (way * angle <= ARC_RAD + TURN_RAD))
        for way in (-1.0, 1.0)
    ]
    if outward.min() <= 0.0 or not all(about_top):
        return None
    highest = about + across @ np.array([middle[0], flat[:, 1].max()])
    return Rung(axis=axis, upright=upright, middle_m=highest, radius_m=radius)
