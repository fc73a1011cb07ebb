"""Robots from URDF: the largest box against brute force, and what is refused."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.leg_boxes import Workspace, largest_box
from stancekit.planners.robot.single_body import GaitRobot, anymal

LINK = '<link name="{}">{}</link>'
MASS = '<inertial><mass value="2"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial>'
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/><axis xyz="{4}"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)


def urdf(path: Path, mass: str) -> Path:
    """Three legs of three joints under a body, its links all of one mass or of none."""
    text = LINK.format("body", mass)
    for k, (x, y) in enumerate(((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2))):
        text += "".join(LINK.format(f"{part}{k}", mass) for part in ("hip", "thigh", "shank"))
        text += JOINT.format(f"a{k}", "body", f"hip{k}", f"{x} {y} 0", "1 0 0")
        text += JOINT.format(f"b{k}", f"hip{k}", f"thigh{k}", "0 0 0", "0 1 0")
        text += JOINT.format(f"c{k}", f"thigh{k}", f"shank{k}", "0 0 -.25", "0 1 0")
        text += LINK.format(f"F{k}", "") + (
            f'<joint name="f{k}" type="fixed"><parent link="shank{k}"/><child link="F{k}"/>'
            '<origin xyz="0 0 -.25"/></joint>'
        )
    path.write_text(f'<robot name="tripod">{text}</robot>')
    return path


def test_the_largest_box_is_that_of_brute_force() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        full = rng.random((4, 4, 4)) < 0.8
        full[1, 2, 1] = True
        low, high = largest_box(full, np.array([1, 2, 1]))
        spans = [[(a, b) for a in range(k + 1) for b in range(k + 1, 5)] for k in (1, 2, 1)]
        best = max(
            (bx - ax) * (by - ay) * (bz - az)
            for (ax, bx), (ay, by), (az, bz) in product(*spans)
            if full[ax:bx, ay:by, az:bz].all()
        )
        assert np.prod(high - low) == best
        assert full[low[0] : high[0], low[1] : high[1], low[2] : high[2]].all()


def test_a_robot_is_measured_from_its_urdf(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    robot = GaitRobot.from_urdf(
        urdf(tmp_path / "robot.urdf", MASS), ["F0", "F1", "F2"], [0.0, 0.5, -0.9] * 3, trunk_half_m=[0.2, 0.1, 0.05],
        workspace=Workspace(steps=20, voxel_m=0.04),
    )  # fmt: skip
    assert robot.mass_kg == pytest.approx(20.0)
    for foot in robot.feet:
        arms = np.array(list(product(*zip(foot.reach_min_m, foot.reach_max_m, strict=True)))) - foot.hip_m
        assert np.linalg.norm(arms, axis=1).max() < 0.5 + 0.07
        assert np.prod(foot.reach_max_m - foot.reach_min_m) > 0.001


def test_a_urdf_without_inertia_is_refused_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    with pytest.raises(InvalidInput, match=r"robot\.urdf: expected links with mass and inertia, got 0 kg in all"):
        GaitRobot.from_urdf(urdf(tmp_path / "robot.urdf", ""), ["F0", "F1", "F2"], [0.1] * 9, trunk_half_m=[0.2] * 3)
    with pytest.raises(InvalidInput, match=r"expected a frame 'paw', found none of that name"):
        GaitRobot.from_urdf(urdf(tmp_path / "robot.urdf", MASS), ["paw"], [0.1] * 9, trunk_half_m=[0.2] * 3)


FILE = """
urdf: robot.urdf
feet: [F0, F1, F2]
posture_rad: [0.0, 0.5, -0.9, 0.0, 0.5, -0.9, 0.0, 0.5, -0.9]
trunk_half_m: [0.2, 0.1, 0.05]
ranges_rad: [[0.3, 0.3], [0.6, 0.6], [0.6, 0.6]]
steps: 12
voxel_m: 0.04
"""


def test_a_robots_file_may_name_its_urdf(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    urdf(tmp_path / "robot.urdf", MASS)
    (tmp_path / "robot.yaml").write_text(FILE)
    robot = GaitRobot.from_yaml(tmp_path / "robot.yaml")
    assert robot.name == "tripod"
    assert robot.mass_kg == pytest.approx(20.0)
    direct = GaitRobot.from_urdf(
        tmp_path / "robot.urdf", ["F0", "F1", "F2"], [0.0, 0.5, -0.9] * 3, trunk_half_m=[0.2, 0.1, 0.05],
        workspace=Workspace(ranges_rad=[(0.3, 0.3), (0.6, 0.6), (0.6, 0.6)], steps=12, voxel_m=0.04),
    )  # fmt: skip
    for ours, theirs in zip(robot.feet, direct.feet, strict=True):
        assert ours.reach_min_m.tolist() == theirs.reach_min_m.tolist()
        assert ours.reach_max_m.tolist() == theirs.reach_max_m.tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("steps: 12", "wings: 2"), "wings: unknown key"),
        (("steps: 12", "steps: many"), r"steps: expected a whole number in \[2, 200\], got 'many'"),
        (("feet: [F0, F1, F2]", "feet: 3"), "feet: expected names of frames, got 3"),
        (("posture_rad: [0.0,", "posture_rad: [0.0, 0.0,"), "posture: expected 9 joint angles, got 10"),
        (("robot.urdf", "none.urdf"), r".*none\.urdf: expected a URDF file, found nothing there"),
    ],
)
def test_a_file_that_names_a_urdf_says_what_is_wrong_with_it(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    pytest.importorskip("pinocchio")
    urdf(tmp_path / "robot.urdf", MASS)
    (tmp_path / "robot.yaml").write_text(FILE.replace(*change))
    with pytest.raises(InvalidInput, match=rf"robot\.yaml: {message}"):
        GaitRobot.from_yaml(tmp_path / "robot.yaml")


def test_anymal_is_the_robot_of_the_paper_and_bad_files_say_all_that_is_wrong(tmp_path: Path) -> None:
    robot = anymal()
    assert robot.mass_kg == pytest.approx(30.475)
    assert robot.foot_names == ("LF", "RF", "LH", "RH")
    for foot in robot.feet:
        assert foot.nominal_m[2] == pytest.approx(-robot.stand_height_m)
    bad = tmp_path / "robot.yaml"
    bad.write_text("name: x\nwings: 2\n")
    with pytest.raises(
        InvalidInput, match=r"robot\.yaml: mass_kg: expected this key, got nothing; .*wings: unknown key"
    ):
        GaitRobot.from_yaml(bad)
