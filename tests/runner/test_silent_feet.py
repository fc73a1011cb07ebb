"""Feet that should press and feel nothing: counted over stances, forgotten as soon as they feel; a
run that stops.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stancekit.runner.control.friction import SILENT_S, SilentFeet
from tests.runner.test_friction import PERIOD_S, felt

PERIODS = round(SILENT_S / PERIOD_S)


def said(
    feet: SilentFeet, periods: int, loads: tuple[float, float], foothold: tuple[int, int] = (0, 1)
) -> str:
    """The last that is said in so many periods. loads: shares of the planned 30 N that the feet
    feel.
    """
    line = ""
    for target, state in felt(np.zeros((periods, 2)), (0.0, 0.0), foothold).pairs:
        line = feet.found(
            target, replace(state, forces_n=np.array(loads)[:, None] * state.forces_n)
        )
    return line


def test_a_foot_that_should_press_and_feels_nothing_is_named_after_a_while_over_several_stances() -> (
    None
):
    feet = SilentFeet(1.0 / PERIOD_S, 60.0, ("LF", "RF"))
    assert said(feet, PERIODS // 2 + 1, (1.0, 0.0)) == ""
    assert (
        said(feet, PERIODS, (1.0, 0.0), foothold=(0, -1)) == ""
    )  # in the air nothing is to be felt
    line = said(feet, PERIODS // 2, (1.0, 0.0))
    assert line.startswith("foot of RF: expected 30 N where it stands, felt none for 0.3 s")


def test_a_foot_that_feels_something_begins_anew() -> None:
    feet = SilentFeet(1.0 / PERIOD_S, 60.0, ("LF", "RF"))
    for _ in range(3):
        assert said(feet, PERIODS - 2, (1.0, 0.0)) == ""
        assert said(feet, 1, (1.0, 0.5)) == ""


def test_of_a_light_robot_less_is_expected() -> None:
    heavy, light = (
        SilentFeet(1.0 / PERIOD_S, weight_n, ("LF", "RF")) for weight_n in (300.0, 20.0)
    )
    record = felt(np.zeros((PERIODS + 1, 2)), (0.0, 0.0), load_n=5.0)
    lines = [
        [
            feet.found(target, replace(state, forces_n=0.0 * state.forces_n))
            for target, state in record.pairs
        ][-1]
        for feet in (heavy, light)
    ]
    assert lines[0] == ""
    assert "expected 5 N" in lines[1]
