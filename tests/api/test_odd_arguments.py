"""What the public classes and functions say to arguments of wrong types and absurd sizes:
InvalidInput, or nothing.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit.planners.errors import InvalidInput
from tests.refusals import refuses

ODD: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    1,
    2**31,
    2**63,
    -(2**63),
    10**400,
    0.5,
    1e308,
    -1e308,
    5e-324,
    float("nan"),
    float("inf"),
    "",
    "x",
    "x" * 3000,
    b"x",
    [],
    {},
    (),
    [1, 2],
    (1, 2),
    ["x"],
    [None],
    [[]],
    {"a": 1},
    {1, 2},
    range(3),
    1j,
    object(),
    int,
    len,
    np.zeros(0),
    np.zeros(3),
    np.zeros((3, 3)),
    np.full(3, np.nan),
    np.full((4, 3), 1e308),
    np.array(["a"]),
    np.array([None]),
    np.array(1.0),
    np.zeros((2, 2, 2)),
    [float("nan")] * 3,
    [[1.0], [1.0, 2.0]],
    iter([]),
    "\ud800",
)


@cache
def sound() -> dict[str, Any]:
    """One of every public class, sound."""
    robot, problem = stancekit.hexapod(), stancekit.sample("wall-3", rng=8)[0]
    x = np.linspace(-1.0, 1.0, 5)
    level = stancekit.HeightField(x_m=x, y_m=x, heights_m=np.zeros((5, 5)), name="level")
    return {
        "Robot": robot,
        "Limb": robot.limbs[0],
        "Problem": problem,
        "Contact": problem.contacts[0],
        "Patch": problem.contacts[0].patch,
        "HeightField": level,
    }


def arguments(value: Any) -> dict[str, Any]:
    """The arguments that make a value again."""
    if isinstance(value, stancekit.HeightField):
        return {name: getattr(value, name) for name in ("x_m", "y_m", "heights_m", "name")}
    return {field.name: getattr(value, field.name) for field in fields(value) if field.init}


@pytest.mark.parametrize("name", ["Robot", "Limb", "Problem", "Contact", "Patch", "HeightField"])
def test_a_constructor_takes_what_it_can_be_or_says_what_is_wrong(name: str) -> None:
    value = sound()[name]
    whole = arguments(value)
    type(value)(**whole)
    wrong, refused = [], 0
    for field in whole:
        for odd in ODD:
            try:
                with np.errstate(all="raise"):
                    type(value)(**{**whole, field: odd})
            except InvalidInput as error:
                refused += 1
                if "\n" in str(error) or len(str(error)) > 2200:
                    wrong.append(f"{field}={odd!r:.40}: {error!s:.80}")
            except Exception as error:
                wrong.append(f"{field}={odd!r:.40}: {type(error).__name__}: {error!s:.80}")
    assert wrong == []
    assert refused > 5 * len(whole)


CALLS: dict[str, tuple[Any, dict[str, Any]]] = {
    "sample": (
        stancekit.sample,
        {"problems": "wall-3", "count": 1, "robot": None, "terrain": None, "rng": 0},
    ),
    "verify": (stancekit.verify, {"subject": None}),
    "explain": (stancekit.explain, {"subject": None}),
    "load": (stancekit.load, {"path": "none"}),
    "save": (stancekit.save, {"thing": None, "path": "none/none"}),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_function_takes_what_it_can_be_or_says_what_is_wrong(name: str) -> None:
    call, whole = CALLS[name]
    names = list(whole)
    wrong, refused = [], 0
    for k, argument in enumerate(names):
        for odd in ODD:
            given = {**whole, argument: odd}
            first, rest = (
                list(given.values())[: min(k + 1, 2)],
                dict(list(given.items())[min(k + 1, 2) :]),
            )
            try:
                partial(call, *first)(**({} if name not in ("sample",) else rest))
            except InvalidInput:
                refused += 1
            except TypeError as error:
                if "stancekit." not in str(error):  # one that names the function and what it takes
                    wrong.append(f"{argument}={odd!r:.40}: {type(error).__name__}: {error!s:.80}")
            except Exception as error:
                wrong.append(f"{argument}={odd!r:.40}: {type(error).__name__}: {error!s:.80}")
    assert wrong == []
    assert refused > 10


def test_lists_of_other_things_are_said_by_their_place() -> None:
    problem = sound()["Problem"]
    more: dict[str, Any] = {"mass_kg": 10.0, "com_nominal_m": [0.0, 0.0, 0.0], "com_radius_m": 0.1}
    with refuses("contacts[0]"):
        stancekit.Problem.posture(contacts=[1, 2], **more)  # type: ignore[arg-type]
    with refuses("contacts"):
        stancekit.Problem.posture(contacts=np.zeros(0), **more)  # type: ignore[arg-type]
    assert (
        stancekit.Problem.posture(contacts=list(problem.contacts), **more).contacts
        == problem.contacts
    )
    for limbs, message in (
        ("x", "expected a list of Limb, got 'x'"),
        (range(3), "got range(0, 3)"),
        (b"x", "got b'x'"),
    ):
        with pytest.raises(InvalidInput) as caught:
            stancekit.Robot(name="a", mass_kg=1.0, limbs=limbs)  # type: ignore[arg-type]
        assert message in str(caught.value)
    with refuses("count"):
        stancekit.sample("wall-3", 2**63)
