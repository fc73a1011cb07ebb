"""The picture of a plan: terrain, chosen patches, the robot at a key frame with its forces, and its way to the goal."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb as rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stancekit.planners.answer.outcome import Posture
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable
from stancekit.planners.problem import Contact, PostureProblem
from stancekit.planners.terrain import Patch

from . import plot as chart
from .painter import CIRCLE, FORCE, ROBOT, Painter
from .plan_legend import draw_legend
from .plan_motion import Moment, PlanMotion
from .plan_terrain import Piece, bounds, draw_terrain, draw_windows, pieces
from .plot import ACCENT, DEFAULT_STYLE, INK, SIZE_PX, Size, leg_colour
from .posture_picture import Scene, arrow_scale, draw_body, draw_legs, name_legs

__all__ = ["PlanStage", "check_picture", "draw_plan", "frame_count", "plan_frames"]

GOAL = "#e8a317"
GHOSTS = 3
"""Most key frames that are shown beside the one in full."""
LONGEST = 0.6
"""Length of the arrow of the largest force, in units of the mean reach."""
VIDEO_PX = (960, 720)
FPS, STEP_S, HOLD_S = 20.0, 1.2, 0.5
"""Of videos: pictures a second, seconds from key frame to key frame, and at the first and the last."""


@DEFAULT_STYLE
def draw_plan(
    plan: Plan, *, frame: int | None = None, caption: str = "", note: str = "", size_px: Size | None = None
) -> Figure:
    """Draw a plan over its course.

    frame: the key frame at which the robot is drawn in full, with its contact forces in their friction cones; the last
    one unless another is named. Some of the others are ghosts. Surfaces are in tints of their friction, icy ones in
    pale blue with glints, and those between the viewer and the robot are glass; the patches that the plan chose are
    framed in the colour of their limb. caption, note: title, and what the line below it says first. size_px: width and
    height; as high as the scene asks for at the usual width where it is None.
    Raises InvalidInput for a frame that there is not.
    """
    frames = plan.course.frames
    shown = frames - 1 if frame is None else frame
    if not 0 <= shown < frames:
        raise InvalidInput(f"frame: expected 0 to {frames - 1}, got {shown}")
    stage = PlanStage(plan)
    painter = stage.painter()
    moment = stage.motion.key(shown)
    stage.draw_ground(painter, shown)
    for k in ghosts(plan, shown):
        stage.draw_ghost(painter, stage.motion.key(k))
    stage.draw_tracks(painter)
    stage.draw_robot(painter, moment)
    stage.draw_path(painter)
    painter.label(plan.course.goal_m, "goal", GOAL)
    name_legs(painter, stage.scene(moment))
    fitted = _fitted(painter)
    figure = chart.sheet(size_px or fitted, fitted)
    scale = painter.paint(chart.plain_axes(figure, 24.0, 70.0, 92.0))
    arrow = arrow_scale(scale / stage.metres_a_newton, 120.0)
    draw_legend(figure, plan.course, stage.friction, arrow)
    chart.headline(figure, caption or f"{plan.course.name}: {frames} key frames", _note(plan, shown, note))
    return figure


def check_picture(path: str | Path) -> Path:
    """The file behind the name of a picture, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end as pictures do, and where nothing can be written.
    """
    if Path(path).suffix.lower() not in chart.UNDATED:
        ends = ", ".join(chart.UNDATED)
        raise InvalidInput(f"{path}: expected a name that ends in {ends}, got {Path(path).suffix or 'no suffix'}")
    return check_writable(path)


def frame_count(plan: Plan) -> int:
    """Pictures of a video of the plan."""
    return round(FPS * (STEP_S * (plan.course.frames - 1) + 2.0 * HOLD_S)) + 1


def plan_frames(plan: Plan, *, size_px: Size = VIDEO_PX) -> Iterator[NDArray[np.uint8]]:
    """The pictures of a video of the plan, uint8 of shape (H, W, 3), one by one, ``FPS`` a second.

    It stays ``HOLD_S`` at the first and the last key frame and takes ``STEP_S`` from one to the next.
    """
    stage = PlanStage(plan)
    kept: tuple[float, NDArray[np.uint8]] | None = None
    for index in range(frame_count(plan)):
        time = min(max(index / FPS - HOLD_S, 0.0) / STEP_S, stage.motion.end)
        if kept is None or kept[0] != time:
            kept = (time, stage.picture(time, size_px))
        yield kept[1]


def ghosts(plan: Plan, shown: int) -> list[int]:
    """Key frames to show beside one, evenly spread and the first among them."""
    others = np.linspace(0, plan.course.frames - 1, GHOSTS + 1).round().astype(int).tolist()
    return sorted(set(others) - {shown})[:GHOSTS]


class PlanStage:
    """A plan with the viewpoint and the colours of its pictures."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.motion = PlanMotion(plan)
        terrain = plan.course.terrain or tuple(put.candidates[0] for put in plan.course.placements)
        self.friction = chart.friction_colours([patch.friction for patch in terrain])
        self.size = float(np.mean([limb.reach_m for limb in plan.course.robot.limbs]))

    @cached_property
    def viewpoint(self) -> tuple[Array, float, float, float]:
        """Target, azimuth, elevation and distance: chosen patches show their faces, and the way is seen from aside."""
        plan = self.plan
        box = bounds(plan)
        target = box.mean(axis=0)
        away_m = max(4.5 * self.size, 1.25 * float(np.linalg.norm(box[1] - box[0])))
        chosen = [plan.course.patch(p, plan.choice) for p in range(len(plan.course.placements))]
        way = plan.com_m[-1] - plan.com_m[0]

        def merit(painter: Painter) -> float:
            faces = [painter.facing(patch.centre_m, patch.normal) for patch in chosen]
            xy, _ = painter.project(np.array([plan.com_m[0], plan.com_m[0] + way]))
            seen = (xy[1] - xy[0]) / max(float(np.linalg.norm(way)), 1e-9)
            return float(
                np.mean(np.clip(faces, -0.15, 0.15)) + 0.10 * abs(seen[0]) + 0.05 * seen[0] + 0.10 * abs(seen[1])
            )

        angles = product(np.deg2rad(np.arange(-180.0, 180.0, 7.5)), np.deg2rad([18.0, 25.0]))
        _, azimuth, elevation = max((merit(Painter(target, *angle, away_m)), *angle) for angle in angles)
        return target, float(azimuth), float(elevation), away_m

    def painter(self) -> Painter:
        """A painter at the viewpoint."""
        return Painter(*self.viewpoint)

    def scene(self, moment: Moment) -> Scene:
        """The robot at a moment as the picture of a posture knows it, with all its limbs."""
        course = self.plan.course
        limbs = range(len(course.robot.limbs))
        contacts = tuple(
            Contact(
                leg=course.robot.limbs[i].name, shoulder_m=course.robot.limbs[i].shoulder_m,
                reach_m=course.robot.limbs[i].reach_m,
                patch=course.patch(int(course.holds[moment.frame, i]), self.plan.choice),
                force_min=course.force_min, force_max=course.force_max,
            )
            for i in limbs
        )  # fmt: skip
        problem = PostureProblem(
            contacts=contacts, mass_kg=course.robot.mass_kg, com_nominal_m=moment.com_m, com_radius_m=0.0,
            gravity_m_s2=course.gravity_m_s2,
        )  # fmt: skip
        posture = Posture(
            com_m=moment.com_m, rotation_rad=moment.rotation_rad, toes_m=moment.toes_m, forces_n=moment.forces_n
        )
        return Scene(problem=problem, posture=posture)

    def draw_ground(self, painter: Painter, frame: int) -> None:
        """Terrain, and the patches that the plan chose."""
        draw_terrain(painter, self._terrain, self.plan.com_m.mean(axis=0), self.friction)
        draw_windows(painter, self.plan, self.friction, frame)

    def draw_robot(self, painter: Painter, moment: Moment) -> None:
        """Body and limbs, and the forces of those that carry in their cones."""
        draw_body(painter, self.scene(moment))
        draw_legs(painter, self.scene(moment))
        for i, (toe, force) in enumerate(zip(moment.toes_m, moment.forces_n, strict=True)):
            placement = int(self.plan.course.holds[moment.frame, i])
            self._draw_force(painter, self.plan.course.patch(placement, self.plan.choice), toe, force)

    def _draw_force(self, painter: Painter, patch: Patch, toe: Array, force: Array) -> None:
        """A contact force in its cone, which is as high as the normal force; nothing for a limb that does not carry."""
        height = float(force @ patch.normal) * self.metres_a_newton
        if height <= 0.0:
            return
        wide = min(patch.friction, 1.2 * self.size / height)
        rim = toe + height * (patch.normal + wide * CIRCLE @ patch.frame[:, 1:].T)
        painter.veil(np.vstack([toe, rim]), ACCENT, 0.08, 0.30)
        painter.veil(rim, ACCENT, 0.08, 0.50)
        painter.arrow(toe, self.metres_a_newton * force, ACCENT, 0.016 * self.size)

    @cached_property
    def _terrain(self) -> list[Piece]:
        return pieces(self.plan)

    @cached_property
    def _room(self) -> Array:
        """Points as far out as the robot gets at any time, shape (K, 3)."""
        moments = [self.motion.at(0.25 * quarter) for quarter in range(4 * self.plan.course.frames - 3)]
        scenes = [self.scene(moment) for moment in moments]
        tips = [moment.toes_m + self.metres_a_newton * moment.forces_n for moment in moments]
        return np.concatenate([*tips, *(part for scene in scenes for part in (scene.body(1.0, 0.0), *scene.legs()))])

    @cached_property
    def metres_a_newton(self) -> float:
        """The largest force of the plan is an arrow of so much of the robot's size."""
        return LONGEST * self.size / max(float(np.linalg.norm(self.plan.forces_n, axis=2).max()), 1e-9)

    def draw_ghost(self, painter: Painter, moment: Moment) -> None:
        """Body and limbs as a drawing in thin lines."""
        scene = self.scene(moment)
        painter.face(scene.body(0.97, 0.0), (0.40, 0.50, 0.60, 0.16), ROBOT, edge=(0.36, 0.42, 0.48, 0.75), width=1.0)
        for joints in scene.legs():
            for pair in pairwise(joints):
                painter.face(np.array(pair), "none", ROBOT, edge=(0.36, 0.42, 0.48, 0.5), width=1.6)

    def draw_tracks(self, painter: Painter) -> None:
        """The way of every toe from placement to placement, dotted."""
        course = self.plan.course
        for p, put in enumerate(course.placements):
            if put.frame:
                line = np.array([self.motion.swing(p, part) for part in np.linspace(0.0, 1.0, 26)])
                colour = leg_colour(course.robot.limb_names.index(put.limb))
                painter.dashes(line, (*rgb(colour), 0.55), ROBOT, width=1.0)

    def draw_path(self, painter: Painter) -> None:
        """The way of the centre of mass with a dot at every key frame, and the goal."""
        com, disc = self.plan.com_m, CIRCLE @ painter.axes[:2]
        for colour, width, rank in (("white", 4.0, 50.0), (INK, 1.8, 60.0)):
            for pair in pairwise(com):
                painter.face(np.array(pair), "none", FORCE, edge=colour, width=width, depth=rank)
        for at in com:
            painter.face(at + 0.022 * self.size * disc, INK, FORCE, edge="white", width=1.0, depth=70.0)
        goal = self.plan.course.goal_m
        spikes = 0.11 * self.size * np.where(np.arange(10) % 2 == 0, 1.0, 0.42)[:, None]
        turn = np.pi / 5.0 * np.arange(10)
        star = goal + spikes * np.column_stack([np.sin(turn), np.cos(turn)]) @ painter.axes[:2]
        painter.face(star, GOAL, FORCE, edge="white", width=1.4, depth=80.0)

    @DEFAULT_STYLE
    def picture(self, time: float, size_px: Size) -> NDArray[np.uint8]:
        """The pixels of one moment of a video."""
        figure = chart.sheet(size_px)
        painter = self.painter()
        moment = self.motion.at(time)
        painter.face(self._room, "none", ROBOT)  # nothing to see, but all pictures of a video show the same room
        self.draw_ground(painter, moment.frame)
        self.draw_robot(painter, moment)
        self.draw_path(painter)
        painter.paint(chart.plain_axes(figure, 10.0, 10.0, 92.0))
        chart.headline(figure, self.plan.course.name, f"key frame {moment.frame} of {self.plan.course.frames - 1}")
        return chart.to_rgb(figure)


def _note(plan: Plan, shown: int, note: str) -> str:
    to_goal_mm = 1e3 * float(np.linalg.norm(plan.com_m[-1] - plan.course.goal_m))
    parts = [note] if note else []
    parts += [
        f"the robot at key frame {shown} of {plan.course.frames - 1}",
        f"{to_goal_mm:.0f} mm from goal at the end",
    ]
    return "   ·   ".join(parts)


def _fitted(painter: Painter) -> Size:
    """The usual width, and the height that the scene then fills."""
    low, high = painter.frame()
    across, up = high - low
    return SIZE_PX[0], int(np.clip((SIZE_PX[0] - 48.0) * up / across + 162.0, 560.0, 1100.0))
