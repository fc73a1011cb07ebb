"""Bases against SciPy's splines and against finite differences."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicHermiteSpline

from stancekit.planners.gait.variables import (
    clamped_basis,
    clamped_knots,
    clamped_symbolic,
    hermite,
    uniform_basis,
)
from stancekit.planners.problem.walk import GAITS, FootPhases, schedule
from tests.refusals import refuses


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_uniform_basis_is_that_of_scipy(order: int) -> None:
    rng = np.random.default_rng(0)
    coefficients, times = rng.standard_normal(23), rng.uniform(0.0, 2.0, 50)
    spline = BSpline(0.1 * np.arange(-3, 24), coefficients, 3)
    assert uniform_basis(times, 2.0, 0.1, order) @ coefficients == pytest.approx(
        spline(times, nu=order), abs=1e-9
    )


def test_the_symbolic_basis_is_the_numeric_one() -> None:
    share = cs.SX.sym("s")
    function = cs.Function("b", [share], [clamped_symbolic(share, 5)])
    shares = np.linspace(0.0, 1.0, 41)
    found = np.array([np.asarray(function(s)).ravel() for s in shares])
    assert found == pytest.approx(clamped_basis(shares, 5).toarray(), abs=1e-12)
    assert len(clamped_knots(5)) == 12


@pytest.mark.parametrize("order", [0, 1, 2])
def test_hermite_weights_are_those_of_scipy(order: int) -> None:
    ends, speeds, lasting = np.array([0.3, -0.2]), np.array([1.0, 2.0]), 0.4
    spline = CubicHermiteSpline([0.0, lasting], ends, speeds)
    for share in (0.0, 0.3, 0.9):
        a, b, c, d = hermite(share, order)
        found = (
            a * ends[0] + b * lasting * speeds[0] + c * ends[1] + d * lasting * speeds[1]
        ) / lasting**order
        assert found == pytest.approx(float(spline(share * lasting, nu=order)))


@pytest.mark.parametrize("name", sorted(GAITS))
def test_every_gait_begins_and_ends_on_all_feet_and_keeps_its_duty(name: str) -> None:
    gait = GAITS[name]
    feet = schedule(gait, ["foot"] * len(gait.offsets), 10.0, 0.05)
    for foot in feet:
        assert foot.edges_s[1] >= 0.2 - 1e-9
        assert 10.0 - foot.edges_s[-2] >= 0.2 - 1e-9
        assert np.diff(foot.switches_s)[::2] == pytest.approx(gait.swing_s, abs=0.025 + 1e-9)
        assert np.diff(foot.switches_s[::2]) == pytest.approx(gait.cycle_s, abs=0.05 + 1e-9)
        assert np.rint(foot.switches_s / 0.05) * 0.05 == pytest.approx(foot.switches_s)


@pytest.mark.parametrize("name", sorted(GAITS))
def test_a_gait_balances_where_fewer_than_three_feet_stand_at_some_moment(name: str) -> None:
    gait = GAITS[name]
    times = np.linspace(2.0, 2.0 + gait.cycle_s, 1001)
    feet = schedule(gait, ["foot"] * len(gait.offsets), 10.0, 0.001)
    assert gait.balances == (np.sum([foot.stands(times) for foot in feet], axis=0).min() < 3)


@pytest.mark.parametrize(
    ("height_m", "cycle_s"), [(0.42, 1.0), (0.42 / 4.0, 0.5), (0.42 * 0.64, 0.8), (2.0, 1.0)]
)
def test_low_robots_step_faster_as_pendulums_of_their_height_fall(
    height_m: float, cycle_s: float
) -> None:
    assert GAITS["trot"].at(height_m, 0.05).cycle_s == pytest.approx(cycle_s)
    assert GAITS["trot"].at(height_m, 0.05).duty == GAITS["trot"].duty
    assert GAITS["tripod"].at(height_m, 0.05) is GAITS["tripod"]


@pytest.mark.parametrize("name", sorted(GAITS))
def test_the_shortest_cycle_has_phases_and_a_shorter_one_is_refused_in_one_line(name: str) -> None:
    gait = replace(GAITS[name], cycle_s=0.2)
    assert schedule(gait, ["foot"] * len(gait.offsets), 4.0, 0.05)[0].swings > 10
    assert GAITS["trot"].at(1e-6, 0.05).cycle_s == pytest.approx(0.2)
    with refuses("cycle_s"):
        schedule(replace(gait, cycle_s=0.15), ["foot"] * len(gait.offsets), 4.0, 0.05)


def test_a_gait_that_does_not_fit_is_refused_in_one_line() -> None:
    with refuses("duration_s"):
        schedule(GAITS["trot"], ["LF", "RF", "LH", "RH"], 1.0, 0.05)
    with refuses("gait"):
        schedule(GAITS["trot"], ["foot"] * 6, 10.0, 0.05)


def test_a_foot_stands_at_lift_off_and_at_touchdown() -> None:
    foot = FootPhases(np.array([0.5, 0.9, 1.5, 1.9]), 3.0)
    assert foot.stands(np.array([0.0, 0.5, 0.51, 0.89, 0.9, 1.7, 3.0])).tolist() == [
        True,
        True,
        False,
        False,
        True,
        False,
        True,
    ]
