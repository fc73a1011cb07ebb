"""MJCF: the robot that MuJoCo compiles, and the same one written as links and joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.mjcf import Mjcf, read_mjcf
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.walker import no_motors
from tests.planners.robot import small_urdfs

TORQUES = {
    "ctrl": ('<motor joint="{j}" ctrlrange="-20 20" gear="2"/>', 40.0),
    "force": ('<motor joint="{j}" ctrlrange="-90 90" forcerange="-12 15"/>', 12.0),
    "servo": ('<position joint="{j}" kp="50" ctrlrange="-1 1"/>', 0.0),
    "servo-force": ('<position joint="{j}" kp="50" forcerange="-9 9"/>', 9.0),
    "two": ('<motor joint="{j}" ctrlrange="-3 3"/><motor joint="{j}" ctrlrange="-4 4"/>', 7.0),
    "one-open": ('<motor joint="{j}" ctrlrange="-3 3"/><motor joint="{j}"/>', 0.0),
    "pull": ('<motor joint="{j}" ctrlrange="0 5"/>', 0.0),
    "none": ("", 0.0),
}
"""Drives of a joint, and the torque that they have together [Nm], by hand."""


def quadruped(
    *,
    knee: str = 'range="-2.6 -0.4"',
    drive: str = '<motor joint="{j}" ctrlrange="-30 30"/>',
    base: str = "<freejoint/>",
    more: str = "",
    world: str = "",
    trunk: str = "",
) -> str:
    """A quadruped, with degrees of freedom for what a test is about.

    Arguments:
        knee: attributes of its knees.
        drive: drives of every joint.
        base: joints of its trunk.
        more, world, trunk: elements of the file, of the world and of the trunk.
    """
    legs, drives = "", ""
    for name, x, y in (("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)):
        legs += f"""
        <body name="{name}_hip" pos="{x} {y} 0">
          <inertial pos="0 0 0" mass="0.5" diaginertia="6e-4 5e-4 4e-4"/>
          <joint name="{name}_haa" axis="1 0 0" range="-0.8 0.8"/>
          <body name="{name}_thigh" pos="0 {0.08 * np.sign(y)} 0" euler="0 0 0.02">
            <joint name="{name}_hfe" axis="0 1 0" range="-1.5 2.5" pos="0 0 0.01"/>
            <geom type="capsule" fromto="0 0 -.02 0 0 -.18" size="0.02" density="900"/>
            <body name="{name}_shank" pos="0 0 -0.2">
              <joint name="{name}_kfe" axis="0 1 0" {knee}/>
              <geom type="cylinder" fromto="0 0 0 0 0 -.19" size="0.012" density="900"/>
              <geom name="{name}_foot" type="sphere" pos="0 0 -0.2" size="0.02" mass="0.05"/>
            </body>
          </body>
        </body>"""
        drives += "".join(drive.format(j=f"{name}_{joint}") for joint in ("haa", "hfe", "kfe"))
    stand = " ".join(["0 0.8 -1.5"] * 4)
    return f"""<mujoco model="made"><compiler angle="radian"/>
      <worldbody>{world}
        <body name="trunk" pos="0 0 0.33">{base}
          <geom type="box" size="0.25 0.08 0.05" mass="6"/>{trunk}{legs}
        </body>
      </worldbody>
      <actuator>{drives}</actuator>
      {more.format(stand=stand)}
    </mujoco>"""


STANDS = '<keyframe><key name="home" qpos="0 0 .33 1 0 0 0 {stand}"/></keyframe>'


def read(text: str, folder: Path) -> RobotModel:
    """The robot of a text."""
    (folder / "robot.xml").write_text(text)
    return named_robot(folder / "robot.xml")


def remarks(model: RobotModel) -> str:
    """All that was remarked."""
    return "\n".join((*model.guesses, *model.doubts))


def worst_difference(path: Path, mjcf: Mjcf, rng: np.random.Generator) -> float:
    """The largest difference of mass, centre of mass and its Jacobian between MuJoCo's model of a
    file and pinocchio's of the URDF, at five postures.
    """
    theirs = mujoco.MjModel.from_xml_path(str(path))
    ours = pin.buildModelFromXML(mjcf.urdf, pin.JointModelFreeFlyer())
    data, seen, worst = ours.createData(), mujoco.MjData(theirs), 0.0
    base = next(b for b in range(theirs.nbody) if theirs.body(b).name == ours.frames[2].name)
    for _ in range(5):
        mujoco.mj_resetData(theirs, seen)
        q, columns = pin.neutral(ours), []
        for j in range(2, ours.njoints):
            joint, angle = theirs.joint(ours.names[j]), rng.uniform(-1.0, 1.0)
            seen.qpos[joint.qposadr[0]] = theirs.qpos0[joint.qposadr[0]] + angle
            at = ours.joints[j].idx_q
            q[at : at + ours.joints[j].nq] = (
                angle if ours.joints[j].nq == 1 else (np.cos(angle), np.sin(angle))
            )
            columns.append((joint.dofadr[0], ours.joints[j].idx_v))
        mujoco.mj_kinematics(theirs, seen)
        mujoco.mj_comPos(theirs, seen)
        turn = seen.xmat[base].reshape(3, 3)
        jacobian = np.zeros((3, theirs.nv))
        mujoco.mj_jacSubtreeCom(theirs, seen, jacobian, base)
        com = turn.T @ (seen.subtree_com[base] - seen.xpos[base])
        mine = pin.jacobianCenterOfMass(ours, data, q)
        worst = max(worst, float(np.abs(com - pin.centerOfMass(ours, data, q)).max()))
        worst = max(
            worst, *(np.abs(turn.T @ jacobian[:, a] - mine[:, b]).max() for a, b in columns)
        )
    mass = sum(inertia.mass for inertia in ours.inertias)
    return max(worst, abs(float(theirs.body_subtreemass[base]) - mass))


def test_the_robot_is_the_one_that_mujoco_compiles(tmp_path: Path) -> None:
    tail = """<body name="tail" pos="-0.3 0 0"><joint name="up" axis="0 1 0" pos="0 0 .01" range="-1 1"/>
      <joint name="side" axis="0 0 1" pos="0 .02 0" range="-1 1" ref="0.3"/>
      <geom type="ellipsoid" size="0.05 0.02 0.03" mass="0.2"/></body>"""
    (tmp_path / "robot.xml").write_text(quadruped(trunk=tail, more=STANDS.replace("{", "0 0.3 {")))
    mjcf = read_mjcf(tmp_path / "robot.xml")
    assert worst_difference(tmp_path / "robot.xml", mjcf, np.random.default_rng(0)) < 1e-12
    model = named_robot(tmp_path / "robot.xml")
    assert model.leg_names == ("FL", "FR", "RL", "RR")
    assert [leg.radius_m for leg in model.legs] == [0.02] * 4
    np.testing.assert_allclose(model.legs[3].stance_rad, [0.0, 0.8, -1.5])
    assert "key frame home" in remarks(model)
    assert "joint side" in remarks(model)  # its angles are from ref on


@pytest.mark.parametrize("name", ["humanoid.xml", "ant.xml"])
def test_robots_of_gymnasium_are_those_that_mujoco_compiles(name: str) -> None:
    import gymnasium

    path = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / name
    mjcf = read_mjcf(path)
    if name == "humanoid.xml":
        assert worst_difference(path, mjcf, np.random.default_rng(1)) < 1e-12
    model = named_robot(path)
    assert [len(leg.joints) for leg in model.legs] == ([4, 4] if "hum" in name else [2] * 4)
    assert ("abdomen_z held" in remarks(model)) == (name == "humanoid.xml")


@pytest.mark.parametrize("name", TORQUES)
def test_torques_are_what_the_drives_of_a_joint_have_together(name: str, tmp_path: Path) -> None:
    drive, torque = TORQUES[name]
    model = read(quadruped(drive=drive), tmp_path)
    assert [joint.torque_nm for leg in model.legs for joint in leg.joints] == [torque] * 12
    assert ("torque limit" in remarks(model)) == (torque == 0.0)


def test_a_joint_s_own_limit_of_force_holds_beside_its_drive_s(tmp_path: Path) -> None:
    model = read(quadruped(knee='range="-2.6 -.4" actuatorfrcrange="-11 11"'), tmp_path)
    assert [joint.torque_nm for joint in model.legs[0].joints] == [30.0, 30.0, 11.0]


def test_what_stands_in_a_scene_is_left_out_and_said(tmp_path: Path) -> None:
    pair = '<contact><pair geom1="floor" geom2="FL_foot"/></contact>'
    door = '<body name="door"><joint axis="0 0 1"/><geom size=".1" type="sphere"/></body>'
    mesh = '<geom type="mesh" mesh="hull" contype="0" conaffinity="0"/>'
    text = quadruped(more=pair + '<asset><mesh name="hull" file="gone.stl"/></asset>', trunk=mesh)
    model = read(text.replace("<worldbody>", f"<worldbody>{door}"), tmp_path)
    assert model.mass_kg == pytest.approx(read(quadruped(), tmp_path).mass_kg)
    assert "without door" in remarks(model)
    assert "mesh hull" in remarks(model)


@pytest.mark.parametrize(
    ("key", "stands"),
    [
        ('name="home" qpos="0 0 5 1 0 0 0 {stand}"', True),
        ('name="hop" qpos="0 0 5 1 0 0 0 {stand}"', False),
        ('name="home" qpos="0 0 .3 .7 .7 0 0 {stand}"', False),
        ('name="home" qpos="0 0 .3 1 0 0 0 0 3 -.4 0 3 -.4 0 3 -.4 0 3 -.4"', False),
    ],
)
def test_a_key_frame_in_which_the_robot_does_not_stand_is_dropped_and_named(
    key: str, stands: bool, tmp_path: Path
) -> None:
    model = read(quadruped(more=f"<keyframe><key {key}/></keyframe>"), tmp_path)
    assert (abs(model.legs[0].stance_rad[1] - 0.8) < 1e-9) == stands
    assert ("home" in remarks(model)) or ("hop" in remarks(model))


def one_leg(text: str) -> str:
    """The robot as an arm, on a base that does not move."""
    first = text.index('<body name="FR_hip"')
    last = text.rindex("</body>\n      </worldbody>")
    drives = text[text.index("<actuator>") : text.index("</actuator>")]
    return (text[:first] + text[last:]).replace(drives, "<actuator>")


REFUSED: dict[str, tuple[str, tuple[str, ...]]] = {
    "a-plane": (
        quadruped(base='<joint name="rootx" type="slide" axis="1 0 0"/>'),
        ("trunk", "rootx", "plane"),
    ),
    "a-ball": (
        quadruped(
            trunk='<body name="head"><joint name="neck" type="ball"/><geom size=".1"/></body>'
        ),
        ("neck",),
    ),
    "no-robot": (
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>',
        ("robot",),
    ),
    "two": (
        quadruped().replace(
            "</worldbody>",
            '<body name="other"><freejoint/><geom size=".1"/>'
            + "".join(
                f'<body><joint name="o{i}" axis="0 1 0"/><geom size=".1"/></body>' for i in range(8)
            )
            + "</body></worldbody>",
        ),
        ("trunk", "other"),
    ),
    "not-xml": ("<mujoco", ("MJCF",)),
    "nan": (quadruped(knee='range="-2 nan"'), ("MJCF", "NaN")),
    "no-such-joint": (quadruped(drive='<motor joint="none"/>'), ("none",)),
    "copies": (
        quadruped(
            more='<worldbody><replicate count="99999999"><geom size=".1"/></replicate></worldbody>'
        ),
        ("replicate",),
    ),
    "keys": (quadruped(more='<size nkey="2000000000"/>'), ("size",)),
    "in-itself": (quadruped(more='<asset><model file="robot.xml"/></asset>'), ("model",)),
    "elements": (quadruped(more="<!-- --><custom/>" * 60_000), ("elements",)),
    "entities": ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', ("MJCF",)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_robot_with_legs_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    text, named = REFUSED[name]
    with pytest.raises(InvalidInput) as refused:
        read(text, tmp_path)
    said = str(refused.value)
    assert "\n" not in said
    assert "robot.xml" in said
    assert all(word in said for word in named), said


@pytest.mark.parametrize(
    ("more", "gap"),
    [
        (
            '<equality><connect body1="FL_shank" body2="FR_shank" anchor="0 0 0"/></equality>',
            "tied",
        ),
        ('<equality><joint joint1="FL_kfe" joint2="FR_kfe"/></equality>', "FL_kfe"),
    ],
)
def test_bodies_that_are_tied_are_no_tree(more: str, gap: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refused:
        read(quadruped(more=more), tmp_path).check_known()
    assert gap in str(refused.value)


def test_pairs_that_never_meet_are_never_looked_at(tmp_path: Path) -> None:
    more = '<contact><exclude body1="FL_shank" body2="RR_shank"/></contact>'
    pairs = read(quadruped(more=more), tmp_path).disabled_pairs
    assert frozenset(("FL_shank", "RR_shank")) in pairs
    assert frozenset(("FL_shank", "RL_shank")) not in pairs


def test_a_urdf_in_an_xml_file_is_one(tmp_path: Path) -> None:
    again = read(read(quadruped(), tmp_path).urdf, tmp_path)
    assert again.leg_names == ("FL", "FR", "RL", "RR")
    assert again.mass_kg == pytest.approx(read(quadruped(), tmp_path).mass_kg)


def test_mutated_files_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    text, rng, refused = quadruped(more=STANDS), np.random.default_rng(7), 0
    for _ in range(60):
        letters = list(text)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(letters)))
            change: Any = rng.choice(["", "9", "-", '"', "<", "e", " "])
            letters[at] = str(change)
        said = ""
        try:
            read("".join(letters), tmp_path)
        except InvalidInput as error:
            said = str(error)
        refused += bool(said)
        assert "\n" not in said
    assert refused > 5


def test_one_chain_of_joints_is_no_robot_with_legs(tmp_path: Path) -> None:
    model = read(one_leg(quadruped(base="")), tmp_path)
    with pytest.raises(InvalidInput) as refused:
        model.check_known()
    assert "legs: " in str(refused.value)


def test_a_straight_posture_is_bent_at_the_knees_and_rotors_are_the_file_s(tmp_path: Path) -> None:
    straight = STANDS.replace("{stand}", " ".join(["0 0 -.01"] * 4))
    text = quadruped(knee='range="-2.6 0.1" armature=".02"', more=straight)
    model = read(text, tmp_path)
    np.testing.assert_allclose([leg.stance_rad[2] for leg in model.legs], -0.6, atol=0.1)
    np.testing.assert_allclose(model.rotors_kg_m2, [model.drive[2], model.drive[2], 0.02] * 4)
    assert all(text in remarks(model) for text in ("key frame home", "no velocity limit"))
    assert "velocity limit" in no_motors(model)
    assert model.unrunnable == ()


def test_one_robot_in_two_files_is_one_robot(tmp_path: Path) -> None:
    urdf = small_urdfs.quadruped(bone='<box size=".04 .04 .1"/>')
    (tmp_path / "robot.urdf").write_text(urdf)
    spec = mujoco.MjSpec.from_string(urdf)  # MuJoCo's own conversion, which makes the trunk a world
    spec.compile()
    trunk = (
        '<body name="base"><freejoint/><inertial pos="0 0 0" mass="10" diaginertia=".01 .01 .01"/>'
    )
    text = spec.to_xml().replace("<worldbody>", f"<worldbody>{trunk}")
    one = read(text.replace("</worldbody>", "</body></worldbody>"), tmp_path)
    two = named_robot(tmp_path / "robot.urdf")
    assert (one.leg_names, one.joint_names) == (two.leg_names, two.joint_names)
    assert one.stand_height_m == pytest.approx(two.stand_height_m, abs=1e-6)
    np.testing.assert_allclose(one.inertia_kgm2, two.inertia_kgm2, atol=1e-6)
    for mine, theirs in zip(one.legs, two.legs, strict=True):
        np.testing.assert_allclose(mine.nominal_m, theirs.nominal_m, atol=1e-6)
        np.testing.assert_array_equal(mine.torque_nm, theirs.torque_nm)
        assert mine.radius_m == pytest.approx(theirs.radius_m)
