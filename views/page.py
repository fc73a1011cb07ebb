"""A motion as one HTML page in three dimensions, which any browser opens from disk without a
network: viser's client.

The page plays the motion like a film with a time line to pull, and can be turned and zoomed.
Everything is in the file.
"""

from __future__ import annotations

import html
import io
from abc import ABC, abstractmethod
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
from typing import Any, ClassVar

import numpy as np
from matplotlib.colors import to_hex

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput, install_command, not_installed
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, write_bytes
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.inverse_kinematics import ToeKinematics
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain import Patch

from .film import film_frames
from .robots import RobotShape, climber, limb_of_three
from .scene import ON_M, Animation, Arrow, Colour, DrawnBody, Layer, Path, Scene, Stage
from .shapes import plate, ring, unit
from .sheet import ACCENT, INK, QUIET, Size
from .video import Frame

_STRIPS = """<style>#strips{position:fixed;left:0;bottom:40px;z-index:9;width:100%;display:flex;overflow-x:auto;
background:rgba(255,255,255,.8)}#strips div{flex:none}
#strips div:first-child{margin-left:auto}#strips div:last-child{margin-right:auto}</style>"""
"""The look of the strips: side by side above the time line, on a narrow screen to be drawn aside."""
FPS = 20.0
"""Pictures per second of films."""
GOAL, REAL = "#e8a317", "#c2410c"
"""Colours of the goal, and of the path of the robot in a world."""


class View(ABC):
    """View of a motion: a picture, a page or a film.

    Joints are where the motion has them. Where it knows none they are found by inverse kinematics,
    and those of limbs without a file are a guess, for the eye.
    """

    film_px: ClassVar[Size] = (854, 480)

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """The robot that moves."""

    @property
    @abstractmethod
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""

    @abstractmethod
    def film(self) -> Animation:
        """The motion as moments, for a page or a film."""

    def frames(self, film: Animation, size_px: Size | None = None) -> Iterator[Frame]:
        """The frames of ``film``, uint8 of shape (H, W, 3), one by one.

        Raises InvalidInput without MuJoCo or a GL library.
        """
        return film_frames(film, size_px or self.film_px)

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return climber(self.robot)

    def near_rad(self, now: Samples) -> Array | None:
        """Angles that unknown joints are sought near, shape (J,) [rad]; None for anywhere."""
        return None

    def guess(self, now: Samples) -> list[Array]:
        """Places of the joints of limbs of which only the reach is known, shape (J, 3) [m] each, the
        foot last.
        """
        turn = rotation_of(now.rotation_rad)
        return [
            limb_of_three(now.com_m + arm, toe, unit(arm), limb.reach_m)
            for limb, toe in zip(self.robot.limbs, now.toes_m, strict=True)
            for arm in [turn @ limb.shoulder_m]
        ]

    def limbs(self, now: Samples) -> Sequence[Array]:
        """Poses of the limbs: angles of a URDF's, shape (n,) [rad]; else where its joints are, shape
        (J, 3) [m], the foot last.
        """
        turn, links = rotation_of(now.rotation_rad), self.shape.links
        if links is not None and now.angles_rad is not None:
            return links.split(now.angles_rad)
        if links is not None:
            near = self.near_rad(now)
            legs, _ = ToeKinematics(links.model).solve(
                now.com_m[None],
                turn[None],
                now.toes_m[None],
                now.normals[None],
                None if near is None else near[None],
            )
            return [angles[0] for angles in legs]
        if now.angles_rad is not None and now.origin_m is not None and self._kinematics is not None:
            return list(now.origin_m + self._kinematics.chains(now.angles_rad) @ turn.T)
        return self.guess(now)

    @cached_property
    def _kinematics(self) -> Kinematics | None:
        """Legs that are drawn up for limbs; None where there are none, or pinocchio is not
        installed.
        """
        try:
            return Kinematics(self.robot)
        except InvalidInput:
            return None

    def pose(self, now: Samples) -> tuple[Array, Array]:
        """Pose in which the body is drawn, p_WB and R_WB: where its link is, or else at the centre
        of mass.
        """
        turn = rotation_of(now.rotation_rad)
        if now.origin_m is None:
            return now.com_m, turn
        return now.origin_m + turn @ self.robot.origin_m, turn

    def bodies(self, now: Samples) -> list[DrawnBody]:
        """The robot at a time."""
        return self.shape.bodies(*self.pose(now), self.limbs(now))

    def ghost(self, now: Samples) -> Scene:
        """Trunk and limbs as a drawing in thin lines."""
        return self.shape.ghost(*self.pose(now), self.limbs(now))

    def forces(self, now: Samples, *, prefix: str = "") -> list[Arrow]:
        """Arrows of the forces of the feet that stand and are loaded."""
        loaded = now.stands & (np.linalg.norm(now.forces_n, axis=1) > 0.0)
        return [
            self.shape.force(
                prefix + self.shape.limbs[k],
                now.toes_m[k],
                self.metres_a_newton * now.forces_n[k],
            )
            for k in np.flatnonzero(loaded).tolist()
        ]


def outline(patch: Patch, colour: Colour, opacity: float = 1.0, width: float = 1.4) -> Path:
    """The border of a chosen patch."""
    return Path(
        pieces_m=ring(patch.vertices_m + ON_M * patch.normal),
        colour=colour,
        opacity=opacity,
        width=width,
        layer=Layer.TERRAIN,
        lift_m=8.0,
    )


def window(name: str, patch: Patch, colour: Colour, edge: Colour) -> DrawnBody:
    """A chosen patch in full colour, framed in the colour of its limb."""
    return DrawnBody(
        name=name,
        shape=plate(patch.vertices_m, ON_M * patch.normal),
        position_m=np.zeros(3),
        colour=colour,
        edge=edge,
        opacity=0.55,
        layer=Layer.TERRAIN,
        lift_m=9.0,
    )


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
