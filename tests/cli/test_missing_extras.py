"""Every extra that is missing: the commands that need it name it in one line, with the command that
installs it.
"""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import stancekit
from stancekit.configs import config_path
from stancekit.planners.robot.robot_file import joint_names
from stancekit.runner.worlds.dynamixel.control_table import nominal

ROOT = Path(__file__).parents[2]
WORDING = re.compile(
    r'stancekit: error: .+: expected [\w.-]+ for .+, it is not installed: pip install .*\[\w+\]"'
)
TOOLS = {"dev"}
"""Extras for working on the package, which no command needs."""
CASES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "exact": (
        ("pyscipopt", "gurobipy"),
        ("plan stairs --planner micp --solver scip", "plan stairs --planner micp --solver gurobi"),
    ),
    "rl": (
        ("torch", "stable_baselines3", "safetensors"),
        (
            "train task.yaml",
            "fit rows --method neural --out nn.safetensors",
        ),
    ),
    "ray": (("ray",), ("label wall-3 new --executor ray --feasible 1 --infeasible 1",)),
    "data": (
        ("pyarrow", "minari"),
        (
            "label wall-3 new --feasible 1 --infeasible 1",
            "fit rows --out e.json",
            "export rows --out minari",
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
import cvxpy, scipy.optimize  # what most need and no extra has: loaded once, and forked
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
    assert plan is not None
    stancekit.save(plan, folder / "climb.json")
    stancekit.label("wall-3", folder / "rows", rows=(1, 1))
    joints = joint_names(plan.problem.robot)
    nominal(joints, port="/dev/null").write(folder / "servos.yaml")
    names = "\n".join(f"  {name}: {{name: {name}}}" for name in joints)
    (folder / "ros.yaml").write_text(f"format: stancekit/ros/1\nrobot: hexapod\njoints:\n{names}\n")
    (folder / "task.yaml").write_bytes(config_path("train-selection.yaml").read_bytes())
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
