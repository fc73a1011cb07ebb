"""What a function of the library is given and cannot use is one line that names the argument, before
any work.
"""

from __future__ import annotations

import inspect
from dataclasses import fields
from functools import cache, partial
from typing import Any, get_type_hints

import numpy as np
import pytest

import stancekit
from stancekit.planners.errors import InvalidInput
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.runner.worlds.world import Imperfections
from tests.refusals import refuses

FUNCTIONS = (
    "draw",
    "evaluate",
    "explain",
    "export",
    "film",
    "fit",
    "heights",
    "label",
    "load",
    "plan",
    "robot",
    "run",
    "sample",
    "save",
    "simulate",
    "solve",
    "terrain",
    "verify",
    "walk",
    "warp",
)
BY_NAME = {
    ("fit", "settings"),
    ("label", "further"),
    ("plan", "old"),
    ("solve", "old"),
    ("terrain", "meaning"),
    ("walk", "task"),
    ("heights", "meaning"),
}
"""Arguments that have names of their own, checked by who knows them."""


class Nothing:
    """Of no use to any function."""


class Slippery:
    """A distribution with nothing but ``sample``."""

    def sample(self, rng):
        return stancekit.sample("wall-3", rng=rng)[0]


def wrong_arguments() -> list[tuple[str, str]]:
    """Every argument of every function."""
    found = [
        (function, name)
        for function in FUNCTIONS
        for name in inspect.signature(getattr(stancekit, function)).parameters
    ]
    return [(function, name) for function, name in found if (function, name) not in BY_NAME]


@pytest.fixture(scope="module")
def fine() -> dict[str, dict[str, Any]]:
    """A good value of every required argument."""
    problem = stancekit.sample("wall-3", rng=8)[0]
    certificate = stancekit.solve(problem).certificate
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    return {
        "sample": {"problems": "wall-3"},
        "solve": {"problem": problem},
        "plan": {"course": "stairs"},
        "walk": {"terrain": "ripple", "goal": (1.0, 0.0)},
        "verify": {"subject": certificate},
        "explain": {"subject": certificate},
        "draw": {"subject": problem},
        "label": {"problems": "wall-3", "folder": "data"},
        "fit": {"dataset": "data"},
        "evaluate": {"selector": "e.json", "dataset": "data"},
        "load": {"path": "a"},
        "save": {"thing": problem, "path": "a.json"},
        "robot": {"source": "hexapod"},
        "terrain": {"source": "ripple"},
        "film": {"motion": walk, "out": "a.mp4"},
        "export": {"subject": walk, "out": "w.csv"},
        "heights": {"source": "hill"},
        "warp": {"terrain": "hill"},
        "simulate": {"motion": walk},
        "run": {"motion": walk},
    }


@pytest.mark.parametrize(("function", "name"), wrong_arguments())
def test_an_argument_of_another_type_is_one_line_with_its_name(
    function, name, fine, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with refuses(name):
        getattr(stancekit, function)(**fine[function] | {name: Nothing()})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("function", "arguments", "options", "line"),
    [
        ("sample", ["wall-3", 1.5], {}, "count"),
        ("sample", ["wall-3", True], {}, "count"),
        (
            "sample",
            ["wall-3"],
            {"rng": -1},
            "rng",
        ),
        (
            "sample",
            [Slippery],
            {},
            "problems",
        ),
        (
            "walk",
            ["ripple", "1,0"],
            {},
            "goal",
        ),
        (
            "walk",
            ["ripple", (1, 0)],
            {"adhesive": "LF"},
            "adhesive",
        ),
        (
            "walk",
            ["ripple", (1, 0)],
            {"adhesive": ["X"]},
            "adhesive",
        ),
    ],
)
def test_what_came_is_said(function: str, arguments: list[Any], options: dict[str, Any], line: str):
    with refuses(line, kind=stancekit.InvalidInput):
        getattr(stancekit, function)(*arguments, **options)


@pytest.mark.parametrize(
    ("function", "arguments", "options", "begins", "ends"),
    [
        (
            "walk",
            ["ripple"],
            {},
            "stancekit.walk: missing a required argument: 'goal'; it t",
            ", time_limit_s",
        ),
        (
            "solve",
            [],
            {"p": 1},
            "stancekit.solve: missing a required argument: 'problem'; it takes problem, ",
            "",
        ),
        (
            "plan",
            ["walls"],
            {"friction": 1},
            "stancekit.plan: got an unexpected keyword argument 'friction'; it t",
            "",
        ),
    ],
)
def test_what_a_verb_takes_is_said(
    function: str, arguments: list[Any], options: dict[str, Any], begins: str, ends: str
):
    with pytest.raises(TypeError) as caught:
        getattr(stancekit, function)(*arguments, **options)
    assert str(caught.value).startswith(begins)
    assert ends in str(caught.value)


def test_a_plan_is_for_another_robot_where_one_is_named(tmp_path):
    with refuses("none.urdf"):
        stancekit.plan("walls", robot=tmp_path / "none.urdf")
    with refuses("robot"):
        stancekit.plan(stancekit.sample("ground-3", rng=3)[0].course(), robot="hexapod")
    assert stancekit.plan("stairs", frames=2, robot="hexapod").solution is not None


@pytest.mark.parametrize("none", [None, float("nan")])
@pytest.mark.parametrize(
    "part",
    ["body", "limits", "timing", "tolerance", ImportOptions, Imperfections, stancekit.LeapFinder],
)
def test_none_is_no_number_of_settings_that_have_one(part: Any, none: float | None) -> None:
    usual = getattr(stancekit.RunSettings(), part) if isinstance(part, str) else part()
    for name in [each for each, value in vars(usual).items() if isinstance(value, float | int)]:
        with refuses(name):
            type(usual)(**{name: none})


def test_numbers_of_numpy_are_numbers():
    problem = stancekit.sample("wall-3", np.int64(1), rng=np.random.default_rng(0))[0]
    assert stancekit.solve(problem, time_limit_s=np.float32(5.0)).solution is not None
    assert stancekit.solve(problem, time_limit_s=5).solution is not None


def test_the_annotations_of_every_verb_can_be_looked_up():
    for function in FUNCTIONS:
        function = inspect.unwrap(getattr(stancekit, function))
        assert set(inspect.signature(function).parameters) <= set(get_type_hints(function))


def test_one_posture_problem_is_a_course_of_one_frame():
    problem = stancekit.sample("ground-3", rng=3)[0]
    assert stancekit.plan(problem).solution.com_m.shape == (1, 3)
    with refuses("frames"):
        stancekit.plan(problem, frames=2)


def test_something_with_sample_is_labelled_by_the_name_of_its_class(tmp_path):
    one, two = (
        stancekit.label(Slippery(), tmp_path / f"{workers}", rows=(3, 3), workers=workers)
        for workers in (1, 2)
    )
    assert [p.to_json() for p in one.problems()] == [p.to_json() for p in two.problems()]
    assert one.problem_class == "Slippery"


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
