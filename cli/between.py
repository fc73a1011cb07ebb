"""A course from a terrain's file and two places, as ``stancekit plan`` takes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from stancekit.planners.errors import InvalidInput

from .gait_options import place
from .options import OptionalFloat, OptionalPath, OptionalText
from .terrain_options import OF_FILE, FootholdOptions, TerrainFile, in_options

if TYPE_CHECKING:
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.problem.course import Course
    from stancekit.planners.problem.file_terrain import FileTerrain
    from stancekit.planners.robot.contact_robot import Sets


@dataclass
class Between:
    """From where to where."""

    start: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """Of a terrain's file: where the robot begins [m]. Frames, gait and candidates are laid out from there to the goal,
    the robot facing along x."""
    goal: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """Of a terrain's file: where its centre of mass is to end [m]."""
    friction: OptionalFloat = None
    """Friction coefficient of a terrain's file; 0.8 unless given. A course has its own, in its file."""
    file: Annotated[TerrainFile, *OF_FILE] = field(default_factory=TerrainFile)
    """What the numbers of a terrain's file mean."""
    footholds: Annotated[FootholdOptions, tyro.conf.OmitArgPrefixes] = field(default_factory=FootholdOptions)
    """What counts as a foothold."""

    def course(
        self, name: str, frames: int | None, robot: str | None, sets: Sets = "inner", reach: OptionalPath = None
    ) -> Course:
        """The course of a file or a name, or over a terrain's file from start to goal. Raises InvalidInput."""
        from stancekit.planners.problem.course_file import read_course
        from stancekit.planners.terrain.import_options import SUFFIXES

        if self.start is None and self.goal is None:
            if Path(name).suffix.lower() in SUFFIXES:
                raise InvalidInput(f"--start: expected --start X,Y and --goal X,Y with the terrain {name}, got none")
            self._check_unused(name)
            return read_course(name, frames, robot, sets, reach)
        if self.start is None or self.goal is None:
            raise InvalidInput("--start: expected --start X,Y and --goal X,Y together, got one of them")
        if Path(name).suffix.lower() not in SUFFIXES:
            raise InvalidInput(f"--start: expected a terrain's file with it, {', '.join(SUFFIXES)}, got {name}")
        return self._laid_out(name, frames, robot, sets, reach)

    def _check_unused(self, name: str) -> None:
        """Raise InvalidInput for what only a terrain's file has a use for."""
        for of, plain in ((self, Between()), (self.file, TerrainFile()), (self.footholds, FootholdOptions())):
            for key, value in vars(plain).items():
                if not hasattr(value, "__dataclass_fields__") and getattr(of, key) != value:
                    said = f"--{key.replace('_', '-')}: expected a terrain's file with it, got {name}"
                    raise InvalidInput(said + (_where_friction_is(name) if key == "friction" else ""))

    def _laid_out(self, name: str, frames: int | None, robot: str | None, sets: Sets, reach: OptionalPath) -> Course:
        from stancekit.planners.problem.course_between import course_between
        from stancekit.planners.problem.course_layout import build_course

        start, goal = self.places()
        terrain = self.terrain(name, robot)
        given = None if robot is None else str(Path(robot).resolve()) if Path(robot).suffix else robot
        with in_options():
            try:
                spec = course_between(terrain, start.tolist(), goal.tolist(), robot=given, frames=frames)
                return build_course(spec, sets=sets, reach=reach)
            except InvalidInput as error:
                text = str(error)
                raise InvalidInput(f"--{text}" if text.startswith(("start:", "goal:")) else text) from None

    def places(self) -> tuple[Array, Array]:
        """Start and goal, shape (2,) [m]. Raises InvalidInput."""
        import numpy as np

        assert self.start is not None
        assert self.goal is not None
        start, goal = place(self.start, "--start"), place(self.goal, "--goal")
        if not (np.all(np.isfinite(start)) and np.all(np.isfinite(goal))):
            raise InvalidInput(f"--start, --goal: expected finite places, got {self.start} and {self.goal}")
        return start, goal

    def terrain(self, name: str, robot: str | None) -> FileTerrain:
        """The terrain's file, with footholds for the feet of a robot. Raises InvalidInput."""
        from dataclasses import asdict

        import numpy as np

        from stancekit.planners.problem.file_terrain import FileTerrain, FootholdKeys
        from stancekit.planners.robot.robot_file import named_robot

        if self.friction is not None and not 0.0 <= self.friction < np.inf:
            raise InvalidInput(f"--friction: expected a number from 0 on, got {self.friction:g}")
        model = None if robot in (None, "hexapod") else named_robot(str(robot))
        keys = asdict(self.file.options())
        return FileTerrain(
            file=str(Path(name).resolve()), footholds=FootholdKeys(**asdict(self.footholds.limits(model))),
            friction=0.8 if self.friction is None else self.friction,
            **{**keys, "kind": keys["kind"] or "file"},
        )  # fmt: skip


def _where_friction_is(name: str) -> str:
    """Of a course that comes with the package: which file to copy."""
    from stancekit.planners.problem.course_file import builtin_courses

    if name not in builtin_courses():
        return "; a course has its friction in its file" if name.endswith((".yaml", ".yml")) else ""
    path = resources.files("stancekit.configs.courses") / f"{name}.yaml"
    return f"; its own friction is in its file: copy {path}, change it, and plan the copy"
