"""Learning for a robot's file and a terrain's, every step a command; what is of another robot is
refused in a line.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.data.labelling import recheck
from stancekit.planners.formats.plan_file import read_envelopes
from stancekit.planners.robot.robot_file import named_robot
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names

PLACES = [
    (0.31 * i, 0.31 * j, 0.02 * ((3 * i + 5 * j) % 4)) for i in range(-4, 4) for j in range(-4, 4)
]
TILES = "".join(
    [
        f"v {x} {y} {z}\nv {x + 0.3} {y} {z}\nv {x + 0.3} {y + 0.3} {z}\nv {x} {y + 0.3} {z}\n"
        for x, y, z in PLACES
    ]
    + [
        f"f {4 * k + 1} {4 * k + 2} {4 * k + 3}\nf {4 * k + 1} {4 * k + 3} {4 * k + 4}\n"
        for k in range(len(PLACES))
    ]
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dog")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "heavy.urdf").write_text(quadruped(mass=2.0))
    (folder / "tiles.obj").write_text(TILES)
    return folder


@pytest.fixture
def files(folder: Path) -> list[str]:
    return ["--robot", str(folder / "dog.urdf"), "--terrain", str(folder / "tiles.obj")]


@pytest.fixture
def rows(folder: Path, stancekit: Callable, files: list[str]) -> Path:
    """A data set of the dog on tiles, made once."""
    made, here = folder / "rows", Path("rows")
    if not made.exists():
        ran = stancekit(
            "label",
            "terrain-4",
            made,
            *files,
            "--feasible",
            24,
            "--infeasible",
            4,
            "--workers",
            1,
            "--shard-size",
            8,
        )
        assert ran.code == 0, ran.err
        assert (
            "infeasible: of these inner sets and a level body, which proves nothing of the robot"
            in " ".join(ran.out.split())
        )
    shutil.copytree(made, here)
    return here


def test_problems_of_a_robots_file_are_sampled_solved_and_verified(
    stancekit: Callable, files: list[str]
) -> None:
    ran = stancekit(
        "sample", "terrain-3", *files, "--count", 4, "--out", "problems.jsonl", "--json"
    )
    assert ran.code == 0
    assert ran.records[0]["problem_class"].startswith("terrain-3-of-quadruped-")
    assert stancekit("solve", "problems.jsonl", "--certificate", "--out", "answers.jsonl").code == 0
    answers = [json.loads(line) for line in Path("answers.jsonl").read_text().splitlines()]
    assert {answer["status"] for answer in answers} <= {"feasible", "infeasible"}
    assert stancekit("verify", "problems.jsonl", "answers.jsonl").code == 0


def test_a_data_set_names_its_robot_and_its_rows_are_proved(rows: Path, folder: Path) -> None:
    dataset = Dataset.open(rows)
    identity = named_robot(folder / "dog.urdf").identity
    assert dataset.robot == identity
    assert dataset.problem_class.startswith(f"terrain-4-of-{identity}-on-tiles-")
    assert json.loads((rows / "header.json").read_text())["plan"]["robot"].endswith("dog.urdf")
    report = recheck(dataset)
    assert report.accepted
    assert (report.witnesses, report.certificates) == (24, 4)
    assert dataset.points.shape == (24, 4, 6)
    assert dataset.infeasible_points.shape == (4, 4, 6)


def test_what_is_fitted_is_evaluated_and_is_refused_for_another_robot(
    rows: Path,
    stancekit: Callable,
    refusal: Callable,
    files: list[str],
    labelled: Path,
    envelopes: Path,
) -> None:
    assert (
        stancekit(
            "fit", rows, *files, "--part", "train", "--method", "heuristic", "--out", "mine.json"
        ).code
        == 0
    )
    learned = read_envelopes("mine.json")
    dataset = Dataset.open(rows)
    assert (learned.robot, learned.problem_class) == (dataset.robot, dataset.problem_class)
    held = ("--part", "test", "--envelope", "mine.json", "--projection", "fix-p", "--json")
    ran = stancekit("evaluate", rows, *files, *held)
    assert ran.code == 0
    mine, lift = ran.records
    assert (
        mine["p1_feasible_of"] == lift["p1_feasible_of"] == len(dataset.only("test").feasible) > 0
    )
    assert lift["p1_feasible"] == 1.0
    assert mine["p1_feasible"] > 0.5
    assert stancekit("fit", rows, *files, "--method", "quantile", "--out", "seen.json").code == 0
    assert_names(refusal("evaluate", rows, "--envelope", "seen.json"), "seen.json")
    assert_names(refusal("evaluate", labelled, "--envelope", "mine.json"), "mine.json")
    assert_names(refusal("evaluate", rows, "--envelope", envelopes), envelopes)


def test_a_data_set_of_another_robot_or_terrain_is_refused(
    rows: Path, folder: Path, refusal: Callable, labelled: Path
) -> None:
    mine, heavy = (named_robot(folder / name).identity for name in ("dog.urdf", "heavy.urdf"))
    robot, out = str(folder / "heavy.urdf"), ("--out", "x.json")
    message = f"robot: expected a data set of {heavy}, got one of {mine}"
    assert refusal("fit", rows, "--robot", robot, *out) == f"rows: {message}"
    message = f"robot: expected a data set of {mine}, got one of hexapod"
    assert refusal("evaluate", labelled, "--robot", folder / "dog.urdf") == f"{labelled}: {message}"
    (folder / "other.obj").write_text(TILES.replace("0.02", "0.03"))
    message = refusal("fit", rows, "--terrain", folder / "other.obj", *out)
    assert message.startswith("rows: terrain: expected a data set of other-")


def test_envelopes_of_another_robot_are_refused_where_problems_are_solved(
    rows: Path, folder: Path, stancekit: Callable, files: list[str]
) -> None:
    assert stancekit("fit", rows, "--method", "heuristic", "--out", "mine.json").code == 0
    heavy, mine = (named_robot(folder / name).identity for name in ("heavy.urdf", "dog.urdf"))
    problems = ("sample", "ground-4", "--robot", folder / "heavy.urdf", "--out", "heavy.jsonl")
    assert stancekit(*problems).code == 0
    ran = stancekit("solve", "heavy.jsonl", "--method", "p1", "--envelope", "mine.json")
    assert ran.code == 2
    learned = Dataset.open(rows).problem_class
    assert f"robot: expected {mine} for an envelope learned for {learned}, got {heavy}" in ran.err


def test_robots_and_terrains_that_will_not_do_are_one_line(
    folder: Path, refusal: Callable, files: list[str]
) -> None:
    message = "expected a robot of 5 legs or more, got quadruped with LF, RF, LH, RH"
    assert (
        refusal("label", "ground-5", "out", "--robot", folder / "dog.urdf")
        == f"ground-5: {message}"
    )
    (folder / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3\nf 1 3 4\n")
    message = refusal(
        "sample", "terrain-3", "--robot", folder / "dog.urdf", "--terrain", folder / "wall.obj"
    )
    assert message == "wall.obj: expected footholds, got none: 1 m² steep"
    assert_names(refusal("sample", "terrain-3", "--robot", folder / "dog.urdf"), "terrain-3")
