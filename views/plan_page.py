"""A plan as one HTML page in three dimensions, which any browser opens from disk without a network: viser's own client.

The page plays the plan like a film with a time line to pull, and can be turned and zoomed. Everything is in the file.
"""

from __future__ import annotations

import html
import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, write_bytes
from stancekit.planners.terrain import Patch

from .painter import CIRCLE, UP
from .plan_motion import Moment
from .plan_picture import GOAL, PlanStage
from .plan_terrain import ICE, ICE_EDGE, ICY
from .plot import ACCENT, INK, leg_colour
from .posture_picture import STEEL

__all__ = ["check_page", "plan_page", "write_plan_page"]

STEPS_A_SECOND = 20.0
LIFT_M = 0.002
"""Frames of patches stand so far off their surface, so that they are seen."""


def check_page(path: str | Path) -> Path:
    """The file behind the name of a page, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .html, where nothing can be written, and without viser 1.1.
    """
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InvalidInput(f"{path}: expected a name that ends in .html, got {Path(path).suffix or 'no suffix'}")
    _viser()
    return check_writable(path)


def write_plan_page(path: str | Path, plan: Plan, *, step_s: float = 1.5) -> None:
    """Write the page, whole or not at all. Raises InvalidInput as ``check_page`` does."""
    target = check_page(path)
    write_bytes(target, plan_page(plan, step_s=step_s).encode())


def plan_page(plan: Plan, *, step_s: float = 1.5) -> str:
    """The page as HTML: surfaces by friction, chosen patches, robot, forces, cones, the way of the centre of mass.

    step_s: seconds from key frame to key frame. Raises InvalidInput without viser 1.1 or newer.
    """
    stage = PlanStage(plan)
    with _server() as server:
        scene = server.scene
        scene.configure_default_lights(cast_shadow=False)
        target, azimuth, elevation, away_m = stage.viewpoint
        level = np.array([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)])
        server.initial_camera.position = tuple(target + 0.78 * away_m * level / np.linalg.norm(level))
        server.initial_camera.look_at = tuple(target)
        server.initial_camera.fov = 0.8
        _add_terrain(scene, stage)
        _add_choice(scene, stage)
        _add_way(scene, stage)
        robot = _Robot(scene, stage)
        recording = server.get_scene_serializer()
        for time in _times(stage, step_s):
            robot.pose(stage.motion.at(time), round(time) if abs(time - round(time)) < 1e-9 else None)
            recording.insert_sleep(1.0 / STEPS_A_SECOND)
        page = str(recording.as_html())
    return _titled(page, stage)


def _times(stage: PlanStage, step_s: float) -> list[float]:
    """Times of the film's steps; every key frame is one of them, and the last stays a moment."""
    steps = max(round(step_s * STEPS_A_SECOND), 1)
    moving = [k / steps for k in range((stage.plan.course.frames - 1) * steps)]
    return moving + [stage.motion.end] * round(STEPS_A_SECOND)


class _Robot:
    """The nodes of the robot in the scene, and how they follow it."""

    def __init__(self, scene: Any, stage: PlanStage) -> None:
        self.stage = stage
        course = stage.plan.course
        first = stage.scene(stage.motion.key(0))
        size, bone = stage.size, 0.033 * stage.size
        rings = [first.body(0.97, -0.06 * size), first.body(0.97, 0.06 * size)]
        local = (np.concatenate(rings) - first.com) @ first.turn
        self.body = scene.add_mesh_simple(
            "/robot/body", local, _prism(6), color=_rgb("#dfe6ee"), flat_shading=True, side="double"
        )
        self.links = [
            [scene.add_cylinder(f"/robot/{limb.name}/link{k}", radius=1.0, height=1.0, color=_rgb(STEEL),
                                radial_segments=10) for k in range(3)]
            for limb in course.robot.limbs
        ]  # fmt: skip
        sizes, knee = (1.45, 1.3, 1.15, 1.15), _rgb("#8593a1")
        self.joints = [
            [scene.add_icosphere(f"/robot/{limb.name}/joint{k}", radius=sizes[k] * bone, subdivisions=2,
                                 color=_rgb(leg_colour(i)) if k == 3 else knee) for k in range(4)]
            for i, limb in enumerate(course.robot.limbs)
        ]  # fmt: skip
        self.bone = bone
        self.arrows = [
            scene.add_arrows(f"/forces/{limb.name}", np.zeros((1, 2, 3)), _rgb(ACCENT), shaft_radius=0.026 * size,
                             head_radius=0.062 * size, head_length=0.14 * size, visible=False)
            for limb in course.robot.limbs
        ]  # fmt: skip
        self.cones = [self._cone(scene, p) for p in range(len(course.placements))]
        self.frames = [
            scene.add_label(f"/frames/{k}", f"key frame {k} of {course.frames - 1}", anchor="bottom-center",
                            visible=False, position=tuple(stage.plan.com_m[k] + 0.25 * size * UP))
            for k in range(course.frames)
        ]  # fmt: skip

    def pose(self, moment: Moment, frame: int | None) -> None:
        """Move every node to a moment; frame: the key frame that it is, if it is one."""
        scene, course = self.stage.scene(moment), self.stage.plan.course
        self.body.position = tuple(moment.com_m)
        self.body.wxyz = _quaternion(moment.rotation_rad)
        loads = np.linalg.norm(moment.forces_n, axis=1)
        for i, joints in enumerate(scene.legs()):
            for k, link in enumerate(self.links[i]):
                a, b = joints[k], joints[k + 1]
                thick = (1.15, 0.9, 0.62)[k] * self.bone
                link.position, link.wxyz = tuple(0.5 * (a + b)), _along(b - a)
                link.scale = (thick, thick, float(np.linalg.norm(b - a)))
            for ball, at in zip(self.joints[i], joints, strict=True):
                ball.position = tuple(at)
            toe, force = moment.toes_m[i], self.stage.metres_a_newton * moment.forces_n[i]
            shown = bool(np.linalg.norm(force) > 0.03 * self.stage.size)
            _show(self.arrows[i], shown)
            if shown:
                self.arrows[i].points = np.array([[toe, toe + force]], dtype=np.float32)
        bearing = {int(course.holds[moment.frame, i]) for i in np.flatnonzero(loads > 1e-3 * course.weight_n)}
        for p, cone in enumerate(self.cones):
            _show(cone, p in bearing)
        for k, label in enumerate(self.frames):
            _show(label, k == moment.frame if frame is None else k == frame)

    def _cone(self, scene: Any, placement: int) -> Any:
        """The friction cone of a placement as a translucent mesh, hidden."""
        plan = self.stage.plan
        patch, toe = plan.course.patch(placement, plan.choice), plan.toes_m[placement]
        height = 0.3 * self.stage.size
        rim = toe + height * (patch.normal + max(patch.friction, 1e-3) * CIRCLE @ patch.frame[:, 1:].T)
        fan = np.array([[0, 1 + k, 1 + (k + 1) % len(rim)] for k in range(len(rim))])
        return scene.add_mesh_simple(
            f"/cones/{placement}", np.vstack([toe, rim]), fan, color=_rgb(ACCENT), opacity=0.16, side="double",
            cast_shadow=False, receive_shadow=False, visible=False,
        )  # fmt: skip


def _add_terrain(scene: Any, stage: PlanStage) -> None:
    """Surfaces in a tint of their friction, open from behind, with borders; ice in pale blue with strokes of light."""
    by_friction: dict[float, list[Patch]] = {}
    for patch in stage.plan.course.terrain:
        by_friction.setdefault(patch.friction, []).append(patch)
    for index, (friction, patches) in enumerate(by_friction.items()):
        icy = friction < ICY
        tint = np.array(to_rgb(ICE)) if icy else 0.25 + 0.75 * np.array(stage.friction.to_rgba(np.array(friction))[:3])
        corners = np.cumsum([0, *(len(patch.vertices_m) for patch in patches)])
        fans = [
            [first, first + k, first + k + 1]
            for first, patch in zip(corners, patches, strict=False)
            for k in range(1, len(patch.vertices_m) - 1)
        ]
        scene.add_mesh_simple(
            f"/terrain/{index}", np.concatenate([_facing(patch) for patch in patches]), np.array(fans),
            color=_rgb(tint), flat_shading=True, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        edge = _rgb(ICE_EDGE if icy else 0.75 * tint)
        _add_lines(scene, f"/terrain/{index}/borders", [_border(patch) for patch in patches], edge, 0.002)
        if icy:
            _add_lines(scene, f"/terrain/{index}/glints", [_glints(patch) for patch in patches], _rgb("white"), 0.005)


def _add_choice(scene: Any, stage: PlanStage) -> None:
    """The patches that the plan chose, framed in the colour of their limb."""
    course = stage.plan.course
    for i, limb in enumerate(course.robot.limb_names):
        of_limb = [p for p, put in enumerate(course.placements) if put.limb == limb]
        borders = [_border(course.patch(p, stage.plan.choice)) for p in of_limb]
        _add_lines(scene, f"/chosen/{limb}", borders, _rgb(leg_colour(i)), 0.0025)


def _add_lines(scene: Any, name: str, lines: list[Array], colour: tuple[int, int, int], thickness: float) -> None:
    """Straight pieces, shape (K, 2, 3) each, as one node."""
    scene.add_line_segments(name, np.concatenate(lines), colour, thickness=thickness)


def _facing(patch: Patch) -> Array:
    """The corners of a patch, to the left as seen from the robot: from behind no face is drawn, just its border."""
    first, second, third = patch.vertices_m[:3]
    turned = np.cross(second - first, third - first) @ patch.normal
    return patch.vertices_m if turned > 0.0 else patch.vertices_m[::-1]


def _border(patch: Patch) -> Array:
    """The edges of a patch a little above it, shape (U, 2, 3)."""
    ring = patch.vertices_m + LIFT_M * patch.normal
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def _glints(patch: Patch) -> Array:
    """Strokes of light across a patch of ice, shape (3, 2, 3)."""
    y, z = 0.2 * float(np.ptp(patch.vertices_m @ patch.frame[:, 2])) * patch.frame[:, 1:].T
    centre = patch.centre_m + LIFT_M * patch.normal
    strokes = ((-0.4, 0.45), (0.0, 0.9), (0.35, 0.5))
    return np.array([[centre + a * (y - z) + s * (y + z) for s in (-half, half)] for a, half in strokes])


def _add_way(scene: Any, stage: PlanStage) -> None:
    """The way of the centre of mass, a dot at every key frame, and the goal."""
    plan, size = stage.plan, stage.size
    if plan.course.frames > 1:
        ways = np.stack([plan.com_m[:-1], plan.com_m[1:]], axis=1)
        scene.add_line_segments("/way", ways, _rgb(INK), thickness=0.02 * size)
    for k, at in enumerate(plan.com_m):
        scene.add_icosphere(f"/way/{k}", radius=0.025 * size, color=_rgb(INK), subdivisions=2, position=tuple(at))
    scene.add_icosphere(
        "/goal", radius=0.05 * size, color=_rgb(GOAL), subdivisions=2, position=tuple(plan.course.goal_m)
    )
    scene.add_label("/goal/name", "goal", anchor="bottom-left", position=(0.0, 0.0, 0.06 * size))


def _titled(page: str, stage: PlanStage) -> str:
    """The page with its title and a legend in a corner."""
    course = stage.plan.course
    name = html.escape(course.name)
    rows = [(INK, "way of the centre of mass"), (ACCENT, "contact forces in friction cones"), (GOAL, "goal")]
    for friction in sorted({patch.friction for patch in course.terrain})[:6]:
        icy = friction < ICY
        colour = ICE if icy else stage.friction.to_rgba(np.array(friction))
        shown = colour if isinstance(colour, str) else "#" + "".join(f"{round(255 * c):02x}" for c in colour[:3])
        rows.append((shown, f"ice, μ = {friction:g}" if icy else f"friction μ = {friction:g}"))
    lines = "".join(
        f'<div><span style="display:inline-block;width:14px;height:14px;margin-right:8px;vertical-align:-2px;'
        f'border:1px solid #9aa5b1;background:{colour}"></span>{html.escape(text)}</div>'
        for colour, text in rows
    )
    style = (
        "position:fixed;right:16px;top:16px;z-index:10;pointer-events:none;padding:10px 14px;border-radius:6px;"
        f"background:rgba(255,255,255,.85);font:13px/1.6 system-ui,sans-serif;color:{INK}"
    )
    legend = f'<div id="plan-legend" style="{style}"><b>{name}</b>: {course.frames} key frames{lines}</div>'
    page = page.replace("<title>Viser</title>", f"<title>{name}</title>", 1)
    end = page.rindex("</body>")
    return page[:end] + legend + page[end:]


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


def _show(node: Any, visible: bool) -> None:
    """Set visibility where it changes: every assignment is a message in the recording."""
    if node.visible != visible:
        node.visible = visible


def _prism(corners: int) -> Array:
    """Faces of a prism whose lower ring comes first, shape (F, 3)."""
    sides = [(k, (k + 1) % corners) for k in range(corners)]
    around = [[[a, b, corners + b], [a, corners + b, corners + a]] for a, b in sides]
    ends = [[[0, k + 1, k], [corners, corners + k, corners + k + 1]] for k in range(1, corners - 1)]
    return np.array([face for pair in around + ends for face in pair])


def _quaternion(rotation_rad: Array) -> tuple[float, ...]:
    """(w, x, y, z) of a rotation vector."""
    angle = float(np.linalg.norm(rotation_rad))
    return (float(np.cos(0.5 * angle)), *(0.5 * np.sinc(0.5 * angle / np.pi) * rotation_rad).tolist())


def _along(direction: Array) -> tuple[float, ...]:
    """(w, x, y, z) of a rotation that turns the z axis into a direction."""
    d = direction / max(float(np.linalg.norm(direction)), 1e-12)
    half = np.array([1.0 + d[2], -d[1], d[0], 0.0]) if d[2] > -1.0 + 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
    return tuple((half / np.linalg.norm(half)).tolist())


def _rgb(colour: Any) -> tuple[int, int, int]:
    red, green, blue = (round(255 * share) for share in to_rgb(colour))
    return red, green, blue
