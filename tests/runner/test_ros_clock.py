"""A robot's clock seen from here: late messages, clocks that are off, simulated time, no stamps."""

import pytest

from stancekit.runner.worlds.ros.joint_states import RobotClock, stamp_of, version_of

PERIOD_S = 0.02
OFF_S = 1.7e9


def heard(
    delays_s: list[float], rate: float = 1.0, off_s: float = OFF_S
) -> tuple[RobotClock, list[float]]:
    """A clock, and when each of its messages was measured by ours; sent every period, and so long
    on the way.
    """
    clock = RobotClock()
    return clock, [
        clock.take(off_s + rate * k * PERIOD_S, k * PERIOD_S + delay_s)
        for k, delay_s in enumerate(delays_s)
    ]


def test_a_late_message_counts_as_measured_when_it_was() -> None:
    clock, measured = heard([0.004] * 20 + [0.5, 0.3])
    assert measured[-2:] == pytest.approx([20 * PERIOD_S + 0.004, 21 * PERIOD_S + 0.004])
    assert clock.at(1.0) == pytest.approx(OFF_S + 1.0 - 0.004)


@pytest.mark.parametrize("off_s", [OFF_S, OFF_S - 2.0, 12.5])
def test_a_clock_that_is_off_is_as_good_as_any(off_s: float) -> None:
    clock, measured = heard([0.003] * 30, off_s=off_s)
    assert clock.at(0.5) == pytest.approx(off_s + 0.497)
    assert measured == pytest.approx([k * PERIOD_S + 0.003 for k in range(30)])


@pytest.mark.parametrize("rate", [0.5, 0.9, 2.0])
def test_no_time_is_told_by_a_simulation_that_goes_at_another_speed(rate: float) -> None:
    clock, measured = heard([0.003] * 100, rate=rate)
    assert clock.at(2.0) is None
    assert measured[-1] == pytest.approx(99 * PERIOD_S + 0.003)


def test_nor_by_stamps_of_0_nor_by_few() -> None:
    clock = RobotClock()
    assert [clock.take(None, 0.1 * k) for k in range(9)] == pytest.approx(
        [0.1 * k for k in range(9)]
    )
    assert clock.at(1.0) is None
    assert heard([0.0] * 4)[0].at(1.0) is None


def test_the_period_is_the_median_of_what_came() -> None:
    clock, _ = heard([0.0, 0.0, 0.01, 0.0, 0.0, 0.0])
    assert clock.period_s() == pytest.approx(PERIOD_S)
    assert RobotClock().period_s() == 0.0


@pytest.mark.parametrize(
    ("message", "stamp", "version"),
    [
        ({"header": {"stamp": {"secs": 3, "nsecs": 500_000_000}}}, 3.5, 1),
        ({"header": {"stamp": {"sec": 3, "nanosec": 250_000_000}}}, 3.25, 2),
        ({"header": {"stamp": {"secs": 0, "nsecs": 0}}}, None, 1),
        ({"header": {"stamp": {"secs": "3", "nsecs": True}}}, None, 1),
        ({"header": 3}, None, None),
        ([], None, None),
    ],
)
def test_stamps_are_read_as_both_ros_write_them(
    message: object, stamp: float | None, version: int | None
) -> None:
    assert (stamp_of(message), version_of(message)) == (stamp, version)
