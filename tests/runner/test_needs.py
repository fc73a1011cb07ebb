"""What a motion needs of its joints, against closed forms."""

import numpy as np
import pytest

from stancekit.planners.robot.actuators import ActuatorModel
from stancekit.runner.acceptance import JointNeeds, thermal_load

SERVO = ActuatorModel(stall_nm=10.0, continuous_nm=2.0, no_load_rad_s=3.0, thermal_s=50.0)


@pytest.mark.parametrize("seconds", [5.0, 50.0, 500.0])
def test_a_constant_torque_heats_as_a_first_order_system_does(seconds: float) -> None:
    period = 0.01
    squares = np.full((round(seconds / period), 1), 2.25)
    load = thermal_load(squares, np.array([50.0]), period)
    assert load[0] == pytest.approx(2.25 * (1.0 - np.exp(-seconds / 50.0)), rel=1e-9)


def test_the_worst_load_is_that_on_the_way_and_not_at_the_end() -> None:
    squares = np.concatenate([np.full((1000, 1), 9.0), np.zeros((9000, 1))])
    load = thermal_load(squares, np.array([20.0]), 0.01)
    assert load[0] == pytest.approx(9.0 * (1.0 - np.exp(-10.0 / 20.0)), rel=1e-9)


def test_peaks_means_and_shares_are_those_of_the_torques() -> None:
    times = np.arange(0.0, 10.0, 0.01)
    torques = np.stack([4.0 * np.sin(2 * np.pi * times), np.full_like(times, -1.0)], axis=1)
    needs = JointNeeds.of(
        ("a", "b"), (SERVO, ActuatorModel(stall_nm=5.0, no_load_rad_s=1.0)), torques, 0.01
    )
    assert needs.peak_nm == pytest.approx([4.0, 1.0], rel=1e-3)
    assert needs.rms_nm == pytest.approx([4.0 / np.sqrt(2.0), 1.0], rel=1e-6)
    assert needs.share_of_stall == pytest.approx([0.4, 0.2], rel=1e-3)
    assert needs.share_of_continuous[0] == pytest.approx(np.sqrt(2.0), rel=1e-6)
    assert np.isnan([needs.share_of_continuous[1], needs.heat[1]]).all()
    assert needs.to_json()["b"]["heat"] is None


def test_a_short_effort_is_borne_and_a_long_one_is_said_with_its_heat() -> None:
    short, long = (
        JointNeeds.of(("knee",), (SERVO,), np.full((count, 1), 6.0), 0.1) for count in (50, 100)
    )  # nine times the heat at last: borne for 50 s · ln(9/8) = 5.9 s
    assert short.said(0) == "6 Nm at most and 6 Nm (RMS)"
    assert long.said(0) == "6 Nm at most and 6 Nm (RMS), 1.6 times the heat that it bears"


def test_what_nobody_knows_of_its_heat_is_taken_to_be_repeated_for_ever() -> None:
    unknown = ActuatorModel(stall_nm=10.0, continuous_nm=2.0, no_load_rad_s=3.0)
    torques = np.array([[4.0], [0.0], [0.0], [0.0]])
    assert JointNeeds.of(("knee",), (unknown,), torques, 0.1).heat == pytest.approx([1.0])
