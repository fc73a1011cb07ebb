"""Scenes as plain data in the world frame and metres: a robot's bodies, terrain, forces, paths and
footholds.

A picture is one ``Scene``, a page or a film an ``Animation``; ``still``, ``page`` and ``film`` draw
them, whatever they are of. A body's shape is a capsule, a sphere, a box or a mesh, so that made-up
limbs and a URDF's links look alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum
from importlib import import_module
from itertools import product
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb, to_rgba
from scipy.ndimage import uniform_filter1d

from stancekit.planners.arguments import cached_property
from stancekit.planners.files.arrays import Array

from .shapes import (
    Box,
    Capsule,
    Faces,
    Mesh,
    Shape,
    Sphere,
    along,
    box_of,
    mesh_of,
    ring,
    triangles_of,
)


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


def _merged(paths: Sequence[Path]) -> list[Path]:
    """Join lines of one look in one path."""
    groups: dict[tuple[Any, ...], list[Array]] = {}
    for path in paths:
        key = (to_rgba(path.colour), path.width, path.opacity, path.layer, path.lift_m, path.halo)
        groups.setdefault(key, []).append(path.pieces_m)
    return [
        Path(
            pieces_m=np.concatenate(pieces),
            colour=colour[:3],
            width=width,
            opacity=opacity,
            layer=layer,
            lift_m=lift_m,
            halo=halo,
        )
        for (colour, width, opacity, layer, lift_m, halo), pieces in groups.items()
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


_POINT_M = 0.0011
"""Width of a line of one point, as a share of the viewer's distance."""


class Stage:
    """The nodes of a scene, by name, and how they follow what it is now; only what changes is sent.

    Arguments:
        scene: viser's.
        distance_m: of the viewer, by which lines are as thick as on paper.
    """

    def __init__(self, scene: Any, distance_m: float) -> None:
        self._scene, self._distance_m = scene, distance_m
        self._nodes: dict[str, Any] = {}
        self._drawn: dict[str, Any] = {}
        self._places: dict[str, tuple[list[float], list[list[float]]]] = {}

    def show(self, scene: Scene, root: str) -> None:
        """Show this scene under a root, and nothing else there; what it was before is changed."""
        shown = {self._sheet(f"{root}/sheet{k}", ground) for k, ground in enumerate(scene.sheets)}
        for k, ((colour, opacity), each) in enumerate(fans(scene.facets).items()):
            corners = each.reshape(-1, 3)
            faces = np.arange(len(corners)).reshape(-1, 3)
            shown.add(
                self._mesh(f"{root}/facets{k}", corners, faces, colour, opacity, flat_shading=True)
            )
        paths = _merged([*scene.paths, *borders(scene.facets)])
        shown |= {self._path(f"{root}/path{k}", path) for k, path in enumerate(paths)}
        shown |= {self._body(f"{root}/{body.name}", body) for body in scene.bodies}
        shown |= {
            self._arrow(f"{root}/{arrow.name}", arrow) for arrow in scene.arrows if arrow.visible
        }
        shown |= {self._label(f"{root}/label {label.name}", label) for label in scene.labels}
        self._only(shown, f"{root}/")

    def pose(self, moment: Scene, note: str = "") -> None:
        """Show the scene of a moment, and nothing else that moves: bodies, forces, and a note above
        the first body.
        """
        shown = {self._body(f"/bodies/{body.name}", body) for body in moment.bodies}
        shown |= {
            self._arrow(f"/forces/{arrow.name}", arrow) for arrow in moment.arrows if arrow.visible
        }
        if note and moment.bodies:
            name = f"/notes/{note}"
            if name not in self._nodes:
                above = moment.bodies[0].position_m + 0.06 * self._distance_m * UP
                self._nodes[name] = self._scene.add_label(
                    name, note, anchor="bottom-center", position=tuple(above)
                )
            shown.add(name)
        self._only(shown, "/bodies/", "/forces/", "/notes/")

    def _only(self, shown: set[str], *roots: str) -> None:
        """Show nothing but this under these roots."""
        for name, node in self._nodes.items():
            if name.startswith(roots) and node.visible != (name in shown):
                node.visible = name in shown

    def _body(self, name: str, body: DrawnBody) -> str:
        """Put a body in its place; a capsule is made once and stretched."""
        first = self._drawn.get(name)
        if first is None or not _alike(first, body):
            corners, faces = mesh_of(body.shape)
            self._mesh(
                name,
                corners,
                triangles_of(faces),
                body.colour,
                body.opacity,
                flat_shading=isinstance(body.shape, (Box, Mesh)),
                side="front",
            )
            self._drawn[name] = first = body
        node, place = self._nodes[name], (body.position_m.tolist(), body.rotation.tolist())
        position, rotation = self._places.get(name, (None, None))
        if position != place[0]:
            node.position = tuple(place[0])
        if rotation != place[1] and not isinstance(body.shape, Sphere):
            node.wxyz = quaternion(body.rotation)
        self._places[name] = place
        if isinstance(body.shape, Capsule) and isinstance(first.shape, Capsule):
            scale = (1.0, 1.0, body.shape.length_m / max(first.shape.length_m, 1e-9))
            if node.scale != scale:
                node.scale = scale
        return name

    def _arrow(self, name: str, arrow: Arrow) -> str:
        points = np.array([[arrow.start_m, arrow.start_m + arrow.vector_m]], dtype=np.float32)
        if name not in self._nodes:
            radius = arrow.radius_m
            self._nodes[name] = self._scene.add_arrows(
                name,
                points,
                _rgb(arrow.colour),
                shaft_radius=radius,
                head_radius=2.4 * radius,
                head_length=5.5 * radius,
            )
        self._nodes[name].points = points
        return name

    def _path(self, name: str, path: Path) -> str:
        thickness = path.width * _POINT_M * self._distance_m
        pieces = (path.pieces_m + min(path.lift_m, 0.01) * UP).astype(np.float32)
        look = (_rgb(path.colour), thickness, len(pieces))
        if self._drawn.get(name) != look:
            self._nodes[name] = self._scene.add_line_segments(
                name, pieces, look[0], thickness=thickness
            )
            self._drawn[name] = look
        elif not np.array_equal(self._nodes[name].points, pieces):
            self._nodes[name].points = pieces
        return name

    def _label(self, name: str, label: Label) -> str:
        if name not in self._nodes:
            self._nodes[name] = self._scene.add_label(name, label.text, anchor="bottom-center")
        node = self._nodes[name]
        if node.text != label.text:
            node.text = label.text
        node.position = tuple(label.position_m)
        return name

    def _sheet(self, name: str, ground: Sheet) -> str:
        """A surface with a colour a node."""
        if self._drawn.get(name) is not ground:
            mesh = import_module("trimesh").Trimesh(
                ground.points_m.reshape(-1, 3),
                triangles_of(ground.faces),
                process=False,
                vertex_colors=np.round(255.0 * ground.colours.reshape(-1, 3)).astype(np.uint8),
            )
            self._nodes[name] = self._scene.add_mesh_trimesh(
                name, mesh, cast_shadow=False, receive_shadow=False
            )
            self._drawn[name] = ground
        return name

    def _mesh(
        self, name: str, points: Array, faces: Faces, colour: Colour, opacity: float, **look: Any
    ) -> str:
        known = self._nodes.get(name)
        if known is None:
            self._nodes[name] = self._scene.add_mesh_simple(
                name,
                points,
                faces,
                color=_rgb(colour),
                opacity=opacity if opacity < 1.0 else None,
                cast_shadow=False,
                receive_shadow=False,
                **look,
            )
            return name
        if not (
            np.array_equal(known.faces, faces)
            and np.array_equal(known.vertices, points.astype(np.float32))
        ):
            known.vertices, known.faces = points.astype(np.float32), faces.astype(np.uint32)
        if known.color != _rgb(colour):
            known.color = _rgb(colour)
        if known.opacity != (opacity if opacity < 1.0 else None):
            known.opacity = opacity if opacity < 1.0 else None
        return name


def _alike(first: DrawnBody, body: DrawnBody) -> bool:
    """Tell whether a node that was made for the one shows the other, too, once it is moved."""
    return (
        first.colour == body.colour
        and first.opacity == body.opacity
        and _same(first.shape, body.shape)
    )


def _same(first: Shape, shape: Shape) -> bool:
    if isinstance(first, Capsule) and isinstance(shape, Capsule):
        return first.radii_m == shape.radii_m
    return first is shape or (
        type(first) is type(shape)
        and all(np.array_equal(vars(first)[name], vars(shape)[name]) for name in vars(first))
    )


def quaternion(rotation: Array) -> tuple[float, ...]:
    """(w, x, y, z) of a rotation, by its largest component; scipy takes ten times as long for a
    single one.
    """
    r = rotation.tolist()
    squares = (
        1.0 + r[0][0] + r[1][1] + r[2][2],
        1.0 + r[0][0] - r[1][1] - r[2][2],
        1.0 - r[0][0] + r[1][1] - r[2][2],
        1.0 - r[0][0] - r[1][1] + r[2][2],
    )
    largest = max(range(4), key=lambda k: squares[k])
    wx, wy, wz = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    rows = (
        (squares[0], wx, wy, wz),
        (wx, squares[1], xy, xz),
        (wy, xy, squares[2], yz),
        (wz, xz, yz, squares[3]),
    )
    scale = 0.5 / math.sqrt(squares[largest])
    return tuple(scale * value for value in rows[largest])


def _rgb(colour: Colour) -> tuple[int, int, int]:
    """Red, green and blue, from 0 to 255."""
    red, green, blue = (round(255 * share) for share in to_rgb(colour))
    return red, green, blue
