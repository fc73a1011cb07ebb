"""Envelopes: boxes, sets of boxes with what they were learned for, and their file."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.question_file import read_envelopes, write_boxes
from stancekit.planners.relaxation.envelope import TILT_ROOM_RAD, Envelope, EnvelopeSet
from tests.refusals import assert_names, refuses

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def problems(drawn):
    return [drawn("wall-3", seed) for seed in range(40)]


@pytest.fixture(scope="module")
def learned(problems):
    rng = np.random.default_rng(0)
    boxes = [Envelope.from_vector(rng.uniform(-1, 1, 36)) for _ in range(2)]
    return EnvelopeSet.for_problems("wall-3", problems, boxes, {"selector": "quantile", "q": 0.05})


def refusal(call, *values, **named):
    with pytest.raises(InvalidInput) as error:
        call(*values, **named)
    assert "\n" not in str(error.value)
    return str(error.value)


# --------------------------------------------------------------------------------------------------------------
# boxes


@given(SEEDS)
def test_the_flat_form_gives_the_box_back_and_puts_pairs_in_order(seed):
    bounds = np.random.default_rng(seed).normal(size=24)
    box = Envelope.from_vector(bounds)
    assert box.contacts == 2
    pairs = bounds.reshape(2, 12)
    np.testing.assert_array_equal(
        box.to_vector(), np.concatenate([pairs.min(axis=0), pairs.max(axis=0)])
    )
    np.testing.assert_array_equal(
        Envelope.from_vector(box.to_vector()).to_vector(), box.to_vector()
    )
    np.testing.assert_array_equal(np.hstack([box.position[0], box.force[0]]), box.low)
    np.testing.assert_array_equal(np.hstack([box.position[1], box.force[1]]), box.high)


@given(SEEDS)
def test_the_box_around_points_is_the_smallest_that_contains_them(seed):
    points = np.random.default_rng(seed).normal(size=(5, 2, 6))
    box = Envelope.around(points)
    assert box.contains(points).all()
    for end, sign in (("low", 1.0), ("high", -1.0)):
        for index in np.ndindex(2, 6):
            bounds = getattr(box, end).copy()
            bounds[index] += sign * 1e-9
            assert not replace(box, **{end: bounds}).contains(points).all()


def test_containment_has_a_margin_and_counts_the_border():
    box = Envelope(low=np.zeros((1, 6)), high=np.ones((1, 6)))
    points = np.array([0.0, 1.0, -0.1, 1.1, np.nan])[:, None, None] * np.ones((1, 6))
    assert box.contains(points).tolist() == [True, True, False, False, False]
    assert box.contains(points, margin=0.11).tolist() == [True, True, True, True, False]
    assert box.widened(0.11).contains(points).tolist() == [True, True, True, True, False]


def test_the_log_volume_is_the_sum_of_the_logarithms_of_the_widths():
    widths = np.arange(1.0, 13.0).reshape(2, 6)
    assert Envelope(low=-widths, high=0.0 * widths).log_volume() == pytest.approx(
        np.log(479001600.0)
    )
    assert Envelope(low=widths, high=widths).log_volume() == -np.inf


def test_bounds_are_copied_read_only_and_in_order():
    low = np.zeros((2, 6))
    box = Envelope(low=low, high=np.ones((2, 6)))
    low[0, 0] = 9.0
    assert box.low[0, 0] == 0.0
    with refuses("read-only", kind=ValueError):
        box.low[0, 0] = 1.0
    high = np.ones((2, 6))
    high[1, 2] = -0.5
    assert_names(refusal(Envelope, low=box.low, high=high), "low[1][2]")
    assert_names(refusal(Envelope, low=box.low, high=high[:1]), "high")
    assert_names(refusal(Envelope, low=low[:, :5], high=high), "low")
    assert_names(refusal(Envelope, low=np.full((1, 6), np.nan), high=np.ones((1, 6))), "low")


# ---------------------------------------------------------------------------------------------------------------
# sets


def test_a_set_describes_the_problems_it_was_learned_from(learned, problems):
    assert (learned.problem_class, learned.legs) == ("wall-3", ("RF", "RR", "LM"))
    assert (learned.force_scale_n, learned.length_scale_m) == (10.0 * 9.81, 0.6)
    for i in range(3):
        normals = np.array([problem.contacts[i].patch.normal for problem in problems])
        mean = normals.sum(axis=0) / np.linalg.norm(normals.sum(axis=0))
        np.testing.assert_allclose(learned.normals[i], mean, atol=1e-12)
        angles = np.arctan2(np.linalg.norm(np.cross(normals, mean), axis=1), normals @ mean)
        assert learned.tilt_rad[i] == pytest.approx(angles.max(), abs=1e-7)
        assert learned.tilt_rad[i] <= np.deg2rad(45.0)


def test_a_set_fits_what_it_was_learned_from_and_patches_a_little_further_over(learned, problems):
    for problem in problems:
        learned.check_fits(problem)
    contact = problems[0].contacts[0]
    axis = np.cross(learned.normals[0], [1.0, 0.0, 0.0])
    axis = axis / np.linalg.norm(axis)

    def leaning(angle):
        normal = np.cos(angle) * learned.normals[0] + np.sin(angle) * axis
        side = np.cross(normal, [1.0, 0.0, 0.0])
        vertices = contact.patch.centre_m + 0.05 * np.array([side, np.cross(normal, side), -side])
        patch = replace(contact.patch, vertices_m=vertices, normal=normal)
        return problems[0].posture_with(
            contacts=(replace(contact, patch=patch), *problems[0].contacts[1:])
        )

    most = learned.tilt_rad[0] + TILT_ROOM_RAD
    learned.check_fits(leaning(most - 1e-3))
    assert_names(refusal(learned.check_fits, leaning(most + 0.02)), "contacts[0].normal")


def test_a_set_fits_its_legs_in_its_own_order_only(learned, problems):
    turned = problems[0].posture_with(contacts=problems[0].contacts[::-1])
    assert_names(refusal(learned.check_fits, turned), "contacts")


def test_a_set_is_never_empty_and_has_a_row_a_leg(learned):
    assert_names(refusal(replace, learned, envelopes=()), "envelopes")
    two = Envelope(low=np.zeros((2, 6)), high=np.ones((2, 6)))
    assert_names(refusal(replace, learned, envelopes=(*learned.envelopes, two)), "envelopes[2]")
    assert_names(refusal(replace, learned, legs=("RF", "RR")), "normals")
    assert_names(refusal(replace, learned, tilt_rad=[0.1]), "tilt_rad")


@pytest.mark.parametrize("scale", [float("nan"), float("inf"), 0.0, -98.1])
@pytest.mark.parametrize("key", ["force_scale_n", "length_scale_m"])
def test_a_scale_is_a_positive_number(learned, key, scale):
    assert_names(refusal(replace, learned, **{key: scale}), key)


@pytest.mark.parametrize(
    ("key", "value"),
    [("legs", ("RF", "RF", "LM")), ("normals", np.zeros((3, 3))), ("tilt_rad", [-1.0, 0.1, 0.1])],
)
def test_what_describes_no_class_of_problems_is_refused(learned, key, value):
    assert_names(refusal(replace, learned, **{key: value}), key)


# ---------------------------------------------------------------------------------------------------------------
# file


def test_a_set_comes_back_from_its_file_to_the_last_bit(learned, tmp_path):
    path = tmp_path / "wall-3.json"
    write_boxes(path, learned)
    again = read_envelopes(path)
    assert json.dumps(again.to_json()) == json.dumps(learned.to_json())
    assert again.legs == learned.legs
    assert again.provenance == {"selector": "quantile", "q": 0.05}
    for mine, theirs in zip(again.envelopes, learned.envelopes, strict=True):
        assert mine.low.tobytes() == theirs.low.tobytes()
        assert mine.high.tobytes() == theirs.high.tobytes()
    assert json.loads(path.read_text())["format"] == "stancekit/envelope/1"


BOX = ("envelopes", 1)
BAD = [
    (
        ("format",),
        "stancekit/envelope/2",
        "format: expected 'stancekit/envelope/1', got 'stancekit/envelope/2'",
    ),
    (("legs",), ..., "legs: expected this key, got nothing"),
    (("legs",), [], "legs: expected one or more different ones, got []"),
    (("legs",), ["RF", "RR"], "normals: expected shape (2, 3), got (3, 3)"),
    (("colour",), 1, "colour: unknown key"),
    (("problem_class",), 3, "problem_class: expected a valid string, got 3"),
    (("force_scale_n",), "98.1", "force_scale_n: expected a valid number, got '98.1'"),
    (("force_scale_n",), True, "force_scale_n: expected a valid number, got True"),
    (("normals",), [[0, 0, 1]], "normals: expected shape (3, 3), got (1, 3)"),
    (("tilt_rad", 0), float("nan"), "expected numbers as JSON has them, got NaN"),
    (("envelopes",), [], "envelopes: expected one or more, got none"),
    ((*BOX, "low", 0, 0), None, "envelopes[1].low[0][0]: expected a valid number, got None"),
    ((*BOX, "mid"), [], "envelopes[1].mid: unknown key"),
    ((*BOX, "high"), ..., "envelopes[1].high: expected this key, got nothing"),
    (("provenance",), None, "provenance: expected a valid dictionary, got None"),
]


@pytest.mark.parametrize(("path", "value", "message"), BAD, ids=lambda _: "")
def test_what_is_wrong_in_a_file_is_named_with_the_file(learned, tmp_path, path, value, message):
    record = json.loads(json.dumps(learned.to_json()))
    place = record
    for key in path[:-1]:
        place = place[key]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(record))
    said = refusal(read_envelopes, file)
    assert said.startswith(f"{file}: {message}")
    assert said == f"{file}: {message}"


def test_all_wrong_keys_are_reported_at_once(learned):
    record = learned.to_json() | {"colour": 1, "legs": "RF", "force_scale_n": None}
    assert sorted(refusal(EnvelopeSet.from_json, record).split("; ")) == [
        "colour: unknown key",
        "force_scale_n: expected a valid number, got None",
        "legs: expected a list in brackets, got 'RF'",
    ]


@pytest.mark.parametrize("what", [[], "text", 3, None])
def test_what_is_no_object_is_named(what):
    assert refusal(EnvelopeSet.from_json, what) == (
        f"expected a JSON object with format 'stancekit/envelope/1', got {type(what).__name__}"
    )


def test_a_bad_box_is_named_by_its_place_in_the_set(learned):
    record = learned.to_json()
    record["envelopes"][1]["low"] = (learned.envelopes[1].high + 1.0).tolist()
    assert refusal(EnvelopeSet.from_json, record).startswith("envelopes[1]")
