"""A command parses, calls `api/` and prints: what it imports from below, and why it may.

Types under TYPE_CHECKING, errors, and the checks of numbers, names and files in ``planners.files``
are free. What else a file imports is listed here with its reason; a file that imports more fails,
and one that no longer needs to, too.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import stancekit
import stancekit.cli
from stancekit.configs import config_path
from stancekit.runner.worlds.dynamixel.control_table import nominal

FOLDER = Path(stancekit.cli.__file__).parent
BELOW = ("planners", "runner", "views", "envs", "learners")
FREE = ("planners.errors", "planners.files.")
DRAWS, CHOICES, TOOL, LATER = (
    "pictures, films and pages that only a command has",
    "names and limits that an option is checked against",
    "something of its own that the library has no function for",
    "still turns options into values itself",
)
MAY: dict[str, dict[str, tuple[str, ...]]] = {
    "about": {
        TOOL: (
            "planners.robot.urdf_reader",
            "planners.terrain.facets",
            "runner.acceptance",
            "runner.worlds.mujoco",
            "views.page",
        )
    },
    "bench": {
        TOOL: (
            "learners.data.executors",
            "learners.evaluation",
            "learners.evaluation.evaluate",
            "learners.evaluation.gait_bench",
            "learners.evaluation.planner_bench",
            "learners.evaluation.room",
            "learners.zoo",
        ),
    },
    "console": {DRAWS: ("views.sheet",)},
    "fit": {
        CHOICES: ("planners.projection.project",),
        TOOL: ("learners.evaluation.evaluate",),
    },
    "gait": {
        CHOICES: ("planners.gait.charts",),
        LATER: ("planners.formats.motion_file",),
        TOOL: ("planners.answer.motion", "planners.verify.trajectory_measurements"),
        DRAWS: (
            "planners.gait.charts.warped",
            "views.gaits",
        ),
    },
    "main": {TOOL: ("planners.plugins",)},
    "options": {
        TOOL: ("planners.plugins",),
        CHOICES: ("planners.search.methods",),
        DRAWS: (
            "views.film",
            "views.page",
            "views.sheet",
        ),
        LATER: ("planners.terrain.import_options",),
    },
    "plan": {
        CHOICES: (
            "planners.answer.plan",
            "planners.answer.report",
            "planners.leap.method",
            "planners.problem.leap",
            "planners.search.methods",
        ),
        LATER: (
            "learners.leaps.policy",
            "planners.formats.question_file",
            "planners.verify",
        ),
    },
    "play": {
        CHOICES: ("planners.terrain.import_options",),
        TOOL: (
            "planners.problem.course_between",
            "views.playground.scenario",
            "views.playground.serving",
        ),
    },
    "run": {
        TOOL: (
            "runner.log",
            "runner.safety.estop",
            "runner.worlds.ros.bridge",
        ),
        DRAWS: ("views.plots",),
        LATER: (
            "planners.motion.plan_motion",
            "planners.robot.leg",
            "runner.acceptance",
            "runner.settings",
            "runner.worlds.world",
        ),
    },
    "solve": {
        CHOICES: (
            "planners.problem.course_file",
            "planners.search.methods",
            "planners.terrain.import_options",
            "planners.terrain.reference",
        ),
        LATER: (
            "planners.problem.course_keys",
            "planners.problem.course_between",
            "planners.problem.course_terrain",
            "planners.robot.reach_sets",
            "planners.robot.robot_file",
            "planners.terrain.footholds",
        ),
    },
    "terrain": {
        TOOL: (
            "planners.robot.model",
            "planners.robot.reach_sets",
            "planners.robot.robot_file",
        ),
        DRAWS: (
            "planners.robot.meshes",
            "views.maps",
            "views.page",
            "views.robots",
            "views.terrain",
        ),
    },
    "verify": {
        CHOICES: ("envs.data.ledger",),
        LATER: ("planners.formats.motion_file",),
    },
}
"""By file and reason: the modules that are imported."""


def imported(path: Path) -> set[str]:
    """The modules from below `api/` that a file imports when it runs, without those that are
    free.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typed = {
        id(inside)
        for node in ast.walk(tree)
        if isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
        for inside in ast.walk(node)
    }
    found = set[str]()
    for node in ast.walk(tree):
        if id(node) in typed:
            continue
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += (
            [node.module]
            if isinstance(node, ast.ImportFrom) and node.module and not node.level
            else []
        )
        found |= {
            name.removeprefix("stancekit.") for name in names if name.startswith("stancekit.")
        }
    return {
        name for name in found if name.split(".")[0] in BELOW and not f"{name}.".startswith(FREE)
    }


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_command_imports_from_below_what_is_listed_with_its_reason(path: Path) -> None:
    may = {name for names in MAY.get(path.stem, {}).values() for name in names}
    assert imported(path) == may


def test_commands_that_ask_the_library_alone_are_seen() -> None:
    assert not imported(FOLDER / "label.py")
    assert "planners.search.methods" in imported(FOLDER / "plan.py")
    assert MAY.keys() <= {path.stem for path in FOLDER.glob("*.py")}


ROOT = Path(__file__).parents[2]
WORDING = re.compile(
    r'stancekit: error: .+: expected [\w.-]+ for .+, it is not installed: pip install .*\[\w+\]"'
)
TOOLS = {"dev"}
"""Extras for working on the package, which no command needs."""
CASES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "exact": (
        ("pyscipopt", "gurobipy"),
        ("plan stairs --method micp --solver scip", "plan stairs --method micp --solver gurobi"),
    ),
    "rl": (
        ("torch", "stable_baselines3", "safetensors"),
        ("fit rows --method neural --out nn.safetensors",),
    ),
    "ray": (("ray",), ("label wall-3 new --executor ray --feasible 1 --infeasible 1",)),
    "data": (
        ("pyarrow",),
        (
            "label wall-3 new --feasible 1 --infeasible 1",
            "fit rows --out e.json",
        ),
    ),
    "robots": (
        ("pinocchio", "mujoco"),
        (
            "robot ant.urdf",
            "plan stairs --robot ant.urdf",
            "gait ripple --goal 1,0 --robot ant.urdf",
            "sample wall-3 --robot ant.urdf",
            "simulate climb.json",
            "demo",
        ),
    ),
    "terrain": (
        ("trimesh", "shapely", "pypcd4"),
        (
            "terrain stones.obj",
            "plan stones.obj --start 0,0 --goal 1,0",
            "terrain cloud.pcd",
            "sample terrain-3 --terrain stones.obj",
        ),
    ),
    "viz": (
        ("viser", "imageio_ffmpeg", "mcap"),
        (
            "play walls --no-browser --port 0",
            "plan stairs --html page.html",
            "demo",
            "plan stairs --video film.mp4",
            "simulate climb.json --video film.mp4",
            "run climb.json --log run.mcap",
            "replay run.mcap",
            "export climb.json --to foxglove",
        ),
    ),
    "catalogue": (
        ("pybullet",),
        (
            "simulate climb.json --world bullet",
            "robot go1",
            "plan stairs --robot go1",
            "gait ripple --goal 1,0 --robot go1",
        ),
    ),
    "machines": (
        ("dynamixel_sdk", "roslibpy"),
        (
            "run climb.json --world dynamixel --setup servos.yaml",
            "run climb.json --world ros --setup ros.yaml",
        ),
    ),
}
"""By extra: the modules that are hidden, and commands that need one of them."""
CLOUD = """# .PCD v0.7
VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH 1
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 1
DATA ascii
0 0 0
"""
HIDDEN = """
import json
import os
import sys
from importlib.machinery import PathFinder
from importlib.metadata import MetadataPathFinder

cases = json.loads(sys.argv[1])
hidden = {name for names, _ in cases.values() for name in names}

class Without:
    def find_spec(self, name, path=None, target=None):
        return None if name.split(".")[0] in hidden else PathFinder.find_spec(name, path, target)

    def find_distributions(self, context):
        found = MetadataPathFinder.find_distributions(context)
        return (each for each in found if each.metadata["Name"] != "example-robot-data")

sys.meta_path[:] = [each for each in sys.meta_path if each is not PathFinder] + [Without()]
# What many need and no extra has: loaded once, and forked.
import joblib, sklearn.mixture
import stancekit.cli.gait, stancekit.cli.plan, stancekit.cli.run, stancekit.views.sheet
import stancekit.learners.data.labelling, stancekit.learners.training.fitting, stancekit.runner.run
import stancekit.planners.gait.method.attempt, stancekit.planners.search.methods
from stancekit.cli.main import main
for extra, (names, lines) in cases.items():
    if child := os.fork():
        os.waitpid(child, 0)
        continue
    hidden = set(names)
    os.dup2(os.open(extra + ".err", os.O_WRONLY | os.O_CREAT), 2)
    for line in lines:
        try:
            main(line.split())
        except SystemExit as end:
            print(f"code {end.code}", file=sys.stderr, flush=True)
    os._exit(0)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the commands read."""
    folder = tmp_path_factory.mktemp("extras")
    for name in ("ant.urdf", "ant.yaml", "stones.obj"):
        (folder / name).write_bytes(config_path(f"demo/{name}").read_bytes())
    plan = stancekit.plan("stairs", frames=2).solution
    stancekit.save(plan, folder / "climb.json")
    stancekit.label("wall-3", folder / "rows", rows=(1, 1))
    joints = plan.problem.robot.joint_names
    nominal(plan.problem.robot, port="/dev/null").write(folder / "servos.yaml")
    names = "\n".join(f"  {name}: {{name: {name}}}" for name in joints)
    (folder / "ros.yaml").write_text(f"format: stancekit/ros/1\nrobot: hexapod\njoints:\n{names}\n")
    (folder / "run.mcap").write_bytes(b"\x89MCAP0\r\n")
    (folder / "cloud.pcd").write_text(CLOUD)
    return folder


def test_every_extra_has_its_commands() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    assert set(CASES) == set(extras) - TOOLS
    assert len(extras) <= 10


@pytest.fixture(scope="module")
def errors(folder: Path) -> Path:
    """A folder with what each extra's commands wrote to standard error."""
    subprocess.run(
        [sys.executable, "-c", HIDDEN, json.dumps(CASES)],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        check=True,
        timeout=600,
    )
    return folder


@pytest.mark.parametrize("extra", CASES)
def test_a_missing_extra_is_named_with_the_command_that_installs_it(
    extra: str, errors: Path
) -> None:
    lines = CASES[extra][1]
    said = (errors / f"{extra}.err").read_text(encoding="utf-8")
    ends = [line for line in said.splitlines() if line.startswith(("stancekit: ", "code "))]
    assert len(ends) == 2 * len(lines), said
    for line, message, code in zip(lines, ends[::2], ends[1::2], strict=True):
        assert code == "code 2", (line, message)
        assert WORDING.fullmatch(message), (line, message)
        assert message.endswith(f'[{extra}]"'), (line, message)
