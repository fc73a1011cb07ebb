"""A motion as one HTML page in three dimensions, which any browser opens from disk without a
network: viser's client.

The page plays the motion like a film with a time line to pull, and can be turned and zoomed.
Everything is in the file.
"""

from __future__ import annotations

import html
import io
import math
from collections.abc import Iterator, Sequence
from contextlib import (
    AbstractContextManager,
    contextmanager,
    nullcontext,
    redirect_stderr,
    redirect_stdout,
)
from importlib import import_module
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.colors import to_hex, to_rgb, to_rgba

from stancekit.planners.errors import InvalidInput, install_command, not_installed
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, write_bytes

from .scene import (
    UP,
    Animation,
    Arrow,
    Box,
    Capsule,
    Colour,
    DrawnBody,
    Faces,
    Label,
    Mesh,
    Path,
    Scene,
    Sheet,
    Sphere,
    borders,
    fans,
    mesh_of,
    triangles_of,
)
from .sheet import ACCENT, INK, QUIET

_STRIPS = """<style>#strips{position:fixed;left:0;bottom:40px;z-index:9;width:100%;display:flex;overflow-x:auto;
background:rgba(255,255,255,.8)}#strips div{flex:none}
#strips div:first-child{margin-left:auto}#strips div:last-child{margin-right:auto}</style>"""
"""The look of the strips: side by side above the time line, on a narrow screen to be drawn aside."""


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


def _alike(made: DrawnBody, body: DrawnBody) -> bool:
    """Tell whether a node that was made for the one shows the other, too, once it is moved."""
    first, shape = made.shape, body.shape
    if (made.colour, made.opacity, type(first)) != (body.colour, body.opacity, type(shape)):
        return False
    if isinstance(first, Capsule) and isinstance(shape, Capsule):
        return first.radii_m == shape.radii_m
    return first is shape or all(
        np.array_equal(vars(first)[name], vars(shape)[name]) for name in vars(first)
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


__all__ = ["PAGES", "check_page", "page", "write_page"]

PAGES = (".html", ".htm")
"""Suffixes of pages' names."""


def check_page(path: str | File) -> File:
    """The file behind the name of a page, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .html, where nothing can be written, and
    without viser 1.1.
    """
    if File(path).suffix.lower() not in PAGES:
        raise InvalidInput(
            f"{path}: expected a name that ends in .html, got {File(path).suffix or 'no suffix'}"
        )
    viser_module()
    return check_writable(path)


def write_page(path: str | File, motion: Animation) -> None:
    """Write the page, whole or not at all.

    Raises InvalidInput as ``check_page`` does.
    """
    target = check_page(path)
    write_bytes(target, page(motion).encode())


def page(motion: Animation) -> str:
    """The page as HTML.

    Raises InvalidInput without viser 1.1 or newer.
    """
    with viser_server() as server:
        server.scene.configure_default_lights(cast_shadow=False)
        view, camera = server.initial_camera, motion.camera
        low, high = motion.window(1.6)
        view.look_at = tuple(camera.target_m + 0.5 * (low + high) @ camera.axes[:2])
        view.position = tuple(camera.position_m)
        view.fov = 2.0 * np.arctan2(0.5 * (high - low)[1], camera.distance_m)
        stage = Stage(server.scene, motion.camera.distance_m)
        stage.show(motion.fixed, "/fixed")
        recording = server.get_scene_serializer()
        notes = list(motion.notes) or [""] * len(motion.moments)
        for moment, note in zip(motion.moments, notes, strict=True):
            stage.pose(moment, note)
            recording.insert_sleep(motion.step_s)
        text = str(recording.as_html())
    return _titled(text, motion)


def _titled(text: str, motion: Animation) -> str:
    """The page with its title and a legend in a corner."""
    lines = "".join(
        f'<div><span style="display:inline-block;width:14px;height:14px;margin-right:8px;vertical-align:-2px;'
        f'border:1px solid #9aa5b1;background:{to_hex(colour)}"></span>{html.escape(words)}</div>'
        for colour, words in motion.legend
    )
    style = (
        "position:fixed;right:16px;top:16px;z-index:10;pointer-events:none;padding:10px "
        "14px;border-radius:6px;"
        f"background:rgba(255,255,255,.85);font:13px/1.6 system-ui,sans-serif;color:{INK}"
    )
    title, note = html.escape(motion.title), html.escape(motion.note)
    note = note and f'<div style="color:{ACCENT if motion.alarm else QUIET}">{note}</div>'
    legend = f'<div id="legend" style="{style}"><b>{title}</b>{note}{lines}</div>'
    if motion.strips:
        legend += f'<div id="strips"><div>{"</div><div>".join(motion.strips)}</div></div>{_STRIPS}'
    text = text.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    end = text.rindex("</body>")
    return text[:end] + legend + text[end:]


@contextmanager
def viser_server(
    host: str = "127.0.0.1", port: int = 8080, making: AbstractContextManager[None] | None = None
) -> Iterator[Any]:
    """A silent viser server; a scene is recorded without a client.

    Arguments:
        port: 0 takes a free one; one that is taken, the next.
        making: entered while the server is made.
    """
    viser = viser_module()
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), making or nullcontext():
        server = viser.ViserServer(host=host, port=port, verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            server.stop()


def viser_module() -> Any:
    """The module viser.

    Raises InvalidInput where it is missing or too old to write pages.
    """
    try:
        module = import_module("viser")
        infra = import_module("viser.infra")
    except ImportError:
        raise not_installed("page", "viser", "pages", "viz") from None
    if not hasattr(infra.StateSerializer, "as_html"):
        raise InvalidInput(
            f"page: expected viser 1.1 or newer, got {module.__version__}: {install_command('viz')}"
        )
    return module
