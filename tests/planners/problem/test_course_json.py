"""A course comes back from its JSON form to the last bit, and what is wrong with a file is named
key by key.
"""

from __future__ import annotations

import copy
import json
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import builtin_courses, read_course
from stancekit.planners.problem.problem import Foothold, StepLimits, Weights
from stancekit.planners.robot import Limb, Robot
from stancekit.planners.terrain import Patch
from tests.refusals import refuses

NUMBERS = st.floats(-5.0, 5.0, allow_subnormal=False)
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
POSITIVE = st.floats(1e-3, 10.0)
NAMES = st.text("abcäß._ -", min_size=1, max_size=4)


@st.composite
def patches(draw):
    """Rectangles and triangles anywhere."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[: draw(st.integers(3, 4))]
    vertices = np.array(draw(POINTS)) + corners * rng.uniform(0.05, 2.0, 2) @ axes[:, :2].T
    shear = axes[:, 0] + rng.normal() * axes[:, 2]
    normal = np.cross(axes[:, 0], axes[:, 1])
    return Patch(
        vertices_m=vertices,
        normal=normal,
        shear_reference=shear,
        friction=draw(st.floats(0.0, 2.0)),
    )


@st.composite
def courses(draw):
    """Courses of any shape: 1 to 4 limbs, 1 to 4 frames, any limbs lifted, 1 to 3 candidates, some
    toes that stand.
    """
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    limbs = tuple(
        Limb(name=name, shoulder_m=np.array(draw(POINTS)), reach_m=draw(POSITIVE)) for name in names
    )
    frames = draw(st.integers(1, 4))
    sets = [tuple(name for name in names if draw(st.booleans())) for _ in range(frames)]
    lifts = ((), *sets[1:])
    placed = [(k, name) for k in range(frames) for name in names if k == 0 or name in lifts[k]]
    footholds = [
        Foothold(limb=name, frame=k, candidates=(draw(patches()),), toe_m=np.array(draw(POINTS)))
        if draw(st.booleans())
        else Foothold(
            limb=name, frame=k, candidates=tuple(draw(st.lists(patches(), min_size=1, max_size=3)))
        )
        for k, name in placed
    ]
    own = {"force_min": -np.abs(draw(POINTS)), "force_max": np.abs(draw(POINTS))}
    footholds = [replace(put, **own) if draw(st.booleans()) else put for put in footholds]
    most = draw(POSITIVE)
    return Problem(
        name=draw(st.text(max_size=5)),
        robot=Robot(name=draw(NAMES), mass_kg=draw(POSITIVE), limbs=limbs),
        terrain=tuple(draw(st.lists(patches(), max_size=3))),
        footholds=tuple(footholds),
        lifts=lifts,
        next_lift=sets[0],
        com_nominal_m=np.array([draw(POINTS) for _ in range(frames)]),
        com_radius_m=np.array([draw(POSITIVE) for _ in range(frames)]),
        goal_m=np.array(draw(POINTS)),
        steps=StepLimits(com_m=most, toe_m=draw(POSITIVE), rotation_rad=0.1, progress_m=0.3 * most),
        weights=Weights(goal=draw(POSITIVE), com_path=draw(st.sampled_from([0.0, 0.3])), tilt=0.0),
        tilt_limit_rad=draw(st.floats(0.0, 0.5)),
        gravity_m_s2=draw(POSITIVE),
        length_scale_m=draw(POSITIVE),
        force_min=-np.abs(draw(POINTS)),
        force_max=np.abs(draw(POINTS)),
        force_scale_n=draw(st.none() | POSITIVE),
        modes=draw(
            st.none() | st.lists(st.integers(0, 3), min_size=frames, max_size=frames).map(tuple)
        ),
    )


def same(one, other):
    """Equal to the last bit, whatever the class."""
    if is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)
        )
    if isinstance(one, tuple):
        return isinstance(other, tuple) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return (
            one.dtype == other.dtype
            and one.shape == other.shape
            and one.tobytes() == other.tobytes()
        )
    return type(one) is type(other) and one == other


def refusal(data):
    with pytest.raises(InvalidInput) as error:
        Problem.from_json(data)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture(scope="module")
def written():
    return json.dumps(read_course("walls", frames=2).to_json())


@pytest.fixture
def data(written):
    return json.loads(written)


@given(courses())
@settings(max_examples=20)
def test_a_course_comes_back_to_the_last_bit(course):
    assert same(Problem.from_json(json.loads(json.dumps(course.to_json()))), course)


@pytest.mark.parametrize("name", builtin_courses())
def test_the_built_in_courses_come_back_to_the_last_bit(name):
    course = read_course(name)
    assert same(Problem.from_json(json.loads(json.dumps(course.to_json()))), course)


def test_a_course_file_is_read_by_its_name(written, tmp_path):
    path = tmp_path / "course.json"
    path.write_text(written)
    assert same(read_course(path), read_course("walls", frames=2))


def test_a_course_file_has_a_fixed_number_of_frames(written, tmp_path):
    path = tmp_path / "course.json"
    path.write_text(written)
    with refuses():
        read_course(path, frames=3)


def test_all_that_is_wrong_is_said_at_once_with_its_place(data):
    data["robot"]["limbs"][1]["reach_m"] = -1.0
    data["terrain"][1]["friction"] = -0.5
    data["placements"][2]["candidates"][0]["normal"] = [0.0, 0.0, 2.0]
    data["steps"]["progress_m"] = 1.0
    message = refusal(data)
    assert "limb LM: reach_m: expected a number above 0, got -1" in message
    assert "terrain[1].friction: expected a number in [0, 1e+06], got -0.5" in message
    assert "placements[2].candidates[0].normal: expected a unit vector, got length 2" in message
    assert (
        "steps.progress_m: expected at most steps.com_m = 0.12, the largest step, got 1" in message
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("goal_m"), "goal_m: expected this key, got nothing"),
        (lambda d: d.update(colour="red"), "colour: unknown key"),
        (lambda d: d.update(format="stancekit/course/2"), "format: expected 'stancekit/course/1'"),
        (lambda d: d["com_nominal_m"].pop(), "com_nominal_m: expected shape (2, 3), got (1, 3)"),
        (
            lambda d: d["placements"].pop(),
            "placements: frame 1, limb RR: expected a foothold, since it moves there",
        ),
        (
            lambda d: d["placements"][0].update(limb="XX"),
            "placements: frame 0, limb LF: expected a foothold",
        ),
        (
            lambda d: d["placements"][0].update(candidates=[]),
            "expected one or more candidate patches, got none within",
        ),
        (
            lambda d: d["placements"][0].update(frame="0"),
            "placements[0].frame: expected a valid integer, got '0'",
        ),
        (
            lambda d: d["lifts"][1].append("tail"),
            "leg: expected one of LF, LM, LR, RF, RM, RR, got 'tail'",
        ),
        (lambda d: d.update(goal_m=[0.0, float("nan"), 0.0]), "goal_m: expected finite numbers"),
        (lambda d: d.update(lifts=[]), "frames: expected 1 to 1000 key frames, got 0"),
    ],
)
def test_a_file_that_was_changed_is_refused_with_the_place(data, change, message):
    changed = copy.deepcopy(data)
    change(changed)
    assert message in refusal(changed)


def test_something_else_than_an_object_is_refused():
    assert (
        refusal([1])
        == "expected a JSON object with format 'stancekit/posture/1' or 'stancekit/course/1', got list"
    )
    assert refusal({"format": "stancekit/motion/1"}).endswith("got the file of a motion")
