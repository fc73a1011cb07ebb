"""Actuators: files say which joint has which, in one line where they do not; a URDF says less than
a data sheet.
"""

from pathlib import Path

import pytest

from stancekit.planners.robot.leg import (
    ActuatorModel,
    Actuators,
    Joint,
    builtin_actuators,
    read_actuators,
)
from tests.refusals import refuses

FILE = """
format: stancekit/actuators/1
actuators:
  strong: {stall_nm: 80, continuous_nm: 40, no_load_rad_s: 12, gear: 9, rotor_kg_m2: 1.0e-4}
joints: {"*_knee": strong, "*": XM430-W350}
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "actuators.yaml"
    path.write_text(text)
    return path


def test_the_first_pattern_that_fits_says_what_turns_a_joint(tmp_path: Path) -> None:
    hip, knee = read_actuators(written(tmp_path, FILE)).of(["LF_hip", "LF_knee"])
    assert (hip.stall_nm, knee.stall_nm) == (4.1, 80.0)
    assert knee.reflected_kg_m2 == pytest.approx(81e-4)
    assert hip.reflected_kg_m2 is None


def test_a_name_is_of_all_joints_and_none_of_those_here_bears_its_stall_torque_for_long() -> None:
    for name, actuator in builtin_actuators().items():
        assert read_actuators(name).of(["a", "b"]) == (actuator, actuator)
        assert actuator.continuous_nm is not None
        assert actuator.continuous_nm == pytest.approx(actuator.stall_nm / 5.0)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (("stancekit/actuators/1", "stancekit/servos/1"), "format"),
        (("continuous_nm: 40", "continuous_nm: 90"), "actuators.strong.continuous_nm"),
        (("stall_nm: 80", "stall_nm: -1"), "actuators.strong.stall_nm"),
        (("gear: 9", "gears: 9"), "actuators.strong.gears"),
        (("XM430-W350", "XM430"), "joints.*"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_with_its_key(
    tmp_path: Path, change: tuple[str, str], name: str
) -> None:
    assert change[0] in FILE
    with refuses("actuators.yaml", name):
        read_actuators(written(tmp_path, FILE.replace(*change)))


def test_joints_without_an_actuator_and_patterns_of_no_joint_are_refused() -> None:
    with refuses("actuators", "joints"):
        Actuators(joints={"*_knee": "XM540-W270"}).of(["LF_hip", "LF_knee"])
    with refuses("actuators", "*_ankle"):
        Actuators(joints={"*_ankle": "XM540-W270", "*": "XM540-W270"}).of(["LF_hip"])
    with refuses("actuators", "XM"):
        read_actuators("XM")


def test_a_urdf_says_effort_and_velocity_and_nothing_of_heat() -> None:
    joint = Joint(name="j", lower_rad=-1.0, upper_rad=1.0, torque_nm=40.0, velocity_rad_s=7.5)
    own = ActuatorModel.of_joint(joint)
    assert (own.stall_nm, own.no_load_rad_s, own.curve, own.continuous_nm) == (
        40.0,
        7.5,
        "flat",
        None,
    )
