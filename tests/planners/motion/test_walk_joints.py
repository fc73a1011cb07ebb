"""Joint angles of walks, against pinocchio: feet are where the walk has them, on ground that is not
level.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.motion.joints import walk_joints
from stancekit.planners.robot.limb import Foot
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.terrain.heightfield import HeightField
from tests.refusals import refuses

from ..robot.small_urdfs import quadruped

SLOPE = 0.2


def leaning(reach_m: float = 0.02) -> Trajectory:
    """A robot that leans this way and that over a slope, its feet where they are."""
    model = model_of(quadruped())
    line = np.linspace(-3.0, 3.0, 61)
    terrain = HeightField(line, line, SLOPE * line[:, None] + 0.0 * line)
    toes = np.array([leg.nominal_m - model.body.com_m for leg in model.legs])
    feet = [
        Foot(
            name=leg.name,
            nominal_m=toe,
            reach_min_m=toe - reach_m,
            reach_max_m=toe + reach_m,
            hip_m=leg.hip_m,
        )
        for leg, toe in zip(model.legs, toes, strict=True)
    ]
    robot = Robot(
        name="quadruped",
        mass_kg=model.body.mass_kg,
        inertia_kgm2=model.body.inertia_kgm2,
        feet=tuple(feet),
        stand_height_m=-float(toes[:, 2].mean()),
        trunk_half_m=np.array([0.3, 0.1, 0.05]),
        model=model,
    )
    turns = 0.1 * np.sin(np.linspace(0.0, 6.0, 41))[:, None] * [1.0, -0.5, 2.0]
    rotation = np.array([pin.exp3(turn) for turn in turns])
    ground = np.column_stack([toes[:, :2], SLOPE * toes[:, 0]])
    return Trajectory(
        times_s=0.005 * np.arange(41),
        torso_m=np.array([0.0, 0.0, 0.9 * model.stand_height_m]) + 0.1 * turns,
        rotation=rotation,
        feet_m=np.broadcast_to(ground, (41, 4, 3)),
        forces_n=np.zeros((41, 4, 3)),
        contact=np.ones((41, 4), dtype=bool),
        robot=robot,
        terrain=terrain,
        friction=0.7,
        adhesive=np.zeros(4, dtype=bool),
        start_xy_m=np.zeros(2),
        goal_xy_m=np.zeros(2),
    )


def test_every_foot_touches_the_slope_where_the_walk_has_it() -> None:
    walk = leaning()
    model, found = walk.robot.model, walk_joints(walk)
    assert model is not None
    assert found.reached.shape == (41, 4)
    assert found.reached.all()
    whole = pin.buildModelFromXML(model.urdf, pin.JointModelFreeFlyer())
    data, normal = whole.createData(), np.array([-SLOPE, 0.0, 1.0]) / np.hypot(SLOPE, 1.0)
    for k in range(0, 41, 5):
        q = pin.neutral(whole)
        q[3:7] = pin.Quaternion(walk.rotation[k]).coeffs()
        for leg, angles in zip(model.legs, found.angles, strict=True):
            for name, angle in zip(leg.joint_names, angles[k], strict=True):
                q[whole.joints[whole.getJointId(name)].idx_q] = angle
        q[:3] = walk.torso_m[k] - walk.rotation[k] @ model.body.com_m
        pin.framesForwardKinematics(whole, data, q)
        for leg, toe in zip(model.legs, walk.feet_m[k], strict=True):
            centre = data.oMf[whole.getFrameId(leg.foot)].translation
            np.testing.assert_allclose(centre - leg.radius_m * normal, toe, atol=1e-5)


def test_knees_do_not_change_their_bend_on_the_way() -> None:
    for angles in walk_joints(leaning()).angles:
        assert np.abs(np.diff(angles, axis=0)).max() < 0.15


def test_feet_out_of_reach_are_told() -> None:
    walk = leaning()
    far = replace(walk, feet_m=walk.feet_m - np.array([0.0, 0.0, 0.4]))
    assert not walk_joints(far).reached.any()


def test_a_robot_of_boxes_has_no_joints() -> None:
    walk = leaning()
    with refuses("robot"):
        walk_joints(replace(walk, robot=replace(walk.robot, model=None)))
