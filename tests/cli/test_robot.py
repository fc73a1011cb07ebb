"""``stancekit robot``: what it says of a file, what it draws, and its exit codes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.data.labelling import recheck
from stancekit.planners.formats.question_file import read_envelopes
from stancekit.planners.robot.robot_file import named_robot
from tests.planners.robot.small_urdfs import MASS, fixed, link, quadruped, robot
from tests.refusals import assert_names


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot's files."""
    folder = tmp_path_factory.mktemp("robots")
    foot = MASS.format(0.1)
    small = foot.replace('".01"', '".00001"')  # a moment of inertia that a small foot can have
    (folder / "dog.urdf").write_text(quadruped(("RF", "LH"), effort=0.0).replace(foot, small))
    (folder / "dog.yaml").write_text("urdf: dog.urdf\nname: dog\njoints: {'*': {torque_nm: 30}}\n")
    (folder / "dog.srdf").write_text(
        '<robot name="dog"><disable_collisions link1="base" link2="RF_THIGH" reason="Never"/></robot>'
    )
    return folder


def test_it_says_what_was_found_and_marks_what_was_guessed(
    folder: Path, stancekit: Callable
) -> None:
    said = stancekit("robot", folder / "dog.urdf").out
    assert "robot   quadruped" in said
    assert "16.200 kg" in said
    assert "RF   RF_FOOT" in said
    assert "LH   LH_KFE  -2.40     -0.30" in said
    assert "guess: legs and feet, by their shape and names: RF (RF_FOOT), LH (LH_FOOT)" in said
    assert "guess: posture to stand in, of RF, LH" in said
    assert "doubt: joints RF_HAA, RF_HFE, RF_KFE, LH_HAA, LH_HFE, LH_KFE: no torque limit" in said


def test_with_json_it_is_one_object_and_corrections_count(
    folder: Path, stancekit: Callable
) -> None:
    asked = ("robot", folder / "dog.yaml", "--srdf", folder / "dog.srdf", "--json")
    (record,) = stancekit(*asked).records
    model = named_robot(folder / "dog.yaml")
    assert record["name"] == "dog"
    assert record["digest"] == model.digest
    assert [leg["name"] for leg in record["legs"]] == ["RF", "LH"]
    assert [joint["torque_nm"] for leg in record["legs"] for joint in leg["joints"]] == [30.0] * 6
    assert record["disabled_pairs"] == [["RF_THIGH", "base"]]
    assert record["doubts"] == []
    assert len(record["guesses"]) == 2
    for leg in record["legs"]:
        assert leg["cover"] >= 0.6
        assert leg["unreachable"] <= 0.006
        assert 0.5 < leg["reach_m"] < 0.7


def test_a_picture_is_written_and_one_that_cannot_be_is_refused_before_any_work(
    folder: Path, stancekit: Callable, refusal: Callable
) -> None:
    assert stancekit("robot", folder / "dog.urdf", "--picture", "dog.png").code == 0
    assert Path("dog.png").read_bytes().startswith(b"\x89PNG")
    said = refusal("robot", "nobody", "--picture", "none/dog.png")
    assert "expected an existing folder none" in said


def test_feet_that_stay_on_a_surface_make_a_robot_without_workspaces(
    tmp_path: Path, stancekit: Callable
) -> None:
    text = quadruped(("LF", "RF")).replace(
        '<joint name="LF_HAA" type="revolute"', '<joint name="LF_HAA" type="fixed"'
    )
    (tmp_path / "flat.urdf").write_text(text)
    ran = stancekit("robot", "flat.urdf")
    assert (ran.code, "no workspace: leg LF: expected three joints or more" in ran.out) == (1, True)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.urdf", quadruped(mass=0.0), "expected links with mass and inertia, got 0 kg in all"),
        (
            "a.urdf",
            robot([link("a"), fixed("f", "base", "a")]),
            "legs: expected chains of two joints or more",
        ),
        (
            "a.yaml",
            "urdf: dog.urdf\njoints: {tail: {torque_nm: 3}}\n",
            "joints: expected one of RF_HAA, RF_HFE,",
        ),
        ("a.yaml", "urdf: [1]\n", "urdf: expected a valid string"),
        ("a.urdf", "", "expected some text, the file is empty"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    folder: Path, refusal: Callable, name: str, text: str, message: str
) -> None:
    (folder / name).write_text(text)
    assert message in refusal("robot", folder / name)


def test_without_a_robot_it_lists_those_with_a_name(stancekit: Callable) -> None:
    rows = stancekit("robot", "--json").records
    assert rows[0] == {"name": "hexapod", "provider": "stancekit", "installed": True}
    assert {row["name"]: row["provider"] for row in rows}["go1"] == "example-robot-data"
    assert "anymal_b" in stancekit("robot").out


def test_an_option_wants_a_robot(refusal: Callable) -> None:
    said = refusal("robot", "--picture", "robot.png")
    assert said == "--picture: expected none with the list of robots, got robot.png"


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
def learning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    learning = tmp_path_factory.mktemp("dog")
    (learning / "dog.urdf").write_text(quadruped())
    (learning / "heavy.urdf").write_text(quadruped(mass=2.0))
    (learning / "tiles.obj").write_text(TILES)
    return learning


@pytest.fixture
def files(learning: Path) -> list[str]:
    return ["--robot", str(learning / "dog.urdf"), "--terrain", str(learning / "tiles.obj")]


@pytest.fixture
def rows(learning: Path, stancekit: Callable, files: list[str]) -> Path:
    """A data set of the dog on tiles, made once."""
    made, here = learning / "rows", Path("rows")
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


def test_a_data_set_names_its_robot_and_its_rows_are_proved(rows: Path, learning: Path) -> None:
    dataset = Dataset.open(rows)
    identity = named_robot(learning / "dog.urdf").identity
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
    held = ("--part", "test", "--envelopes", "mine.json", "--projection", "fix-p", "--json")
    ran = stancekit("evaluate", rows, *files, *held)
    assert ran.code == 0
    mine, lift = ran.records
    assert (
        mine["p1_feasible_of"] == lift["p1_feasible_of"] == len(dataset.only("test").feasible) > 0
    )
    assert lift["p1_feasible"] == 1.0
    assert mine["p1_feasible"] > 0.5
    assert stancekit("fit", rows, *files, "--method", "quantile", "--out", "seen.json").code == 0
    assert_names(refusal("evaluate", rows, "--envelopes", "seen.json"), "seen.json")
    assert_names(refusal("evaluate", labelled, "--envelopes", "mine.json"), "mine.json")
    assert_names(refusal("evaluate", rows, "--envelopes", envelopes), envelopes)


def test_a_data_set_of_another_robot_or_terrain_is_refused(
    rows: Path, learning: Path, refusal: Callable, labelled: Path
) -> None:
    mine, heavy = (named_robot(learning / name).identity for name in ("dog.urdf", "heavy.urdf"))
    robot, out = str(learning / "heavy.urdf"), ("--out", "x.json")
    message = f"robot: expected a data set of {heavy}, got one of {mine}"
    assert refusal("fit", rows, "--robot", robot, *out) == f"rows: {message}"
    message = f"robot: expected a data set of {mine}, got one of hexapod"
    assert (
        refusal("evaluate", labelled, "--robot", learning / "dog.urdf") == f"{labelled}: {message}"
    )
    (learning / "other.obj").write_text(TILES.replace("0.02", "0.03"))
    message = refusal("fit", rows, "--terrain", learning / "other.obj", *out)
    assert message.startswith("rows: terrain: expected a data set of other-")


def test_envelopes_of_another_robot_are_refused_where_problems_are_solved(
    rows: Path, learning: Path, stancekit: Callable, files: list[str]
) -> None:
    assert stancekit("fit", rows, "--method", "heuristic", "--out", "mine.json").code == 0
    heavy, mine = (named_robot(learning / name).identity for name in ("heavy.urdf", "dog.urdf"))
    problems = ("sample", "ground-4", "--robot", learning / "heavy.urdf", "--out", "heavy.jsonl")
    assert stancekit(*problems).code == 0
    ran = stancekit("solve", "heavy.jsonl", "--method", "p1", "--envelopes", "mine.json")
    assert ran.code == 2
    learned = Dataset.open(rows).problem_class
    assert f"robot: expected {mine} for an envelope learned for {learned}, got {heavy}" in ran.err


def test_robots_and_terrains_that_will_not_do_are_one_line(
    learning: Path, refusal: Callable, files: list[str]
) -> None:
    message = "expected a robot of 5 legs or more, got quadruped with LF, RF, LH, RH"
    assert (
        refusal("label", "ground-5", "out", "--robot", learning / "dog.urdf")
        == f"ground-5: {message}"
    )
    (learning / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3\nf 1 3 4\n")
    message = refusal(
        "sample", "terrain-3", "--robot", learning / "dog.urdf", "--terrain", learning / "wall.obj"
    )
    assert message == "wall.obj: expected footholds, got none: 1 m² steep"
    assert_names(refusal("sample", "terrain-3", "--robot", learning / "dog.urdf"), "terrain-3")
