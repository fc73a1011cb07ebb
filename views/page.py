"""A motion as one HTML page in three dimensions, which any browser opens from disk without a
network: viser's client.

The page plays the motion like a film with a time line to pull, and can be turned and zoomed.
Everything is in the file.
"""

from __future__ import annotations

import html
import io
from collections.abc import Iterator
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
from matplotlib.colors import to_hex

from stancekit.planners.errors import InvalidInput, install_command, not_installed
from stancekit.planners.files.writing import check_writable, write_bytes

from .scene import Animation
from .sheet import ACCENT, INK, QUIET
from .stage import Stage

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
    text = text.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    end = text.rindex("</body>")
    return text[:end] + legend + text[end:]


@contextmanager
def viser_server(
    host: str = "127.0.0.1", port: int = 8080, making: AbstractContextManager[None] | None = None
) -> Iterator[Any]:
    """A viser server, which says nothing; to record a scene nobody has to connect to it.

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
