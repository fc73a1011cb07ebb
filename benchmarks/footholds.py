"""Footholds of the meshes in a folder against an independent sampling of the same triangles by
rays.

For every mesh the area of its footholds (slope and clearance, no margin) beside a stratified sample
of points on its triangles: those on slopes within the limit, with nothing within the clearance
along the normal and outside of solids, each by the share of the triangles that cover its place. The
rays are trimesh's, the footholds polygons of shapely's. The two agree where they are within 5 %.

    python benchmarks/footholds.py MESHES-FOLDER
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, Row, launch

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain.footholds import FootholdLimits, footholds_of
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.terrain_file import read_terrain
from stancekit.planners.terrain.triangle_mesh import TriangleMesh

WITHIN = 0.05
OFF_M = 1e-4
"""Rays start this far off the surface [m]."""


@dataclass(frozen=True, kw_only=True)
class FootholdOptions(Options):
    """Which meshes, and how they are sampled."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Where *.stl, *.obj, *.ply and *.dae lie, at any depth."""
    kinds: str = "stl"
    """Suffixes, with commas between them."""
    samples: int = 4000
    """Points on each mesh."""
    slope_rad: float = 0.6
    clearance_m: float = 0.1
    most_triangles: int = 200_000


def main(options: FootholdOptions) -> None:
    """A row a mesh, and how many agree."""
    paths = sorted(
        path for kind in options.kinds.split(",") for path in options.folder.rglob(f"*.{kind}")
    )
    rows = []
    for path in paths:
        rows.append(row_of(path, options))
        options.say(rows[-1])
    good = sum(row["agree"] for row in rows)
    cpu = [row["cpu_s"] for row in rows]
    options.say(
        {
            "meshes": len(rows),
            "agree": good,
            "cpu_s_median": round(float(np.median(cpu)), 3),
            "cpu_s_most": max(cpu),
        }
    )


def row_of(path: Path, options: FootholdOptions) -> Row:
    """The two areas of one mesh, or why it has none."""
    begun = time.process_time()
    row: Row = {"mesh": path.stem, "agree": False}
    limits = FootholdLimits(
        slope_rad=options.slope_rad,
        clearance_m=options.clearance_m,
        margin_m=0.0,
        width_m=1e-3,
        roughness_m=0.01,
    )
    try:
        mesh = read_terrain(path, ImportOptions(most_triangles=options.most_triangles))
        assert isinstance(mesh, TriangleMesh)
        found = footholds_of(mesh, limits)
    except InvalidInput as error:
        return row | {"why": str(error), "cpu_s": round(time.process_time() - begun, 3)}
    row |= {
        "triangles": len(mesh.triangles),
        "patches": len(found.pieces),
        "area_m2": round(found.area_m2, 4),
    }
    row["cpu_s"] = round(time.process_time() - begun, 3)
    area, error = sampled(mesh, limits, options.samples, np.random.default_rng(options.seed))
    gap = abs(found.area_m2 - area)
    row |= {
        "sampled_m2": round(area, 4),
        "error_m2": round(error, 4),
        "off": round(gap / max(area, 1e-12), 4),
    }
    row["agree"] = bool(gap <= WITHIN * area)
    return row | {
        "refused_m2": {
            name: round(value, 3) for name, value in found.refused_m2.items() if value > 1e-3
        }
    }


def sampled(
    mesh: TriangleMesh, limits: FootholdLimits, count: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Area on which one may stand, and its standard error [m²]."""
    import trimesh

    solid = trimesh.Trimesh(mesh.corners_m, mesh.triangles, process=False)
    areas = np.where(solid.face_normals[:, 2] >= np.cos(limits.slope_rad), solid.area_faces, 0.0)
    total = float(areas.sum())
    if total == 0.0:
        return 0.0, 0.0
    at = (np.arange(count) + rng.random(count)) / count * total  # one point in each stratum of area
    face = np.minimum(np.searchsorted(np.cumsum(areas), at), len(areas) - 1)
    u, v = np.sort(rng.random((2, count)), axis=0)
    a, b, c = np.moveaxis(mesh.spread_m[face], 1, 0)
    points = a + u[:, None] * (b - a) + (v - u)[:, None] * (c - a)
    normals = np.asarray(solid.face_normals[face])
    same = np.array([len(faces) for faces in coplanar(solid, points, normals)])
    free = np.ones(count, dtype=bool)
    inside = np.zeros(count)
    for ray, distance, facing in hits(solid, points + OFF_M * normals, normals):
        free[ray] &= distance > limits.clearance_m
        inside[ray] += np.sign(facing)
    worth = np.where(free & (inside <= 0.0), 1.0 / np.maximum(same, 1), 0.0)
    return total * float(worth.mean()), total * float(worth.std()) / np.sqrt(count)


def hits(solid: Any, origins: Array, directions: Array) -> Iterator[tuple[int, float, float]]:
    """Every triangle that each ray meets: ray, distance, and the share of its normal along the
    ray.
    """
    places, rays, faces = solid.ray.intersects_location(origins, directions, multiple_hits=True)
    places, rays = np.reshape(places, (-1, 3)), np.asarray(rays, dtype=int)
    distance = np.linalg.norm(places - origins[rays], axis=1)
    facing = np.einsum("ij,ij->i", solid.face_normals[faces], directions[rays])
    yield from zip(rays.tolist(), distance.tolist(), facing.tolist(), strict=True)


def coplanar(solid: Any, points: Array, normals: Array) -> list[list[int]]:
    """For every point the triangles of its own plane and side that cover it."""
    found = [list[int]() for _ in points]
    places, rays, faces = solid.ray.intersects_location(
        points + OFF_M * normals, -normals, multiple_hits=True
    )
    places, rays = np.reshape(places, (-1, 3)), np.asarray(rays, dtype=int)
    near = np.linalg.norm(places - points[rays], axis=1) < 0.5 * OFF_M
    along = np.einsum("ij,ij->i", solid.face_normals[faces], normals[rays]) > 0.999
    for ray, face in zip(rays[near & along].tolist(), faces[near & along].tolist(), strict=True):
        found[ray].append(face)
    return found


if __name__ == "__main__":
    launch(main, FootholdOptions, __doc__)
