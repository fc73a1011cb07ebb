"""Measurements are judged: joints that jump, two publishers, a controller that follows somebody
else.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stancekit.runner.worlds.ros import controller, joint_states
from stancekit.runner.worlds.ros.controller import FOREIGN, ControllerState
from stancekit.runner.worlds.ros.joint_states import JointStates
from stancekit.runner.worlds.ros.setup import Mapping, same_names
from tests.refusals import refuses

JOINTS = ("hip", "knee")
FASTEST = np.array([4.0, 4.0])


class Clock:
    """In place of the module ``time``."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    for module in (joint_states, controller):
        monkeypatch.setattr(module, "time", made)
    return made


@pytest.fixture
def states(clock: Clock) -> JointStates:
    return JointStates(Mapping(same_names(JOINTS), JOINTS), JOINTS, FASTEST)


def message(hip: float, knee: float, at_s: float = 0.0) -> dict[str, Any]:
    stamp = {"sec": int(at_s), "nanosec": round(1e9 * (at_s - int(at_s)))}
    return {
        "header": {"stamp": stamp},
        "name": list(JOINTS),
        "position": [hip, knee],
        "velocity": [0.0, 0.0],
    }


def state(actual: list[float], desired: list[float], at_s: float) -> dict[str, Any]:
    points = {
        "actual": {"positions": actual, "velocities": [0.0, 0.0]},
        "desired": {"positions": desired},
    }
    return {"header": message(0.0, 0.0, at_s)["header"], "joint_names": list(JOINTS)} | points


@pytest.mark.parametrize("stamped", [True, False])
def test_a_joint_that_jumps_is_refused_by_name_and_what_was_measured_stays(
    states: JointStates, clock: Clock, stamped: bool
) -> None:
    for _ in range(10):
        clock.now += 0.02
        states.take(message(0.1, 1.6, clock.now if stamped else 0.0))
    clock.now += 0.01
    with refuses("knee"):
        states.take(message(0.0, 0.0, clock.now if stamped else 0.0))
    np.testing.assert_allclose(states.read()[0], [0.1, 1.6])


@pytest.mark.parametrize("stamped", [True, False])
def test_a_joint_at_its_greatest_speed_is_believed_also_when_messages_come_in_bursts(
    states: JointStates, clock: Clock, stamped: bool
) -> None:
    for k in range(100):
        sent_s = 100.0 + 0.01 * k
        clock.now = (
            100.0 + 0.05 * np.ceil(0.2 * k) + 1e-4 * (k % 5)
        )  # five at once, as a busy machine gives them
        states.take(message(4.0 * 0.01 * k, -4.0 * 0.01 * k, sent_s if stamped else 0.0))
    assert states.read()[0][0] == pytest.approx(3.96)


def test_joints_that_are_not_the_robots_may_have_no_positions_and_are_left_alone(
    states: JointStates,
) -> None:
    states.take({"name": ["left_wheel", "right_wheel"], "velocity": [1.0, 1.0]})
    states.take({"name": ["finger"], "position": [None]})
    assert states.others == {"left_wheel", "right_wheel", "finger"}
    with refuses():
        states.take({"name": ["hip", "wheel"], "velocity": [1.0, 1.0]})


def test_two_measurements_of_a_joint_that_differ_are_two_publishers_also_when_every_third_is_right(
    states: JointStates, clock: Clock
) -> None:
    known = ControllerState(Mapping(same_names(JOINTS), JOINTS), JOINTS, states)
    for k in range(60):
        clock.now += 0.02
        states.take(message(0.1, 1.6 if k % 3 == 0 else 1.75, clock.now))
        known.take(state([0.1, 1.6], [0.1, 1.6], clock.now))
    assert known.trouble() == (
        "knee: joint states say 1.750 rad, while its controller measures 1.600: two publishers?"
    )


def test_measurements_of_moving_joints_may_differ_by_what_they_turn_in_between(
    states: JointStates, clock: Clock
) -> None:
    known = ControllerState(Mapping(same_names(JOINTS), JOINTS), JOINTS, states)
    for k in range(100):
        clock.now += 0.02
        if k % 5 == 0:  # ten times a second
            said = message(0.02 * k, 0.0, clock.now) | {"velocity": [1.0, 0.0]}
            states.take(said)
        moving = state([0.02 * k, 0.0], [0.02 * k, 0.0], clock.now)
        moving["actual"]["velocities"] = [1.0, None]
        known.take(moving)
        assert known.trouble() is None


def test_a_controller_that_wants_what_nobody_sent_follows_somebody_else(
    states: JointStates, clock: Clock
) -> None:
    known = ControllerState(Mapping(same_names(JOINTS), JOINTS), JOINTS, states)
    known.take(state([0.0, 0.0], [0.0, 0.0], clock.now))
    for k in range(100):
        clock.now += 0.02
        known.sent(np.array([0.01 * k, 0.0]))
        known.take(state([0.01 * k, 0.0], [0.01 * max(k - 4, 0), 0.0], clock.now))
        assert known.trouble() is None
    for _ in range(FOREIGN):
        clock.now += 0.02
        known.take(state([1.0, 0.0], [1.0, 0.2], clock.now))
    assert (
        known.trouble()
        == "knee: the controller wants 0.200 rad, which was not sent: another client?"
    )
    known.forget()
    assert known.trouble() is None


def test_a_controller_that_moves_joints_is_busy(states: JointStates) -> None:
    known = ControllerState(Mapping(same_names(JOINTS), JOINTS), JOINTS, states)
    still = state([0.0, 0.0], [0.0, 0.0], 100.0)
    known.take(still)
    assert known.busy() is None
    still["desired"]["velocities"] = [0.0, 0.3]
    known.take(still)
    assert known.busy() == "knee: the controller turns it by 0.30 rad/s: another client?"


@pytest.mark.parametrize("names", [("reference", "feedback"), ("desired", "actual")])
def test_states_of_every_version_are_understood(
    states: JointStates, names: tuple[str, str]
) -> None:
    known = ControllerState(Mapping(same_names(JOINTS), JOINTS), JOINTS, states)
    points = {
        names[0]: {"positions": [0.0, 0.0], "velocities": [0.0, 1.0]},
        names[1]: {"positions": []},
    }
    known.take({"joint_names": list(JOINTS)} | points)
    assert known.names == JOINTS
    assert known.busy() is not None
