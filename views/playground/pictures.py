"""Pictures of a scene and of the answer to it, in parts that change on their own."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from typing import Any

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import cached_property
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import feet_motion
from stancekit.planners.problem import Problem
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Robot

from ..gaits import CELLS, GRID, GRID_M, GaitView
from ..page import GOAL
from ..plans import PlanView, asked, ghosts
from ..robots import RobotShape, climber
from ..scene import DrawnBody, Label, Path as Line, Scene
from ..shapes import Sphere
from ..sheet import INK, friction_colours, leg_colour
from ..terrain import Piece, block, grid_on_ground, on_ground, pieces_within, surfaces
from .answers import SceneAnswer
from .page_parts import (
    LimbLoad,
    cone_share,
    from_behind,
    key_values,
    loads,
    solver_of,
    summary,
    verdict,
    verdict_of_walk,
)
from .scenario import Scenario, WalkScenario

_STEP_M = 0.25
_AROUND_M = 0.75
"""Terrain is shown so far beyond the nominal path, at least."""
_WAY = "#73808d"
"""Colour of what is in ink on paper: a page is white or nearly black."""


class Pictures:
    """Draws courses and plans; what does not change from one to the next is kept."""

    tab, unit = "Plan", "key frame"

    def __init__(self) -> None:
        self._solver: tuple[Hashable, Kinematics | None] | None = None
        self._shape: tuple[Hashable, RobotShape] | None = None
        self._ground: tuple[Hashable, Scene] | None = None
        self._pieces: tuple[Hashable, list[Piece]] | None = None

    def shape(self, robot: Robot) -> RobotShape:
        """Shape of a robot."""
        key = (robot.name, robot.identity, tuple((each.name, each.reach_m) for each in robot.limbs))
        if self._shape is None or self._shape[0] != key:
            self._shape = (key, climber(robot))
        return self._shape[1]

    def view(self, plan: Plan) -> PlanView:
        """A plan as something to look at."""
        return PlanView(plan, drawn_as=self.shape(plan.problem.robot))

    def camera(self, course: Problem, answer: SceneAnswer) -> tuple[Array, float, Array]:
        """The first view of a course: where it looks, from how far [m], and in what direction."""
        path = course.com_nominal_m
        reach = max(limb.reach_m for limb in course.robot.limbs)
        away_m = 2.0 * (float(np.linalg.norm(np.ptp(path, axis=0))) + 2.0 * reach)
        towards = np.array([-0.75, -0.45, 0.35])
        if isinstance(answer.plan, Plan):
            towards = self.view(answer.plan).camera.axes[2]
        return path.mean(axis=0), away_m, from_behind(towards, path[0], course.goal_m)

    def shown(self, before: SceneAnswer, answer: SceneAnswer, at: float) -> tuple[float, float]:
        """Key frame that is shown with another answer, and the last one; an end is followed."""
        course, earlier = answer.course, before.course
        last = float(course.frames - 1) if isinstance(course, Problem) else 0.0
        stays = isinstance(earlier, Problem) and at < earlier.frames - 1.001
        return at if stays else last, last

    def ground(self, course: Problem) -> Scene:
        """The surfaces about the path, in the tints of their friction."""
        box = bounds_m(course)
        places = (
            box.tobytes(),
            *((patch.vertices_m.tobytes(), patch.normal.tobytes()) for patch in course.terrain),
        )
        frictions = [patch.friction for patch in course.terrain]
        if self._pieces is None or self._pieces[0] != places:
            self._pieces = (places, pieces_within(course.terrain, box))
        key = (places, *frictions)
        if self._ground is None or self._ground[0] != key:
            colours = friction_colours(frictions)
            self._ground = (key, surfaces(course.terrain, self._pieces[1], colours))
        return self._ground[1]

    def asked(self, _scenario: Scenario, answer: SceneAnswer) -> Scene:
        """Without a plan: where the body was asked to go, and what is lacking."""
        course = answer.course
        if not isinstance(course, Problem):
            return Scene()
        return asked(course, self.shape(course.robot), answer.lack)

    def found(self, view: PlanView) -> Scene:
        """The way of a plan, the tracks of its toes, and its robot at some key frames in thin
        lines.
        """
        scene = _between(view.way) + view.tracks
        for k in ghosts(view.plan, view.plan.problem.frames - 1):
            ghost = view.ghost(view.key(k))
            scene += Scene(paths=ghost.paths)
        return scene

    def moment(self, view: PlanView, at: float) -> tuple[Scene, Scene, list[LimbLoad], str]:
        """The robot and its forces in their cones at a key frame or between two, what they are
        called, in N, what its limbs give, and what moment that is.
        """
        frame = round(at)
        rests = abs(at - frame) < 0.01
        now = view.key(frame) if rests else view.between_keys(at)
        title = f"key frame {frame} of {view.plan.problem.frames - 1}"
        if not rests:
            title = f"between key frames {int(at)} and {int(at) + 1}"
        names = [each for each in view.names(now).labels if each.name != "goal"]  # its grip has it
        limbs = loads(view.plan, now, self._legs(view.plan.problem))
        return view.moving(now), Scene(labels=names), limbs, title

    def _legs(self, course: Problem) -> Kinematics | None:
        """The solver for the robot, made once."""
        robot = course.robot
        key = (robot.name, robot.identity, robot.mass_kg, robot.limb_names, course.gravity_m_s2)
        if self._solver is None or self._solver[0] != key:
            self._solver = (key, solver_of(course))
        return self._solver[1]

    def summary(self, answer: SceneAnswer) -> str:
        """The plan in a few numbers, as HTML."""
        return summary(answer)

    def verdict(self, answer: SceneAnswer, number: int, drawn_ms: float) -> str:
        """The verdict as HTML."""
        return verdict(answer, number, drawn_ms)


def _between(scene: Scene) -> Scene:
    """The scene with everything that is drawn in the ink colour drawn in the colour of ways
    instead.
    """
    bodies = [replace(each, colour=_WAY) if each.colour == INK else each for each in scene.bodies]
    paths = [replace(each, colour=_WAY) if each.colour == INK else each for each in scene.paths]
    return replace(scene, bodies=bodies, paths=paths)


def bounds_m(course: Problem) -> Array:
    """Lowest and highest corner of what is shown, shape (2, 3) [m]: about the path, as far as limbs
    reach, in steps.
    """
    reach = max(
        limb.reach_m + float(np.linalg.norm(limb.shoulder_m)) for limb in course.robot.limbs
    )
    around = max(_AROUND_M, 1.2 * reach)
    com = np.vstack([course.com_nominal_m, course.goal_m[None]])
    low, high = com.min(axis=0) - around, com.max(axis=0) + around
    return _STEP_M * np.array([np.floor(low / _STEP_M), np.ceil(high / _STEP_M)])


class WalkPictures:
    """Draws a terrain with a way over it, and walks, as ``Pictures`` does courses."""

    tab, unit = "Walk", "time [s]"

    def __init__(self, scenario: WalkScenario) -> None:
        self._first = scenario

    def camera(self, *_: Any) -> tuple[Array, float, Array]:
        """The first view of a walk."""
        walk = self._first
        start, goal = map(np.array, (walk.start_m, walk.goal_m))
        away_m = 2.2 * (float(np.hypot(*(start - goal))) + 3.0 * walk.walker.stand_height_m)
        middle = 0.5 * (walk.torso_m(walk.start_m) + walk.torso_m(walk.goal_m))
        return middle, away_m, from_behind(np.array([-0.45, -0.75, 0.5]), start, goal)

    def shown(self, _: Any, answer: SceneAnswer, at: float) -> tuple[float, float]:
        """A walk is shown from its beginning."""
        duration_s = getattr(answer.plan, "duration_s", 0.0)
        return 0.0, duration_s

    def view(self, trajectory: Trajectory) -> GaitView:
        """A walk as something to look at."""
        return GaitView(trajectory, moves_as=feet_motion(trajectory))

    def ground(self, _: Any) -> Scene:
        """All of the terrain, with lines of constant x and y, ``GRID_M`` apart."""
        return self._ground

    @cached_property
    def _ground(self) -> Scene:
        field, size_m = self._first.terrain, self._first.walker.stand_height_m
        low, high = np.array(field.domain_m).T
        sheets = block(
            field, low, high, facets=2 * CELLS, depth_m=0.25 * size_m, relief_m=0.5 * size_m
        )
        lines = grid_on_ground(field, low, high, GRID_M, 8 * CELLS)
        grid = Line(pieces_m=lines, colour=GRID, opacity=0.35, width=0.35, lift_m=0.006)
        return Scene(sheets=sheets, paths=[grid])

    def asked(self, scenario: WalkScenario, _: SceneAnswer) -> Scene:
        """A straight line on the ground from start to goal, and the goal."""
        line = np.linspace(scenario.start_m, scenario.goal_m, 81)
        low, high = np.array(scenario.terrain.domain_m).T
        laid = on_ground(np.column_stack([line, 0.0 * line[:, :1]]), scenario.terrain, low, high)
        ball = DrawnBody(
            name="goal",
            shape=Sphere(0.06 * scenario.walker.stand_height_m),
            position_m=scenario.torso_m(scenario.goal_m),
            colour=GOAL,
        )
        way = Line(pieces_m=laid[::2], colour=INK, width=2.0, lift_m=0.01)
        return Scene(paths=[way], bodies=[ball])

    def found(self, view: GaitView) -> Scene:
        """The ways of a walk."""
        return Scene(paths=view.fixed.paths[1:])

    def moment(self, view: GaitView, at: float) -> tuple[Scene, Scene, list[LimbLoad], str]:
        """The robot at a time, the contact forces on its feet in words, and as loads."""
        trajectory, now = view.trajectory, view.now(at)
        rows, labels = list[LimbLoad](), list[Label]()
        for k, limb in enumerate(view.shape.limbs):
            down, force_n = bool(now.stands[k]), now.forces_n[k]
            share, size_n = float("nan"), float(np.linalg.norm(force_n))
            if down:
                share = cone_share(force_n, now.normals[k], trajectory.friction)
                text, place = f"{limb} {size_n:.0f} N", now.toes_m[k]
                labels.append(Label(name=limb, position_m=place, text=text, colour=leg_colour(k)))
            rows.append(LimbLoad(name=limb, force_n=size_n, cone=share, in_air=not down))
        title = f"{at:.2f} s of {trajectory.duration_s:g} s"
        return view.moment(at), Scene(labels=labels), rows, title

    def summary(self, answer: SceneAnswer) -> str:
        """The walk in a few numbers, as HTML; empty without one."""
        walk = answer.plan
        if not isinstance(walk, Trajectory):
            return ""
        length = float(np.linalg.norm(np.diff(walk.torso_m, axis=0), axis=1).sum())
        rows = [
            ("robot", f"{walk.robot.name}, {walk.robot.mass_kg:.3g} kg"),
            ("way", f"{length:.2f} m in {walk.duration_s:g} s"),
            ("chart", str(walk.provenance.get("chart", "–"))),
        ]
        return key_values(rows)

    def verdict(self, answer: SceneAnswer, number: int, _: float) -> str:
        """The verdict as HTML."""
        return verdict_of_walk(answer, number)
