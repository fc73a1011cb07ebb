"""The picture of a posture: patches, the robot on them, its contact forces in their cones, and an envelope."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgb as rgb
from matplotlib.figure import Figure

from stancekit.planners.answer.outcome import Posture
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, frozen
from stancekit.planners.problem import PostureProblem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.terrain import Patch

from . import plot as chart
from .painter import CIRCLE, FORCE, GROUND, ROBOT, UP, Painter, unit
from .plot import ACCENT, DEFAULT_STYLE, INK, SIZE_PX, ComparisonBar, Size, draw_comparison, leg_colour, save, to_rgb

__all__ = ["ComparisonBar", "draw_comparison", "draw_posture", "save", "to_rgb"]

STEEL, JOINT, RIM, SHELL = "#5b6b7b", "#8593a1", "#2b3642", "#dfe6ee"
WEIGHT_ARROW = 0.8
"""Length of an arrow as heavy as the robot, in units of the mean reach."""
COUNT_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What is drawn, in the world frame and metres."""

    problem: PostureProblem
    posture: Posture | None

    @property
    def patches(self) -> list[Patch]:
        return [contact.patch for contact in self.problem.contacts]

    @property
    def com(self) -> Array:
        return self.problem.com_nominal_m if self.posture is None else self.posture.com_m

    @cached_property
    def turn(self) -> Array:
        """I + [Θ]×, shape (3, 3)."""
        x, y, z = np.zeros(3) if self.posture is None else self.posture.rotation_rad
        return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])

    @property
    def mounts(self) -> Array:
        """Shoulders in the body frame, shape (N, 3)."""
        return np.array([contact.shoulder_m for contact in self.problem.contacts])

    @property
    def shoulders(self) -> Array:
        return np.asarray(self.com + self.mounts @ self.turn.T)

    @cached_property
    def unit(self) -> float:
        """Mean reach: the size of the robot."""
        return float(np.mean([contact.reach_m for contact in self.problem.contacts]))

    @cached_property
    def radius(self) -> float:
        """How far the shoulders are from the body's axis."""
        return max(float(np.mean(np.linalg.norm(self.mounts[:, :2], axis=1))), 0.1 * self.unit)

    @cached_property
    def extent(self) -> Array:
        """Lowest and highest coordinates of patches and shoulders before anything is solved, shape (2, 3)."""
        vertices = [patch.vertices_m for patch in self.patches]
        points = np.concatenate([*vertices, self.problem.com_nominal_m + self.mounts])
        return np.array([points.min(axis=0), points.max(axis=0)])

    @property
    def grid_m(self) -> float:
        """0.1 m, or in a large scene a larger power of ten."""
        return float(0.1 * 10.0 ** max(0.0, np.ceil(np.log10(np.max(self.extent[1] - self.extent[0]) / 3.0))))

    def body(self, size: float, height: float) -> Array:
        """A hexagon around the body's axis with corners towards the shoulders, shape (6, 3)."""
        corners = np.arctan2(self.mounts[0, 1], self.mounts[0, 0]) + np.pi / 3.0 * np.arange(6)
        ring = size * self.radius * np.column_stack([np.cos(corners), np.sin(corners), np.zeros(6)])
        return np.asarray(self.com + (ring + height * UP) @ self.turn.T)

    def legs(self) -> list[Array]:
        """Shoulder, hip, knee and toe of every leg; none without a posture."""
        if self.posture is None:
            return []
        parts = zip(self.shoulders, self.posture.toes_m, self.problem.contacts, strict=True)
        return [_leg(v, toe, unit(self.turn @ contact.shoulder_m), contact.reach_m) for v, toe, contact in parts]

    @property
    def metres_a_newton(self) -> float:
        return WEIGHT_ARROW * self.unit / self.problem.weight_n


@DEFAULT_STYLE
def draw_posture(
    problem: PostureProblem,
    posture: Posture | None = None,
    *,
    envelope: Envelope | None = None,
    caption: str = "",
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw a posture problem, and a posture and an envelope where given.

    Patches are coloured by friction and stand out of the wall or ground behind them; the force at a toe is an arrow in
    its friction cone, which is as high as the normal force. The envelope's bounds on p are boxes about the centre of
    mass, and a strip below shows all of its bounds with the posture in them. Without a posture the body is shown at the
    nominal centre of mass, and the caption says so. size_px: width and height. Raises InvalidInput.
    """
    count = len(problem.contacts)
    if posture is not None:
        for name, shape in (("com_m", (3,)), ("rotation_rad", (3,)), ("toes_m", (count, 3)), ("forces_n", (count, 3))):
            frozen(getattr(posture, name), shape, f"posture: {name}")
    if envelope is not None and envelope.contacts != count:
        raise InvalidInput(f"envelope: expected {count} contacts, got {envelope.contacts}")
    scene = Scene(problem=problem, posture=posture)
    figure = chart.sheet(size_px)
    painter = _view(scene)
    friction = chart.friction_colours([patch.friction for patch in scene.patches])
    _draw_terrain(painter, scene, friction)
    draw_body(painter, scene)
    if posture is not None:
        draw_legs(painter, scene)
        _draw_forces(painter, scene, posture)
    if envelope is not None:
        low, high = (scene.com + problem.length_scale_m * bounds for bounds in envelope.position)
        for k in range(count):
            painter.box(low[k], high[k], leg_colour(k))
    _draw_com(painter, scene)
    name_legs(painter, scene)
    floor = 0.0 if envelope is None else 252.0
    axes = chart.plain_axes(figure, 24.0, floor + 70.0, 92.0)
    scale = painter.paint(axes)
    x, y = painter.project(scene.com)[0][0]
    chart.mark_com(axes, (float(x), float(y)), 8.0 * scale)
    longest = 160.0 if envelope is None else 95.0
    arrow = None if posture is None else arrow_scale(scale / scene.metres_a_newton, longest)
    chart.draw_legend(figure, floor + 12.0, friction, arrow=arrow, boxes=envelope is not None)
    if envelope is not None:
        chart.draw_strip(figure, problem.legs, envelope, None if posture is None else _point(problem, posture))
    chart.headline(figure, *_words(scene, caption), alarm=posture is None)
    return figure


def arrow_scale(newtons_a_unit: float, longest: float) -> tuple[float, str]:
    """The longest arrow of a round force, in units of paper, and its label."""
    power = 10.0 ** np.floor(np.log10(longest * newtons_a_unit))
    newtons = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * newtons_a_unit)
    return newtons / newtons_a_unit, f"contact force, {newtons:g} N"


def _words(scene: Scene, caption: str) -> tuple[str, str]:
    """Title and the line below it."""
    problem, posture = scene.problem, scene.posture
    weight = f"{problem.weight_n:.1f} N"
    if posture is None:
        title = caption or f"{len(problem.contacts)} contacts, {weight}: no posture"
        return title, "no posture (infeasible or unsolved): patches, and the shoulders at the nominal centre of mass"
    count = len(problem.contacts)
    limbs = f"{COUNT_WORDS[count] if count < len(COUNT_WORDS) else count} limb{'s' if count > 1 else ''}"
    away_mm = 1e3 * float(np.linalg.norm(posture.com_m - problem.com_nominal_m))
    tilt_deg = np.rad2deg(np.linalg.norm(posture.rotation_rad))
    moved = f"centre of mass {away_mm:.0f} mm from nominal   ·   body turned by {tilt_deg:.1f}°"
    return caption or f"held by {limbs}, {weight}", f"{moved}   ·   grid {scene.grid_m:g} m"


def _point(problem: PostureProblem, posture: Posture) -> Array:
    """[p, f] of E2–E4, shape (N, 6)."""
    frames = np.array([contact.patch.frame for contact in problem.contacts])
    forces = np.einsum("nji,nj->ni", frames, posture.forces_n) / float(problem.force_scale_n or 1.0)
    return np.concatenate([(posture.toes_m - posture.com_m) / problem.length_scale_m, forces], axis=1)


def _view(scene: Scene) -> Painter:
    """The viewpoint from which the patches show their faces, stand apart and are not behind the body."""
    centres = np.array([patch.centre_m for patch in scene.patches])
    home = scene.problem.com_nominal_m
    points = np.concatenate([centres, home + scene.mounts])
    away_m = max(4.5 * scene.unit, 1.5 * float(np.linalg.norm(scene.extent[1] - scene.extent[0])))

    def merit(painter: Painter) -> float:
        shown = min(painter.facing(patch.centre_m, patch.normal) for patch in scene.patches)
        xy, _ = painter.project(points)
        apart = np.linalg.norm(xy[:, None] - xy[None], axis=-1) + 9.0 * np.eye(len(xy))
        clear = np.linalg.norm(xy[: len(centres)] - painter.project(home)[0], axis=1)
        return 3.0 * min(shown, 0.3) + float(apart.min()) / scene.unit + min(float(clear.min()) / scene.radius, 1.2)

    angles = product(np.deg2rad(np.arange(-180.0, 180.0, 7.5)), np.deg2rad([20.0, 27.0]))
    return max((Painter(scene.extent.mean(axis=0), *angle, away_m) for angle in angles), key=merit)


def _draw_terrain(painter: Painter, scene: Scene, friction: ScalarMappable) -> None:
    """Patches as the faces of stones on a wall or on the ground: one plane for each direction they face."""
    low, high = scene.extent[0] - 0.1 * scene.unit, scene.extent[1] + 0.1 * scene.unit
    sides: dict[tuple[int, float], list[Patch]] = {}
    for patch in scene.patches:
        axis = int(np.argmax(np.abs(patch.normal)))
        sides.setdefault((axis, float(np.sign(patch.normal[axis]))), []).append(patch)
    for (axis, sign), patches in sides.items():
        level = sign * (min(float(np.min(sign * patch.vertices_m[:, axis])) for patch in patches) - 0.02)
        painter.plane(axis, level, low, high, scene.grid_m)
        if (axis, sign) == (2, 1.0):
            _draw_shadow(painter, scene, level)
        for patch in patches:
            painter.stone(patch.vertices_m, axis, level, friction.to_rgba(np.array(patch.friction)), INK)


def _draw_shadow(painter: Painter, scene: Scene, level: float) -> None:
    """What the robot would shade of level ground under a high sun."""
    lines = [scene.body(0.97, 0.0)]
    for joints in scene.legs():
        for a, b in pairwise(joints):
            aside, on = 0.035 * scene.unit * unit(np.cross(UP, b - a)), 0.02 * scene.unit * unit(b - a)
            lines.append(np.array([a - on + aside, b + on + aside, b + on - aside, a - on - aside]))
    for line in lines:
        shade = line.copy()
        shade[:, 2] = level
        painter.face(shade, "#e3e7ec", GROUND, depth=-8.0)


def draw_body(painter: Painter, scene: Scene) -> None:
    """A hexagonal prism with a deck, its corners at the shoulders, and a chevron that points ahead."""
    alpha = 1.0 if scene.posture is not None else 0.55
    thick = 0.06 * scene.unit
    for size, low, high in ((0.97, -thick, thick), (0.72, thick, 1.5 * thick)):
        top = scene.body(size, high)
        painter.prism(top, scene.body(size, low), SHELL, ROBOT, STEEL, alpha)
        painter.face(top, painter.lit(SHELL, scene.turn @ UP, alpha), ROBOT, edge=STEEL, width=0.8)
    outline = np.array([[0.55, 0.0], [0.36, 0.20], [0.36, 0.10], [0.45, 0.0], [0.36, -0.10], [0.36, -0.20]])
    chevron = np.column_stack([scene.radius * outline, np.full(6, 1.5 * thick)])
    painter.face(scene.com + chevron @ scene.turn.T, STEEL, ROBOT, depth=painter.near(scene.com) + 0.1 * scene.unit)


def draw_legs(painter: Painter, scene: Scene) -> None:
    bone = 0.033 * scene.unit
    for k, joints in enumerate(scene.legs()):
        for a, b, start, end in zip(joints[:-1], joints[1:], (1.2, 1.0, 0.8), (1.1, 0.8, 0.45), strict=True):
            painter.tube(a, b, (start * bone, end * bone), STEEL, ROBOT, RIM)
        for joint, size in zip(joints[:3], (1.45, 1.3, 1.15), strict=True):
            painter.ball(joint, size * bone, JOINT, ROBOT, RIM)
        painter.ball(joints[3], 0.95 * bone, leg_colour(k), ROBOT, RIM)


def _leg(shoulder: Array, toe: Array, outward: Array, reach_m: float) -> Array:
    """Shoulder, hip, knee and toe of a leg whose knee bends up and outward, shape (4, 3) [m]: a guess, for the eye."""
    hip = shoulder + 0.13 * reach_m * unit(outward + 0.5 * unit(toe - shoulder))
    line = toe - hip
    length = max(float(np.linalg.norm(line)), 1e-6)
    thigh, shank = np.array([0.44, 0.54]) * max(reach_m, 1.03 * length)
    along = (length**2 + thigh**2 - shank**2) / (2.0 * length)
    bend = UP + 0.5 * outward
    bend = unit(bend - (bend @ line) * line / length**2)
    return np.array([shoulder, hip, hip + along / length * line + np.sqrt(max(thigh**2 - along**2, 0.0)) * bend, toe])


def _draw_forces(painter: Painter, scene: Scene, posture: Posture) -> None:
    """Contact forces from the toes, in cones as high as the normal force, and the weight from the centre of mass."""
    scale, thickness = scene.metres_a_newton, 0.016 * scene.unit
    for patch, toe, force in zip(scene.patches, posture.toes_m, posture.forces_n, strict=True):
        height = max(float(force @ patch.normal) * scale, 0.15 * scene.unit)
        height = min(height, scene.unit / max(patch.friction, 1e-9))
        rim = toe + height * patch.normal + height * patch.friction * CIRCLE @ patch.frame[:, 1:].T
        painter.veil(np.vstack([toe, rim]), ACCENT, 0.07, 0.30)
        painter.veil(rim, ACCENT, 0.07, 0.50)
        painter.arrow(toe, scale * force, ACCENT, thickness)
    weight = -scale * scene.problem.weight_n * UP
    painter.arrow(scene.com, weight, INK, thickness)
    painter.label(scene.com + weight, f"{scene.problem.weight_n:.1f} N", INK)


def name_legs(painter: Painter, scene: Scene) -> None:
    """The limb's name at its toe, with its force; without a posture at its patch, and a line from its shoulder."""
    for k, contact in enumerate(scene.problem.contacts):
        if scene.posture is None:
            line = np.linspace(scene.shoulders[k], contact.patch.centre_m, 26)
            painter.dashes(line, leg_colour(k), ROBOT, width=1.6)
            painter.ball(scene.shoulders[k], 0.05 * scene.unit, leg_colour(k), ROBOT, RIM)
            painter.label(contact.patch.centre_m, contact.leg, leg_colour(k))
        else:
            newtons = float(np.linalg.norm(scene.posture.forces_n[k]))
            painter.label(scene.posture.toes_m[k], f"{contact.leg} {newtons:.0f} N", leg_colour(k))


def _draw_com(painter: Painter, scene: Scene) -> None:
    """The ball that the centre of mass may move in."""
    outline = scene.problem.com_nominal_m + scene.problem.com_radius_m * CIRCLE @ painter.axes[:2]
    painter.face(outline, (*rgb(INK), 0.04), FORCE, depth=-9.0)
    painter.dashes(outline, (*rgb(INK), 0.5), FORCE, width=1.0, depth=-9.0)
