"""Pictures of a scene and of the answer to it, in parts that change on their own."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.problem import Problem
from stancekit.planners.robot.model import Robot

from ..page import GOAL
from ..plans import PlanView, ghosts
from ..robots import RobotShape, climber
from ..scene import DrawnBody, Label, Path, Scene
from ..shapes import Sphere, dashed
from ..sheet import ACCENT, INK, friction_colours
from ..terrain import Piece, pieces_within, surfaces

STEP_M = 0.25
AROUND_M = 0.75
"""Terrain is shown so far beyond the nominal path, at least."""
WAY = "#73808d"
"""Colour of what is in ink on paper: a page is white or nearly black."""


class Pictures:
    """Draws scenes; what does not change from one to the next is kept."""

    def __init__(self) -> None:
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

    def asked(self, course: Problem) -> Scene:
        """Without a plan: where the body was asked to go, from start to goal."""
        com, size = course.com_nominal_m, 0.02 * self.shape(course.robot).size_m
        line = dashed(np.concatenate([np.linspace(a, b, 9) for a, b in pairwise(com)] or [com]))
        marks = [
            DrawnBody(name=f"asked {k}", shape=Sphere(size), position_m=at, colour=ACCENT)
            for k, at in enumerate(com)
        ] + [
            DrawnBody(name="goal", shape=Sphere(3.0 * size), position_m=course.goal_m, colour=GOAL)
        ]
        words = Label(name="asked", position_m=com[0], text="asked for: no plan", colour=ACCENT)
        return Scene(
            paths=[Path(pieces_m=line, colour=ACCENT, width=2.0)], bodies=marks, labels=[words]
        )

    def found(self, view: PlanView) -> Scene:
        """The way of a plan, the tracks of its toes, and its robot at some key frames in thin
        lines.
        """
        scene = _between(view.way) + view.tracks
        for k in ghosts(view.plan, view.plan.problem.frames - 1):
            ghost = view.ghost(view.keys.key(k))
            scene += Scene(paths=ghost.paths)
        return scene

    def moment(self, view: PlanView, now: Samples) -> tuple[Scene, Scene]:
        """The robot and its forces in their cones; and what they are called, in N."""
        names = Scene(
            labels=[each for each in view.names(now).labels if each.name != "goal"]
        )  # its grip has it
        return view.moving(now), names


def _between(scene: Scene) -> Scene:
    """The scene with everything that is drawn in the ink colour drawn in the colour of ways
    instead.
    """
    bodies = [replace(each, colour=WAY) if each.colour == INK else each for each in scene.bodies]
    paths = [replace(each, colour=WAY) if each.colour == INK else each for each in scene.paths]
    return replace(scene, bodies=bodies, paths=paths)


def bounds_m(course: Problem) -> Array:
    """Lowest and highest corner of what is shown, shape (2, 3) [m]: about the path, as far as limbs
    reach, in steps.
    """
    reach = max(
        limb.reach_m + float(np.linalg.norm(limb.shoulder_m)) for limb in course.robot.limbs
    )
    around = max(AROUND_M, 1.2 * reach)
    com = np.vstack([course.com_nominal_m, course.goal_m[None]])
    low, high = com.min(axis=0) - around, com.max(axis=0) + around
    return STEP_M * np.array([np.floor(low / STEP_M), np.ceil(high / STEP_M)])
