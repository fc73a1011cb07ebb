"""``stancekit robot``: what it says of a file, what it draws, and its exit codes."""

import json
from pathlib import Path

import pytest

from stancekit.cli.main import run
from stancekit.cli.robot import ShowRobot
from stancekit.planners.robot.robot_file import named_robot
from tests.planners.robot.small_urdfs import MASS, fixed, link, quadruped, robot


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
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(ShowRobot(str(folder / "dog.urdf"))) == 0
    said = capsys.readouterr().out
    assert "robot   quadruped" in said
    assert "16.200 kg" in said
    assert "RF   RF_FOOT" in said
    assert "LH   LH_KFE  -2.40     -0.30" in said
    assert "guess: legs and feet, by their shape and names: RF (RF_FOOT), LH (LH_FOOT)" in said
    assert "guess: posture to stand in, of RF, LH" in said
    assert "doubt: joints RF_HAA, RF_HFE, RF_KFE, LH_HAA, LH_HFE, LH_KFE: no torque limit" in said


def test_with_json_it_is_one_object_and_corrections_count(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(ShowRobot(str(folder / "dog.yaml"), srdf=folder / "dog.srdf", json=True)) == 0
    record = json.loads(capsys.readouterr().out)
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
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(ShowRobot(str(folder / "dog.urdf"), picture=tmp_path / "dog.png")) == 0
    assert (tmp_path / "dog.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert run(ShowRobot("nobody", picture=tmp_path / "none" / "dog.png")) == 2
    assert f"expected an existing folder {tmp_path / 'none'}" in capsys.readouterr().err


def test_feet_that_stay_on_a_surface_make_a_robot_without_workspaces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = quadruped(("LF", "RF")).replace(
        '<joint name="LF_HAA" type="revolute"', '<joint name="LF_HAA" type="fixed"'
    )
    (tmp_path / "flat.urdf").write_text(text)
    assert run(ShowRobot(str(tmp_path / "flat.urdf"))) == 1
    assert "no workspace: leg LF: expected three joints or more" in capsys.readouterr().out


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
    folder: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, message: str
) -> None:
    (folder / name).write_text(text)
    assert run(ShowRobot(str(folder / name))) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert message in said.err


def test_without_a_robot_it_lists_those_with_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(ShowRobot(json=True)) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == {"name": "hexapod", "provider": "stancekit", "installed": True}
    assert {row["name"]: row["provider"] for row in rows}["go1"] == "example-robot-data"
    assert run(ShowRobot()) == 0
    assert "anymal_b" in capsys.readouterr().out


def test_an_option_wants_a_robot(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(ShowRobot(picture=Path("robot.png"))) == 2
    assert (
        capsys.readouterr().err
        == "stancekit: error: --picture: expected a robot with it, got none\n"
    )
