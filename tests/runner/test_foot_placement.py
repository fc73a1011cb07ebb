"""Where feet are put down, for a small quadruped whose body is not where it should be."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import walker_of
from stancekit.runner.control.body_feedback import BodyPose
from stancekit.runner.control.foot_placement import (
    GIVES_M,
    WITH_FEET,
    ContactFeedback,
    FootPlacement,
)
from stancekit.runner.worlds.world import State
from tests.planners.robot.small_urdfs import quadruped
from tests.runner.at_rest import at_rest

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


PLACE = BodyPose(origin_m=np.zeros(3), rotation=np.eye(3), velocity=np.zeros(6))


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
