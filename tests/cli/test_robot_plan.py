"""``stancekit plan`` for a robot's file: joints are judged, and only outer sets prove that there is no plan."""

import json
from pathlib import Path

import pytest

from stancekit.cli.main import run
from stancekit.cli.plan import PlanCourse
from stancekit.cli.simulate import Simulate
from stancekit.cli.verify import Verify
from tests.planners.robot.small_urdfs import quadruped

pytest.importorskip("pinocchio")

COURSE = """
name: step
robot: dog.urdf
frames: 6
gait: wave
start_m: [0.0, 0.0, {0}]
goal_m: [0.2, 0.0, {0}]
body: {{com_radius_m: {1}, first_radius_m: 0.005, tilt_limit_rad: 0.01}}
terrain: {{kind: flat, friction: {2}}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dog")
    (folder / "dog.urdf").write_text(quadruped())
    return folder


@pytest.fixture(autouse=True)
def cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STANCEKIT_CACHE", str(folder / "cache"))


def planned(folder: Path, capsys: pytest.CaptureFixture[str], *values: float) -> tuple[int, dict]:
    (folder / "course.yaml").write_text(COURSE.format(*values))
    code = run(PlanCourse(str(folder / "course.yaml"), json=True))
    return code, json.loads(capsys.readouterr().out)


def test_joint_angles_come_with_a_plan(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, record = planned(folder, capsys, 0.5, 0.005, 0.7)
    assert (code, record["status"]) == (0, "feasible")
    assert record["joints"]["reached"]
    assert [leg["joints"][0] for leg in record["joints"]["legs"]] == ["LF_HAA", "RF_HAA", "LH_HAA", "RH_HAA"]
    assert all(max(leg["error_m"]) < 1e-4 for leg in record["joints"]["legs"])


def test_a_body_that_is_higher_than_the_legs_are_long_is_proved_infeasible(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, record = planned(folder, capsys, 0.64, 0.005, 0.7)
    assert (code, record["status"]) == (1, "infeasible")


def test_what_is_between_inner_and_outer_sets_is_undecided(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, record = planned(folder, capsys, 0.58, 0.005, 0.7)
    assert (code, record["status"]) == (1, "undecided")
    assert record["message"] == (
        "no plan in the inner sets of the legs, and no proof in the outer ones that there is none"
    )


def test_nothing_is_said_or_done_with_legs_that_are_not_the_robots(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The hexapod's legs, which the project draws up, are neither asked nor moved in place of a file's own."""
    (folder / "course.yaml").write_text(COURSE.format(0.5, 0.005, 0.7))
    out = folder / "plan.json"
    assert run(PlanCourse(str(folder / "course.yaml"), out=out, json=True)) == 0
    capsys.readouterr()
    assert run(Verify(out, json=True)) == 0
    (joints,) = [line for line in capsys.readouterr().out.splitlines() if "not checked" in line]
    assert "got half-spaces: legs of a robot's file are neither checked joint by joint nor run yet" in joints
    assert run(Simulate(out, world="mujoco")) == 2
    said = capsys.readouterr().err
    assert "expected balls of reach for a URDF of its own, got half-spaces" in said
    assert said.count("\n") == 1
