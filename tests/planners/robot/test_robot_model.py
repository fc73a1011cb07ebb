"""Robots from URDF without a word of configuration, joints by name, corrections, and what is
refused.
"""

from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M, Servo, hexapod_model, named_robot
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.robot.urdf_reader import JointCorrection
from tests.planners.robot.link_frames import link_frames
from tests.planners.robot.small_urdfs import (
    HIPS,
    LIMITS,
    fixed,
    joint,
    leg,
    limit,
    link,
    quadruped,
    robot,
    small,
)
from tests.refusals import refuses

pin = pytest.importorskip("pinocchio")

NAMES = [f"{name}_{part}" for name in HIPS for part in LIMITS]
ORDERS = [
    ("LF", "RF", "LH", "RH"),
    ("RH", "LF", "RF", "LH"),
    ("LH", "RH", "RF", "LF"),
    ("RF", "LF", "RH", "LH"),
]


def texts(model: RobotModel, kind: str) -> list[str]:
    return list(model.guesses if kind == "guess" else model.doubts)


def test_the_hexapods_urdf_agrees_with_the_hexapod() -> None:
    model, robot_, servo = hexapod_model(), hexapod(), Servo()
    assert model.name == robot_.name
    assert model.leg_names == robot_.limb_names
    assert model.mass_kg == pytest.approx(robot_.mass_kg, rel=1e-9)
    assert model.guesses == model.doubts == ()
    for each, limb in zip(model.legs, robot_.limbs, strict=True):
        np.testing.assert_allclose(each.hip_m, limb.shoulder_m, atol=1e-9)
        assert each.radius_m == FOOT_RADIUS_M
        assert limb.reach_m < each.chain.length_m < 1.1 * limb.reach_m
        np.testing.assert_allclose(each.lower_rad, servo.lower_rad)
        np.testing.assert_allclose(each.upper_rad, servo.upper_rad)
        np.testing.assert_allclose(each.torque_nm, servo.torque_nm)


def test_its_feet_are_those_of_the_kinematics_that_plans_use() -> None:
    model, angles = hexapod_model(), np.random.default_rng(0).uniform(-0.5, 0.9, 24)
    feet = [
        each.chain.feet(angles[None, 4 * i : 4 * i + 4])[0] for i, each in enumerate(model.legs)
    ]
    np.testing.assert_allclose(feet, Kinematics(hexapod()).feet(angles), atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_joints_are_right_by_name_in_any_order_of_limbs(order: tuple[str, ...]) -> None:
    model = model_of(quadruped(order))
    assert model.leg_names == order
    known = pin.buildModelFromXML(quadruped())  # another order, so only names can be right
    data, q = known.createData(), pin.neutral(known)
    said = {
        name: np.random.default_rng(ord(name[0]) + ord(name[1])).uniform(-0.5, 0.5, 3)
        for name in HIPS
    }
    for name, angles in said.items():
        for part, angle in zip(("HAA", "HFE", "KFE"), angles, strict=True):
            q[known.joints[known.getJointId(f"{name}_{part}")].idx_q] = angle
    pin.framesForwardKinematics(known, data, q)
    for each in model.legs:
        assert each.joint_names == tuple(f"{each.name}_{part}" for part in ("HAA", "HFE", "KFE"))
        foot = each.chain.feet(said[each.name][None])[0]
        np.testing.assert_allclose(
            foot, data.oMf[known.getFrameId(f"{each.name}_FOOT")].translation, atol=1e-12
        )


def test_every_order_of_limbs_gives_the_same_legs() -> None:
    first = model_of(quadruped())
    for order in permutations(HIPS):
        model = model_of(quadruped(order))
        assert model.leg_names == order
        for each in model.legs:
            twin = first.leg(each.name)
            np.testing.assert_array_equal(each.nominal_m, twin.nominal_m)
            assert each.joints == twin.joints


def test_legs_and_feet_are_found_and_the_guess_is_marked() -> None:
    arm = [joint(f"arm_{i}", ("base", "arm0", "arm1")[i], f"arm{i}", "0 0 .2") for i in range(3)]
    model = model_of(
        robot([*(link(f"arm{i}") for i in range(3)), *arm, *(leg(name) for name in HIPS)])
    )
    assert model.leg_names == tuple(HIPS)
    assert [each.foot for each in model.legs] == [f"{name}_FOOT" for name in HIPS]
    assert [each.radius_m for each in model.legs] == [0.02] * 4
    assert texts(model, "guess")[0].startswith(
        "legs and feet, by their shape and names: LF (LF_FOOT), RF (RF_FOOT)"
    )
    assert texts(model, "guess")[1] == "posture to stand in, of LF, RF, LH, RH"
    assert model.mass_kg == pytest.approx(10.0 + 3.0 + 4 * 3.1)
    for each in model.legs:
        assert np.all((each.lower_rad <= each.stance_rad) & (each.stance_rad <= each.upper_rad))
        assert -0.55 < each.nominal_m[2] < -0.3


def test_centre_of_mass_and_inertia_are_those_of_the_links() -> None:
    model = model_of(quadruped())
    known = pin.buildModelFromXML(model.urdf, pin.JointModelFreeFlyer())
    q = pin.neutral(known)
    for each in model.legs:
        for name, angle in zip(each.joint_names, each.stance_rad, strict=True):
            q[known.joints[known.getJointId(name)].idx_q] = angle
    np.testing.assert_allclose(
        model.com_m, pin.centerOfMass(known, known.createData(), q), atol=1e-12
    )
    assert np.linalg.eigvalsh(model.inertia_kgm2)[0] > 0.0


def test_links_are_where_pinocchio_has_them() -> None:
    model = model_of(quadruped(("RH", "LF", "LH", "RF")))
    rng = np.random.default_rng(3)
    angles = [each.random_angles(1, rng)[0] for each in model.legs]
    known = pin.buildModelFromXML(model.urdf)
    data, q = known.createData(), pin.neutral(known)
    for each, posture in zip(model.legs, angles, strict=True):
        for name, angle in zip(each.joint_names, posture, strict=True):
            q[known.joints[known.getJointId(name)].idx_q] = angle
    pin.framesForwardKinematics(known, data, q)
    frames = link_frames(model, angles)
    assert len(frames) == 17
    for name, (turn, place) in frames.items():
        theirs = data.oMf[known.getFrameId(name)]
        np.testing.assert_allclose(place, theirs.translation, atol=1e-12)
        np.testing.assert_allclose(turn, theirs.rotation, atol=1e-12)


def test_corrections_are_written_into_the_urdf_and_bind_whoever_reads_it() -> None:
    joints = {
        "*_KFE": JointCorrection(limits_rad=(-2.0, -0.5)),
        "RH_KFE": JointCorrection(torque_nm=12.5),
    }
    model = model_of(quadruped(), joints=joints)
    known = pin.buildModelFromXML(model.urdf)
    for name in HIPS:
        knee = model.leg(name).joints[2]
        assert (knee.lower_rad, knee.upper_rad) == (-2.0, -0.5)
        assert knee.torque_nm == (12.5 if name == "RH" else 40.0)
        assert known.lowerPositionLimit[known.joints[known.getJointId(knee.name)].idx_q] == -2.0
    assert model.digest != model_of(quadruped()).digest


def test_an_srdf_says_how_to_stand_and_which_links_may_touch() -> None:
    state = "".join(
        f'<joint name="{name}_{part}" value="{value}"/>'
        for name in HIPS
        for part, value in zip(LIMITS, (0.1, 0.6, -1.2), strict=True)
    )
    srdf = (
        f'<robot name="q"><group_state name="standing" group="all">{state}</group_state>'
        '<disable_collisions link1="base" link2="LF_THIGH" reason="Never"/></robot>'
    )
    model = model_of(quadruped(), srdf=srdf)
    np.testing.assert_allclose([each.stance_rad for each in model.legs], [[0.1, 0.6, -1.2]] * 4)
    assert model.disabled_pairs == {frozenset(("base", "LF_THIGH"))}
    assert texts(model, "guess")[1] == "posture to stand in, from the SRDF: standing"


@pytest.mark.parametrize(
    ("far_m", "ball", "foot"),
    [(0.5, False, "LF_FOOT"), (1.1, False, "LF_PROBE"), (1.1, True, "LF_FOOT")],
)
def test_a_link_called_foot_is_one_unless_another_goes_three_times_as_far_and_nothing_is_a_ball(
    far_m: float, ball: bool, foot: str
) -> None:
    probe = link("LF_PROBE") + fixed("LF_PROBED", "LF_SHANK", "LF_PROBE", f"0 0 {-far_m}")
    text = robot([leg("LF") + probe, *(leg(name) for name in list(HIPS)[1:])])
    shape = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'
    assert model_of(text if ball else text.replace(shape, "")).leg("LF").foot == foot


def test_numbers_that_are_hard_to_believe_are_marked() -> None:
    assert texts(model_of(quadruped(effort=0.0)), "doubt") == [
        f"joints {', '.join(NAMES)}: no torque limit"
    ]
    many = model_of(quadruped(effort=1000.0, mass=0.1))
    assert texts(many, "doubt") == [f"joints {', '.join(NAMES)}: a torque limit of 1000 Nm"]
    turning = model_of(quadruped().replace('lower="-2.4" upper="-0.3"', 'lower="-10" upper="10"'))
    knees = ", ".join(f"{name}_KFE" for name in HIPS)
    assert texts(turning, "doubt") == [
        f"joints {knees}: turns freely, its limits are a whole turn apart or more"
    ]
    assert [each.turns.tolist() for each in turning.legs] == [[False, False, True]] * 4


def test_meshes_are_found_by_package_and_missing_ones_are_marked(tmp_path: Path) -> None:
    folder = tmp_path / "share" / "my_robot" / "urdf"
    folder.mkdir(parents=True)
    trimesh.creation.box((6.0, 2.5, 1.0)).export(tmp_path / "share" / "my_robot" / "trunk.stl")
    text = quadruped().replace(
        '<sphere radius="0.02"/>', '<mesh filename="package://gone/foot.dae"/>'
    )
    text = text.replace(
        '<box size="0.6 0.25 0.1"/>',
        '<mesh filename="package://my_robot/trunk.stl" scale=".1 .1 .1"/>',
    )
    (folder / "robot.urdf").write_text(text)
    model = named_robot(folder / "robot.urdf")
    trunk = next(shape for shape in model.shapes if shape.link == "base")
    assert trunk.mesh == (tmp_path / "share" / "my_robot" / "trunk.stl").resolve()
    assert trunk.size_m.tolist() == [0.1, 0.1, 0.1]
    where = "a YAML file's packages: say where package:// leads"
    feet = ", ".join(f"{name}_FOOT" for name in HIPS)
    unknown = "touches with a mesh that cannot be had: say with which point or ball, in a YAML file's contacts:"
    assert texts(model, "doubt") == [
        f"links {feet}: {unknown}",
        f"mesh package://gone/foot.dae: no such file, not drawn; {where}",
    ]


def test_meshes_are_found_in_a_folder_that_was_copied_out_of_its_package(tmp_path: Path) -> None:
    folder = tmp_path / "my_robot" / "urdf"
    folder.mkdir(parents=True)
    trimesh.creation.box((6.0, 2.5, 1.0)).export(tmp_path / "my_robot" / "trunk.stl")
    mesh = '<mesh filename="package://all-robots/robots/my_robot/trunk.stl" scale=".1 .1 .1"/>'
    (folder / "robot.urdf").write_text(quadruped().replace('<box size="0.6 0.25 0.1"/>', mesh))
    model = named_robot(folder / "robot.urdf")
    trunk = next(shape for shape in model.shapes if shape.link == "base")
    assert trunk.mesh == (tmp_path / "my_robot" / "trunk.stl").resolve()
    assert texts(model, "doubt") == []


def test_names_with_quotes_stay_as_they_are() -> None:
    text = (
        quadruped()
        .replace("LF_", "L&quot;F&apos;&lt;_")
        .replace("quadruped", "O&apos;Dog &quot;1&quot;")
    )
    model = model_of(text)
    assert model.name == 'O\'Dog "1"'
    assert model.leg_names[0] == "L\"F'<"
    assert model.legs[0].joint_names[0] == "L\"F'<_HAA"


TWO_FEET = robot(
    [link(name) for name in ("waist", "la", "lb", "lc", "ra", "rb", "rc")]
    + [joint("waist_yaw", "base", "waist", axis="0 0 1")]
    + [
        joint(f"{s}{k}", p, f"{s}{k}", f"0 {y} {z}")
        for s, y in (("l", 0.2), ("r", -0.2))
        for k, p, z in (("a", "waist", 0), ("b", f"{s}a", -0.3), ("c", f"{s}b", -0.3))
    ]
)


def snake(last: int) -> str:
    """One chain of joints, the first of which is number 0."""
    names = ["base", *(f"t{k}" for k in range(last + 1))]
    links = [link(name) for name in names[1:]]
    return robot(
        [*links, *(joint(f"j{k}", *pair, "0 0 -.01") for k, pair in enumerate(pairwise(names)))]
    )


FIXED = robot([link("a"), link("b"), fixed("f", "base", "a"), fixed("g", "a", "b")])
MAST = robot(
    [
        link("low"),
        link("high"),
        link("top"),
        joint("turn", "base", "low", "0 0 .1", "0 0 1"),
        joint("bend", "low", "high", "0 0 .3"),
        fixed("f", "high", "top", "0 0 .3"),
    ]
)
MIMIC = quadruped().replace(
    '<limit lower="-2.4"', '<mimic joint="LF_HFE" multiplier="-2"/><limit lower="-2.4"', 1
)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (quadruped(mass=0.0), {}, "expected links with mass and inertia, got 0 kg in all"),
        (FIXED, {}, "legs: expected chains of two joints or more under the base, found none"),
        (MAST, {}, "legs: expected chains of joints that reach below the base, found none"),
        (
            FIXED,
            {"feet": ["b"]},
            "feet: expected joints between the base and 'b', all of them are fixed",
        ),
        (MIMIC, {}, "joint 'LF_KFE': expected a joint of its own, it mimics LF_HFE"),
        (
            quadruped(),
            {"feet": ["LF_FOOT", "LF_SHANK"]},
            "feet: expected one foot a leg, joint 'LF_HAA' carries LF_FOOT and LF_SHANK",
        ),
        (
            quadruped(),
            {"feet": ["paw"]},
            "feet: expected a link (base, LF_HIP, LF_THIGH, LF_SHANK, LF_FOOT, LH_HIP, LH_THIGH, LH_SHANK, LH_FOOT, "
            "RF_HIP, RF_THIGH, RF_SHANK, …), found none that is called 'paw'",
        ),
        (
            quadruped(),
            {"joints": {"LF_KNEE": JointCorrection(torque_nm=2.0)}},
            "joints: expected one of LF_HAA, LF_HFE, LF_KFE, RF_HAA, RF_HFE, RF_KFE, LH_HAA, LH_HFE, LH_KFE, RH_HAA, "
            "RH_HFE, RH_KFE, got 'LF_KNEE'",
        ),
        (
            quadruped(),
            {"posture_rad": {"LF_TOE": 1.0}},
            "posture_rad: expected one of LF_HAA, LF_HFE, LF_KFE, RF_HAA, RF_HFE, RF_KFE, LH_HAA, LH_HFE, LH_KFE, RH_HAA, "
            "RH_HFE, RH_KFE, got 'LF_TOE'",
        ),
        (
            quadruped().replace('lower="-0.7"', 'lower="-0.7."'),
            {},
            "joint LF_HAA: lower: expected a number, got '-0.7.'",
        ),
        (snake(150), {}, "expected 500 joints or fewer, 150 of which move, got 151 and 151"),
        (snake(24), {"feet": ["t24"]}, "leg 't24': expected 24 joints or fewer, got 25"),
        ("<robot", {}, "expected a URDF: unclosed token: line 1, column 0"),
        ("<sdf/>", {}, "expected a URDF: expected a robot, got 'sdf'"),
        (
            quadruped().replace('radius="0.02"', 'radius="wide"'),
            {},
            "link 'LF_FOOT': sphere: expected 1 numbers, got 'wide'",
        ),
        (
            quadruped().replace('sphere radius="0.02"', 'capsule radius="0.02" length="-0.06"', 1),
            {},
            "link 'LF_FOOT': capsule: expected sizes of 0 or more, got -0.06",
        ),
    ],
)
def test_what_is_wrong_is_one_line(text: str, options: dict, message: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        model_of(text, where="my.urdf", **options)
    assert str(caught.value) == f"my.urdf: {message}"


def test_a_yaml_file_names_a_urdf_and_corrects_it(tmp_path: Path) -> None:
    (tmp_path / "q.urdf").write_text(quadruped())
    (tmp_path / "q.yaml").write_text(
        "urdf: q.urdf\nname: dog\nfeet: {FL: LF_FOOT, FR: RF_FOOT, HL: LH_FOOT}\n"
        "joints:\n  '*_HAA': {limits_rad: [-0.3, 0.3]}\nposture_rad: {'*_HAA': 0.0, '*_HFE': 0.6, '*_KFE': -1.2}\n"
    )
    model = named_robot(tmp_path / "q.yaml")
    assert model.name == "dog"
    assert model.leg_names == ("FL", "FR", "HL")
    assert model.legs[0].joint_names == ("LF_HAA", "LF_HFE", "LF_KFE")
    assert model.legs[2].upper_rad[0] == 0.3
    assert model.legs[1].stance_rad.tolist() == [0.0, 0.6, -1.2]
    (held,) = model.guesses  # of a leg that the file does not name
    assert not model.doubts
    assert "RH_KFE held at -0.3" in held


def test_a_robot_that_lies_on_its_side_is_put_upright(tmp_path: Path) -> None:
    lying = quadruped().replace('<link name="base">', '<link name="base0"/><link name="base">', 1)
    lying = lying.replace("</robot>", fixed("side", "base0", "base") + "</robot>")
    lying = lying.replace(
        '<child link="base"/><origin xyz="0 0 0"/>', '<child link="base"/><origin rpy="1.5 .1 0"/>'
    )
    (tmp_path / "q.urdf").write_text(lying)
    turn = model_of(lying, feet=["LF_FOOT"]).mounts["base"].rotation
    yaw, pitch, roll = Rotation.from_matrix(turn.T).as_euler("ZYX").tolist()
    (tmp_path / "q.yaml").write_text(f"urdf: q.urdf\nroot_rpy_rad: [{roll}, {pitch}, {yaw}]\n")
    model, upright = named_robot(tmp_path / "q.yaml"), model_of(quadruped())
    assert model.leg_names == upright.leg_names
    for ours, theirs in zip(model.legs, upright.legs, strict=True):
        np.testing.assert_allclose(ours.hip_m, theirs.hip_m, atol=1e-9)
        q = theirs.stance_rad[None]
        np.testing.assert_allclose(ours.chain.feet(q), theirs.chain.feet(q), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("urdf: q.urdf\nwings: 2\n", "wings: unknown key"),
        ("name: dog\n", "urdf: expected this key, got nothing"),
        ("urdf: none.urdf\n", "{0}/none.urdf: expected a file, found nothing there"),
        (
            "urdf: q.urdf\njoints: {nose: {torque_nm: 3}}\n",
            "{0}/q.urdf: joints: expected one of LF_HAA, LF_HFE, LF_KFE, RF_HAA, RF_HFE, RF_KFE, LH_HAA, LH_HFE, LH_KFE, "
            "RH_HAA, RH_HFE, RH_KFE, got 'nose'",
        ),
        (
            "urdf: q.urdf\njoints: {LF_HAA: {torque_nm: -3}}\n",
            "joints.LF_HAA.torque_nm: expected greater than 0, got -3",
        ),
    ],
)
def test_a_yaml_file_says_what_is_wrong_with_it(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "q.urdf").write_text(quadruped())
    (tmp_path / "q.yaml").write_text(text)
    with pytest.raises(InvalidInput) as caught:
        named_robot(tmp_path / "q.yaml")
    assert str(caught.value) == f"{tmp_path}/q.yaml: {message.format(tmp_path)}"


def test_names_that_are_no_robots_are_refused() -> None:
    with refuses("robot"):
        named_robot("centipede")


def tail(limits: str, follows: str = "") -> str:
    """A quadruped with a tail of one joint."""
    extra = f"<mimic {follows}/>{limits}" if follows else limits
    text = robot([joint("wag", "base", "tail", "-.3 0 0", extra=extra), link("tail")])
    return quadruped().replace("</robot>", text.partition("</link>")[2])


@pytest.mark.parametrize(
    ("text", "gap"),
    [
        (tail('<limit lower="-1" upper="1" effort="4" velocity="10"/>'), ""),
        (
            tail(limit("HAA"), 'joint="LF_HFE" multiplier="4"'),
            "joint wag: expected a joint of its own or a fixed one, got one that follows LF_HFE",
        ),
        (
            tail(limit("HAA"), 'joint="wag"'),
            "joint wag: expected a joint of its own or a fixed one, got one that follows wag",
        ),
    ],
)
def test_joints_that_no_leg_has_rest_where_plans_take_them_to_be(text: str, gap: str) -> None:
    model = model_of(text)
    assert len(model.legs) == 4
    assert model.gaps == ((gap,) if gap else ())
    if gap:
        assert gap in model.doubts
        with refuses("robot quadruped", "joint wag"):
            model.check_known()


@pytest.mark.parametrize(
    ("limits", "follows"),
    [
        ('<limit lower="3" upper="3.3" effort="4" velocity="10"/>', ""),
        (limit("HAA"), 'joint="arm" offset="3"'),
    ],
)
def test_joints_that_cannot_rest_at_0_are_held_where_they_can(limits: str, follows: str) -> None:
    model = model_of(tail(limits, follows))
    assert model.gaps == ()
    assert any("joint wag held at 3" in text for text in model.guesses)
    tail_joint = next(joint for joint in model.tree.findall("joint") if joint.get("name") == "wag")
    assert tail_joint.get("type") == "fixed"
    assert model.legs[0].joint_names == model_of(quadruped()).legs[0].joint_names


@pytest.mark.parametrize("feet", [(), ("lc", "rc")])
def test_a_joint_above_two_legs_is_a_waist_and_held(feet: tuple[str, ...]) -> None:
    model = model_of(TWO_FEET, feet=feet)
    assert [len(leg.joints) for leg in model.legs] == [3, 3]
    assert any("waist_yaw held" in text for text in model.guesses)


def limited(lower: str, upper: str) -> str:
    """A quadruped with these limits of its front left knee, and soft ones."""
    return quadruped().replace('lower="-2.4" upper="-0.3"', f'lower="{lower}" upper="{upper}"', 1)


@pytest.mark.parametrize(
    ("lower", "upper", "limits", "guessed"),
    [
        ("-0.3", "-2.4", (-2.4, -0.3), True),
        ("0", "0", (-np.pi, np.pi), True),
        ("-14", "-0.3", (-0.3 - 2.0 * np.pi, -0.3), False),
        ("-115", "115", (-np.pi, np.pi), True),
        ("-2.4", "-0.3", (-2.4, -0.3), False),
    ],
)
def test_limits_are_followed_or_said_to_be_guessed(
    lower: str, upper: str, limits: tuple[float, float], guessed: bool
) -> None:
    model = model_of(limited(lower, upper))
    knee = model.legs[0].joints[2]
    np.testing.assert_allclose((knee.lower_rad, knee.upper_rad), limits)
    assert bool(model.limit_doubts) == guessed
    assert all("LF_KFE" in line for line in model.limit_doubts)
    again = model_of(model.urdf)  # as a plan's file has it
    assert again.limit_doubts == model.limit_doubts


def test_limits_in_degrees_are_a_persons_to_say() -> None:
    with refuses("LF_KFE"):
        model_of(limited("-149", "-17")).check_known()
    said = {"LF_KFE": JointCorrection(limits_rad=(-2.6, -0.3))}
    model_of(limited("-149", "-17"), joints=said).check_known()


def test_soft_limits_inside_hard_ones_are_kept_to() -> None:
    soft = '<safety_controller k_velocity="1" soft_lower_limit="-2" soft_upper_limit="-0.5"/>'
    text = quadruped()
    at = text.index("</joint>", text.index('name="LF_KFE"'))
    knee = model_of(text[:at] + soft + text[at:]).legs[0].joints[2]
    assert (knee.lower_rad, knee.upper_rad) == (-2.0, -0.5)


def test_legs_that_are_mirror_images_stand_as_mirror_images() -> None:
    parts = list[str]()
    for name, (x, y) in {"LF": (1, 1), "RF": (1, -1), "LH": (-1, 1), "RH": (-1, -1)}.items():
        limits = '<limit lower="-1.4" upper="1.4" effort="40" velocity="10"/>'
        at, parent = f"{0.3 * x} {0.15 * y} 0", "base"
        for number, axis in enumerate(("0 0 1", "1 0 0", "0 1 0", "0 1 0", "0 1 0")):
            child = f"{name}_{number}"
            parts += [small(link(child), 1.0), joint(child, parent, child, at, axis, limits)]
            parent, at = child, ("0 0 -.2" if number >= 2 else f"0 {0.03 * y} 0")
        foot = small(link(f"{name}_FOOT", 0.1, '<sphere radius="0.02"/>'), 0.1)
        parts += [foot, fixed(f"{name}_ANKLE", parent, f"{name}_FOOT", at)]
    stances = np.array([leg.stance_rad for leg in model_of(robot(parts)).legs])
    signs = np.array([-1.0, -1.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(stances[[1, 3]], signs * stances[[0, 2]], atol=1e-6)
    np.testing.assert_allclose(stances[:2], stances[2:], atol=1e-6)
