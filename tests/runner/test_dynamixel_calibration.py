"""Calibration files: what is refused, and how; angles and ticks."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.robot_file import joint_names
from stancekit.runner.worlds.dynamixel.control_table import (
    Calibration,
    JointServo,
    ServoTicks,
    nominal,
)
from tests.refusals import refuses

JOINTS = joint_names(hexapod())


def spoil(change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    data = json.loads(json.dumps({"format": "stancekit/servos/1", "port": "port", "joints": {}}))
    for i, name in enumerate(JOINTS):
        data["joints"][name] = {"id": i + 1, "lower_rad": -1.0, "upper_rad": 1.0, "current_a": 2.0}
    change(data)
    return data


REFUSED: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "an id twice": (
        lambda d: d["joints"]["LF_knee"].update(id=2),
        "joints.LF_knee.id: expected its own id, got 2, which LF_hip has",
    ),
    "a joint missing": (
        lambda d: d["joints"].pop("RR_hip"),
        "joints: expected joint RR_hip, got nothing",
    ),
    "a joint too many": (
        lambda d: d["joints"].update(tail=dict(d["joints"]["LF_yaw"], id=99)),
        "joints: unknown joint tail",
    ),
    "an id out of range": (
        lambda d: d["joints"]["LF_hip"].update(id=253),
        "joints.LF_hip.id: expected less than or equal to 252, got 253",
    ),
    "a direction of 2": (
        lambda d: d["joints"]["LF_hip"].update(direction=2),
        "joints.LF_hip.direction: expected -1 or 1, got 2",
    ),
    "limits the wrong way": (
        lambda d: d["joints"]["LF_hip"].update(lower_rad=2.0),
        "joints.LF_hip.upper_rad: expected a number above 2, got 1",
    ),
    "limits beyond a turn": (
        lambda d: d["joints"]["LF_hip"].update(zero_tick=3900),
        "joints.LF_hip.upper_rad: expected an angle within the servo's one turn, 0 to 4095, got 1 at tick 4552",
    ),
    "too much current": (
        lambda d: d["joints"]["LF_hip"].update(current_a=5.8),
        "joints.LF_hip.current_a: expected up to 5.51, the most of an XM540-W270, got 5.8",
    ),
    "an unknown key": (
        lambda d: d["joints"]["LF_hip"].update(offset=1),
        "joints.LF_hip.offset: unknown key",
    ),
    "another format": (
        lambda d: d.update(format="stancekit/servos/2"),
        "format: expected stancekit/servos/1, got 'stancekit/servos/2'",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_calibration_file_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    change, message = REFUSED[name]
    path = tmp_path / "servos.json"
    path.write_text(json.dumps(spoil(change)))
    with pytest.raises(InvalidInput) as refused:
        Calibration.from_yaml(path, JOINTS)
    assert str(refused.value) == f"{path}: {message}"


def test_everything_wrong_with_a_calibration_file_is_said_at_once(tmp_path: Path) -> None:
    def change(data: dict[str, Any]) -> None:
        data["joints"]["LF_hip"]["id"] = data["joints"]["LF_knee"]["id"] = 1

    path = tmp_path / "servos.yaml"
    path.write_text(json.dumps(spoil(change)))
    with pytest.raises(InvalidInput) as refused:
        Calibration.from_yaml(path, JOINTS)
    assert str(refused.value).count("expected its own id, got 1, which LF_yaw has") == 2


def test_a_joint_written_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "servos.yaml"
    path.write_text("format: stancekit/servos/1\njoints:\n  a: {id: 1}\n  a: {id: 2}\n")
    with refuses("a"):
        Calibration.from_yaml(path)


def test_a_calibration_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    written = replace(nominal(JOINTS, port="port"), watchdog_s=0.3, desk=True)
    written.write(tmp_path / "servos.yaml")
    assert Calibration.from_yaml(tmp_path / "servos.yaml", JOINTS) == written


@given(st.integers(1, 4094), st.sampled_from([-1, 1]), st.floats(-1.0, 1.0))
def test_an_angle_comes_back_from_its_tick_within_half_a_tick(
    zero: int, direction: int, angle: float
) -> None:
    servo = JointServo(
        id=1, zero_tick=zero, direction=direction, lower_rad=-0.001, upper_rad=0.001, current_a=1.0
    )
    turning = ServoTicks([servo])
    ticks = turning.ticks(np.array([angle]))
    assert np.sign(ticks[0] - zero) in (0, direction * np.sign(angle))
    assert abs(turning.angles(ticks)[0] - angle) <= np.pi / 4096 + 1e-12
