"""The picture of a run: lines of every limb, however many joints it has."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stancekit.runner.log import Message, Recorded
from stancekit.views.gait_plot import draw_tracking, tracked
from tests.refusals import refuses

JOINTS = ["a1", "a2", "a3", "b1", "b2"]


def recorded(**plan: Any) -> Recorded:
    """A log of three commands to limbs of three and two joints, joint k off by k mrad."""
    off = 1e-3 * np.arange(5.0)
    contents = [("plan", {"joints": JOINTS, "course": "two limbs", **plan})]
    for k in range(4):
        state = {
            "time_s": 0.1 * k,
            "angles_rad": off.tolist(),
            "position_m": [0.0] * 3,
            "torques_nm": [1.0, -5.0, 2.0, 0.5, -0.25],
            "forces_n": [[0.0, 0.0, 9.0], [0.0, 3.0, 4.0]],
        }
        contents.append(("measurement", state))
    contents += [("command", {"planned_rad": [0.0] * 5, "sent_rad": [0.0] * 5})] * 3
    return Recorded(
        messages=tuple(Message(time_ns=0, topic=t, content=c) for t, c in contents), whole=True
    )


def test_each_limb_is_one_line_of_the_worst_of_its_joints() -> None:
    figure = draw_tracking(recorded(limbs={"A": JOINTS[:3], "B": JOINTS[3:]}))
    away, torque, force, _ = figure.axes
    assert [line.get_label() for line in away.lines] == ["A", "B"]
    for axes, values in ((away, (2.0, 4.0)), (torque, (5.0, 0.5)), (force, (9.0, 5.0))):
        for line, value in zip(axes.lines, values, strict=True):
            np.testing.assert_allclose(line.get_ydata(), value)


def test_what_was_planned_slid_and_planned_anew_is_drawn_where_the_log_says_it() -> None:
    log = recorded(limbs={"A": JOINTS[:3], "B": JOINTS[3:]}, torque_nm=[6.0, 6.0, 6.0, 4.0, 4.0])
    aim = {
        "origin_m": [0.1, 0.0, 0.0],
        "forces_n": [[0.0, 0.0, 8.0], [0.0, 0.0, 5.0]],
        "foothold": [0, 1],
    }
    feet = [[[0.001 * k, 0.0, 0.0], [0.0, 0.002 * k, 0.0]] for k in range(4)]
    states = [
        replace(each, content=each.content | {"feet_m": feet[k]})
        for k, each in enumerate(m for m in log.messages if m.topic == "measurement")
    ]
    rest = [each for each in log.messages if each.topic != "measurement"]
    said: list[tuple[str, dict[str, Any]]] = [
        ("target", aim | {"time_s": 0.1 * k, "rolled_m": [[0.0005 * k, 0.0, 0.0], [0.0] * 3]})
        for k in range(1, 4)
    ]
    said.append(("decision", {"what": "plan anew", "why": "feet slid", "time_s": 0.2}))
    said.append(("decision", {"what": "armed", "why": "asked", "time_s": 0.3}))
    more = [Message(time_ns=0, topic=topic, content=content) for topic, content in said]
    figure = draw_tracking(Recorded(messages=(*rest[:1], *states, *rest[1:], *more), whole=True))
    away, torque, force, slid, body = figure.axes
    assert [line.get_xdata() for line in away.lines[2:]] == [[0.2, 0.2]]
    assert list(torque.lines[2].get_ydata()) == [6.0, 6.0]
    for line, value in zip(force.lines[2:4], (8.0, 5.0), strict=True):
        np.testing.assert_allclose(line.get_ydata(), value)
    for line, rate in zip(slid.lines[:2], (0.5, 2.0), strict=True):  # what a foot rolls is no slip
        np.testing.assert_allclose(line.get_ydata(), [0.0, rate, 2.0 * rate])
    np.testing.assert_allclose(body.lines[0].get_ydata(), 100.0)


def test_a_limb_without_a_foot_that_was_felt_is_refused() -> None:
    with refuses("log", "forces_n"):
        tracked(recorded(limbs={"A": JOINTS}))


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"limbs": {}},
        {"limbs": {"A": JOINTS[:2], "B": JOINTS[3:]}},
        {"limbs": {"A": [], "B": JOINTS}},
    ],
)
def test_limbs_that_are_not_those_of_the_joints_are_refused(said: dict[str, Any]) -> None:
    with refuses("log", "limbs"):
        tracked(recorded(**said))
