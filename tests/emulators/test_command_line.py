"""``python -m tests.emulators``: servos as the calibration file has them, faults by lines, one line
for bad input.
"""

from __future__ import annotations

import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.formats.motion_file import read_motion, write_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.runner.worlds.dynamixel.control_table import Calibration, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from tests.emulators import __main__ as emulators
from tests.emulators.devices import DeviceProcess, shafts, start_of


@pytest.fixture
def folder(folder_once: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with plan.json and servos.yaml."""
    monkeypatch.chdir(folder_once)
    return folder_once


@pytest.fixture(scope="module")
def folder_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan, and a calibration file of servos that are mounted otherwise."""
    path = tmp_path_factory.mktemp("bus")
    plan = TwoStage().solve(read_course("walls")).solution
    write_motion(path / "plan.json", plan, check_plan(plan))
    usual = nominal(plan.problem.robot, port="bus", latency_ms=40.0)
    turned = {
        name: replace(
            each,
            id=100 - each.id,
            direction=-1 if k % 2 else 1,
            zero_tick=2000 + k,
            lower_rad=max(each.lower_rad, -2.7),
            upper_rad=min(each.upper_rad, 2.7),
        )
        for k, (name, each) in enumerate(usual.joints.items())
    }
    replace(usual, baud=3000000, joints=turned).write(path / "servos.yaml")
    return path


def test_the_servos_stand_as_the_plan_begins_by_the_calibration_file_and_are_gone_with_the_command(
    folder: Path,
) -> None:
    names, angles = start_of(Path("plan.json"))
    robot = read_motion("plan.json")[0].problem.robot
    words = ("plan.json", "--setup", "servos.yaml", "--firmware", 44)
    with DeviceProcess("bus", *words) as bus:
        assert bus.where["port"] == "bus"
        assert Path("bus").resolve() == Path(bus.where["path"])
        state = bus.state()
        assert state["ids"] == [100 - k for k in range(1, 25)]
        assert 0.0 <= state["own_s"] <= state["now_s"]
        with DynamixelWorld(robot, Calibration.from_yaml("servos.yaml", names)) as world:
            measured = world.connect((), np.zeros(24), np.zeros(3), np.eye(3)).angles_rad
            assert not world.bus.fast
        np.testing.assert_allclose(measured, angles, atol=2e-3)
        bus.ask("power loss in 0.01 s")
        with pytest.raises(ValueError, match="expected one of silent servo, "):
            bus.inject("tea")
        with pytest.raises(ValueError, match=r", got 1$"):
            bus.inject("silent servo 1")
        bus.process.send_signal(signal.SIGTERM)
        assert bus.process.wait(60.0) == 0
    assert not Path("bus").is_symlink()


def test_without_a_calibration_file_they_are_those_that_a_run_is_tried_with(folder: Path) -> None:
    names, angles = start_of(Path("plan.json"))
    with DeviceProcess("bus", "plan.json") as bus:
        state = bus.state()
    assert state["ids"] == list(range(1, 25))
    robot = read_motion("plan.json")[0].problem.robot
    stand = shafts(nominal(robot, port="bus"), names, angles)
    np.testing.assert_allclose(state["position_rad"], stand)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fault", "tea"], "expected one of silent servo, "),
        (["--fault", "silent servo 3"], "expected the id of a servo, 99, 98, "),
        (["--link", "servos.yaml"], "--link: expected a path for a link, got servos.yaml, which"),
        (["--link", "nowhere/bus"], "[Errno 2] No such file or directory: "),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    message: str,
) -> None:
    monkeypatch.setattr(
        sys, "argv", ["emulators", "bus", "plan.json", "--setup", "servos.yaml", *words]
    )
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    assert emulators.main() == 2
    error = capsys.readouterr().err
    assert error.startswith(f"emulators: error: {message}")
    assert error.count("\n") == 1
    assert Calibration.from_yaml("servos.yaml").baud == 3000000
    assert not Path("bus").is_symlink()
