"""Files that say what ROS calls the joints: what they mean, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from stancekit.planners.errors import InvalidInput
from stancekit.runner.worlds.ros.setup import Mapping, RosJoint, RosSetup, same_names
from tests.refusals import refuses

JOINTS = ("LF_yaw", "LF_hip")


def written(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "robot.yaml"
    same_names(JOINTS, estop="/e_stop").write(path)
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | changes, sort_keys=False))
    return path


def test_what_is_written_is_read(tmp_path: Path) -> None:
    setup = RosSetup(
        ros=1, port=9091, joints={"LF_yaw": RosJoint(name="j1", direction=-1, offset_rad=0.25)}
    )
    setup.write(tmp_path / "robot.yaml")
    assert RosSetup.from_yaml(tmp_path / "robot.yaml", ("LF_yaw",)) == setup


def test_angles_go_to_ros_by_direction_and_offset_and_come_back() -> None:
    joints = {
        "LF_hip": RosJoint(name="b"),
        "LF_yaw": RosJoint(name="a", direction=-1, offset_rad=0.5),
    }
    mapping = Mapping(RosSetup(joints=joints), JOINTS)
    assert mapping.names == ("a", "b")
    angles = np.array([[0.2, 0.3], [-1.0, 0.0]])
    np.testing.assert_allclose(mapping.to_ros(angles), [[0.3, 0.3], [1.5, 0.0]])
    np.testing.assert_allclose(mapping.from_ros(mapping.to_ros(angles)), angles)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"format": "stancekit/servos/1"},
            "format: expected stancekit/ros/1, got 'stancekit/servos/1'",
        ),
        ({"rso": 2}, "rso: unknown key"),
        ({"ros": 3}, "ros: expected 1 or 2, got 3"),
        ({"controller": "no slash"}, "controller: String should match"),
        ({"joints": {"LF_yaw": {"name": "a"}}}, "joints: expected joint LF_hip, got nothing"),
        ({"joints": {j: {"name": j} for j in (*JOINTS, "RF_yaw")}}, "joints: unknown joint RF_yaw"),
        (
            {"joints": {j: {"name": "a"} for j in JOINTS}},
            "joints.LF_hip.name: expected a name of its own, got a, which LF_yaw has",
        ),
        (
            {"joints": {"LF_yaw": {"name": "a", "direction": 2}, "LF_hip": {"name": "b"}}},
            "joints.LF_yaw.direction: expected -1 or 1, got 2",
        ),
    ],
)
def test_a_file_that_says_something_wrong_is_refused_with_its_place(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    path = written(tmp_path, **changes)
    with pytest.raises(InvalidInput) as refused:
        RosSetup.from_yaml(path, JOINTS)
    assert str(refused.value).startswith(f"{path}: {message}")
    assert "\n" not in str(refused.value)


def test_a_file_that_is_no_yaml_or_no_object_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    for text in ("a: [", "- 1"):
        path.write_text(text)
        with refuses(path):
            RosSetup.from_yaml(path)
