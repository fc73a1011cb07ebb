"""A motion as one HTML page in three dimensions, which any browser opens from disk without a network: viser's client.

The page plays the motion like a film with a time line to pull, and can be turned and zoomed. Everything is in the file.
"""

from __future__ import annotations

import html
import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from scipy.spatial.transform import Rotation

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, write_bytes

from .scene import UP, Body, Colour, Motion, Scene, Sheet, borders, fans
from .shapes import Box, Capsule, Faces, Mesh, mesh_of, triangles_of
from .sheet import ACCENT, INK, QUIET

__all__ = ["check_page", "page", "write_page"]

POINT_M = 0.0011
"""Width of a line of one point, as a share of the viewer's distance."""


def check_page(path: str | File) -> File:
    """The file behind the name of a page, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .html, where nothing can be written, and without viser 1.1.
    """
    if File(path).suffix.lower() not in (".html", ".htm"):
        raise InvalidInput(f"{path}: expected a name that ends in .html, got {File(path).suffix or 'no suffix'}")
    _viser()
    return check_writable(path)


def write_page(path: str | File, motion: Motion) -> None:
    """Write the page, whole or not at all. Raises InvalidInput as ``check_page`` does."""
    target = check_page(path)
    write_bytes(target, page(motion).encode())


def page(motion: Motion) -> str:
    """The page as HTML. Raises InvalidInput without viser 1.1 or newer."""
    with _server() as server:
        server.scene.configure_default_lights(cast_shadow=False)
        view, camera = server.initial_camera, motion.camera
        low, high = motion.window(1.6)
        view.look_at = tuple(camera.target_m + 0.5 * (low + high) @ camera.axes[:2])
        view.position = tuple(camera.position_m)
        view.fov = 2.0 * np.arctan2(0.5 * (high - low)[1], camera.distance_m)
        stage = _Stage(server.scene, motion.camera.distance_m)
        stage.show(motion.fixed, "/fixed")
        recording = server.get_scene_serializer()
        notes = list(motion.notes) or [""] * len(motion.moments)
        for moment, note in zip(motion.moments, notes, strict=True):
            stage.pose(moment, note)
            recording.insert_sleep(motion.step_s)
        text = str(recording.as_html())
    return _titled(text, motion)


class _Stage:
    """The nodes of a motion, by name, and how they follow it; only what changes is recorded."""

    def __init__(self, scene: Any, distance_m: float) -> None:
        self._scene, self._distance_m = scene, distance_m
        self._nodes: dict[str, Any] = {}
        self._drawn: dict[str, Any] = {}

    def show(self, scene: Scene, root: str) -> None:
        """What stays as it is."""
        for k, ground in enumerate(scene.sheets):
            self._add_sheet(f"{root}/sheet{k}", ground)
        for k, ((colour, opacity), each) in enumerate(fans(scene.facets).items()):
            faces = np.arange(3 * len(each)).reshape(-1, 3)
            self._add_mesh(f"{root}/facets{k}", each.reshape(-1, 3), faces, colour, opacity, flat_shading=True)
        for k, path in enumerate([*scene.paths, *borders(scene.facets)]):
            thickness = path.width * POINT_M * self._distance_m
            pieces = path.pieces_m + min(path.lift_m, 0.01) * UP
            self._scene.add_line_segments(f"{root}/path{k}", pieces, _rgb(path.colour), thickness=thickness)
        for body in scene.bodies:
            self._body(f"{root}/{body.name}", body)

    def pose(self, moment: Scene, note: str) -> None:
        """What is there at a moment, and nothing else that moves."""
        shown = {self._body(f"/bodies/{body.name}", body) for body in moment.bodies}
        for arrow in filter(lambda arrow: arrow.visible, moment.arrows):
            name = f"/forces/{arrow.name}"
            points = np.array([[arrow.start_m, arrow.start_m + arrow.vector_m]], dtype=np.float32)
            if name not in self._nodes:
                radius = arrow.radius_m
                self._nodes[name] = self._scene.add_arrows(
                    name, points, _rgb(arrow.colour), shaft_radius=radius, head_radius=2.4 * radius,
                    head_length=5.5 * radius,
                )  # fmt: skip
            self._nodes[name].points = points
            shown.add(name)
        if note and moment.bodies:
            name = f"/notes/{note}"
            if name not in self._nodes:
                above = moment.bodies[0].position_m + 0.06 * self._distance_m * UP
                self._nodes[name] = self._scene.add_label(name, note, anchor="bottom-center", position=tuple(above))
            shown.add(name)
        for name, node in self._nodes.items():
            if name.startswith("/fixed"):
                continue
            if node.visible != (name in shown):
                node.visible = name in shown

    def _body(self, name: str, body: Body) -> str:
        """Put a body in its place; a capsule is made once and stretched."""
        if name not in self._nodes:
            corners, faces = mesh_of(body.shape)
            self._nodes[name] = self._add_mesh(
                name, corners, triangles_of(faces), body.colour, body.opacity,
                flat_shading=isinstance(body.shape, (Box, Mesh)), side="double" if body.opacity < 1.0 else "front",
            )  # fmt: skip
            self._drawn[name] = body
        node, first = self._nodes[name], self._drawn[name]
        node.position, node.wxyz = tuple(body.position_m), _quaternion(body.rotation)
        if isinstance(body.shape, Capsule) and isinstance(first.shape, Capsule):
            node.scale = (1.0, 1.0, body.shape.length_m / max(first.shape.length_m, 1e-9))
        return name

    def _add_sheet(self, name: str, ground: Sheet) -> None:
        """A surface with a colour a node."""
        mesh = import_module("trimesh").Trimesh(
            ground.points_m.reshape(-1, 3), triangles_of(ground.faces), process=False,
            vertex_colors=np.round(255.0 * ground.colours.reshape(-1, 3)).astype(np.uint8),
        )  # fmt: skip
        self._scene.add_mesh_trimesh(name, mesh, cast_shadow=False, receive_shadow=False)

    def _add_mesh(self, name: str, points: Array, faces: Faces, colour: Colour, opacity: float, **look: Any) -> Any:
        return self._scene.add_mesh_simple(
            name, points, faces, color=_rgb(colour), opacity=opacity if opacity < 1.0 else None, cast_shadow=False,
            receive_shadow=False, **look,
        )  # fmt: skip


def _titled(text: str, motion: Motion) -> str:
    """The page with its title and a legend in a corner."""
    lines = "".join(
        f'<div><span style="display:inline-block;width:14px;height:14px;margin-right:8px;vertical-align:-2px;'
        f'border:1px solid #9aa5b1;background:{to_hex(colour)}"></span>{html.escape(words)}</div>'
        for colour, words in motion.legend
    )
    style = (
        "position:fixed;right:16px;top:16px;z-index:10;pointer-events:none;padding:10px 14px;border-radius:6px;"
        f"background:rgba(255,255,255,.85);font:13px/1.6 system-ui,sans-serif;color:{INK}"
    )
    title, note = html.escape(motion.title), html.escape(motion.note)
    note = note and f'<div style="color:{ACCENT if motion.alarm else QUIET}">{note}</div>'
    legend = f'<div id="legend" style="{style}"><b>{title}</b>{note}{lines}</div>'
    text = text.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    end = text.rindex("</body>")
    return text[:end] + legend + text[end:]


@contextmanager
def _server() -> Iterator[Any]:
    """A viser server, needed only to record a scene; nobody is meant to connect to it. It says nothing."""
    viser = _viser()
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", verbose=False)
        try:
            yield server
        finally:
            server.stop()


def _viser() -> Any:
    """The module viser. Raises InvalidInput where it is missing or too old to write pages."""
    hint = "install it with pip install 'stancekit[viz]'"
    try:
        module = import_module("viser")
        infra = import_module("viser.infra")
    except ImportError:
        raise InvalidInput(f"page: expected viser; {hint}") from None
    if not hasattr(infra.StateSerializer, "as_html"):
        raise InvalidInput(f"page: expected viser 1.1 or newer, got {module.__version__}; {hint}")
    return module


def _quaternion(rotation: Array) -> tuple[float, ...]:
    """(w, x, y, z) of a rotation."""
    return tuple(Rotation.from_matrix(rotation).as_quat(scalar_first=True).tolist())


def _rgb(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(255 * share) for share in to_rgb(colour))
    return red, green, blue
