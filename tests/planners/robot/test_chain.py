"""Batched kinematics against pinocchio, and against finite differences."""

import numpy as np
import pytest

from stancekit.planners.robot.leg import Leg
from stancekit.planners.robot.robot_file import hexapod_model
from stancekit.planners.robot.robot_model import RobotModel, model_of
from tests.planners.robot.small_urdfs import fixed, joint, link, quadruped, robot

SLIDES = '<limit lower="-.1" upper=".2" effort="40" velocity="10"/>'


def odd_legs() -> str:
    """Axes in odd directions, a joint that turns freely and one that slides."""
    parts = []
    for name, x in (("a", 0.3), ("b", -0.3)):
        parts += [link(f"{name}{i}") for i in range(5)]
        parts += [
            joint(f"{name}_0", "base", f"{name}0", f"{x} .1 0", "0.6 0 0.8"),
            joint(f"{name}_1", f"{name}0", f"{name}1", ".02 .03 -.2", "0 -1 0").replace(
                "revolute", "continuous"
            ),
            joint(f"{name}_2", f"{name}1", f"{name}2", "0 .01 -.2", "0 0 -1", SLIDES).replace(
                "revolute", "prismatic"
            ),
            joint(f"{name}_3", f"{name}2", f"{name}3", "0 0 -.2", "0.48 0.6 0.64"),
            fixed(f"{name}_f", f"{name}3", f"{name}4", "0 .02 -.2"),
        ]
    return robot(parts).replace(
        '<origin xyz="0 .01 -.2"/>', '<origin xyz="0 .01 -.2" rpy=".3 -.2 .5"/>'
    )


def models() -> list[RobotModel]:
    pytest.importorskip("pinocchio")
    return [hexapod_model(), model_of(quadruped()), model_of(odd_legs())]


def pinocchio_feet(
    model: RobotModel, leg: Leg, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Feet and Jacobians as pinocchio has them, found by the joints' names."""
    import pinocchio as pin

    known = pin.buildModelFromXML(model.urdf)
    data, joints = (
        known.createData(),
        [known.joints[known.getJointId(name)] for name in leg.joint_names],
    )
    frame = known.getFrameId(leg.foot)
    feet, jacobians = [], []
    for posture in angles:
        q = pin.neutral(known)
        for each, angle in zip(joints, posture, strict=True):
            q[each.idx_q : each.idx_q + each.nq] = (
                angle if each.nq == 1 else (np.cos(angle), np.sin(angle))
            )
        whole = pin.computeFrameJacobian(
            known, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        feet.append(data.oMf[frame].translation.copy())
        jacobians.append(whole[:3, [each.idx_v for each in joints]])
    return np.array(feet), np.array(jacobians)


def test_feet_and_jacobians_are_those_of_pinocchio() -> None:
    rng = np.random.default_rng(0)
    for model in models():
        for leg in model.legs:
            angles = leg.random_angles(20, rng)
            feet, jacobians = leg.chain.feet_and_jacobian(angles)
            theirs, their_jacobians = pinocchio_feet(model, leg, angles)
            np.testing.assert_allclose(feet, theirs, atol=1e-12)
            np.testing.assert_allclose(leg.chain.feet(angles), theirs, atol=1e-12)
            np.testing.assert_allclose(jacobians, their_jacobians, atol=1e-12)


def test_jacobians_are_those_of_finite_differences() -> None:
    rng, step = np.random.default_rng(1), 1e-6
    for model in models():
        leg = model.legs[-1]
        angles = leg.random_angles(5, rng)
        _, jacobian = leg.chain.feet_and_jacobian(angles)
        for i, unit in enumerate(np.eye(len(leg.joints))):
            ahead, behind = (
                leg.chain.feet(angles + step * unit),
                leg.chain.feet(angles - step * unit),
            )
            np.testing.assert_allclose(
                jacobian[:, :, i], (ahead - behind) / (2.0 * step), atol=1e-8
            )


def test_the_frames_of_the_joints_carry_the_foot() -> None:
    rng = np.random.default_rng(2)
    for model in models():
        for leg in model.legs:
            angles = leg.random_angles(7, rng)
            turns, places = leg.chain.frames(angles)
            feet = places[:, -1] + turns[:, -1] @ leg.chain.tip_m
            np.testing.assert_allclose(feet, leg.chain.feet(angles), atol=1e-12)
            np.testing.assert_allclose(
                turns @ turns.transpose(0, 1, 3, 2),
                np.broadcast_to(np.eye(3), turns.shape),
                atol=1e-12,
            )
