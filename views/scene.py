"""Scenes as plain data in the world frame and metres: a robot's bodies, terrain, forces, paths and
footholds.

A picture is one ``Scene``, a page or a film an ``Animation``; ``still``, ``page`` and ``film`` draw
them, whatever they are of. A body's shape is a capsule, a sphere, a box or a mesh, so that made-up
limbs and a URDF's links look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb, to_rgba

from stancekit.planners.files.arrays import Array

from .camera import Camera
from .shapes import Capsule, Faces, Shape, along, box_of, ring

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


CUBE = np.array(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0])).reshape(3, -1).T
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

    def window(self, aspect: float) -> tuple[Array, Array]:
        """Corners of what is seen on the picture plane, shape (2,) [m]: the robot at all times, and
        terrain around; all of the terrain where there is nobody.

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


def _corners(body: DrawnBody, boxes: dict[int, Array]) -> Array:
    """Corners of the box of a body's shape, in the world, shape (8, 3) [m].

    Arguments:
        boxes: of shapes by identity, found once.
    """
    if id(body.shape) not in boxes:
        low, high = box_of(body.shape)
        boxes[id(body.shape)] = low + CUBE * (high - low)
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


def merged(paths: Sequence[Path]) -> list[Path]:
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
