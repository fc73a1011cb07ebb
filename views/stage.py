"""Scenes as the nodes of a viser server: made once by name, then moved, changed or hidden."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from stancekit.planners.files.arrays import Array

from .scene import UP, Arrow, Colour, DrawnBody, Label, Path, Scene, Sheet, borders, fans, merged
from .shapes import Box, Capsule, Faces, Mesh, Shape, Sphere, mesh_of, triangles_of

POINT_M = 0.0011
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
        paths = merged([*scene.paths, *borders(scene.facets)])
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
                rgb(arrow.colour),
                shaft_radius=radius,
                head_radius=2.4 * radius,
                head_length=5.5 * radius,
            )
        self._nodes[name].points = points
        return name

    def _path(self, name: str, path: Path) -> str:
        thickness = path.width * POINT_M * self._distance_m
        pieces = (path.pieces_m + min(path.lift_m, 0.01) * UP).astype(np.float32)
        look = (rgb(path.colour), thickness, len(pieces))
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
                color=rgb(colour),
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
        if known.color != rgb(colour):
            known.color = rgb(colour)
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
    if first is shape:
        return True
    if isinstance(first, Mesh) and isinstance(shape, Mesh):
        return np.array_equal(first.vertices_m, shape.vertices_m) and np.array_equal(
            first.faces, shape.faces
        )
    if isinstance(first, Box) and isinstance(shape, Box):
        return np.array_equal(first.half_m, shape.half_m)
    if isinstance(first, Capsule) and isinstance(shape, Capsule):
        return first.radii_m == shape.radii_m
    return first == shape


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


def rgb(colour: Colour) -> tuple[int, int, int]:
    """Red, green and blue, from 0 to 255."""
    red, green, blue = (round(255 * share) for share in to_rgb(colour))
    return red, green, blue
