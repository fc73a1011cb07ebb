"""``stancekit about`` and ``demo``: this installation and this computer, as a report of a bug needs them;
the main job from end to end, as the commands that do it.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .console import emit, out, progress, say

DOCUMENTED_S = 5.9
"""CPU time of 1,000 cold solves on the computer that measured the figures of the documentation
[s]."""


@dataclass
class About:
    """Say what is installed and how fast this computer is: for a report of a bug, and before
    figures are compared.

    Prints the version, Python, every extra with the versions of its packages and the command that
    installs a missing one, the library that draws films, the number of cores, and the CPU time of
    1,000 cold solves of one cone program beside that of the documentation's computer.

      stancekit about
      stancekit about --json
    """

    measure: bool = True
    """Measure the speed of this computer, which takes some seconds; --no-measure does not."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Look, measure, print."""
        from stancekit.runner.acceptance import about

        with progress("about") as bar:
            record = about(measure=self.measure, progress=bar)
        if self.json:
            emit(record | {"documented_s": DOCUMENTED_S})
            return 0
        say(_lines(record))
        return 0


def _lines(found: dict[str, Any]) -> list[str]:
    from stancekit.planners.errors import install_command

    lines = [
        f"stancekit  {found['stancekit']}, in {found['folder']}",
        f"Python     {found['python']}, {found['platform']}",
        f"core       {_versions(found['core'])}",
    ]
    for extra, packages in found["extras"].items():
        missing = [name for name, version in packages.items() if version is None]
        text = (
            f"{install_command(extra)}  (without {', '.join(missing)})"
            if missing
            else _versions(packages)
        )
        lines.append(f"{extra:<10} {text}")
    gl = found["gl"]
    lines.append(f"GL         {gl or 'none: no films; apt-get install libegl1 libgl1'}")
    lines.append(f"cores      {found['cores']}, load {found['load']:.1f}")
    if found["solves_s"] is not None:
        ratio = found["solves_s"] / DOCUMENTED_S
        lines.append(
            f"speed      1,000 cold solves in {found['solves_s']:.2f} CPU-s, {ratio:.2f} times the "
            f"{DOCUMENTED_S:g} of the documentation's computer"
        )
    return lines


def _versions(packages: dict[str, str | None]) -> str:
    return ", ".join(f"{name} {version}" for name, version in packages.items())


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
        say(
            (
                f"Made: a plan, its verdict, its run in MuJoCo, three pictures and a page, in {folder}",
                f"Look: open {folder / 'climb.html'} in a browser and turn it; posture.png, climb.png, "
                "run.png",
                "Next: stancekit play walls; yours: stancekit plan MESH --robot URDF --start X,Y "
                "--goal X,Y --html FILE",
            )
        )
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
