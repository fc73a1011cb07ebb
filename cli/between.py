"""A course from a terrain's file and two places, as ``stancekit plan`` takes it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput

from .gait_options import place
from .options import OptionalFloat, OptionalPath, OptionalText
from .terrain_options import OF_FILE, FootholdOptions, TerrainFile, in_options

if TYPE_CHECKING:
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.problem import Problem
    from stancekit.planners.problem.file_terrain import FileTerrain
    from stancekit.planners.robot.model import Robot
    from stancekit.planners.terrain.footholds import Footholds


@dataclass
class Between:
    """The places between which a course is laid out."""

    start: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """On a terrain's file or name: where the robot begins [m]. Frames, gait and candidates are laid
    out from there to the goal, the robot facing along x."""
    goal: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """On a terrain's file or name: where its centre of mass is to end [m]."""
    friction: OptionalFloat = None
    """Friction coefficient of a terrain's file; 0.8 unless given. A course has its own, in its
    file."""
    map: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.npz")] = None
    """File of `stancekit map`, with a terrain's file or name: the way keeps off places where it is
    proved that the robot cannot stand, facing along x, and costs more where that is likely."""
    file: Annotated[TerrainFile, *OF_FILE] = field(default_factory=TerrainFile)
    """What the numbers of a terrain's file mean."""
    footholds: Annotated[FootholdOptions, tyro.conf.OmitArgPrefixes] = field(
        default_factory=FootholdOptions
    )
    """What counts as a foothold."""

    def question(
        self, name: str, frames: int | None, robot: str | None, reach: Path | None
    ) -> Footholds | Problem | str:
        """Course as ``stancekit.plan`` takes it.

        Raises InvalidInput for options that do not go together.
        """
        from stancekit.planners.problem.course_file import read_course
        from stancekit.planners.terrain.import_options import SUFFIXES

        suffix = Path(name).suffix.lower()
        if self.start is None and self.goal is None:
            if suffix in SUFFIXES:
                raise InvalidInput(
                    f"--start: expected --start X,Y and --goal X,Y with the terrain {name}, got "
                    "none"
                )
            self._check_unused(name)
            return name if reach is None else read_course(name, frames, robot, reach=reach)
        if self.start is None or self.goal is None:
            raise InvalidInput(
                "--start: expected --start X,Y and --goal X,Y together, got one of them"
            )
        if suffix not in SUFFIXES:
            from stancekit.planners.terrain.reference import (
                names_ground,
            )  # splines are slow to import

            if not names_ground(name):
                known = f"{', '.join(SUFFIXES)}, or a ground by its name"
                raise InvalidInput(
                    f"--start: expected a terrain's file as COURSE, {known}, got {name}"
                )
        return self.found(name, robot)

    def asked(self, frames: int | None, robot: str | None, reach: Path | None) -> dict[str, Any]:
        """The arguments of ``stancekit.plan`` that say where, in how many frames and by whom."""
        if self.start is None or self.goal is None:
            return {} if reach is not None else {"frames": frames, "robot": robot}
        start, goal = (place.tolist() for place in self.places())
        who: Robot | str | None = robot
        if reach is not None:
            from stancekit.planners.robot.reach_file import read_reach
            from stancekit.planners.robot.robot_file import robot_of

            made = robot_of(robot or "hexapod")
            who = read_reach(reach, made.limb_names).applied(made)
        return {"frames": frames, "robot": who, "start_xy_m": start, "goal_xy_m": goal}

    def course(self, name: str, frames: int | None, robot: str | None) -> Problem:
        """The course of a file or a name, or over a terrain's file from start to goal.

        Raises InvalidInput.
        """
        from stancekit.planners.problem.alternatives import AS_ASKED
        from stancekit.planners.problem.course_between import laid_between
        from stancekit.planners.problem.course_file import read_course
        from stancekit.planners.terrain.footholds import Footholds

        with self.in_options():
            question = self.question(name, frames, robot, None)
            if not isinstance(question, Footholds):
                return read_course(name, frames, robot)
            start, goal = (place.tolist() for place in self.places())
            return laid_between(question, start, goal, robot=robot, frames=frames)(
                "inner", AS_ASKED
            )

    @contextmanager
    def in_options(self) -> Iterator[None]:
        """Let messages name places and the terrain's settings as the options that give them."""
        with in_options():
            try:
                yield
            except InvalidInput as error:
                text = str(error)
                text = f"--{text}" if text.startswith("frames:") else text
                text = text.replace("standing:", "--map:") if text.startswith("standing:") else text
                for name in ("start", "goal"):
                    text = (
                        text.replace(f"{name}_xy_m:", f"--{name}:")
                        if text.startswith(name)
                        else text
                    )
                raise InvalidInput(text) from None

    def _check_unused(self, name: str) -> None:
        """Raise InvalidInput for what only a terrain's file has a use for."""
        for of, plain in (
            (self, Between()),
            (self.file, TerrainFile()),
            (self.footholds, FootholdOptions()),
        ):
            for key, value in vars(plain).items():
                if not hasattr(value, "__dataclass_fields__") and getattr(of, key) != value:
                    message = f"--{key.replace('_', '-')}: expected a terrain's file as COURSE, got {name}"
                    raise InvalidInput(
                        message + (_where_friction_is(name) if key == "friction" else "")
                    )

    def places(self) -> tuple[Array, Array]:
        """Start and goal, shape (2,) [m].

        Raises InvalidInput.
        """
        import numpy as np

        assert self.start is not None
        assert self.goal is not None
        start, goal = place(self.start, "--start"), place(self.goal, "--goal")
        if not (np.all(np.isfinite(start)) and np.all(np.isfinite(goal))):
            raise InvalidInput(
                f"--start, --goal: expected finite places, got {self.start} and {self.goal}"
            )
        return start, goal

    def found(self, name: str, robot: str | None) -> Footholds:
        """The footholds of the terrain's file for the feet of a robot.

        Raises InvalidInput.
        """
        from stancekit.terrains import terrain

        friction, limits = self._friction(), self.footholds.limits()
        with in_options():
            return terrain(
                name, friction=friction, robot=robot, limits=limits, **vars(self.file.asked())
            )

    def terrain(self, name: str) -> FileTerrain:
        """The terrain's file as a description, whose footholds are found when they are asked
        for.
        """
        from stancekit.planners.problem.file_terrain import FileTerrain

        keys = vars(self.file.asked())
        return FileTerrain(
            file=str(Path(name).resolve()),
            footholds=self.footholds.limits(),
            friction=self._friction(),
            **{**keys, "kind": keys["kind"] or "file"},
        )

    def _friction(self) -> float:
        import math

        from stancekit.planners.terrain.footholds import FRICTION

        if self.friction is not None and not 0.0 <= self.friction < math.inf:
            raise InvalidInput(f"--friction: expected a number from 0 on, got {self.friction:g}")
        return FRICTION if self.friction is None else self.friction


def _where_friction_is(name: str) -> str:
    """Name the file to copy for a course that comes with the package."""
    from stancekit.planners.problem.course_file import builtin_courses

    if name not in builtin_courses():
        return "; a course has its friction in its file" if name.endswith((".yaml", ".yml")) else ""
    path = resources.files("stancekit.configs.courses") / f"{name}.yaml"
    return f"; its own friction is in its file: copy {path}, change it, and plan the copy"
