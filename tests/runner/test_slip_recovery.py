"""What a robot does at once when feet slide: seen in time, nothing else taken for it, and where its
feet go then.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M
from stancekit.runner.control.slip_recovery import LAND_M_S, STAND_S, SlipDetector, StandingMotion
from stancekit.runner.control.tracker import Target
from stancekit.runner.worlds.world import State
from tests.runner.at_rest import at_rest

RATE_HZ = 200.0
UP = np.tile([0.0, 0.0, 1.0], (6, 1))
FEET = np.random.default_rng(0).uniform(-0.3, 0.3, (6, 3))


def sample(foothold: tuple[int, ...] = tuple(range(6))) -> Samples:
    return at_rest(
        feet_m=FEET, forces_n=20.0 * UP, foothold=foothold, normals=UP, friction=np.ones(6)
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
        forces_n=load_n * UP,
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
    first = slid.index(True)
    assert 5 + 0.1 * RATE_HZ <= first <= 5 + 0.1 * RATE_HZ + 1


def test_feet_in_the_air_come_down_and_the_others_and_the_body_stay() -> None:
    now = sample((0, -1, 2, -1, 4, -1))
    toes = FEET - FOOT_RADIUS_M * UP
    toes[1::2] -= [0.0, 0.0, 0.06]
    pushes = 20.0 * UP, 10.0 * UP
    motion = StandingMotion(
        replace(now, frame=np.array(2.0)),
        com_m=np.ones(3),
        rotation_rad=np.full(3, 0.1),
        feet_m=FEET,
        toes_m=toes,
        normals=UP,
        forces_n=pushes,
        foothold=np.arange(6, 12),
    )
    assert motion.duration_s == pytest.approx(0.06 / LAND_M_S + STAND_S)
    half, end = motion.at(0.5 * 0.06 / LAND_M_S), motion.at(motion.duration_s)
    np.testing.assert_allclose(half.feet_m[1::2], FEET[1::2] - [0.0, 0.0, 0.03])
    np.testing.assert_allclose(end.feet_m, toes + FOOT_RADIUS_M * UP)
    for each in (motion.at(0.0), half, end):
        np.testing.assert_array_equal(each.com_m, np.ones(3))
        np.testing.assert_array_equal(each.feet_m[::2], FEET[::2])
        assert each.frame == 2.0
    np.testing.assert_array_equal([half.foothold, end.foothold], [now.foothold, np.arange(6, 12)])
    np.testing.assert_array_equal(half.forces_n, pushes[0])
    np.testing.assert_array_equal(end.forces_n, pushes[1])
