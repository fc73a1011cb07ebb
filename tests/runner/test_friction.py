"""The friction that feet felt, as an interval: what slides say, what stances that held say, and
what is forgotten.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M
from stancekit.planners.terrain import Patch
from stancekit.runner.control.closed_loop import LAND_M_S, STAND_S, standing_motion
from stancekit.runner.control.estimation import FrictionEstimator, FrictionInterval, SlipDetector
from stancekit.runner.control.tracker import Target
from stancekit.runner.log import Record
from stancekit.runner.worlds.world import State
from tests.emulators.slipping import FAULTS, SlippingWorld
from tests.refusals import refuses
from tests.runner.at_rest import at_rest

PERIOD_S, MU = 0.005, 0.6
UP = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
ALONG = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def felt(
    ratios: Array,
    speeds_m_s: tuple[float, float],
    foothold: tuple[int, int] = (0, 1),
    load_n: float = 30.0,
    carried: float = 1.0,
) -> Record:
    """Two feet, on a floor and on a wall, that feel |f_t| = ratio μ f_n, shape (T, 2), and move
    along at a speed. carried: of the load that is planned.
    """
    record = Record()
    for k, ratio in enumerate(ratios):
        sample = at_rest(
            feet_m=np.zeros((2, 3)),
            forces_n=load_n * UP,
            foothold=foothold,
            normals=UP,
            friction=np.full(2, MU),
        )
        target = Target(
            targets_rad=np.zeros(1),
            sample=sample,
            origin_m=np.zeros(3),
            shift_m=np.zeros(3),
            angles_rad=np.zeros(1),
            torques_nm=np.zeros(1),
            rolled_m=np.zeros((2, 3)),
            error_m=np.zeros(2),
        )
        moved = (np.array(speeds_m_s) * PERIOD_S * k)[:, None] * ALONG
        state = State(
            time_s=k * PERIOD_S,
            position_m=np.zeros(3),
            rotation=np.eye(3),
            velocity=np.zeros(6),
            angles_rad=np.zeros(1),
            rates_rad_s=np.zeros(1),
            torques_nm=np.zeros(1),
            feet_m=moved,
            forces_n=carried * load_n * (UP + (ratio * MU)[:, None] * ALONG),
            bump_n=0.0,
            sent_rad=np.zeros(1),
        )
        record.add(target, state, 0.0)
    return record


def interval(*records: Record, unit: float = 1.0) -> FrictionInterval:
    estimator = FrictionEstimator(PERIOD_S)
    for record in records:
        estimator.add(record, unit)
    return estimator.interval


def test_feet_that_held_say_how_much_there_is_at_least_and_the_course_is_believed() -> None:
    found = interval(felt(np.full((60, 2), [0.7, 0.4]), (0.0, 0.0)))
    assert (found.share, found.high, found.planned_on) == (1.0, 1.0, 1.0)
    assert (found.slides, found.held) == (0, 2)
    assert 0.65 < found.low < 0.75
    assert found.line.startswith("at least 0.7")


def test_a_foot_that_slides_says_how_much_there_is_and_the_lower_end_is_planned_on() -> None:
    found = interval(felt(np.full((40, 2), [0.65, 0.4]), (0.05, 0.0)))
    assert (found.slides, found.held) == (1, 1)
    assert found.share == pytest.approx(0.65, abs=0.006)
    assert found.planned_on == found.low
    assert 0.02 < found.share - found.low < 0.05  # 1.64 σ of .02
    assert 0.02 < found.high - found.share < 0.05


def test_the_interval_holds_what_there_is_nine_times_of_ten() -> None:
    rng, hits = np.random.default_rng(0), 0
    for _ in range(200):
        truth = rng.uniform(0.4, 0.9)
        slides = truth + 0.02 * rng.standard_normal()
        noise = 0.01 * rng.standard_normal((40, 2))
        ratios = (
            np.stack([np.full(40, slides), np.full(40, truth * rng.uniform(0.3, 1.0))], axis=1)
            + noise
        )
        found = interval(felt(ratios, (0.05, 0.0)))
        hits += found.low <= truth <= found.high
    assert 170 <= hits <= 200


@pytest.mark.parametrize("truth", [0.65, 0.75])
def test_feet_that_hold_at_the_border_of_their_cones_do_not_push_it_above_what_slid(
    truth: float,
) -> None:
    slid = [
        felt(np.full((40, 2), truth), (0.05, 0.0)) for _ in range(5)
    ]  # in simulation both read the truth exactly
    held = [felt(np.full((40, 2), truth), (0.0, 0.0)) for _ in range(18)]
    found = interval(*slid, *held)
    assert (found.slides, found.held) == (4, 41)
    assert truth - 0.05 < found.low < truth - 0.01
    assert truth <= found.share < truth + 0.0125
    assert truth + 0.01 < found.high < truth + 0.05


def test_slides_that_differ_make_it_wider_and_the_same_ones_over_and_over_do_not_make_it_narrow() -> (
    None
):
    agree = [felt(np.full((40, 2), [0.65, 0.4]), (0.05, 0.0)) for _ in range(12)]
    differ = [felt(np.full((40, 2), [ratio, 0.4]), (0.05, 0.0)) for ratio in (0.6, 0.64, 0.68, 0.7)]
    one, same, wide = interval(agree[0]), interval(*agree), interval(*differ)
    widths = [each.high - each.low for each in (same, one, wide)]
    assert 0.015 <= widths[0] < widths[1] < widths[2]


def test_what_a_later_slide_contradicts_is_forgotten_and_what_is_below_it_stays() -> None:
    before = felt(np.full((60, 2), [0.95, 0.5]), (0.0, 0.0))
    slid = felt(np.full((40, 2), [0.6, 0.3]), (0.05, 0.0))
    found = interval(before, slid)
    assert found.share == pytest.approx(0.6, abs=0.01)
    assert found.held == 2  # the .5 of before and the .3 of now
    other_way = interval(
        slid, before
    )  # held with more than had slid: the estimate goes up, and says so
    assert other_way.share > found.share


def test_ratios_are_of_the_courses_friction_whatever_the_plan_counted_on() -> None:
    record = felt(np.full((40, 2), [1.0, 0.4]), (0.05, 0.0))
    assert interval(record, unit=0.7).share == pytest.approx(0.7, abs=0.006)


@pytest.mark.parametrize(
    "record",
    [
        felt(np.full((40, 2), 0.5), (0.05, 0.0), load_n=1.0),  # bears nothing
        felt(np.full((40, 2), 0.5), (0.05, 0.05), foothold=(-1, -1)),  # flies
        felt(np.full((40, 2), 0.5), (0.005, 0.005)),  # creeps: neither
        felt(np.full((5, 2), 0.5), (0.05, 0.0)),  # too short to tell
        felt(np.full((40, 2), [0.1, 0.0]), (0.3, 0.3), carried=0.4),  # falls, along the surfaces
        Record(),
    ],
)
def test_what_bears_nothing_flies_or_creeps_says_nothing(record: Record) -> None:
    found = interval(record)
    assert (found.slides, found.held, found.planned_on) == (0, 0, 1.0)


def test_a_foot_that_was_just_put_down_may_still_find_its_place() -> None:
    air, down = (
        felt(np.zeros((10, 2)), (0.0, 0.0), foothold=(-1, 1)),
        felt(np.full((18, 2), 0.5), (0.05, 0.0)),
    )
    assert interval(Record(pairs=[*air.pairs, *down.pairs], began_s=[0.0] * 28)).slides == 0
    assert all(a.time_s <= b.time_s for (_, a), (_, b) in pairwise(down.pairs))


ROBOT = hexapod()
STANDING = np.tile([0.0, 0.3, 0.0, 1.2], len(ROBOT.limbs))
SPREAD = STANDING + np.tile([0.0, -0.06, 0.0, 0.0], len(ROBOT.limbs))
"""Targets that press the feet outwards against the ground."""


def ground(friction: float) -> Patch:
    corners = 2.0 * np.array(
        [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    )
    axes = {"normal": np.array([0.0, 0.0, 1.0]), "shear_reference": np.array([1.0, 0.0, 0.0])}
    return Patch(vertices_m=corners, friction=friction, **axes)


def shares(world: SlippingWorld, periods: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Tangential over normal force of every foot, and how far each slid, mean and end of the last
    half.
    """
    height = 0.012 - float(Kinematics(ROBOT).feet(STANDING)[:, 2].min())
    first = world.connect((ground(0.8),), STANDING, np.array([0.0, 0.0, height]), np.eye(3))
    states = [world.step(SPREAD) for _ in range(periods)]
    forces = np.mean([state.forces_n for state in states[periods // 2 :]], axis=0)
    slid = np.linalg.norm((states[-1].feet_m - first.feet_m)[:, :2], axis=1)
    return np.linalg.norm(forces[:, :2], axis=1) / np.maximum(forces[:, 2], 1e-9), slid


def test_a_foot_that_slips_has_no_more_friction_than_it_is_left_with_and_the_others_have_theirs() -> (
    None
):
    with SlippingWorld(ROBOT, limb=1) as world:
        before, _ = shares(world)
    with SlippingWorld(ROBOT, limb=1) as world:
        world.inject("foot slips", 0.1)
        after, slid = shares(world)
        assert world.happened_s == pytest.approx(0.1, abs=0.006)
    assert before.min() > 0.05
    assert after[1] < 0.03
    assert slid[1] == slid.max()
    assert np.delete(after, 1).min() > 0.05


def test_friction_that_differs_bounds_all_feet() -> None:
    with SlippingWorld(ROBOT, share=0.01) as world:
        world.inject("friction differs", 0.1)
        after, _ = shares(world)
    assert after.max() < 0.01


def test_an_unknown_fault_is_refused() -> None:
    with (
        SlippingWorld(ROBOT) as world,
        refuses(*FAULTS, kind=ValueError),
    ):
        world.inject("earthquake")


RATE_HZ = 200.0
UPRIGHT = np.tile([0.0, 0.0, 1.0], (6, 1))
FEET = np.random.default_rng(0).uniform(-0.3, 0.3, (6, 3))


def sample(foothold: tuple[int, ...] = tuple(range(6))) -> Samples:
    return at_rest(
        feet_m=FEET,
        forces_n=20.0 * UPRIGHT,
        foothold=foothold,
        normals=UPRIGHT,
        friction=np.ones(6),
    )


def target(now: Samples, rolled_m: Array | None = None) -> Target:
    return Target(
        targets_rad=np.zeros(24),
        sample=now,
        origin_m=np.zeros(3),
        shift_m=np.zeros(3),
        angles_rad=np.zeros(24),
        torques_nm=np.zeros(24),
        rolled_m=np.zeros((6, 3)) if rolled_m is None else rolled_m,
        error_m=np.zeros(6),
    )


def state(feet_m: Array, load_n: float = 20.0) -> State:
    return State(
        time_s=0.0,
        position_m=np.zeros(3),
        rotation=np.eye(3),
        velocity=np.zeros(6),
        angles_rad=np.zeros(24),
        rates_rad_s=np.zeros(24),
        torques_nm=np.zeros(24),
        feet_m=feet_m,
        forces_n=load_n * UPRIGHT,
        bump_n=0.0,
        sent_rad=np.zeros(24),
    )


def seen(
    way: Array,
    *,
    load_n: float = 20.0,
    foothold: tuple[int, ...] = tuple(range(6)),
    rolls: bool = False,
) -> Array:
    """Feet 1 moves along a way in 0.1 s; who was seen to slide at any time."""
    watch, found = SlipDetector(RATE_HZ), np.zeros(6, dtype=bool)
    for k in range(20):
        moved = np.zeros((6, 3))
        moved[1] = way * k / 19
        found |= watch.slipping(
            target(sample(foothold), moved if rolls else None), state(FEET + moved, load_n)
        )
    return found


def test_a_loaded_foot_that_moves_along_its_surface_slides() -> None:
    np.testing.assert_array_equal(np.flatnonzero(seen(np.array([0.006, 0.0, 0.0]))), [1])


@pytest.mark.parametrize(
    ("way", "options"),
    [
        ([0.0, 0.0, 0.006], {}),  # pressed in
        ([0.002, 0.0, 0.0], {}),  # creeps
        ([0.006, 0.0, 0.0], {"load_n": 1.0}),
        ([0.006, 0.0, 0.0], {"foothold": (0, -1, 2, 3, 4, 5)}),
        ([0.006, 0.0, 0.0], {"rolls": True}),
    ],
)
def test_what_is_pressed_creeps_carries_nothing_flies_or_rolls_slides_not(
    way: list[float], options: dict
) -> None:  # type: ignore[type-arg]
    assert not seen(np.array(way), **options).any()


def test_a_foot_that_was_just_put_down_may_find_its_place() -> None:
    watch, slid = SlipDetector(RATE_HZ), list[bool]()
    for k in range(60):
        moved = np.zeros((6, 3))
        moved[1, 0] = 0.06e-3 * k
        foothold = (0, -1 if k < 5 else 1, 2, 3, 4, 5)
        slid.append(bool(watch.slipping(target(sample(foothold)), state(FEET + 5.0 * moved)).any()))
    assert 5 + 0.1 * RATE_HZ <= slid.index(True) <= 5 + 0.1 * RATE_HZ + 1


def test_feet_in_the_air_come_down_and_the_others_and_the_body_stay() -> None:
    now = sample((0, -1, 2, -1, 4, -1))
    toes = FEET - FOOT_RADIUS_M * UPRIGHT
    toes[1::2] -= [0.0, 0.0, 0.06]
    pushes = 20.0 * UPRIGHT, 10.0 * UPRIGHT
    motion = standing_motion(
        replace(now, frame=np.array(2.0)),
        com_m=np.ones(3),
        rotation_rad=np.full(3, 0.1),
        feet_m=FEET,
        toes_m=toes,
        normals=UPRIGHT,
        forces_n=pushes,
        foothold=np.arange(6, 12),
    )
    assert motion.duration_s == pytest.approx(0.06 / LAND_M_S + STAND_S)
    half, end = motion.at(0.5 * 0.06 / LAND_M_S), motion.at(motion.duration_s)
    np.testing.assert_allclose(half.feet_m[1::2], FEET[1::2] - [0.0, 0.0, 0.03])
    np.testing.assert_allclose(end.feet_m, toes + FOOT_RADIUS_M * UPRIGHT)
    for each in (motion.at(0.0), half, end):
        np.testing.assert_array_equal(each.com_m, np.ones(3))
        np.testing.assert_array_equal(each.feet_m[::2], FEET[::2])
        assert each.frame == 2.0
    np.testing.assert_array_equal([half.foothold, end.foothold], [now.foothold, np.arange(6, 12)])
    np.testing.assert_array_equal(half.forces_n, pushes[0])
    np.testing.assert_array_equal(end.forces_n, pushes[1])
