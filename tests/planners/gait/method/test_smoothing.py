"""The second phase lowers peaks and loses neither feasibility nor its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.gait.gait_program import GaitProgram
from stancekit.planners.gait.method.smoothing import Smoothing, peak_g, smoothed
from stancekit.planners.verify.trajectories import check_trajectory
from tests.refusals import refuses


@pytest.fixture(scope="module")
def rough(small):
    """A feasible motion that shakes, for its guess did."""
    program = small()
    solution = program.solve(program.perturbed(np.random.default_rng(3), 0.02))
    assert solution.success
    return solution


@pytest.fixture(scope="module")
def rounds(rough):
    return list(smoothed(rough, Smoothing(rounds=3, enough_g=0.0, gain=0.0)))


def test_every_round_ends_feasible_and_the_peak_goes_down(rough, rounds):
    peaks = [peak_g(check_trajectory(rough.trajectory())), *(one.peak_g for one in rounds)]
    assert rounds
    assert all(one.solution.success for one in rounds)
    assert all(one.solution.violation < rough.program.settings.tolerance for one in rounds)
    assert peaks[-1] < 0.8 * peaks[0]


def test_the_peak_is_that_of_the_samples_themselves(rounds):
    torso = rounds[-1].report.answer.torso_m
    samples = np.linalg.norm(np.diff(torso, 2, axis=0), axis=1) / 0.005**2
    assert rounds[-1].peak_g == pytest.approx(samples.max() / 9.81, rel=1e-6)


def test_a_calm_motion_is_left_alone(rough):
    assert list(smoothed(rough, Smoothing(enough_g=100.0))) == []


def test_what_asks_to_stop_is_heard_between_solves(rough):
    asked = iter([False, True])
    assert (
        len(
            list(
                smoothed(
                    rough, Smoothing(rounds=4, enough_g=0.0, gain=0.0), stop=lambda: next(asked)
                )
            )
        )
        == 1
    )


def test_a_round_that_loses_feasibility_is_the_last(rough):
    def failing(program: GaitProgram, guess, /, **options):
        return replace(rough, success=False)

    found = list(smoothed(rough, Smoothing(rounds=4, enough_g=0.0), solve=failing))
    assert len(found) == 1
    assert not found[0].solution.success


@pytest.mark.parametrize(("name", "value"), [("rounds", -1), ("iterations", 0), ("gain", -0.1)])
def test_settings_out_of_range_are_refused(name, value):
    with refuses(name):
        Smoothing(**{name: value})
