"""Whole robots in any posture are within their outer sets, wherever their centre of mass goes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.equilibrium.scaled import HalfSpaces
from stancekit.planners.robot.outer_sets import (
    OuterSets,
    outer_sets,
    outward_m,
)
from stancekit.planners.robot.reach_sets import contains_all
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.robot.urdf_reader import pinocchio
from stancekit.planners.robot.walker import contact_robot
from tests.planners.robot.made_robots import LEGS, MIDDLE, quadruped

pytest.importorskip("pinocchio")
ARM = (
    '<link name="arm"><inertial><origin xyz="0 0 0.3"/><mass value="1.5"/><inertia ixx="0.02" ixy="0" ixz="0" '
    'iyy="0.02" iyz="0" izz="0.01"/></inertial></link><joint name="lift" type="continuous"><parent link="trunk"/>'
    '<child link="arm"/><origin xyz="0.1 0 0.06"/><axis xyz="0 1 0"/></joint>'
)
ROBOTS = {
    "light legs": quadruped(trunk=30.0),
    "heavy legs": quadruped(trunk=1.2),
    "an arm": quadruped(trunk=4.0, extra=ARM),
    "six legs": quadruped(trunk=3.0, legs={**LEGS, **MIDDLE}),
    "free hips": quadruped(trunk=2.0, joints="continuous"),
    "long": quadruped(trunk=30.0, legs={name: (8.0 * x, y) for name, (x, y) in LEGS.items()}),
}


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return model_of(ROBOTS[request.param], where=request.param)


def postures(robot: RobotModel, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the feet, shape (count, N, 3), and of mass, shape (count, 3), in the base's frame
    [m], all joints of the file at random and at their limits.
    """
    pin, model = pinocchio(), robot.built
    data, rng = model.createData(), np.random.default_rng(0)
    feet, centres = [], []
    for _ in range(count):
        q = pin.neutral(model)
        for joint in list(model.joints)[2:]:
            low, high = (
                float(each[joint.idx_q])
                for each in (model.lowerPositionLimit, model.upperPositionLimit)
            )
            if joint.nq == 2:
                low, high = -np.pi, np.pi
            angle = rng.choice([low, high]) if rng.random() < 0.4 else rng.uniform(low, high)
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            )
        pin.forwardKinematics(model, data, q)
        ends = [(model.getJointId(leg.joint_names[-1]), leg.chain.tip_m) for leg in robot.legs]
        feet.append([data.oMi[joint].act(tip) for joint, tip in ends])
        centres.append(np.array(pin.centerOfMass(model, data, q)))
    return np.array(feet), np.array(centres)


def test_every_posture_of_the_whole_robot_is_within_its_outer_sets(robot: RobotModel) -> None:
    sets: OuterSets = outer_sets(robot)
    feet, centres = postures(robot, 1500)
    away = feet - centres[:, None]
    assert np.all(np.einsum("kni,di->knd", away, sets.normals) <= sets.feet_m)
    assert np.all(np.linalg.norm(away - sets.balls_m[:, :3], axis=2) <= sets.balls_m[:, 3])
    assert np.all(np.linalg.norm(away, axis=2) <= sets.reach_m)
    assert np.all(np.linalg.norm(feet[:, :, None] - feet[:, None], axis=3) <= sets.apart_m + 1e-12)
    assert np.all(centres @ sets.normals.T <= sets.com_m)
    box = np.array([[-0.2, -0.1, -0.05], [0.2, 0.1, 0.05]])
    beyond = np.maximum(centres - box[1], box[0] - centres)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    assert np.where(outside > 0.0, outside, beyond.max(axis=1)).max() <= outward_m(robot) + 1e-9


@pytest.mark.parametrize("tilt_rad", [0.02, 0.2618, 0.5])
def test_toes_of_bodies_that_are_truly_turned_are_within_the_limits_of_a_problem(
    robot: RobotModel, tilt_rad: float
) -> None:
    outer = contact_robot(robot, sets="outer", tilt_rad=tilt_rad)
    assert contains_all(outer, tilt_rad)
    assert not contains_all(outer, tilt_rad + 0.05)
    if len(robot.legs) == 6:
        assert not contains_all(contact_robot(robot), tilt_rad)
    (feet, centres), rng = postures(robot, 500), np.random.default_rng(1)
    for i, limb in enumerate(outer.limbs):
        away = np.repeat(feet[:, i] - centres, 8, axis=0)
        out = rng.normal(size=away.shape)
        out *= robot.legs[i].radius_m / np.linalg.norm(out, axis=1, keepdims=True)
        turns = tilt_rad * rng.choice([-1.0, 1.0, 0.3], away.shape)
        toes = Rotation.from_rotvec(turns).apply(away) + out
        shoulders = limb.shoulder_m + np.cross(turns, limb.shoulder_m)
        assert np.linalg.norm(toes - shoulders, axis=1).max() <= limb.reach_m
        spaces = HalfSpaces.of([limb], 1.0, tilt_rad)
        along, out_of = toes @ spaces.normals.T, spaces.outer_bounds - turns @ spaces.outer_levers.T
        assert np.all(along <= out_of)
