"""``stancekit emulate bus``: servos as the calibration file has them, faults by lines, one line for
bad input.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("pinocchio")

from stancekit.cli.main import main
from stancekit.planners.formats.plan_file import read_plan, write_plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import Robot
from stancekit.planners.robot.urdf import joint_names
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_plan
from stancekit.runner.emulators.start import start_of
from stancekit.runner.worlds.dynamixel.calibration import Calibration, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld

EMULATE = [
    sys.executable,
    "-m",
    "stancekit.cli.main",
    "emulate",
    "bus",
    "plan.json",
    "--setup",
    "servos.yaml",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan, and a calibration file of servos that are mounted otherwise."""
    path = tmp_path_factory.mktemp("bus")
    plan = TwoStagePlanner().solve(read_course("walls")).solution
    assert plan is not None
    write_plan(path / "plan.json", plan, check_plan(plan))
    usual = nominal(joint_names(plan.problem.robot), port="bus", latency_ms=40.0)
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


@contextmanager
def emulated(
    folder: Path, *options: str
) -> Iterator[tuple[subprocess.Popen[str], dict[str, object]]]:
    """The command's process, and the line that says where the bus is."""
    with subprocess.Popen(
        [*EMULATE, *options], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as bus:
        assert bus.stdout is not None
        yield bus, json.loads(bus.stdout.readline())
        if bus.poll() is None:
            bus.kill()


def asked(bus: subprocess.Popen[str], line: str = "") -> dict[str, object]:
    """The answer to a line."""
    assert bus.stdin is not None
    assert bus.stdout is not None
    bus.stdin.write(line + "\n")
    bus.stdin.flush()
    answer: dict[str, object] = json.loads(bus.stdout.readline())
    return answer


def test_the_servos_stand_as_the_plan_begins_by_the_calibration_file_and_are_gone_with_the_command(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    names, angles = start_of("plan.json")
    calibration = Calibration.from_yaml("servos.yaml", names)
    with emulated(folder, "--firmware", "44") as (bus, where):
        assert where["port"] == "bus"
        assert Path("bus").resolve() == Path(str(where["path"]))
        state = asked(bus)
        assert state["ids"] == [100 - k for k in range(1, 25)]
        assert 0.0 < float(str(state["time_share"])) <= 1.0
        with DynamixelWorld(plan_robot(folder), calibration) as world:
            measured = world.reset((), np.zeros(24), np.zeros(3), np.eye(3)).angles_rad
            assert not world.bus.fast
        np.testing.assert_allclose(measured, angles, atol=2e-3)
        assert "error" not in asked(bus, "power loss")
        assert "expected one of silent servo, " in str(asked(bus, "tea")["error"])
        assert str(asked(bus, "silent servo 1")["error"]).endswith(", got 1")
        bus.send_signal(signal.SIGTERM)
        assert bus.wait() == 0  # a test that hangs has failed
    assert not Path("bus").is_symlink()


def plan_robot(folder: Path) -> Robot:
    return read_plan(folder / "plan.json")[0].problem.robot


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--fault", "tea"], "--fault: expected one of silent servo, "),
        (["--fault", "silent servo 3"], "--fault: expected the id of a servo, 99, 98, "),
        (["--firmware", "0"], "--firmware: expected "),
        (["--at-s=-1"], "--at-s: expected "),
        (
            ["--link", "servos.yaml"],
            "--link: expected a path at which a link can be made, got servos.yaml, which is",
        ),
        (["--link", "nowhere/bus"], "--link: cannot make nowhere/bus: No such file or directory"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as end:
        main(["emulate", "bus", "plan.json", "--setup", "servos.yaml", *options])
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith(f"stancekit: error: {message}")
    assert error.count("\n") == 1
    assert Calibration.from_yaml("servos.yaml").baud == 3000000
