"""The wrench that brings a body to its place, and who gives it: sums, cones, and a quadruped that
walks with it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stancekit
from stancekit import Motion
from stancekit.pictures import view_of
from stancekit.planners.equilibrium.rows import Rows
from stancekit.planners.files.arrays import Array
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.gait.method.attempt import Attempt, Attempted, Workbench
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.motion.motion import Samples
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.walk import Walk
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import walking_robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import walker_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.body_feedback import (
    EVEN,
    WEIGHTS,
    BodyController,
    BodyFeedback,
    BodyPose,
)
from stancekit.runner.control.foot_placement import (
    GIVES_M,
    WITH_FEET,
    ContactFeedback,
    FootPlacement,
)
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import State, make_world
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses
from tests.runner.at_rest import at_rest

MASS, WEIGHT = 20.0, 196.2
BONE = '<sphere radius="0.03"/>'
"""A walk of links without shapes is not run: nobody knows what they meet."""
INERTIA = np.diag([0.4, 0.9, 1.1])
FEET = np.array([[0.3, 0.2, -0.4], [0.3, -0.2, -0.38], [-0.3, 0.2, -0.42], [-0.3, -0.2, -0.4]])
ALL = np.ones(4, dtype=np.bool_)


def controller(**options: float) -> BodyController:
    return BodyController(MASS, INERTIA, WEIGHT, BodyFeedback(**options))


def sample(friction: float = 0.7) -> Samples:
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    return at_rest(
        feet_m=FEET,
        forces_n=0.25 * WEIGHT * up,
        foothold=(0, 1, 2, 3),
        normals=up,
        friction=np.full(4, friction),
    )


def test_ground_is_steep_where_friction_alone_does_not_hold_on_it() -> None:
    lean = np.arctan(0.7) + np.array(
        [-0.01, 0.01, 0.5 * np.pi - np.arctan(0.7), np.pi - np.arctan(0.7)]
    )
    normals = np.stack([np.sin(lean), np.zeros(4), np.cos(lean)], axis=1)
    assert replace(sample(), normals=normals).steep.tolist() == [False, True, True, True]
    assert not replace(sample(1e-6)).steep.any()


def total(forces: Array) -> Array:
    return np.concatenate([forces.sum(axis=0), np.cross(FEET, forces).sum(axis=0)])


def pose(
    turn: Rotation = Rotation.identity(), origin: Array | None = None, speed: Array | None = None
) -> BodyPose:
    there, still = (
        np.zeros(3) if origin is None else origin,
        np.zeros(6) if speed is None else speed,
    )
    return there, turn.as_matrix(), still


def test_the_wrench_pulls_back_and_damps_and_is_nothing_where_nothing_is_off() -> None:
    of = controller(position_s2=160.0, turn_s=30.0, rotation_s2=250.0)
    np.testing.assert_allclose(of.wrench(pose(), pose()), 0.0, atol=1e-12)
    low = of.wrench(pose(), pose(origin=np.array([0.0, 0.0, -0.01])))
    np.testing.assert_allclose(low, [0.0, 0.0, MASS * 160.0 * 0.01, 0.0, 0.0, 0.0], atol=1e-9)
    turning = of.wrench(pose(), pose(speed=np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0])))
    np.testing.assert_allclose(
        turning, [0.0, 0.0, 0.0, 0.0, -30.0 * 0.1 * INERTIA[1, 1], 0.0], atol=1e-9
    )
    yawed = Rotation.from_rotvec([0.0, 0.0, 0.5 * np.pi])
    tipped = (
        Rotation.from_rotvec([0.01, 0.0, 0.0]) * yawed
    )  # about the world's x, which is the body's y
    np.testing.assert_allclose(
        of.wrench(pose(yawed), pose(tipped))[3:],
        [-250.0 * 0.01 * INERTIA[1, 1], 0.0, 0.0],
        atol=1e-6,
    )


def test_forces_of_feet_add_up_to_what_was_planned_and_the_wrench() -> None:
    rng = np.random.default_rng(4)
    now = sample(friction=2.0)
    for _ in range(20):
        wrench = rng.uniform(-1.0, 1.0, 6) * [10.0, 10.0, 20.0, 3.0, 3.0, 1.0]
        forces = controller().forces(wrench, now, FEET, now.forces_n, ALL)
        np.testing.assert_allclose(
            total(forces) - total(now.forces_n), wrench, atol=0.02 * np.linalg.norm(wrench)
        )


def test_no_other_forces_within_the_bounds_come_nearer_to_what_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng, asked = np.random.default_rng(6), list[object]()
    solve, planned = Rows[Any].solve, sample().forces_n
    monkeypatch.setattr(Rows, "solve", lambda *args: asked.append(args) or solve(*args))

    def cost(forces: Array, wrench: Array) -> float:
        lacks = WEIGHTS * (total(forces - planned) - wrench) / WEIGHT
        return float(lacks @ lacks + EVEN * np.sum(((forces - planned) / WEIGHT) ** 2))

    light = 0
    for friction, size in product((0.5, 20.0), np.geomspace(0.01, 2.0, 30)):
        now = sample(friction)
        wrench, before = size * rng.normal(size=6) * [40.0, 40.0, 90.0, 20.0, 20.0, 5.0], len(asked)
        forces = controller().forces(wrench, now, FEET, planned, ALL)
        slack = 1e-7 if len(asked) > before else 1e-15
        light += slack < 1e-7 and bool((forces[:, 2] < 0.0300001 * WEIGHT).any())
        for far in np.geomspace(1e-4, 10.0, 40):
            other = forces + far * rng.normal(size=(4, 3))
            other[:, 2] = np.maximum(other[:, 2], 0.03 * WEIGHT)
            across = np.linalg.norm(other[:, :2], axis=1, keepdims=True)
            other[:, :2] *= np.minimum(1.0, 0.8 * friction * other[:, 2:] / across)
            assert cost(other, wrench) >= cost(forces, wrench) - slack
    assert light >= 3, light
    assert 5 < len(asked) < 50, len(asked)


def test_no_foot_leaves_its_share_of_the_cone_or_pulls_or_carries_in_the_air() -> None:
    rng, now = np.random.default_rng(5), sample(friction=0.5)
    bound = 0
    for _ in range(50):
        stands = rng.random(4) < 0.7
        wrench = rng.normal(size=6) * [80.0, 80.0, 150.0, 20.0, 20.0, 10.0]
        given = np.where(stands[:, None], now.forces_n, 0.0)
        forces = controller().forces(wrench, now, FEET, given, stands)
        assert (forces[~stands] == 0.0).all()
        along, across = forces[stands, 2], np.linalg.norm(forces[stands, :2], axis=1)
        assert (along >= 0.03 * WEIGHT - 1e-9).all()
        assert (across <= 0.8 * 0.5 * along + 1e-9).all()
        bound += int((across > 0.8 * 0.5 * along - 1e-6).sum())
    assert bound > 20


@pytest.mark.parametrize(("planned", "given"), [(0.5, 0.5), (0.9, 0.9), (1.0, 0.95)])
def test_a_plan_that_uses_more_of_the_cone_than_feedback_may_keeps_its_forces(
    planned: float, given: float
) -> None:
    lean = np.array([planned * 0.6, 0.0, 1.0])
    now = replace(sample(friction=0.6), forces_n=np.tile(0.25 * WEIGHT * lean, (4, 1)))
    forces = controller().forces(np.zeros(6), now, FEET, now.forces_n, ALL)
    across = np.linalg.norm(forces[:, :2], axis=1)
    np.testing.assert_allclose(across.sum() / forces[:, 2].sum(), given * 0.6, rtol=0.01)
    assert (across <= max(given, 0.8) * 0.6 * forces[:, 2] + 1e-9).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_wrench_that_is_no_number_leaves_what_was_planned(value: float) -> None:
    now = sample()
    forces = controller().forces(np.full(6, value), now, FEET, now.forces_n, ALL)
    np.testing.assert_allclose(forces, now.forces_n, atol=1e-9)


def test_a_foot_that_has_not_landed_is_made_up_for() -> None:
    now, three = sample(friction=2.0), np.array([True, True, True, False])
    given = np.where(three[:, None], now.forces_n, 0.0)
    lost = total(now.forces_n) - total(given)
    assert lost[2] == pytest.approx(0.25 * WEIGHT)
    assert np.linalg.norm(lost[3:]) > 10.0
    forces = controller().forces(np.zeros(6), now, FEET, given, three)
    np.testing.assert_allclose(total(forces), total(now.forces_n), atol=0.02 * WEIGHT)


def test_a_foot_that_the_robot_turns_about_is_relieved_of_nearly_all_that_it_presses_with() -> None:
    now = replace(sample(), forces_n=100.0 * WEIGHT * UP * [[0.04], [0.48], [0.48], [0.0]])
    righted = 100.0 * WEIGHT * UP * [[0.015], [0.4925], [0.4925], [0.0]]
    wrench = total(righted) - total(now.forces_n)
    forces = controller().forces(wrench, now, FEET, now.forces_n, np.arange(4) < 3)
    np.testing.assert_allclose(forces, righted, atol=2e-3 * WEIGHT)


def test_a_body_beside_its_place_is_not_tipped_by_forces_planned_for_it_there() -> None:
    now, away = sample(friction=2.0), np.array([0.02, -0.01, 0.0])
    tips = np.cross(FEET - away, now.forces_n).sum(axis=0) - total(now.forces_n)[3:]
    np.testing.assert_allclose(tips, -np.cross(away, [0.0, 0.0, WEIGHT]))
    forces = controller().forces(np.zeros(6), now, FEET - away, now.forces_n, ALL)
    np.testing.assert_allclose(
        np.cross(FEET - away, forces).sum(axis=0), total(now.forces_n)[3:], atol=0.03
    )


@pytest.fixture(scope="module")
def walked() -> Attempted:
    """A small quadruped, two seconds over low waves."""
    model = model_of(quadruped(bone=BONE), posture_rad={"*_HAA": 0.0, "*_HFE": 0.7, "*_KFE": -1.3})
    waves = HeightField.from_function(
        lambda x, y: 0.02 * np.sin(4 * x + 0.3) * np.cos(3 * y), 1.5, 0.1, name="waves"
    )
    task = Walk(
        robot=walker_of(model),
        terrain=waves,
        start=np.zeros(2),
        goal=np.array([0.2, 0.1]),
        duration_s=2.5,
        friction=0.6,
    )
    found = Workbench(task, GaitSettings()).run(Attempt(chart="decoupled"))
    assert found.report.accepted, found.report.message
    return found


@pytest.fixture(scope="module")
def accepted(walked: Attempted, tmp_path_factory: pytest.TempPathFactory) -> Accepted:
    path = tmp_path_factory.mktemp("walked") / "walk.json"
    write_motion(path, walked.trajectory, walked.report)
    return Accepted.from_file(path)


def run_with(accepted: Accepted, body: BodyFeedback) -> RunReport:
    with make_world("mujoco", accepted.robot) as made:
        return Runner(made, settings=RunSettings(body=body)).run(accepted, accepted.plan.ground())


@pytest.fixture(scope="module")
def as_planned(accepted: Accepted) -> RunReport:
    """A run as every run is that says nothing else."""
    assert RunSettings() == RunSettings(body=BodyFeedback())
    return run_with(accepted, BodyFeedback())


def test_a_quadruped_of_a_file_walks_as_planned(as_planned: RunReport) -> None:
    assert as_planned.succeeded, as_planned.message
    run = as_planned.execution
    assert run.body_rms_m < 8e-3
    assert run.slip_m.max() < 8e-3
    assert run.bump_s == 0.0
    assert 0.0 < run.torque_share.max() < 0.9
    np.testing.assert_allclose(
        (run.trace.com_m[-1] - run.trace.com_m[0])[:2], [0.2, 0.1], atol=0.02
    )


def test_a_page_of_an_executed_walk_shows_the_feet_where_the_world_had_them(
    walked: Attempted, as_planned: RunReport, tmp_path: Path
) -> None:
    run = as_planned.execution
    film, times_s = view_of(walked.trajectory, run).film(), run.trace.time_s - run.trace.time_s[0]
    assert film.step_s * (len(film.moments) - 1) == pytest.approx(times_s[-1], abs=film.step_s)
    for k, moment in enumerate(film.moments):
        bodies = {body.name: body.position_m for body in moment.bodies}
        feet = [bodies[f"{leg} foot"] for leg in ("LF", "RF", "LH", "RH")]
        row = int(np.argmin(np.abs(times_s - k * film.step_s)))
        np.testing.assert_allclose(feet, run.trace.feet_m[row], atol=1e-3)
    stancekit.film(walked.trajectory, tmp_path / "walk.html", run)
    assert walked.trajectory.robot.name in (tmp_path / "walk.html").read_text()


def test_without_the_wrench_its_body_strays_farther(
    accepted: Accepted, as_planned: RunReport
) -> None:
    off = BodyFeedback(position_s2=0.0, velocity_s=0.0, rotation_s2=0.0, turn_s=0.0)
    assert run_with(accepted, off).execution.body_worst_m > 1.5 * as_planned.execution.body_worst_m


CRAWL = """
name: flat
robot: dog.urdf
frames: 4
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.12, 0.0, 0.45]
steps: {com_m: 0.15, toe_m: 0.4}
terrain: {kind: flat, friction: 0.7}
"""


@pytest.fixture(scope="module")
def crawl(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    folder = tmp_path_factory.mktemp("crawl")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(CRAWL)
    plan = plan_with_reserve(TwoStage(), read_course(folder / "flat.yaml")).solution
    assert plan is not None
    return with_joints(plan)


@pytest.mark.parametrize("rate_hz", [50.0])
def test_a_quadruped_of_a_file_crawls_over_three_feet_and_none_of_them_slips(
    crawl: Motion, rate_hz: float
) -> None:
    report = stancekit.simulate(crawl, make_world("mujoco", crawl.robot, rate_hz=rate_hz))
    assert report.succeeded, report.message
    assert report.execution.body_rms_m < 0.006
    assert report.execution.slip_m.max() < 0.008


def test_a_walk_for_other_legs_or_weaker_joints_is_refused_in_one_line(
    accepted: Accepted,
) -> None:
    weaker = model_of(
        quadruped(effort=12.0, bone=BONE), posture_rad={"*_HAA": 0.0, "*_HFE": 0.7, "*_KFE": -1.3}
    )
    other = replace(accepted.robot, model=weaker)
    with (
        make_world("mujoco", other) as made,
        refuses("walk.json", "robot"),
    ):
        Runner(made).prepare(accepted)
    own = accepted.plan.asked(robot=replace(accepted.plan.robot, model=weaker))
    with refuses("torque"):
        Accepted.verified(own, "walk")


PERIOD_S, BESIDE = 0.005, np.array([0.02, -0.01, 0.0])
NONE = np.zeros((4, 3))
UP = np.array([0.0, 0.0, 0.01])


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    model = model_of(quadruped(), posture_rad={"*_HAA": 0.0, "*_HFE": 0.7, "*_KFE": -1.3})
    return Kinematics(walking_robot(walker_of(model)))


def standing(kinematics: Kinematics) -> tuple[Array, Samples]:
    """Joints, and what should be: the body at the origin, all feet on level ground."""
    angles = np.concatenate([leg.stance_rad for leg in kinematics.model.legs])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    forces = 0.25 * kinematics.robot.mass_kg * kinematics.gravity_m_s2 * up
    return angles, at_rest(
        feet_m=kinematics.feet(angles),
        forces_n=forces,
        foothold=(0, 1, 2, 3),
        normals=up,
        friction=np.full(4, 0.6),
    )


def state(angles: Array, position: Array, velocity: Array | None = None) -> State:
    return State(
        time_s=0.0,
        position_m=position,
        rotation=np.eye(3),
        velocity=np.zeros(6) if velocity is None else velocity,
        angles_rad=angles,
        rates_rad_s=np.zeros(12),
        torques_nm=np.zeros(12),
        feet_m=NONE,
        forces_n=NONE,
        bump_n=0.0,
        sent_rad=angles,
    )


def of(kinematics: Kinematics, first: Samples, step_s: float = 0.0) -> FootPlacement:
    weight = kinematics.robot.mass_kg * kinematics.gravity_m_s2
    return FootPlacement(
        first, kinematics, ContactFeedback(), weight_n=weight, step_s=step_s, period_s=PERIOD_S
    )


PLACE: BodyPose = np.zeros(3), np.eye(3), np.zeros(6)


def test_a_foot_that_does_not_bear_pulls_no_body_and_one_that_bears_does(
    kinematics: Kinematics,
) -> None:
    angles, now = standing(kinematics)
    up = replace(now, foothold=np.array((-1, 1, 2, 3)), feet_m=now.feet_m + UP)
    feet = of(kinematics, up)
    seen = state(angles, BESIDE), PLACE
    for felt in (np.array([2.0, 50.0, 50.0, 50.0]), np.full(4, 50.0)):
        for _ in range(400):
            feet.follow(now, now, felt, NONE, seen)
        under_the_body = now.feet_m + feet.moved_m
        if felt[0] < 10.0:  # as the joints have it
            share = 2.0 / (0.1 * kinematics.robot.mass_kg * kinematics.gravity_m_s2)
            np.testing.assert_allclose(under_the_body[0], now.feet_m[0] + share * BESIDE, atol=1e-5)
        else:  # the body is beside its place: a foot that holds pushes it back by so much
            np.testing.assert_allclose(under_the_body[0], now.feet_m[0] + BESIDE, atol=1e-5)


def test_only_a_foot_that_should_carry_is_lowered_where_it_lost_its_load(
    kinematics: Kinematics,
) -> None:
    """One that presses with little loses that as the robot tips away from it, and turns it over."""
    now = standing(kinematics)[1]
    for share, lowered in ((0.15, True), (0.05, False)):
        turns = replace(now, forces_n=4.0 * now.forces_n * [[share], [0.5], [0.5], [0.0]])
        feet, felt = of(kinematics, turns), np.array([0.0, 50.0, 50.0, 50.0])
        for _ in range(200):
            feet.seek(turns, turns, felt, np.zeros(4, dtype=np.bool_))
            feet.follow(turns, turns, felt, NONE, None)
        assert (feet.moved_m[0, 2] < -0.005) == lowered


@pytest.mark.parametrize("noise_n", [0.0, 5.0])
def test_a_foot_whose_sensor_is_noisy_does_not_land_on_its_noise_and_lands_where_it_bears(
    kinematics: Kinematics, noise_n: float
) -> None:
    angles, now = standing(kinematics)
    rng, seen, none_late = (
        np.random.default_rng(3),
        (state(angles, np.zeros(3)), PLACE),
        np.zeros(4, dtype=np.bool_),
    )
    lift = np.zeros((4, 3))
    lift[0] = 10.0 * UP
    feet, last = of(kinematics, now), replace(now, foothold=np.array((-1, 1, 2, 3)))
    for k in range(200):  # up, and down again
        up = replace(last, feet_m=now.feet_m + lift * np.sin(np.pi * (k + 1) / 201))
        felt = np.array([0.0, 50.0, 50.0, 50.0]) + noise_n * rng.standard_normal(4)
        feet.seek(last, up, felt, none_late)
        feet.follow(last, up, felt, NONE, seen)
        last = up
        assert not feet.touched[0]
    bears = np.array([max(1.6, 4.6 * noise_n), 50.0, 50.0, 50.0])
    feet.seek(last, now, bears, none_late)
    feet.follow(last, now, bears, NONE, seen)
    assert feet.touched[0]


def test_feet_in_the_air_step_where_the_body_falls(kinematics: Kinematics) -> None:
    angles, now = standing(kinematics)
    air = replace(now, foothold=np.array((-1, 1, 2, -1)))
    feet = of(kinematics, air, step_s=0.15)
    late = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    for _ in range(400):
        feet.follow(air, air, np.zeros(4), NONE, (state(angles, np.zeros(3), late), PLACE))
    assert feet.moved_m[0, 1] == feet.moved_m[3, 1] == pytest.approx(1.15 * 0.15 * 0.1)
    np.testing.assert_allclose(feet.moved_m[[0, 3]][:, [0, 2]], 0.0, atol=1e-12)


def test_a_foot_that_lands_early_stops_at_once(kinematics: Kinematics) -> None:
    angles, now = standing(kinematics)
    heights = np.array([0.005, 0.0, -0.005, -0.01])  # the ground is higher than was planned
    first = np.eye(4)[:, :1] * [0.0, 0.0, 1.0]
    path = [
        replace(now, foothold=np.array((-1, 1, 2, 3)), feet_m=now.feet_m + height * first)
        for height in heights
    ]
    feet, seen = of(kinematics, path[0]), (state(angles, np.zeros(3)), PLACE)
    feet.follow(path[0], path[1], np.array([60.0, 50.0, 50.0, 50.0]), NONE, seen)
    assert feet.touched[0]
    commanded = [path[1].feet_m[0, 2] + feet.moved_m[0, 2]]
    for k in (1, 2):
        feet.follow(path[k], path[k + 1], np.array([60.0, 50.0, 50.0, 50.0]), NONE, seen)
        commanded.append(path[k + 1].feet_m[0, 2] + feet.moved_m[0, 2])
    assert np.ptp(commanded) < 0.001 < np.ptp(heights[1:])


def test_a_body_is_pulled_half_way_over_feet_that_stepped_aside(kinematics: Kinematics) -> None:
    angles, now = standing(kinematics)
    feet = of(
        kinematics,
        replace(now, foothold=np.array((-1, -1, -1, -1)), feet_m=now.feet_m + UP),
        step_s=0.15,
    )
    for _ in range(2):
        feet.follow(now, now, np.full(4, 50.0), NONE, (state(angles, BESIDE), PLACE))
    np.testing.assert_allclose(feet.shift_m, WITH_FEET * BESIDE, atol=1e-9)


def test_a_foot_on_noisy_ground_comes_down_as_far_as_its_ground_may_be_and_no_farther(
    kinematics: Kinematics,
) -> None:
    _, then = standing(kinematics)
    now = replace(then, foothold=np.full(4, -1))
    depths = np.array([0.0, 0.004, 0.012, 0.02])
    feet = FootPlacement(
        now,
        kinematics,
        ContactFeedback(),
        weight_n=100.0,
        step_s=0.0,
        period_s=PERIOD_S,
        touch_downs_m=depths,
    )
    before, waited = feet.moved_m, np.zeros(4)
    for _ in range(round(2.0 / PERIOD_S)):
        waited += PERIOD_S * feet.seek(now, then, np.zeros(4), np.zeros(4, dtype=bool))
    assert before == pytest.approx(0.0)
    lowered = ContactFeedback().seek_m_s * waited
    assert lowered == pytest.approx([0.02, 0.004 + GIVES_M, 0.012 + GIVES_M, 0.02], abs=2e-4)


def test_a_foot_that_stands_higher_than_planned_is_not_pressed_down_as_it_lifts(
    kinematics: Kinematics,
) -> None:
    angles, now = standing(kinematics)
    first = np.eye(4)[:, :1] * [0.0, 0.0, 1.0]
    fall, rise = np.linspace(0.002, -0.008, 40), np.linspace(-0.008, 0.02, 40)
    path = [replace(now, feet_m=now.feet_m + height * first) for height in (*fall, *rise)]
    air = [replace(each, foothold=np.array((-1, 1, 2, 3))) for each in path]
    samples = [*air[:40], *[path[39]] * 100, *air[40:]]
    felt, seen = np.array([60.0, 50.0, 50.0, 50.0]), (state(angles, np.zeros(3)), PLACE)
    feet, commanded = of(kinematics, samples[0]), list[float]()
    for last, then in pairwise(samples):
        feet.follow(last, then, felt, NONE, seen)
        commanded.append(float(then.feet_m[0, 2] + feet.moved_m[0, 2] - now.feet_m[0, 2]))
    assert feet.touched.tolist() == [False, True, True, True]
    assert min(commanded[130:]) > -3e-4  # it stood at 0, 8 mm above its place
    assert commanded[-1] > 0.015
