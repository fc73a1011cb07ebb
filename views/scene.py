"""Scenes as plain data in the world frame and metres: a robot's bodies, terrain, forces, paths and
footholds, and the shapes that they are made of.

A picture is one ``Scene``, a page or a film an ``Animation``; ``still``, ``page`` and ``film`` draw
them, whatever they are of. A body's shape is a capsule, a sphere, a box or a mesh, so that made-up
limbs and a URDF's links look alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum
from itertools import product
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb, to_rgba
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import ConvexHull

from stancekit.planners.arguments import cached_property
from stancekit.planners.files.arrays import Array, way_to

Faces = NDArray[np.int64]
"""Corners of faces by index, shape (F, 3) or (F, 4), to the left as seen from outside."""
_AROUND = 16
"""Corners of what is round."""
_TURN = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)


@dataclass(frozen=True)
class Capsule:
    """A round bar along z about the origin, with these radii below and above [m]."""

    length_m: float
    radii_m: tuple[float, float]


@dataclass(frozen=True)
class Sphere:
    """A ball about the origin."""

    radius_m: float


@dataclass(frozen=True, eq=False)
class Box:
    """A box about the origin.

    Arguments:
        half_m: half its sides, shape (3,) [m].
    """

    half_m: Array


@dataclass(frozen=True, eq=False)
class Mesh:
    """Corners, shape (V, 3) [m], and faces, shape (F, 3)."""

    vertices_m: Array
    faces: Faces


Shape = Capsule | Sphere | Box | Mesh


def triangles_of(faces: Faces) -> Faces:
    """Faces of four corners in halves, shape (2 F, 3)."""
    return faces if faces.shape[1] == 3 else np.concatenate([faces[:, :3], faces[:, [0, 2, 3]]])


def mesh_of(shape: Shape) -> tuple[Array, Faces]:
    """Corners, shape (V, 3) [m], and faces of a shape."""
    match shape:
        case Mesh(vertices, faces):
            return vertices, faces
        case Box(half):
            corners = (
                np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
            )
            sides = ["0132", "4675", "0451", "2376", "0264", "1573"]
            return corners, np.array([[int(k) for k in side] for side in sides])
        case Sphere(radius):
            turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
            return turned(radius * np.column_stack([np.cos(turn), np.sin(turn)]))
        case Capsule(length, (low, high)):
            turn = np.linspace(0.0, 0.5 * np.pi, 5)
            cap = np.column_stack([np.cos(turn), np.sin(turn)])
            bar = np.column_stack([np.linspace(low, high, 7), length * np.linspace(-0.5, 0.5, 7)])
            below = low * cap[:0:-1] * [1.0, -1.0] - [0.0, 0.5 * length]
            return turned(np.concatenate([below, bar, high * cap[1:] + [0.0, 0.5 * length]]))
    raise TypeError(shape)


def box_of(shape: Shape) -> tuple[Array, Array]:
    """Lowest and highest coordinates of a shape, shape (3,) each [m]."""
    match shape:
        case Capsule(length, (low, high)):
            wide = max(low, high)
            return np.array([-wide, -wide, -0.5 * length - low]), np.array(
                [wide, wide, 0.5 * length + high]
            )
        case Sphere(radius):
            return np.full(3, -radius), np.full(3, radius)
    points = mesh_of(shape)[0]
    return points.min(axis=0), points.max(axis=0)


def turned(profile: Array) -> tuple[Array, Faces]:
    """The solid of a profile (distance from z, height), shape (K, 2) [m] and upward, turned around
    z.
    """
    ring = np.column_stack([np.cos(_TURN), np.sin(_TURN)])
    corners = np.concatenate(
        [np.column_stack([radius * ring, np.full(_AROUND, z)]) for radius, z in profile]
    )
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(_AROUND), indexing="ij")
    ahead = (column + 1) % _AROUND
    quads = [
        _AROUND * row + column,
        _AROUND * row + ahead,
        _AROUND * (row + 1) + ahead,
        _AROUND * (row + 1) + column,
    ]
    return corners, np.stack(quads, axis=-1).reshape(-1, 4)


def hull(points: Array) -> Mesh:
    """The convex solid of these corners, shape (K, 3) [m]."""
    result = ConvexHull(points)
    outward = np.cross(
        points[result.simplices[:, 1]] - points[result.simplices[:, 0]],
        points[result.simplices[:, 2]] - points[result.simplices[:, 0]],
    )
    inward = np.einsum("ij,ij->i", outward, result.equations[:, :3]) < 0.0
    return Mesh(points, np.where(inward[:, None], result.simplices[:, ::-1], result.simplices))


def plate(outline: Array, offset_m: Array) -> Mesh:
    """The solid between a convex outline, shape (K, 3) [m], and the same moved, by shape (3,) [m]."""
    count, corner = len(outline), np.arange(len(outline))
    after, fan = np.roll(corner, -1), np.column_stack([0 * corner, corner - 1, corner])[2:]
    faces = np.concatenate(
        [
            np.column_stack([corner, after, count + after]),
            np.column_stack([corner, count + after, count + corner]),
            fan[:, ::-1],
            count + fan,
        ]
    )
    first = outline[0]
    area = np.cross(outline[1:-1] - first, outline[2:] - first).sum(axis=0)
    to_the_left = float(area @ offset_m) > 0.0
    return Mesh(
        np.concatenate([outline, outline + offset_m]), faces if to_the_left else faces[:, ::-1]
    )


def prism(outline: Array, low_m: float, high_m: float) -> Mesh:
    """The convex prism over an outline in the plane, shape (K, 2) [m]."""
    return hull(
        np.concatenate(
            [np.column_stack([outline, np.full(len(outline), z)]) for z in (low_m, high_m)]
        )
    )


def disc(normal: Array, radius_m: float) -> Mesh:
    """A thin round plate across a normal: a foothold."""
    ends = prism(radius_m * np.column_stack([np.cos(_TURN), np.sin(_TURN)]), 0.0, 0.08 * radius_m)
    return Mesh(ends.vertices_m @ along(normal).T, ends.faces)


def arrow_profile(length: float, radius: float) -> Array:
    """Profile of an arrow: the shaft from the origin, and its head."""
    neck = length - min(5.5 * radius, 0.6 * length)
    return np.array(
        [[0.0, 0.0], [radius, 0.0], [radius, neck], [2.4 * radius, neck], [0.0, length]]
    )


def along(direction: Array) -> Array:
    """A rotation that turns z into a direction, shape (3, 3)."""
    z = unit(direction)
    x = unit(np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z))
    return np.column_stack([x, np.cross(z, x), z])


def unit(vector: Array) -> Array:
    """The vector over its length; zero stays zero."""
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def polyline(points: Array) -> Array:
    """A line through points, shape (K, 3), in straight pieces, shape (K − 1, 2, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def thinned(points: Array, off_m: float) -> Array:
    """A line through points, shape (K, 3), without every second corner that is within ``off_m`` of
    the piece in its place, again and again: flat ground needs no corners, and each piece costs a
    viewer time.
    """
    while len(points) > 2:
        middle = np.arange(1, len(points) - 1, 2)
        start, piece = points[middle - 1], points[middle + 1] - points[middle - 1]
        square = np.maximum(np.sum(piece**2, axis=1), 1e-24)
        share = np.clip(np.sum((points[middle] - start) * piece, axis=1) / square, 0.0, 1.0)
        idle = np.linalg.norm(points[middle] - start - share[:, None] * piece, axis=1) < off_m
        if not idle.any():
            break
        points = np.delete(points, middle[idle], axis=0)
    return points


def dashed(points: Array) -> Array:
    """Every second piece of a line through points, shape (K, 3)."""
    return polyline(points)[::2]


def dashes(points: Array, apart_m: float = 0.05) -> Array:
    """Dashes along a line whose points may be far apart, shape (K, 3), each so long [m]."""
    spent = way_to(points)
    at = np.linspace(0.0, spent[-1], max(2, 1 + round(spent[-1] / apart_m)))
    return dashed(np.stack([np.interp(at, spent, axis) for axis in points.T], axis=1))


def lines_told(told: object) -> list[Array]:
    """The lines through points, shape (L, 3) each [m], of a list that a file may hold; what is none
    is left out.
    """
    lines = list[Array]()
    for line in told if isinstance(told, list) else []:
        try:
            points = np.asarray(line, dtype=np.float64)
        except (ValueError, TypeError, OverflowError):
            continue
        if (
            points.ndim == 2
            and points.shape[1] == 3
            and len(points) > 1
            and np.isfinite(points).all()
        ):
            lines.append(points)
    return lines


def ring(points: Array) -> Array:
    """A line through points and back to the first, in straight pieces."""
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A perspective on a target, shape (3,) [m], so far away [m]; what is at the target is drawn to
    scale.
    """

    target_m: Array
    azimuth_rad: float
    elevation_rad: float
    distance_m: float

    @cached_property
    def axes(self) -> Array:
        """Rows right, up and towards the viewer, shape (3, 3)."""
        (a, b), (c, d) = ((np.cos(x), np.sin(x)) for x in (self.azimuth_rad, self.elevation_rad))
        return np.array([[-b, a, 0.0], [-a * d, -b * d, c], [a * c, b * c, d]])

    @property
    def position_m(self) -> Array:
        """Place of the viewer, shape (3,)."""
        return np.asarray(self.target_m + self.distance_m * self.axes[2])

    @cached_property
    def light(self) -> Array:
        """Direction to the light, above the viewer's left, shape (3,)."""
        towards = np.array([-0.45, 0.75, 0.55]) @ self.axes
        return np.asarray(towards / np.linalg.norm(towards))

    def project(self, points: Array) -> tuple[Array, Array]:
        """Points, shape (…, 3), on the picture plane, shape (…, 2) [m], and how near they are,
        shape (…) [m].
        """
        local = (points - self.target_m) @ self.axes.T
        away = np.maximum(
            self.distance_m - local[..., 2], 0.2 * self.distance_m
        )  # what is behind the viewer: ahead
        return local[..., :2] * (self.distance_m / away)[..., None], local[..., 2]

    def facing(self, points: Array, normals: Array) -> Array:
        """Cosine of the angle at which the viewer sees faces, shape (…); negative from behind."""
        towards = self.position_m - points
        length = np.maximum(np.linalg.norm(towards, axis=-1), 1e-12)
        return np.asarray(np.sum(normals * towards, axis=-1) / length)

    def lit(self, colours: Array, normals: Array) -> Array:
        """Colours of faces with these unit normals in the light, shape (…, 3)."""
        shade = 0.78 + 0.30 * np.clip(normals @ self.light, -0.4, 1.0)[..., None]
        base = colours * np.minimum(shade, 1.0)
        return np.asarray(base + (1.0 - base) * np.maximum(0.0, shade - 1.0) * 2.5)


def best_view(
    target_m: Array,
    distance_m: float,
    merit: Callable[[Camera], float],
    *,
    step_deg: float,
    elevations_deg: Sequence[float],
) -> Camera:
    """The camera of most merit, of those around the target at these elevations."""
    angles = product(np.deg2rad(np.arange(-180.0, 180.0, step_deg)), np.deg2rad(elevations_deg))
    cameras = (
        Camera(
            target_m=target_m,
            azimuth_rad=float(azimuth),
            elevation_rad=float(elevation),
            distance_m=distance_m,
        )
        for azimuth, elevation in angles
    )
    return max(cameras, key=merit)


Colour = Any
"""A colour as matplotlib knows them: "#d1233b", or shares of red, green and blue."""
UP = np.array([0.0, 0.0, 1.0])
ON_M = 0.002
"""What lies on a surface is drawn so far off it."""


class Layer(IntEnum):
    """Order in which things cover each other on paper, the later ones the earlier; within one the
    nearer. With a depth buffer it is idle.
    """

    BACKDROP = 0
    TERRAIN = 1
    SPACE = 2
    GLASS = 3
    TOP = 4


_ROOM, _LAG_S = 0.62, 1.5
"""Half of what a camera that follows sees, in sizes of the robot, and the time over which it follows."""
_CUBE = np.array(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0])).reshape(3, -1).T
"""Corners of the unit cube, shape (8, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnBody:
    """A shape at p_WB, shape (3,) [m], and R_WB, shape (3, 3).

    Arguments:
        edge: colour of its outline, if it has one.
        lift_m: how much nearer than it is it counts on paper.
    """

    name: str
    shape: Shape
    position_m: Array
    colour: Colour
    rotation: Array = field(default_factory=lambda: np.eye(3))
    edge: Colour | None = None
    opacity: float = 1.0
    layer: Layer = Layer.SPACE
    lift_m: float = 0.0

    @property
    def solid(self) -> bool:
        """Tell whether it casts a shadow: neither glass nor a mark over the picture."""
        return self.opacity == 1.0 and self.layer is not Layer.TOP


@dataclass(frozen=True, kw_only=True, eq=False)
class Facet:
    """A flat piece of terrain, corners of shape (K, 3) [m] around it, seen from where its normal
    points.

    Arguments:
        opacity: of what is between the edges.
        lift_m: a body's.
    """

    corners_m: Array
    normal: Array
    colour: Colour
    edge: Colour | None = None
    width: float = 0.7
    opacity: float = 1.0
    layer: Layer = Layer.TERRAIN
    lift_m: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """A surface over a grid of nodes: points and colours, shape (n, m, 3), to the left as seen from
    above.
    """

    points_m: Array
    colours: Array

    @property
    def faces(self) -> Faces:
        """Corners of its facets by index, shape (F, 4)."""
        rows, columns = self.points_m.shape[:2]
        node = np.arange(rows * columns).reshape(rows, columns)
        return np.stack(
            [node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1
        ).reshape(-1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Arrow:
    """A force or another vector, shape (3,) [m] as drawn, at its place; none where it is too short
    to see.
    """

    name: str
    start_m: Array
    vector_m: Array
    radius_m: float
    colour: Colour

    @property
    def visible(self) -> bool:
        """Tell whether it is longer than it is thick."""
        return bool(np.linalg.norm(self.vector_m) > 2.0 * self.radius_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """Straight pieces, shape (K, 2, 3) [m].

    Arguments:
        width: in points on paper, where a halo sets it off.
        lift_m: a body's.
    """

    pieces_m: Array
    colour: Colour
    width: float = 1.0
    opacity: float = 1.0
    layer: Layer = Layer.SPACE
    lift_m: float = 0.0
    halo: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Label:
    """Words beside a place, on paper where they cover little."""

    name: str
    position_m: Array
    text: str
    colour: Colour


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """All that is drawn at one moment."""

    bodies: Sequence[DrawnBody] = ()
    facets: Sequence[Facet] = ()
    sheets: Sequence[Sheet] = ()
    arrows: Sequence[Arrow] = ()
    paths: Sequence[Path] = ()
    labels: Sequence[Label] = ()

    def __add__(self, other: Scene) -> Scene:
        """Both together."""
        return Scene(
            **{
                part.name: (*getattr(self, part.name), *getattr(other, part.name))
                for part in fields(self)
            }
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Animation:
    """Scene that stays, and scenes at each of T moments, ``step_s`` apart, as seen by a camera.

    Of the moments' parts, those of one name are one thing that moves.

    Arguments:
        notes: what is said at each moment.
        title, note: the line above and below it all, alarm: whether the note is bad news.
        legend: colours and what they mean.
        strips: pictures below it on a page, as SVG.
    """

    fixed: Scene
    moments: Sequence[Scene]
    step_s: float
    camera: Camera
    title: str
    note: str = ""
    alarm: bool = False
    notes: Sequence[str] = ()
    legend: Sequence[tuple[Colour, str]] = ()
    strips: Sequence[str] = ()

    def window(self, aspect: float) -> tuple[Array, Array]:
        """Corners of what is seen on the picture plane, shape (2,) [m]: the robot at all times, and
        terrain around; all of the terrain without a robot.

        Arguments:
            aspect: width over height.
        """
        boxes = dict[int, Array]()  # of shapes, most of which are there at all moments
        near = [
            corner
            for moment in (self.fixed, *self.moments)
            for body in moment.bodies
            for corner in _corners(body, boxes)
        ]
        near += [
            arrow.start_m + arrow.vector_m for moment in self.moments for arrow in moment.arrows
        ]
        far = [facet.corners_m for facet in self.fixed.facets] + [
            s.points_m.reshape(-1, 3) for s in self.fixed.sheets
        ]
        robot = self.camera.project(np.array(near) if near else np.concatenate(far))[0]
        low, high = robot.min(axis=0), robot.max(axis=0)
        low, high = low - 0.03 * (high - low), high + 0.03 * (high - low)
        if far:
            whole = self.camera.project(np.concatenate(far))[0]
            room = 1e9 if self.fixed.sheets else float(np.max(high - low))
            low = np.maximum(np.minimum(low, whole.min(axis=0)), low - room)
            high = np.minimum(np.maximum(high, whole.max(axis=0)), high + room)
        middle, half = 0.5 * (low + high), 0.51 * (high - low)
        half = np.maximum(half, half[::-1] * np.array([aspect, 1.0 / aspect]))
        return middle - half, middle + half

    def windows(self, aspect: float) -> Array:
        """Corners of what a camera sees that follows the robot, shape (T, 2, 2) [m]: parts of the
        ``window``, all of one size.

        Arguments:
            aspect: width over height.
        """
        whole, boxes = np.array(self.window(aspect)), dict[int, Array]()
        solids = [
            [corner for body in moment.bodies if body.solid for corner in _corners(body, boxes)]
            for moment in self.moments
        ]
        if not all(solids):
            return np.broadcast_to(whole, (len(solids), 2, 2))
        seen = [self.camera.project(np.array(corners))[0] for corners in solids]
        low, high = (np.array([end(xy, axis=0) for xy in seen]) for end in (np.min, np.max))
        half = _ROOM * (high - low).max(axis=0)
        half = np.maximum(half, half[::-1] * np.array([aspect, 1.0 / aspect]))
        half = np.minimum(half, 0.5 * (whole[1] - whole[0]))
        smooth = uniform_filter1d(
            0.5 * (low + high), 1 + round(_LAG_S / self.step_s), axis=0, mode="nearest"
        )
        middle = np.clip(smooth, whole[0] + half, whole[1] - half)
        middle = np.clip(middle, high - half, low + half)
        return np.stack([middle - half, middle + half], axis=1)


def _corners(body: DrawnBody, boxes: dict[int, Array]) -> Array:
    """Corners of the box of a body's shape, in the world, shape (8, 3) [m].

    Arguments:
        boxes: of shapes by identity, found once.
    """
    if id(body.shape) not in boxes:
        low, high = box_of(body.shape)
        boxes[id(body.shape)] = low + _CUBE * (high - low)
    return np.asarray(body.position_m + boxes[id(body.shape)] @ body.rotation.T)


def fans(facets: Sequence[Facet]) -> dict[tuple[Colour, float], Array]:
    """Triangles of facets, shape (F, 3, 3) [m], to the left from where they are seen, by colour and
    opacity.
    """
    result: dict[tuple[Colour, float], list[Array]] = {}
    for facet in facets:
        if facet.opacity > 0.0:
            corners = facet.corners_m
            if np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ facet.normal < 0.0:
                corners = corners[::-1]
            fan = np.stack(
                [np.broadcast_to(corners[0], corners[2:].shape), corners[1:-1], corners[2:]], axis=1
            )
            result.setdefault((to_rgb(facet.colour), facet.opacity), []).append(fan)
    return {key: np.concatenate(parts) for key, parts in result.items()}


def borders(facets: Sequence[Facet]) -> list[Path]:
    """The edges of facets, those of one look together, a little off the surface."""
    result: dict[tuple[Colour, float], list[Array]] = {}
    for facet in facets:
        if facet.edge is not None:
            result.setdefault((to_rgba(facet.edge), facet.width), []).append(
                ring(facet.corners_m + ON_M * facet.normal)
            )
    return [
        Path(pieces_m=np.concatenate(pieces), colour=colour[:3], opacity=colour[3], width=width)
        for (colour, width), pieces in result.items()
    ]


def between(
    name: str, start: Array, end: Array, radii: tuple[float, float], colour: Colour, edge: Colour
) -> DrawnBody:
    """A capsule from one point to another."""
    return DrawnBody(
        name=name,
        shape=Capsule(float(np.linalg.norm(end - start)), radii),
        position_m=0.5 * (start + end),
        rotation=along(end - start),
        colour=colour,
        edge=edge,
    )
