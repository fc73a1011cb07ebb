"""``stancekit play``: a course on a page, dragged and planned anew."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from stancekit.planners.errors import InvalidInput

from .between import Between
from .console import out
from .options import OptionalInt

if TYPE_CHECKING:
    from stancekit.views.playground.scenario import Scenario


@dataclass
class Play:
    """Play with a course on a page: drag the goal, walls and surfaces, slide friction and mass, and see the plan.

    COURSE is a built-in one (stairs, walls, icy-walls, tube, ground-to-wall), FAMILY:LEVEL:SEED, a published scene, a
    YAML or JSON file, or with --start and --goal a terrain's file, as for `stancekit plan`.

      stancekit play walls
      stancekit play my-course.yaml --robot hexapod go1.urdf
      stancekit play rubble.stl --start 0,0 --goal 2,0.5

    The page shows at once a plan whose contacts hold: forces in their cones, torques, what every limit has in hand, or
    the sentence that says why there is none and by how much a limit is missed. Once nothing is changed any more the
    plan is judged as by `stancekit plan`, joints and bodies, too: the page says which of the two it shows. Plan and
    course are saved in the formats of the other commands. All tabs show the same scene. Ctrl-C ends.
    """

    course: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="COURSE")]
    """Built-in name, FAMILY:LEVEL:SEED, YAML or JSON file, or a terrain's file."""
    robot: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE|NAME ...")] = ()
    """Robots of the page's menu, built-in names or .urdf or .yaml files (extra kin); it begins with the first one."""
    frames: OptionalInt = None
    """Number of key frames to begin with, where not the course's own."""
    between: Annotated[Between, tyro.conf.OmitArgPrefixes] = field(default_factory=Between)
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
        check_port(self.host, self.port)
        scenario = self._scenario(self.robot[0] if self.robot else None)
        with served(scenario, robots=self.robot, folder=self.folder, host=self.host, port=self.port) as page:
            out.print(f"{page.address} shows {scenario.name}; Ctrl-C ends", highlight=False)
            if self.browser:
                page.open_browser()
            page.wait()
        return 0

    def _scenario(self, robot: str | None) -> Scenario:
        """What the page begins with. Raises InvalidInput."""
        from stancekit.planners.problem.course_file import described
        from stancekit.planners.terrain.terrain_file import SUFFIXES
        from stancekit.views.playground.between_scenario import BetweenScenario
        from stancekit.views.playground.fixed_scenario import FixedScenario
        from stancekit.views.playground.keys_scenario import KeysScenario

        suffix = Path(self.course).suffix.lower()
        if suffix in SUFFIXES and self.between.start is not None and self.between.goal is not None:
            (x, y), (x_goal, y_goal) = (each.tolist() for each in self.between.places())
            terrain = self.between.terrain(self.course, robot)
            return BetweenScenario(
                terrain=terrain, start_m=(x, y), goal_m=(x_goal, y_goal), robot=robot or "hexapod", frames=self.frames
            )
        if suffix in SUFFIXES or suffix == ".json" or self.between != Between() or "surfaces" in described(self.course):
            return FixedScenario(laid=self.between.course(self.course, self.frames, robot))
        return KeysScenario.of(self.course, robot, self.frames)

    def _check(self) -> None:
        if not 0 <= self.port <= 65535:
            raise InvalidInput(f"--port: expected 0 to 65535, got {self.port}")
        if not self.folder.is_dir():
            raise InvalidInput(f"--folder: expected a folder, got {self.folder}")
