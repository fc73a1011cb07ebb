"""``stancekit demo``: the main job from end to end, as the commands that do it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .console import out

SEED = 8
"""A draw of wall-3 that cannot be held."""
_GOAL = "1,0"


@dataclass
class Demo:
    """Plan, judge and simulate a robot with six legs over stepping stones; before that, a posture
    and its refusal.

    Runs the commands that it shows, and writes their files to a folder: pictures, a plan, and a
    page that a browser opens. Robot and terrain are files in configs/demo. Needs the extras
    robots, terrain and viz.

      stancekit demo
    """

    out: Path = Path("out/demo")
    """Folder for everything that is made."""

    def run(self) -> int:
        """Run the commands; the exit code of the first one that fails."""
        from stancekit.planners.files.writing import make_folder

        from .main import parse, run

        self._check()
        make_folder(self.out)
        steps = list(self._steps())
        for number, (what, words) in enumerate(steps, 1):
            bar = f"[{'=' * number}{' ' * (len(steps) - number)}]"
            out.print(f"\n{bar} {number} of {len(steps)}: {what}", style="bold", highlight=False)
            out.print(f"$ stancekit {shlex.join(words)}", highlight=False)
            if code := run(parse(words)):
                return code
        folder = self.out.resolve()
        out.print()
        for line in (
            f"Made: a plan, its verdict, its run in MuJoCo, three pictures and a page, in {folder}",
            f"Look: open {folder / 'climb.html'} in a browser and turn it; posture.png, climb.png, "
            "run.png",
            "Next: stancekit play walls; yours: stancekit plan MESH --robot URDF --start X,Y "
            "--goal X,Y --html FILE",
        ):
            out.print(line, highlight=False)
        return 0

    def _check(self) -> None:
        """Raise InvalidInput where an extra is missing, before anything is computed."""
        from stancekit.planners.robot.urdf_reader import pinocchio
        from stancekit.planners.terrain.facets import shapely_module
        from stancekit.runner.worlds.mujoco import mujoco_module
        from stancekit.views.page import viser_module

        for module in (pinocchio, mujoco_module, shapely_module, viser_module):
            module()

    def _steps(self) -> Iterator[tuple[str, Sequence[str]]]:
        """Every step: what happens, and the command."""
        from stancekit.configs import config_path

        def at(name: str) -> str:
            return str(self.out / name)

        terrain, robot = (
            _short(config_path(f"demo/{name}").resolve()) for name in ("stones.obj", "ant.yaml")
        )
        draw = ("--count", "1", "--seed", str(SEED), "--out", at("posture.jsonl"))
        yield "draw three toes on two leaning walls", ("sample", "wall-3", *draw)
        yield (
            "decide, with a proof",
            ("solve", at("posture.jsonl"), "--certificate", "--out", at("answer.jsonl")),
        )
        yield (
            "check the proof without a solver",
            ("verify", at("posture.jsonl"), at("answer.jsonl"), "--explain"),
        )
        yield (
            "draw why it cannot be held",
            ("picture", at("posture.jsonl"), "--out", at("posture.png")),
        )
        files = (
            "--out",
            at("climb.json"),
            "--picture",
            at("climb.png"),
            "--html",
            at("climb.html"),
        )
        way = ("--start", "0,0", "--goal", _GOAL)
        yield "plan a robot over stepping stones", ("plan", terrain, "--robot", robot, *way, *files)
        yield "judge the plan, by other code", ("verify", at("climb.json"))
        yield "run it in MuJoCo", ("simulate", at("climb.json"), "--picture", at("run.png"))


def _short(path: Path) -> str:
    """The path from the current folder where it lies in there."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
