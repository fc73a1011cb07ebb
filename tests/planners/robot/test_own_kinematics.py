"""Kinematics of robots' own legs, of any numbers of joints in any order, against chains,
differences and work.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.robot.robot_model import RobotModel, model_of
from tests.planners.robot.small_urdfs import fixed, joint, leg, link, quadruped, robot

pytest.importorskip("pinocchio")
from stancekit.planners.robot.kinematics import REACHED_M, Kinematics, rotation_of
from tests.planners.robot.link_frames import link_frames

FIVE = [
    *(link(f"T_{part}") for part in ("A", "B", "C", "D", "E")),
    link("T_FOOT", 0.1, '<sphere radius="0.03"/>'),
    joint("T_a", "base", "T_A", "0 0.3 0", "0 0 1"),
    joint("T_b", "T_A", "T_B", "0 0 0", "1 0 0"),
    joint("T_c", "T_B", "T_C", "0 0 -.1", "0 1 0"),
    joint("T_d", "T_C", "T_D", "0 0 -.2", "0 1 0"),
    joint("T_e", "T_D", "T_E", "0 0 -.2", "0 1 0", '<limit effort="20" velocity="10"/>').replace(
        'name="T_e" type="revolute"', 'name="T_e" type="continuous"'
    ),
    fixed("T_f", "T_E", "T_FOOT", "0 0 -.1"),
]
"""A leg of five joints, the last of which turns freely."""
ARM = [link("ARM", 0.5), joint("shoulder", "base", "ARM", "0 0 .2")]


def known(model: RobotModel) -> Robot:
    """A robot with this model, whose limbs are balls that reach far."""
    limbs = tuple(Limb(name=own.name, shoulder_m=own.hip_m, reach_m=2.0) for own in model.legs)
    return Robot(name=model.name, mass_kg=model.mass_kg, limbs=limbs, model=model)


@pytest.fixture(scope="module", params=["four", "five and three", "two bases"])
def model(request: pytest.FixtureRequest) -> RobotModel:
    if request.param == "four":
        return model_of(quadruped(("RH", "LF", "RF", "LH")))
    text = robot([leg("RH"), *FIVE, leg("LF"), *ARM])
    if (
        request.param == "two bases"
    ):  # a root that flies in the file itself, with the base away from it and turned
        floating = joint("fly", "world", "base", "0.5 -0.3 0.2").replace('"revolute"', '"floating"')
        text = text.replace(
            '<link name="base">', f'<link name="world"/>{floating}<link name="base">', 1
        )
        text = text.replace(
            '<origin xyz="0.5 -0.3 0.2"/>', '<origin xyz="0.5 -0.3 0.2" rpy="0.3 0.2 -0.4"/>'
        )
    return model_of(text, feet={"RH": "RH_FOOT", "T": "T_FOOT", "LF": "LF_FOOT"})


@pytest.fixture
def kinematics(model: RobotModel) -> Kinematics:
    return Kinematics(known(model))


def drawn(model: RobotModel, rng: np.random.Generator) -> list[np.ndarray]:
    return [own.random_angles(1, rng)[0] for own in model.legs]


def test_feet_are_those_of_the_chains_leg_by_leg_and_joints_have_their_names(
    model: RobotModel, kinematics: Kinematics
) -> None:
    rng = np.random.default_rng(0)
    assert kinematics.joints == tuple(name for own in model.legs for name in own.joint_names)
    for _ in range(10):
        angles = drawn(model, rng)
        by_chain = [own.chain.feet(q[None])[0] for own, q in zip(model.legs, angles, strict=True)]
        np.testing.assert_allclose(kinematics.feet(np.concatenate(angles)), by_chain, atol=1e-12)
        places = [
            own.chain.frames(q[None])[1][0] for own, q in zip(model.legs, angles, strict=True)
        ]
        chains = kinematics.chains(np.concatenate(angles))
        for chain, joints, foot in zip(chains, places, by_chain, strict=True):
            np.testing.assert_allclose(chain[: len(joints)], joints, atol=1e-12)
            np.testing.assert_allclose(
                chain[len(joints) :], np.tile(foot, (len(chain) - len(joints), 1)), atol=1e-12
            )
    assert kinematics.joints[0] == "RH_HAA"


def test_feet_turn_with_their_links(model: RobotModel, kinematics: Kinematics) -> None:
    angles = drawn(model, np.random.default_rng(1))
    frames = link_frames(model, angles)
    expected = [frames[own.foot][0] for own in model.legs]
    np.testing.assert_allclose(kinematics.foot_frames(np.concatenate(angles)), expected, atol=1e-12)


def test_postures_are_found_for_toes_and_joints_keep_their_limits(
    model: RobotModel, kinematics: Kinematics
) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        angles = drawn(model, rng)
        feet = np.array(
            [own.chain.feet(q[None])[0] for own, q in zip(model.legs, angles, strict=True)]
        )
        com, vector = rng.normal(size=3), rng.uniform(-0.3, 0.3, 3)
        normals = rng.normal(size=feet.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        radii = np.array([[own.radius_m] for own in model.legs])
        toes = com + (feet - model.com_m) @ rotation_of(vector).T - radii * normals
        angles, error, _ = kinematics.solve(com, vector, toes, normals=normals)
        assert np.all(error <= REACHED_M)
        assert not kinematics.beyond(angles).any()
        placed = com + (kinematics.feet(angles) - model.com_m) @ rotation_of(vector).T
        np.testing.assert_allclose(placed - radii * normals, toes, atol=1e-5)


def test_a_robot_that_stands_has_its_centre_of_mass_where_the_model_has_it(
    model: RobotModel, kinematics: Kinematics
) -> None:
    stance = np.concatenate([own.stance_rad for own in model.legs])
    np.testing.assert_allclose(kinematics.com_offset(stance), model.com_m, atol=1e-12)
    np.testing.assert_array_equal(kinematics.robot.origin_m, model.com_m)


def test_torques_are_those_of_virtual_work(model: RobotModel, kinematics: Kinematics) -> None:
    rng = np.random.default_rng(3)
    angles, turn = np.concatenate(drawn(model, rng)), rotation_of(rng.uniform(-0.3, 0.3, 3))
    forces = 30.0 * rng.normal(size=(len(model.legs), 3))

    def work(q: np.ndarray) -> float:
        height = float((turn @ kinematics.com_offset(q))[2])
        return model.mass_kg * 9.81 * height - float(np.sum(forces * (kinematics.feet(q) @ turn.T)))

    step = 1e-6
    slope = [
        (work(angles + step * e) - work(angles - step * e)) / (2.0 * step)
        for e in np.eye(len(angles))
    ]
    np.testing.assert_allclose(kinematics.torques(angles, turn, forces), slope, atol=1e-5)


def test_torques_of_accelerations_are_the_change_of_momentum(
    model: RobotModel, kinematics: Kinematics
) -> None:
    """A leg's power is the change of its kinetic energy, by the masses where the chains put
    them.
    """
    rng = np.random.default_rng(4)
    angles = np.concatenate(drawn(model, rng))
    velocity, acceleration = rng.uniform(-1.0, 1.0, (2, len(angles)))
    step = 1e-4

    def momentum(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """∂T/∂v, from inverse dynamics without velocities: M(q) v."""
        return kinematics.inertial_torques(q, np.zeros_like(v), v)

    def energy(t: float) -> float:
        v = velocity + acceleration * t
        return 0.5 * float(v @ momentum(angles + velocity * t + 0.5 * acceleration * t * t, v))

    power = float(kinematics.inertial_torques(angles, velocity, acceleration) @ velocity)
    assert power == pytest.approx((energy(step) - energy(-step)) / (2.0 * step), rel=1e-4, abs=1e-6)
    masses = momentum(angles, np.eye(len(angles))[2])
    moved = kinematics.com_offset(angles + step * np.eye(len(angles))[2]) - kinematics.com_offset(
        angles
    )
    assert np.linalg.norm(moved) > 0.0
    assert masses[2] > 0.0


def test_what_a_leg_does_is_no_matter_of_the_others(
    model: RobotModel, kinematics: Kinematics
) -> None:
    rng = np.random.default_rng(5)
    start = np.concatenate([own.stance_rad for own in model.legs])
    feet = kinematics.feet(start)
    feet[1] += [0.01, -0.01, 0.02]
    feet[2] += [0.0, 0.0, -5.0]
    moved, error = kinematics.reach(feet, start, start)
    np.testing.assert_array_equal(moved[kinematics.legs == 0], start[kinematics.legs == 0])
    assert error[0] < 1e-6
    assert error[1] < 1e-5
    assert error[2] > 1.0
    longest = max(len(own.joints) for own in model.legs)
    assert kinematics.by_leg(rng.normal(size=len(start))).shape == (len(model.legs), longest)


def test_a_joint_beyond_its_limits_is_told_and_one_that_turns_freely_is_not() -> None:
    model = model_of(
        robot([leg("RH"), *FIVE, leg("LF")]), feet={"RH": "RH_FOOT", "T": "T_FOOT", "LF": "LF_FOOT"}
    )
    kinematics = Kinematics(known(model))
    angles = np.concatenate([own.stance_rad for own in model.legs])
    turned = angles.copy()
    turned[7] += 4.0 * np.pi
    assert kinematics.joints[7] == "T_e"
    np.testing.assert_allclose(kinematics.feet(turned), kinematics.feet(angles), atol=1e-9)
    assert not kinematics.beyond(turned).any()
    turned[2] = -2.5
    np.testing.assert_allclose(
        kinematics.beyond(turned), np.where(np.arange(len(angles)) == 2, 0.1, 0.0), atol=1e-12
    )


def test_limits_of_torque_are_the_files_and_none_where_it_has_none() -> None:
    assert np.all(np.isinf(Kinematics(known(model_of(quadruped(effort=0.0)))).torque_nm))
    np.testing.assert_array_equal(
        Kinematics(known(model_of(quadruped(effort=33.0)))).torque_nm, 33.0
    )


def test_torques_are_the_same_however_the_whole_robot_is_turned(
    model: RobotModel, kinematics: Kinematics
) -> None:
    """About the vertical: gravity stays, forces turn along."""
    angles = np.concatenate(drawn(model, np.random.default_rng(6)))
    turn, forces = (
        rotation_of([0.2, -0.1, 0.0]),
        np.random.default_rng(7).normal(size=(len(model.legs), 3)),
    )
    about = Rotation.from_euler("z", 1.1).as_matrix()
    one = kinematics.torques(angles, turn, forces)
    np.testing.assert_allclose(
        kinematics.torques(angles, about @ turn, forces @ about.T), one, atol=1e-10
    )


def test_gravity_is_that_of_the_course(model: RobotModel) -> None:
    angles = np.concatenate([own.stance_rad for own in model.legs])
    none = np.zeros((len(model.legs), 3))
    earth, moon = (
        Kinematics(replace(known(model)), gravity_m_s2=g).torques(angles, np.eye(3), none)
        for g in (9.81, 1.62)
    )
    np.testing.assert_allclose(moon * 9.81, earth * 1.62, atol=1e-9)
