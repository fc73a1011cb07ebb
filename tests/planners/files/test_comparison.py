"""Where two values from files differ first, against what was changed on purpose."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from stancekit.planners.files.writing import SAME, first_difference

VALUE: dict[str, Any] = {
    "name": "walls",
    "rows": [[1.0, 2.0], [3.0, 4.0]],
    "robot": {"mass_kg": 10.0, "legs": None},
}


def changed(*path: str | int, to: Any) -> dict[str, Any]:
    found = copy.deepcopy(VALUE)
    part: Any = found
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = to
    return found


def test_equal_values_have_no_difference_and_roundings_are_none() -> None:
    assert first_difference(VALUE, VALUE) == ""
    assert first_difference(changed("robot", "mass_kg", to=10.0 * (1.0 + 0.5 * SAME)), VALUE) == ""
    assert first_difference(changed("rows", to=((1, 2.0), (3.0, 4.0))), VALUE) == ""


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (changed("name", to="stairs"), "name: expected"),
        (changed("rows", 1, 0, to=3.0 + 1e-6), "rows[1][0]: expected"),
        (changed("rows", 0, to=[1.0]), "rows[0]: expected 2, got 1"),
        (changed("robot", "mass_kg", to="10"), "robot.mass_kg: expected"),
        (changed("robot", "legs", to=0), "robot.legs: expected"),
        (changed("robot", "mass_kg", to=True), "robot.mass_kg: expected"),
        (changed("robot", to=[]), "robot: expected"),
        (changed("speed", to=1.0), "speed: expected nothing, got 1.0"),
        ({key: VALUE[key] for key in ("name", "rows")}, "robot: expected this key, got nothing"),
    ],
)
def test_the_first_difference_is_named_by_its_place(said: dict[str, Any], message: str) -> None:
    assert first_difference(said, VALUE).startswith(message)
