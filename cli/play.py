"""``stancekit play``: a question on a page, dragged and planned anew."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from stancekit.planners.errors import InvalidInput

from .console import out
from .options import OptionalInt, OptionalText, check_unused
from .solve import Between

if TYPE_CHECKING:
    from stancekit.views.playground.scenario import Scenario


@dataclass
class Play:
    """Play with a course on a page: drag goal and walls, slide friction and mass, and see the plan.

    COURSE is a built-in one (stairs, walls, icy-walls, tube, ground-to-wall), FAMILY:LEVEL:SEED, a
    YAML or JSON file, or with --start and --goal a terrain's file, as for `stancekit plan`.

      stancekit play walls
      stancekit play my-course.yaml --robot hexapod,go1.urdf
      stancekit play rubble.stl --start 0,0 --goal 2,0.5

    The page shows at once a plan whose contacts hold: forces in their cones, torques, what every
    limit has in hand, or the sentence that says why there is none and by how much a limit is
    missed. Once nothing is changed any more the plan is judged as by `stancekit plan`, joints and
    bodies, too: the page says which of the two it shows. Plan and course are saved in the formats
    of the other commands. All tabs show the same scene. Ctrl-C ends.
    """

    course: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="COURSE")]
    """Built-in name, FAMILY:LEVEL:SEED, YAML or JSON file, the proof of a course, or a terrain's
    file."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="FILE|NAME[,FILE|NAME…]")] = None
    """Robots of the page's menu with commas between them, built-in names or .urdf or .yaml files
    (extra robots); it begins with the first one."""
    frames: OptionalInt = None
    """Number of key frames to begin with, where not the course's own."""
    between: Annotated[Between, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="")] = field(
        default_factory=Between
    )
    """From where to where over a terrain's file."""
    folder: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path()
    """Where the page saves."""
    host: str = "127.0.0.1"
    """Address to listen at. Whoever can reach it can change the scene and save into the folder."""
    port: int = 8080
    """Port to listen at; 0 takes a free one."""
    browser: bool = True
    """Open the page in a browser, where there is a desktop; --no-browser does not."""

    def run(self) -> int:
        """Serve until Ctrl-C."""
        from stancekit.views.playground.serving import check_port, served

        self._check()
        check_unused(self.between, ("map",), "play")
        check_port(self.host, self.port)
        robots = tuple(filter(None, (self.robot or "").split(",")))
        scenario = self._scenario(robots[0] if robots else None)
        with served(
            scenario, robots=robots, folder=self.folder, host=self.host, port=self.port
        ) as page:
            out.print(f"{page.address} shows {self.course}; Ctrl-C ends", highlight=False)
            if self.browser:
                page.open_browser()
            page.wait()
        return 0

    def _scenario(self, robot: str | None) -> Scenario:
        """Scenario that the page begins with.

        Raises InvalidInput.
        """
        from stancekit import Problem, load, robot as robot_of
        from stancekit.planners.problem.course_between import LaidBetween
        from stancekit.planners.terrain.import_options import SUFFIXES
        from stancekit.views.playground.scenario import Scenario

        suffix = Path(self.course).suffix.lower()
        if suffix in SUFFIXES and self.between.start is not None and self.between.goal is not None:
            start, goal = (tuple(each.tolist()) for each in self.between.places())
            name = robot or "hexapod"
            question = LaidBetween(
                terrain=self.between.terrain(self.course),
                start_m=start,
                goal_m=goal,
                robot=robot_of(name),
                frames=self.frames,
            )
            return Scenario.about(question, name)
        if suffix == ".json":
            with suppress(InvalidInput):  # what is no proof is read as a course
                proof = getattr(load(self.course), "refuted", None)
                if isinstance(proof, Problem):
                    return Scenario.about(proof)
        if suffix in SUFFIXES or suffix == ".json" or self.between != Between():
            return Scenario.about(self.between.course(self.course, self.frames, robot))
        return Scenario.of(self.course, robot, self.frames)

    def _check(self) -> None:
        from stancekit.planners.files.arrays import checked_int

        checked_int(self.port, "--port", least=0, most=65535)
        if not self.folder.is_dir():
            raise InvalidInput(f"--folder: expected a folder, got {self.folder}")
