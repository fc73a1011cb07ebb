"""A plan over time: in balance at every sample, smooth, its feet clear of the terrain and its ends
where toes are.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stancekit import Motion, WalkQuestion
from stancekit.planners.motion.joints import walk_joints
from stancekit.planners.motion.motion import Played
from stancekit.planners.motion.path import clear_swing
from stancekit.planners.motion.plan_motion import Timing, plan_motion, step_s
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import standing_forces
from stancekit.planners.robot.inverse_kinematics import REACHED_M
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Foot, Robot
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.search.pieces import with_pause
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.patch import Solid, Solids
from stancekit.runner.motion.redundancy import load_transfer
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses


@pytest.fixture(scope="module")
def plan() -> Motion:
    outcome = TwoStage().solve(read_course("stairs", frames=4))
    assert outcome.solution is not None
    return outcome.solution


@pytest.fixture(scope="module")
def motion(plan: Motion) -> Played:
    return plan_motion(plan)


def times(motion: Played) -> np.ndarray:
    return np.linspace(0.0, motion.duration_s, 400)


def test_every_instant_is_in_balance_with_the_feet_that_stand(motion: Played) -> None:
    course = motion.path.plan.problem
    for time in times(motion):
        now = motion.at(float(time))
        air = ~now.stands
        assert not now.forces_n[air].any()
        arms = now.feet_m - FOOT_RADIUS_M * now.normals - now.com_m
        np.testing.assert_allclose(now.forces_n.sum(axis=0), [0.0, 0.0, course.weight_n], atol=1e-3)
        np.testing.assert_allclose(np.cross(arms, now.forces_n).sum(axis=0), 0.0, atol=1e-3)


def test_forces_stay_within_their_cones(motion: Played) -> None:
    course, choice = motion.path.plan.problem, motion.path.plan.choice
    for time in times(motion):
        now = motion.at(float(time))
        for foothold, force in zip(now.foothold, now.forces_n, strict=True):
            if foothold >= 0:
                patch = course.patch(foothold, choice)
                normal = float(force @ patch.normal)
                assert (
                    np.linalg.norm(force - normal * patch.normal) <= patch.friction * normal + 1e-4
                )


def test_a_robot_that_stands_on_all_feet_goes_on_with_its_load_moved_evenly_and_in_balance(
    motion: Played,
) -> None:
    first, weight = motion.at(0.0), motion.path.plan.problem.weight_n
    assert not first.forces_n.any(axis=1).all()  # some of them are about to lift
    share = np.linalg.lstsq(  # all feet push straight up, which balances level ground, too
        np.vstack([np.ones(6), (first.feet_m - first.com_m)[:, :2].T]),
        [weight, 0.0, 0.0],
        rcond=None,
    )[0]
    stood = share[:, None] * [0.0, 0.0, 1.0]
    assert stood[:, 2].min() > 0.0
    resumption, rest_s = load_transfer(motion, stood, motion.rest_s), motion.rest_s
    assert rest_s == pytest.approx(Timing().settle_s)
    np.testing.assert_array_equal(resumption.at(0.0).forces_n, stood)
    found = [resumption.at(float(time_s)) for time_s in np.linspace(0.0, rest_s, 40)]
    for now in found:
        arms = first.feet_m - FOOT_RADIUS_M * first.normals - now.com_m
        np.testing.assert_allclose(now.forces_n.sum(axis=0), [0.0, 0.0, weight], atol=1e-3)
        np.testing.assert_allclose(
            np.cross(arms, now.forces_n).sum(axis=0), 0.0, atol=0.02 * weight * FOOT_RADIUS_M
        )
        np.testing.assert_array_equal(now.feet_m, first.feet_m)
    lifting = np.array([now.forces_n[~first.forces_n.any(axis=1), 2] for now in found])
    assert (np.diff(lifting, axis=0) <= 1e-12).all()
    assert (
        np.abs(np.diff(lifting, axis=0)).max() < 0.06 * stood[:, 2].max()
    )  # 1.875 of an even pace
    for time_s in (rest_s, 0.5 * motion.duration_s, motion.duration_s):
        np.testing.assert_array_equal(resumption.at(time_s).forces_n, motion.at(time_s).forces_n)
    assert (resumption.duration_s, resumption.solids) == (motion.duration_s, motion.solids)
    np.testing.assert_array_equal(resumption.knots_s, motion.knots_s)


def test_feet_that_stand_are_a_radius_off_their_toes(motion: Played) -> None:
    for time in times(motion):
        now = motion.at(float(time))
        for limb, foothold in enumerate(now.foothold):
            if foothold >= 0:
                toe = motion.path.plan.toes_m[foothold]
                np.testing.assert_allclose(
                    now.feet_m[limb], toe + FOOT_RADIUS_M * motion.path.normals[foothold], atol=1e-9
                )


def test_it_goes_through_every_key_frame_and_ends_at_the_last(motion: Played) -> None:
    frames = np.array([motion.at(float(time)).frame for time in times(motion)])
    assert np.all(np.diff(frames) >= -1e-12)
    end = motion.at(motion.duration_s + 1.0)
    np.testing.assert_allclose(end.com_m, motion.path.plan.com_m[-1])
    np.testing.assert_allclose(end.rotation_rad, motion.path.plan.rotation_rad[-1])
    assert set(range(motion.path.plan.problem.frames)) <= {round(float(f), 9) for f in frames}


def test_nothing_leaps(motion: Played) -> None:
    step = 0.002
    moments = [motion.at(step * i) for i in range(int(motion.duration_s / step))]
    feet = np.array([moment.feet_m for moment in moments])
    com = np.array([moment.com_m for moment in moments])
    forces = np.array([moment.forces_n for moment in moments])
    assert np.linalg.norm(np.diff(feet, axis=0), axis=2).max() < 2.0 * step
    assert np.linalg.norm(np.diff(com, axis=0), axis=1).max() < 0.5 * step
    assert np.linalg.norm(np.diff(forces, axis=0), axis=2).max() < 500.0 * step


def test_feet_in_the_air_stay_off_the_terrain(motion: Played) -> None:
    solids = [patch.solid for patch in motion.path.plan.problem.terrain]
    looked_at = 0
    for time in times(motion):
        now = motion.at(float(time))
        for limb, foothold in enumerate(now.foothold):
            if foothold < 0:
                looked_at += 1
                gap = min(float(solid.distance(now.feet_m[limb][None])[0]) for solid in solids)
                assert gap > FOOT_RADIUS_M - 1e-6
    assert looked_at > 50


def test_a_swing_rises_over_a_step_that_is_in_its_way() -> None:
    corners = np.array([[0.0, -0.2, 0.0], [0.2, -0.2, 0.0], [0.2, 0.2, 0.0], [0.0, 0.2, 0.0]])
    low = Patch(
        vertices_m=corners - [0.2, 0.0, 0.0],
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=0.5,
    )
    high = Patch(
        vertices_m=corners + np.array([0.0, 0.0, 0.09]),
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=0.5,
    )
    ends = (np.array([-0.02, 0.0, FOOT_RADIUS_M]), np.array([0.15, 0.0, 0.09 + FOOT_RADIUS_M]))
    up = np.array([0.0, 0.0, 1.0])
    solids = [low.solid, Solid.behind(high.vertices_m, high.normal, 0.09)]
    swing = clear_swing(ends, (up, up), 0.05, Solids(solids))
    assert np.linalg.norm(swing[1] - swing[0]) > 0.05
    way = swing[1] + np.linspace(0.0, 1.0, 200)[:, None] * (swing[2] - swing[1])
    assert min(solid.distance(way).min() for solid in solids) > FOOT_RADIUS_M
    flat = clear_swing((ends[0], ends[0] + [-0.1, 0.0, 0.0]), (up, up), 0.05, Solids(solids[:1]))
    assert np.linalg.norm(np.diff(flat, axis=0), axis=1) == pytest.approx((0.05, 0.1, 0.05))


def test_a_faster_pace_takes_as_much_less_time(plan: Motion) -> None:
    assert plan_motion(plan, Timing().at_pace(2.0)).duration_s == pytest.approx(
        plan_motion(plan).duration_s / 2.0
    )


def test_a_schedule_that_lifts_all_limbs_at_once_is_refused_with_its_frame(plan: Motion) -> None:
    course = plan.problem
    names, first = course.robot.limb_names, [p for p in course.footholds if p.frame == 0]
    again = [replace(p, frame=1) for p in first]
    every = replace(
        course,
        footholds=(*first, *again),
        lifts=((), names),
        next_lift=(),
        com_nominal_m=course.com_nominal_m[:2],
        com_radius_m=course.com_radius_m[:2],
        modes=None,
    )
    leap = Motion(
        problem=every,
        com_m=plan.com_m[:2],
        rotation_rad=plan.rotation_rad[:2],
        toes_m=np.tile(plan.toes_at(0), (2, 1)),
        choice=np.zeros(12),
        forces_n=np.zeros((len(every.stances), 6, 3)),
    )
    with refuses("frame 1"):
        _ = plan_motion(leap)


def test_while_the_body_moves_alone_all_feet_carry_in_balance_and_inside_their_cones() -> None:
    course = with_pause(read_course("walls", frames=3), 1)
    plan = TwoStage().solve(course).solution
    assert plan is not None
    kinematics = Kinematics(course.robot)
    standing = standing_forces(plan, kinematics)
    assert sorted(standing) == [0, 1, 2]
    moves = plan_motion(plan, standing_n=standing)
    begin, end = step_s(moves, 2)
    alone = [moves.at(float(time_s)) for time_s in np.linspace(begin + 1e-6, end, 9)]
    assert np.linalg.norm(alone[-1].com_m - alone[0].com_m) > 0.01
    np.testing.assert_allclose(alone[0].forces_n, standing[1], atol=1e-6)
    np.testing.assert_allclose(alone[-1].forces_n, standing[2], atol=1e-6)
    for sample in alone:
        assert min(sample.foothold) >= 0
        toes = sample.feet_m - kinematics.radii_m[:, None] * sample.normals
        np.testing.assert_allclose(
            sample.forces_n.sum(axis=0), [0.0, 0.0, course.weight_n], atol=1e-3
        )
        moment = np.cross(toes - sample.com_m, sample.forces_n).sum(axis=0)
        np.testing.assert_allclose(moment, 0.0, atol=1e-3 * course.weight_n * course.length_scale_m)
        along = np.einsum("ij,ij->i", sample.forces_n, sample.normals)
        across = np.linalg.norm(sample.forces_n - along[:, None] * sample.normals, axis=1)
        assert (along > 0.0).all()
        assert (across <= sample.friction * along + 1e-6).all()


SLOPE = 0.2


def leaning(reach_m: float = 0.02) -> Motion:
    """A robot that leans this way and that over a slope, its feet where they are."""
    model = model_of(quadruped())
    line = np.linspace(-3.0, 3.0, 61)
    terrain = HeightField(line, line, SLOPE * line[:, None] + 0.0 * line)
    toes = np.array([leg.nominal_m - model.com_m for leg in model.legs])
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
        mass_kg=model.mass_kg,
        inertia_kgm2=model.inertia_kgm2,
        feet=tuple(feet),
        stand_height_m=-float(toes[:, 2].mean()),
        trunk_half_m=np.array([0.3, 0.1, 0.05]),
        model=model,
    )
    turns = 0.1 * np.sin(np.linspace(0.0, 6.0, 41))[:, None] * [1.0, -0.5, 2.0]
    rotation = np.array([pin.exp3(turn) for turn in turns])
    ground = np.column_stack([toes[:, :2], SLOPE * toes[:, 0]])
    return Motion(
        times_s=0.005 * np.arange(41),
        torso_m=np.array([0.0, 0.0, 0.9 * model.stand_height_m]) + 0.1 * turns,
        rotation=rotation,
        feet_m=np.broadcast_to(ground, (41, 4, 3)),
        forces_n=np.zeros((41, 4, 3)),
        contact=np.ones((41, 4), dtype=bool),
        problem=WalkQuestion(
            robot=robot,
            terrain=terrain,
            friction=0.7,
            adhesive=np.zeros(4, dtype=bool),
            start=np.zeros(2),
            goal=np.zeros(2),
        ),
    )


def test_every_foot_touches_the_slope_where_the_walk_has_it() -> None:
    walk = leaning()
    model, (found, error_m) = walk.robot.model, walk_joints(walk)
    assert error_m.shape == (41, 4)
    assert (error_m <= REACHED_M).all()
    whole = pin.buildModelFromXML(model.urdf, pin.JointModelFreeFlyer())
    data, normal = whole.createData(), np.array([-SLOPE, 0.0, 1.0]) / np.hypot(SLOPE, 1.0)
    for k in range(0, 41, 5):
        q = pin.neutral(whole)
        q[3:7] = pin.Quaternion(walk.rotation[k]).coeffs()
        for name, angle in zip(model.joint_names, found[k], strict=True):
            q[whole.joints[whole.getJointId(name)].idx_q] = angle
        q[:3] = walk.torso_m[k] - walk.rotation[k] @ model.com_m
        pin.framesForwardKinematics(whole, data, q)
        for leg, toe in zip(model.legs, walk.feet_m[k], strict=True):
            centre = data.oMf[whole.getFrameId(leg.foot)].translation
            np.testing.assert_allclose(centre - leg.radius_m * normal, toe, atol=1e-5)


def test_knees_do_not_change_their_bend_on_the_way() -> None:
    assert np.abs(np.diff(walk_joints(leaning())[0], axis=0)).max() < 0.15


def test_feet_out_of_reach_are_told() -> None:
    walk = leaning()
    far = replace(walk, feet_m=walk.feet_m - np.array([0.0, 0.0, 0.4]))
    assert (walk_joints(far)[1] > REACHED_M).all()


def test_a_robot_of_boxes_has_no_joints() -> None:
    walk = leaning()
    with refuses("robot"):
        walk_joints(walk.asked(robot=replace(walk.robot, model=None)))
