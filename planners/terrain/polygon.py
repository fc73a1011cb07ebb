"""Convex polygons in their plane, and the pieces of a surface that a toe may be given: clipped,
shrunk, nearest.

A plane polygon is an array of shape (U, 2) [m], its corners in order around the border, either way
round. Half-planes are (normals, offsets), the points with normals · x ≤ offsets. Clipping only adds
corners where a border is crossed.

All points of a rigid flat sole are on one patch, so its centre q is where every q + o_k is: the patch
shrunk by the points. With the yaw fixed that is a convex polygon, and everything else that is linear
in a toe stays so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, cross, flat_cross, read_only
from .patch import Patch, flat_patches, with_polygons

_Corner = tuple[float, float]
Corners = list[_Corner]

SMALLEST_M = 1e-3
"""What is left of a surface counts as nothing where it is nowhere wider than this [m]."""
STEEP = 0.7
"""A surface whose upward share of the normal is below this (45°) is a wall: its shear axis z points
up."""
VOID_M = -0.6
"""Height of what is between stones and in gaps, where a height is needed [m]."""
EDGE_M = 1e-9
"""Neighbouring surfaces have no seam between them [m]."""
_ROUNDING_M2 = 1e-9
"""An area below this says nothing of the side that a point is on [m²]."""
UPRIGHT = 0.1
"""A surface whose normal has a smaller upward share is a riser or a wall: it has no height at a
place."""


def half_planes(polygon: Array) -> tuple[Array, Array]:
    """The half-planes that a convex polygon is the intersection of: normals, shape (U, 2), and
    offsets, shape (U,).
    """
    edges = polygon[_following(polygon)] - polygon
    real = np.hypot(*edges.T) > 1e-12
    edges, starts = edges[real], polygon[real]
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) * np.sign(signed_area(polygon))
    outward /= np.hypot(*outward.T)[:, None]
    return outward, np.einsum("ij,ij->i", outward, starts)


def signed_area(polygon: Array) -> float:
    """Area of a plane polygon, positive where its corners run to the left [m²]."""
    x, y = (polygon - polygon[0]).T
    ahead = _following(polygon)
    return 0.5 * float(np.sum(x * y[ahead] - y * x[ahead]))


def clipped(polygon: Array, normals: Array, offsets: Array) -> Array:
    """The part of a convex polygon inside all half-planes, shape (V, 2); (0, 2) where nothing with
    an area is left.
    """
    if len(polygon):
        cuts = (polygon @ normals.T > offsets).any(
            axis=0
        )  # what is inside a half-plane stays inside it when it is cut
        for normal, offset in zip(normals[cuts], offsets[cuts], strict=True):
            if len(polygon) == 0:
                break
            polygon = _below(polygon, polygon @ normal - offset)
    return polygon if len(polygon) >= 3 and width(polygon) > SMALLEST_M else np.zeros((0, 2))


def in_square(corners: Corners, centre: _Corner, side_m: float) -> Corners:
    """The corners of the part of a convex polygon inside a square along the axes of its plane; none
    where nothing with an area is left. Few corners: no arrays are made.
    """
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        offset = sign * centre[axis] + 0.5 * side_m
        if any(sign * corner[axis] > offset for corner in corners):
            corners = _cut(corners, [sign * corner[axis] - offset for corner in corners])
    return corners if len(corners) >= 3 and _least_width(corners) > SMALLEST_M else []


def shrunk(polygon: Array, margin_m: float) -> Array:
    """The points of a convex polygon at least ``margin_m`` inside its border, shape (V, 2), maybe
    (0, 2).
    """
    normals, offsets = half_planes(polygon)
    return clipped(polygon, normals, offsets - margin_m)


def nearest(polygon: Array, point: Array) -> Array:
    """The point of a convex polygon nearest to a point of the plane, shapes (..., U, 2) and (...,
    2).

    A corner may be given several times in a row, so that polygons of different U can be asked at
    once.
    """
    edges = polygon[..., [*range(1, polygon.shape[-2]), 0], :] - polygon
    arms = point[..., None, :] - polygon
    turns = flat_cross(edges, arms)
    inside = np.all(turns >= 0.0, axis=-1, keepdims=True)  # on the same side of every edge
    inside |= np.all(turns <= 0.0, axis=-1, keepdims=True)
    shares = (arms * edges).sum(axis=-1) / np.maximum((edges * edges).sum(axis=-1), 1e-24)
    feet = polygon + np.minimum(np.maximum(shares, 0.0), 1.0)[..., None] * edges
    best = ((feet - point[..., None, :]) ** 2).sum(axis=-1).argmin(axis=-1)
    foot = np.take_along_axis(feet, best[..., None, None], axis=-2)[..., 0, :]
    return np.where(inside, point, foot)


def _following(polygon: Array) -> list[int]:
    """Index of the corner that follows each corner."""
    return [*range(1, len(polygon)), 0]


def _below(polygon: Array, heights: Array) -> Array:
    """The part of a polygon where the heights of its corners, linear between them, are not
    positive.
    """
    if heights.max() <= 0.0:
        return polygon
    corners = _cut([(x, y) for x, y in polygon.tolist()], heights.tolist())
    return np.array(corners) if corners else np.zeros((0, 2))


def _cut(points: Corners, high: list[float]) -> Corners:
    """The corners where heights, linear between them, are not positive; none where there are fewer
    than three.
    """
    corners = Corners()
    ahead = zip(points[1:] + points[:1], high[1:] + high[:1], strict=True)
    for (x, y), h, ((to_x, to_y), g) in zip(points, high, ahead, strict=True):
        if h <= 0.0:
            corners.append((x, y))
        if (h < 0.0 < g) or (g < 0.0 < h):
            share = h / (h - g)
            corners.append((x + share * (to_x - x), y + share * (to_y - y)))
    pairs = zip(corners, corners[-1:] + corners[:-1], strict=True)
    thinned = [
        (x, y)
        for (x, y), (before_x, before_y) in pairs
        if max(abs(x - before_x), abs(y - before_y)) > 1e-9
    ]
    return thinned if len(thinned) >= 3 else []


def width(polygon: Array) -> float:
    """Least width of a convex polygon [m]: that across one of its edges; 0 where it has none of a
    length.
    """
    edges = polygon[_following(polygon)] - polygon
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    long = lengths > 1e-12
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)[long] / lengths[long, None]
    heights = normals @ polygon.T
    return float((heights.max(axis=1) - heights.min(axis=1)).min()) if len(normals) else 0.0


def _least_width(corners: Corners) -> float:
    """The ``width`` of a convex polygon of few corners [m]."""
    least = math.inf
    for (x, y), (to_x, to_y) in zip(corners, corners[1:] + corners[:1], strict=True):
        length = math.hypot(to_x - x, to_y - y)
        if length > 1e-12:
            across = [((to_y - y) * p - (to_x - x) * q) / length for p, q in corners]
            least = min(least, max(across) - min(across))
    return least if math.isfinite(least) else 0.0


def _clearly_outside(corners: Corners, point: _Corner) -> bool:
    """Tell whether a point of the plane is on both sides of edges of a convex polygon, by more than
    rounding.
    """
    turns = [
        (to_x - x) * (point[1] - y) - (to_y - y) * (point[0] - x)
        for (x, y), (to_x, to_y) in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    return min(turns) < -_ROUNDING_M2 and max(turns) > _ROUNDING_M2


class Surface:
    """A patch of the terrain with its plane coordinates, made once and asked for many toes.

    polygon: the patch in its plane, shape (U, 2).
    """

    def __init__(self, patch: Patch, margin_m: float) -> None:
        self.patch = patch
        self._axes = patch.frame[:, 1:]  # y and z of the contact frame
        self.origin_m = patch.centre_m
        self.polygon = self._flat(patch.vertices_m)
        self._margin_m = margin_m

    @cached_property
    def room(self) -> Array:
        """Remainder of the polygon ``margin_m`` from its border, shape (V, 2), maybe (0, 2)."""
        return shrunk(self.polygon, self._margin_m)

    @cached_property
    def _corners(self) -> Corners:
        return [(y, z) for y, z in self.polygon.tolist()]

    @cached_property
    def _room_corners(self) -> Corners:
        return [(y, z) for y, z in self.room.tolist()]

    @property
    def empty(self) -> bool:
        """Nothing is left of it inside the margin."""
        return len(self.room) == 0

    @property
    def width_m(self) -> float:
        """Greatest distance between two corners of what is left inside the margin [m]."""
        gaps = self.room[:, None] - self.room
        return float(np.sqrt((gaps**2).sum(axis=-1).max())) if len(self.room) else 0.0

    def height(self, point_m: Array) -> float:
        """Distance of a point from the plane, positive on the robot's side [m]."""
        return float((point_m - self.origin_m) @ self.patch.normal)

    def covers(self, point_m: Array) -> bool:
        """Tell whether the patch, margin and all, lies above or below a point."""
        point = self._flat(point_m)
        if _clearly_outside(self._corners, (float(point[0]), float(point[1]))):
            return False
        return bool(np.all(nearest(self.polygon, point) == point))

    def under(self, point_m: Array) -> float | None:
        """Height of the patch at a place (x, y) of the plan; None where it is not there, or upright
        [m].
        """
        normal = self.patch.normal
        if abs(normal[2]) < SMALLEST_M:
            return None
        height = float(self.origin_m[2] - (point_m - self.origin_m[:2]) @ normal[:2] / normal[2])
        return height if self.covers(np.array([*point_m, height])) else None

    def nearest(self, point_m: Array) -> Array:
        """The point of the surface inside the margin nearest to a point, shape (3,) [m]."""
        return self._world(nearest(self.room, self._flat(point_m)))

    def window(self, centre_m: Array, side_m: float) -> Patch | None:
        """The part inside the margin and a square about ``centre_m`` along the shear axes; None
        where there is none.
        """
        piece = self.piece(centre_m, side_m)
        return patches_of([(self, piece)])[0] if piece else None

    def piece(self, centre_m: Array, side_m: float) -> Corners:
        """The corners of a ``window`` in the plane; none where there is none."""
        y, z = self._flat(centre_m).tolist()
        return in_square(self._room_corners, (y, z), side_m)

    def around(self, centre_m: Array, side_m: float) -> tuple[Patch, ...]:
        """Remainder that ``window`` leaves of the part inside the margin, in convex pieces."""
        rest, pieces = self.room, list[Array]()
        for normal, offset in zip(*self._square(centre_m, side_m), strict=True):
            pieces.append(clipped(rest, -normal[None], -np.array([offset])))
            rest = clipped(rest, normal[None], np.array([offset]))
        return tuple(self.patch.with_vertices(self._world(piece)) for piece in pieces if len(piece))

    def _square(self, centre_m: Array, side_m: float) -> tuple[Array, Array]:
        """Half-planes of a square along the shear axes, as of ``half_planes``."""
        axes = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        return axes, axes @ self._flat(centre_m) + 0.5 * side_m

    def _flat(self, points_m: Array) -> Array:
        return np.asarray((points_m - self.origin_m) @ self._axes)

    def _world(self, points: Array) -> Array:
        return np.asarray(self.origin_m + points @ self._axes.T)


def patches_of(pieces: Sequence[tuple[Surface, Corners]]) -> list[Patch]:
    """Pieces of surfaces as patches; those of as many corners are put together at once.

    Raises InvalidInput for the first that is none.

    Arguments:
        pieces: each surface with the corners of a convex piece in its plane.
    """
    patches: list[Patch | None] = [None] * len(pieces)
    for count in {len(corners) for _, corners in pieces}:
        chosen = [k for k, (_, corners) in enumerate(pieces) if len(corners) == count]
        surfaces = [pieces[k][0] for k in chosen]
        frames = np.array([surface.patch.frame for surface in surfaces])
        origins = np.array([surface.origin_m for surface in surfaces])
        flat = np.array([pieces[k][1] for k in chosen])
        vertices = origins[:, None] + flat @ frames[:, :, 1:].transpose(0, 2, 1)
        moved = with_polygons([each.patch for each in surfaces], vertices, frames)
        for k, patch in zip(chosen, moved, strict=True):
            patches[k] = patch
    return [patch for patch in patches if patch is not None]


def surface_patch(vertices_m: Array, friction: float, *, towards_m: Array | None = None) -> Patch:
    """A patch from its corners alone, shape (U, 3): the normal by their order (seen from the robot:
    to the left), the shear axis z up on walls and forward on ground.

    Arguments:
        towards_m: a point on the robot's side: the normal is turned towards it, whatever the order,
            shape (3,).

    Raises:
        InvalidInput: for corners that are no convex planar polygon.
    """
    vertices = np.asarray(vertices_m, dtype=np.float64)
    normal = np.asarray(_newells(vertices[None])[0])
    if towards_m is not None and (towards_m - vertices.mean(axis=0)) @ normal < 0.0:
        normal = -normal
    return Patch(
        vertices_m=vertices, normal=normal, shear_reference=shear_of(normal), friction=friction
    )


def surface_patches(
    vertices_m: Array, frictions: Sequence[float], towards_m: Array
) -> tuple[Patch, ...]:
    """The ``surface_patch`` of K polygons of as many corners each, all at once.

    Raises InvalidInput for the first that is none.

    Arguments:
        vertices_m: shape (K, U, 3) [m].
        frictions: of each.
        towards_m: a point on the robot's side of each, shape (K, 3) [m].
    """
    normals = _newells(vertices_m)
    behind = np.vecdot(towards_m - vertices_m.mean(axis=1), normals) < 0.0
    normals = np.where(behind[:, None], -normals, normals)
    shears = np.array([shear_of(normal) for normal in normals]).reshape(-1, 3)
    return tuple(flat_patches(vertices_m, normals, shears, frictions))


def shear_of(normal: Array) -> Array:
    """The shear reference of the house's terrains: up on walls, forward on ground, shape (3,)."""
    return np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < STEEP else np.array([1.0, 0.0, 0.0])


def _newells(vertices: Array) -> Array:
    """The unit normals of polygons of as many corners each by their order, shape (K, U, 3) to (K, 3);
    (0, 0, 1) where one has no area, which Patch then refuses.
    """
    about = vertices - vertices.mean(axis=1, keepdims=True)
    total = np.zeros((len(vertices), 3))
    for k in range(vertices.shape[1]):
        total = total + cross(about[:, k], about[:, (k + 1) % vertices.shape[1]])
    lengths = np.sqrt(np.vecdot(total, total))[:, None]
    flat = total / np.where(lengths > 1e-12, lengths, 1.0)
    return np.where(lengths > 1e-12, flat, np.array([0.0, 0.0, 1.0]))


_MOST_POINTS = 16
_FLAT_M = 1e-7
"""A sole's points are in one plane: corners of a patch under it may be this far off [m]."""


def checked_sole(value: ArrayLike, where: str) -> Array:
    """Points of a sole (forward, left) about the foot's frame, shape (K, 2) [m], read-only.

    Raises InvalidInput unless they are three or more that are not in one line.
    """
    points = read_only(value, (None, 2), where)
    if not 3 <= len(points) <= _MOST_POINTS:
        raise InvalidInput(
            f"{where}: expected 3 to {_MOST_POINTS} points of a sole, got {len(points)}"
        )
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-3:
        raise InvalidInput(
            f"{where}: expected points that are not in one line, got {points.tolist()}"
        )
    return points


def sole_offsets(sole_m: Array, patch: Patch, yaw_rad: float) -> Array:
    """From the centre of a sole on a patch to its points, world frame, shape (K, 3) [m].

    Its forward axis is the patch's z, the shear reference, turned by the yaw about the normal; left
    is n × forward.
    """
    normal, y, z = patch.frame.T
    forward = np.cos(yaw_rad) * z - np.sin(yaw_rad) * y
    return np.asarray(sole_m @ np.array([forward, np.cross(normal, forward)]))


def sole_region(patch: Patch, offsets_m: Array) -> Patch:
    """Region in which the centre of a sole may be that is on a patch with all of its points: a
    piece of the patch's plane.

    Arguments:
        offsets_m: of the points, shape (K, 3).

    Raises:
        InvalidInput: where there is no room, and for a patch that is bent.
    """
    axes, origin = patch.frame[:, 1:], patch.centre_m
    off = float(np.abs((patch.vertices_m - origin) @ patch.normal).max())
    if off > _FLAT_M:
        raise InvalidInput(
            f"expected a patch flat to {_FLAT_M:g} m under a sole, got corners {off:.3g} m off its "
            "plane"
        )
    polygon, points = (patch.vertices_m - origin) @ axes, offsets_m @ axes
    normals, offsets = half_planes(polygon)
    left = clipped(polygon - points[0], normals, offsets - (normals @ points.T).max(axis=1))
    if not len(left):
        raise InvalidInput("expected room for a sole on the patch, got less than a millimetre")
    return replace(patch, vertices_m=origin + left @ axes.T)
