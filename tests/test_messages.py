"""Messages as users read them, on one page of text that is reviewed: ``messages.txt``.

A line ``$ …`` is a command, a line ``>>> …`` a line of Python; what they say stands below them.
``python -m tests.test_messages`` writes the page anew. No other test asks for a wording.
"""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit.cli.main import main
from stancekit.planners.errors import StancekitError
from stancekit.planners.robot.robot_file import drawn_urdf
from stancekit.runner.settings import RunSettings, Timing
from tests.emulators.memory_world import PATIENT, MemoryWorld

PAGE = Path(__file__).with_name("messages.txt")
MOST = 60
COURSE = """
name: mine
frames: 3
gait: tripod
start_m: [0.0, 0.0, 0.2]
goal_m: [0.0, 0.0, 0.3]
stride_m: 0.05
stance: {outward_m: 0.08, down_m: 0.0}
body: {com_radius_m: 0.06, first_radius_m: 0.02}
steps: {com_m: 0.12, toe_m: 0.3, rotation_rad: 0.15, progress_m: 0.02}
candidates: {count: 1, window_m: 0.26, margin_m: 0.02}
terrain: {kind: walls, friction: 1.0, apart_m: 0.38}
"""
OPEN = "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n"
BARE = '<robot name="bare"><link name="trunk"/></robot>'


def lay_out(folder: Path) -> dict[str, Any]:
    """Write the files that the page names, and return the names that its Python has."""
    for name, text in {
        "empty.yaml": "",
        "list.yaml": "- 1",
        "open.yaml": "terrain: [",
        "typo.yaml": COURSE.replace("friction: 1.0", "frction: 1.0"),
        "negative.yaml": COURSE.replace("friction: 1.0", "friction: -1.0"),
        "far.yaml": COURSE.replace("goal_m: [0.0, 0.0, 0.3]", "goal_m: [500.0, 0.0, 0.3]"),
        "apart.yaml": COURSE.replace("apart_m: 0.38", "apart_m: 3.0"),
        "slick.yaml": COURSE.replace("friction: 1.0", "friction: 0.05"),
        "nan.obj": OPEN,
        "open.urdf": '<robot name="open">',
        "bare.urdf": BARE,
        "heavy.urdf": drawn_urdf(stancekit.hexapod()).replace('mass value="', 'mass value="-', 1),
    }.items():
        (folder / name).write_text(text, encoding="utf-8")
    np.save(folder / "flat.npy", np.zeros((41, 41)))
    np.save(folder / "row.npy", np.zeros(9))
    plan = stancekit.plan("walls", frames=2).solution
    assert plan.keyed
    stancekit.save(plan, folder / "plan.json")
    stancekit.save(replace(plan, forces_n=1.1 * plan.forces_n), folder / "pushed.json")
    text = (folder / "plan.json").read_text(encoding="utf-8")
    changed = re.sub(r'"mass_kg": 10(\.0)?', '"mass_kg": 11', text, count=1)
    assert changed != text
    (folder / "changed.json").write_text(changed, encoding="utf-8")
    return {
        "stancekit": stancekit,
        "np": np,
        "replace": replace,
        "plan": plan,
        "problem": stancekit.sample("wall-3", rng=8)[0],
        "level": stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.05),
        "run": lambda **faults: _run(plan, **faults),
        "button": lambda world: world.latch.trip("button"),
    }


def _run(plan: stancekit.Motion, **faults: Any) -> str:
    """The message of a run on servos in memory, with attributes of the world set before."""
    world = MemoryWorld()
    for name, value in faults.items():
        setattr(world, name, value)
    settings = RunSettings(timing=Timing().at_pace(4.0), limits=PATIENT)
    return stancekit.run(plan, world, settings=settings, arm="without").message


def command(line: str) -> str:
    """The exit code of a command and what it says, but for tables, which hold seconds."""
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        try:
            code = main(line.split())
        except SystemExit as end:
            code = int(end.code or 0)
    lines = [line for line in said.getvalue().splitlines() if line and not line.startswith(" ")]
    return "\n".join([*lines, f"exit code {code}"])


def expression(line: str, names: dict[str, Any]) -> str:
    """The value of a line of Python, or its error."""
    try:
        return str(eval(line, dict(names)))
    except (StancekitError, TypeError, AttributeError) as error:
        return f"{type(error).__name__}: {error}"


def asked() -> Iterator[str]:
    """The commands and lines of Python of the page."""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith(("$ ", ">>> ")):
            yield line


def page(folder: Path) -> str:
    """The page as the package says it now."""
    with chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "100")
        for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
            patch.delenv(name, raising=False)
        names = lay_out(folder)
        said = [
            command(line[2:].removeprefix("stancekit "))
            if line.startswith("$ ")
            else expression(line[4:], names)
            for line in asked()
        ]
    texts = (text.replace(f"{folder}{os.sep}", "") for text in said)
    return "\n\n".join(f"{line}\n{text}" for line, text in zip(asked(), texts, strict=True)) + "\n"


def test_messages_are_what_the_page_shows(tmp_path: Path) -> None:
    assert 40 < len(list(asked())) <= MOST
    assert page(tmp_path) == PAGE.read_text(encoding="utf-8")


if __name__ == "__main__":
    with TemporaryDirectory() as made:
        PAGE.write_text(page(Path(made)), encoding="utf-8")
    sys.stdout.write(f"{PAGE}\n")
