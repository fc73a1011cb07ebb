"""The picture of a run: lines of every limb, however many joints it has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.runner.log import Message, Recorded
from stancekit.views.tracking_plot import draw_tracking, tracked

JOINTS = ["a1", "a2", "a3", "b1", "b2"]


def recorded(**plan: Any) -> Recorded:
    """A log of three commands to limbs of three and two joints, joint k off by k mrad."""
    off = 1e-3 * np.arange(5.0)
    contents = [("plan", {"joints": JOINTS, "course": "two limbs", **plan})]
    for k in range(4):
        state = {
            "time_s": 0.1 * k, "angles_rad": off.tolist(), "position_m": [0.0] * 3,
            "torques_nm": [1.0, -5.0, 2.0, 0.5, -0.25], "forces_n": [[0.0, 0.0, 9.0], [0.0, 3.0, 4.0]],
        }  # fmt: skip
        contents.append(("measurement", state))
    contents += [("command", {"planned_rad": [0.0] * 5, "sent_rad": [0.0] * 5})] * 3
    return Recorded(messages=tuple(Message(time_ns=0, topic=t, content=c) for t, c in contents), whole=True)


def test_each_limb_is_one_line_of_the_worst_of_its_joints() -> None:
    figure = draw_tracking(recorded(limbs={"A": JOINTS[:3], "B": JOINTS[3:]}))
    away, torque, force, _ = figure.axes
    assert [line.get_label() for line in away.lines] == ["A", "B"]
    for axes, values in ((away, (2.0, 4.0)), (torque, (5.0, 0.5)), (force, (9.0, 5.0))):
        for line, value in zip(axes.lines, values, strict=True):
            np.testing.assert_allclose(line.get_ydata(), value)


def test_a_limb_without_a_foot_that_was_felt_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"^log: forces_n: expected numbers of shape \(3, 1, 3\), got \(3, 2, 3\)"):
        tracked(recorded(limbs={"A": JOINTS}))


@pytest.mark.parametrize("said", [{}, {"limbs": {}}, {"limbs": {"A": JOINTS[:2], "B": JOINTS[3:]}},
                                  {"limbs": {"A": [], "B": JOINTS}}])  # fmt: skip
def test_limbs_that_are_not_those_of_the_joints_are_refused(said: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match=r"^log: limbs: expected the names of 5 joints by limb, got "):
        tracked(recorded(**said))
