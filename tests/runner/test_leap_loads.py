"""What a leap needs of its tracker and its drives: forces over whole periods, and loads beside angles."""

from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.formats.leap_file import read_leap
from stancekit.planners.motion.leap_motion import LeapRun
from stancekit.runner.motion.redundancy import MeanForces
from stancekit.runner.worlds import make_world

FILE = Path(__file__).parents[1] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def motion() -> LeapRun:
    plan = read_leap(FILE).plan
    assert plan is not None
    return LeapRun(plan)


@pytest.mark.parametrize("period_s", [0.005, 0.0061])
def test_a_tracker_commands_the_impulse_of_a_leap(motion: LeapRun, period_s: float):
    times = np.arange(0.0, motion.duration_s, period_s)
    commanded = MeanForces(motion, period_s).at(times).forces_n.sum(axis=(0, 1)) * period_s
    fine = np.arange(-period_s, times[-1], 1e-4) + 5e-5
    planned = motion.at(fine).forces_n.sum(axis=(0, 1)) * 1e-4
    weight = motion.plan.problem.weight_n
    np.testing.assert_allclose(
        commanded, planned, atol=0.3 * period_s * weight
    )  # a tenth of a period each change


def test_what_carries_in_a_part_of_a_period_stands_in_it(motion: LeapRun):
    plan, before = motion.plan, motion.settle_s
    first = plan.problem.timings_s[plan.timing][0] + before
    mean = MeanForces(motion, 0.005)
    assert (mean.at(first + 0.001).foothold >= 0).all()
    assert (mean.at(first + 0.0051).foothold < 0).all()
    half = mean.at(first + 0.0025).forces_n
    np.testing.assert_allclose(half, 0.4 * motion.at(first - 1e-4).forces_n, rtol=0.51)


def test_loads_may_lead_beyond_the_limits_of_angles(motion: LeapRun):
    robot = motion.plan.problem.robot
    with make_world("mujoco", robot) as world:
        model = robot.source.own_model()
        stance = np.concatenate([leg.stance_rad for leg in model.legs])
        upper = np.minimum(world.drives.upper_rad, 9.0)
        world.reset((), stance, np.array([0.0, 0.0, 5.0]), np.eye(3))
        loads = np.full(len(stance), 0.7)
        for _ in range(100):
            apart = world.loaded(upper + 0.5 + loads, loads)
        np.testing.assert_allclose(apart.sent_rad, upper + loads, atol=1e-9)
        for _ in range(100):
            together = world.step(upper + 0.5 + loads)
        np.testing.assert_allclose(together.sent_rad, upper, atol=1e-9)
