"""Robots, patches and posture problems: what goes in comes out to the last bit, and what is wrong
is named.
"""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.robot import Limb, Robot, hexapod
from stancekit.planners.terrain import Patch
from tests.refusals import assert_names, refuses

SEEDS = st.integers(0, 2**32 - 1)
DIRECTIONS = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
)
TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
SQUARE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
NOT_CONVEX = "vertices_m: expected a convex polygon, its vertices in order around the border"


def flat(
    vertices=TRIANGLE, *, normal=(0.0, 0.0, 1.0), shear_reference=(1.0, 0.0, 0.0), friction=0.5
):
    return Patch(
        vertices_m=vertices, normal=normal, shear_reference=shear_reference, friction=friction
    )


def star(points, step):
    angle = 2.0 * np.pi * step * np.arange(points) / points
    return np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])


def refusal(make, *values, **named):
    with pytest.raises(InvalidInput) as error:
        make(*values, **named)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture
def record(drawn):
    """A good problem's JSON, to be spoilt."""
    return json.loads(json.dumps(drawn("wall-3", 0).to_json()))


def spoilt(record, *changes):
    """The record with each (path, value) put in; a value of ``...`` takes the key away."""
    record = copy.deepcopy(record)
    for path, value in changes:
        place = record
        *before, last = path
        for key in before:
            place = place[key]
        if value is ...:
            del place[last]
        else:
            place[last] = value
    return record


# -------------------------------------------------------------------------------------------------------------
# JSON


@pytest.mark.parametrize("name", ["ground-3", "wall-3", "wall-5"])
@pytest.mark.parametrize("seed", range(5))
def test_a_problem_comes_back_from_its_json_to_the_last_bit(drawn, name, seed):
    problem = drawn(name, seed)
    text = json.dumps(problem.to_json(), allow_nan=False)
    again = Problem.from_json(json.loads(text))
    assert json.dumps(again.to_json(), allow_nan=False) == text
    assert again.legs == problem.legs
    for mine, theirs in zip(again.contacts, problem.contacts, strict=True):
        assert mine.patch.frame.tobytes() == theirs.patch.frame.tobytes()
        assert mine.force_min.tobytes() == theirs.force_min.tobytes()


@given(SEEDS)
@settings(max_examples=40)
def test_any_numbers_come_back_to_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    first = np.cross(normal, rng.normal(size=3))
    vertices = rng.normal(size=3) + 10.0 ** rng.uniform(-2, 2) * np.array(
        [0 * first, first, np.cross(normal, first)]
    )
    patch = flat(
        vertices,
        normal=normal,
        shear_reference=first * rng.uniform(0.1, 9.0),
        friction=rng.exponential(),
    )
    bound = np.sort(rng.normal(size=(2, 3)), axis=0)
    contact = Contact(
        leg="LM",
        shoulder_m=rng.normal(size=3),
        reach_m=rng.exponential(),
        patch=patch,
        force_min=bound[0],
        force_max=bound[1],
    )
    problem = Problem.posture(
        contacts=(contact,),
        mass_kg=rng.exponential(),
        gravity_m_s2=rng.exponential(),
        com_radius_m=rng.exponential(),
        force_scale_n=rng.exponential(),
        length_scale_m=rng.exponential(),
        tilt_limit_rad=rng.uniform(0.0, 1.5),
        com_nominal_m=rng.normal(size=3),
    )
    text = json.dumps(problem.to_json())
    assert json.dumps(Problem.from_json(json.loads(text)).to_json()) == text


def test_the_json_has_the_keys_of_the_format(record):
    assert record["format"] == "stancekit/posture/1"
    assert list(record) == [
        "format",
        "mass_kg",
        "gravity_m_s2",
        "force_scale_n",
        "length_scale_m",
        "com_nominal_m",
        "com_radius_m",
        "tilt_limit_rad",
        "contacts",
    ]
    assert list(record["contacts"][0]) == [
        "leg",
        "shoulder_m",
        "reach_m",
        "vertices_m",
        "normal",
        "shear_reference",
        "friction",
        "force_min",
        "force_max",
    ]


def test_the_legs_may_be_those_of_another_robot(record):
    for contact, leg in zip(record["contacts"], "abc", strict=True):
        contact["leg"] = leg
    limbs = tuple(Limb(name=name, shoulder_m=np.zeros(3), reach_m=1.0) for name in "abc")
    read = Problem.from_json(record, robot=Robot(name="crab", mass_kg=2.0, limbs=limbs))
    assert read.legs == ("a", "b", "c")
    assert read.mass_kg == 10.0
    assert_names(refusal(Problem.from_json, record), "contacts[0].leg")


ONE = ("contacts", 1)
HUGE = 10**400
BAD = [
    ((("mass_kg",), ...), "mass_kg: expected this key, got nothing"),
    ((("weight",), 3.0), "weight: unknown key"),
    (
        (("format",), "stancekit/posture/2"),
        "format: expected 'stancekit/posture/1', got 'stancekit/posture/2'",
    ),
    ((("format",), ...), "format: expected this key, got nothing"),
    ((("mass_kg",), -1.0), "mass_kg: expected a number above 0, got -1"),
    ((("mass_kg",), 0), "mass_kg: expected a number above 0, got 0"),
    ((("mass_kg",), float("nan")), "mass_kg: expected finite numbers, got nan"),
    ((("mass_kg",), float("inf")), "mass_kg: expected finite numbers, got inf"),
    ((("mass_kg",), 1e300), "mass_kg: expected magnitudes up to 1e+06, got 1e+300"),
    ((("mass_kg",), HUGE), f"mass_kg: expected a valid number, got {str(HUGE)[:60]}"),
    ((("mass_kg",), "10"), "mass_kg: expected a valid number, got '10'"),
    ((("mass_kg",), True), "mass_kg: expected a valid number, got True"),
    ((("mass_kg",), None), "mass_kg: expected a valid number, got None"),
    ((("mass_kg",), [10.0]), "mass_kg: expected a valid number, got [10.0]"),
    ((("gravity_m_s2",), 0.0), "gravity_m_s2: expected a number above 0, got 0"),
    ((("force_scale_n",), float("-inf")), "force_scale_n: expected finite numbers, got -inf"),
    ((("length_scale_m",), 0.0), "length_scale_m: expected a number above 0, got 0"),
    ((("com_radius_m",), -0.1), "com_radius_m: expected a number in [0, 1e+06], got -0.1"),
    ((("tilt_limit_rad",), 3.0), "tilt_limit_rad: expected a number in [0, 1.5708], got 3"),
    ((("com_nominal_m",), [0.0, 0.0]), "com_nominal_m: expected shape (3,), got (2,)"),
    ((("com_nominal_m",), [0.0, None, 0.0]), "com_nominal_m[1]: expected a valid number, got None"),
    ((("contacts",), []), "contacts: expected one or more, got none"),
    ((("contacts",), {}), "contacts: expected a list in brackets, got {}"),
    ((("contacts", 1), "RR"), "contacts[1]: expected a valid dictionary, got 'RR'"),
    (((*ONE, "leg"), "XX"), "contacts[1].leg: expected one of LF, LM, LR, RF, RM, RR, got 'XX'"),
    (((*ONE, "leg"), 3), "contacts[1].leg: expected a valid string, got 3"),
    (((*ONE, "leg"), "RF"), "contacts: expected every leg once, got ['RF', 'RF', 'LM']"),
    (((*ONE, "reach_m"), ...), "contacts[1].reach_m: expected this key, got nothing"),
    (((*ONE, "colour"), "red"), "contacts[1].colour: unknown key"),
    (((*ONE, "reach_m"), 0.0), "contacts[1].reach_m: expected a number above 0, got 0"),
    (((*ONE, "friction"), -0.2), "contacts[1].friction: expected a number in [0, 1e+06], got -0.2"),
    (((*ONE, "friction"), float("nan")), "contacts[1].friction: expected finite numbers, got nan"),
    (
        ((*ONE, "friction"), HUGE),
        f"contacts[1].friction: expected a valid number, got {str(HUGE)[:60]}",
    ),
    (((*ONE, "friction"), False), "contacts[1].friction: expected a valid number, got False"),
    (
        ((*ONE, "shoulder_m"), [0.0, 1e300, 0.0]),
        "contacts[1].shoulder_m: expected magnitudes up to 1e+06, got 1e+300",
    ),
    (
        ((*ONE, "normal"), [0.0, 0.0, 2.0]),
        "contacts[1].normal: expected a unit vector, got length 2",
    ),
    (
        ((*ONE, "normal"), [0.0, 0.0, 0.0]),
        "contacts[1].normal: expected a unit vector, got length 0",
    ),
    (((*ONE, "vertices_m", 2), ...), "contacts[1].vertices_m: expected 3 or more vertices, got 2"),
    (
        ((*ONE, "vertices_m", 0), [0.0, 1.0]),
        "contacts[1].vertices_m: expected numbers of shape (any, 3), got ",
    ),
    (
        ((*ONE, "vertices_m", 0, 2), "1"),
        "contacts[1].vertices_m[0][2]: expected a valid number, got '1'",
    ),
    (
        ((*ONE, "vertices_m", 0, 2), float("inf")),
        "contacts[1].vertices_m: expected finite numbers, got [[",
    ),
    (
        ((*ONE, "shear_reference"), [0, 0, 0]),
        "contacts[1].shear_reference: expected a non-zero vector, got length 0",
    ),
    (
        ((*ONE, "force_min"), [2, 0, 0]),
        "contacts[1].force_min: expected at most force_max [1.0, 1.0, 1.0], got [2.0, 0.0, 0.0]",
    ),
    (
        ((*ONE, "force_max"), [1.0, 1.0, 1.0, 1.0]),
        "contacts[1].force_max: expected shape (3,), got (4,)",
    ),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=lambda _: "")
def test_what_is_wrong_in_a_file_is_named_with_what_came(record, change, message):
    said = refusal(Problem.from_json, spoilt(record, change))
    assert said.startswith(message) if message.endswith(("got ", "[[")) else said == message
    assert len(said) < 250


@pytest.mark.parametrize("what", [[], "text", 3, None, True, 1.5])
def test_what_is_no_object_is_named(what):
    kind = type(what).__name__
    expected = f"expected a JSON object with format 'stancekit/posture/1' or 'stancekit/course/1', got {kind}"
    assert refusal(Problem.from_json, what) == expected


def test_all_keys_of_the_wrong_kind_are_reported_at_once(record):
    changes = [
        (("mass_kg",), "heavy"),
        (("com_radius_m",), ...),
        (("wind",), 1.0),
        ((*ONE, "friction"), None),
        (("contacts", 2, "normal"), 5),
    ]
    said = refusal(Problem.from_json, spoilt(record, *changes)).split("; ")
    assert sorted(said) == [
        "com_radius_m: expected this key, got nothing",
        "contacts[1].friction: expected a valid number, got None",
        "contacts[2].normal: expected a list in brackets, got 5",
        "mass_kg: expected a valid number, got 'heavy'",
        "wind: unknown key",
    ]


def test_all_contacts_out_of_range_are_reported_at_once(record):
    changes = [(("contacts", i, "friction"), -1.0 - i) for i in range(3)]
    assert refusal(Problem.from_json, spoilt(record, *changes)) == "; ".join(
        f"contacts[{i}].friction: expected a number in [0, 1e+06], got {-1 - i}" for i in range(3)
    )


def test_all_values_out_of_range_are_reported_at_once(record):
    changes = [
        (("mass_kg",), -1.0),
        (("com_radius_m",), -1.0),
        ((*ONE, "friction"), -1.0),
        ((*ONE, "reach_m"), -1.0),
    ]
    said = refusal(Problem.from_json, spoilt(record, *changes))
    assert [
        key for key in ("mass_kg", "com_radius_m", "[1].friction", "[1].reach_m") if key not in said
    ] == []


def test_the_body_is_reported_also_where_every_contact_is_wrong(record):
    changes = [(("mass_kg",), -1.0), *((("contacts", i, "reach_m"), -1.0) for i in range(3))]
    assert "mass_kg" in refusal(Problem.from_json, spoilt(record, *changes))


def test_everything_wrong_with_a_patch_is_reported_at_once(record):
    changes = [
        ((*ONE, "friction"), -1.0),
        ((*ONE, "shear_reference"), [0, 0, 0]),
        ((*ONE, "normal"), [0, 0, 9]),
    ]
    said = refusal(Problem.from_json, spoilt(record, *changes))
    assert [
        key
        for key in ("friction", "shear_reference", "normal")
        if f"contacts[1].{key}: " not in said
    ] == []


# ------------------------------------------------------------------------------------------------------------
# patch


@given(DIRECTIONS, DIRECTIONS)
@settings(max_examples=100)
def test_the_contact_frame_is_right_handed_with_z_along_the_projected_reference(normal, reference):
    normal = normal / np.linalg.norm(normal)
    if np.linalg.norm(np.cross(normal, reference)) < 0.05 * np.linalg.norm(reference):
        return
    side = np.cross(normal, reference)
    patch = flat([0 * side, side, np.cross(normal, side)], normal=normal, shear_reference=reference)
    n, y, z = patch.frame.T
    np.testing.assert_allclose(patch.frame.T @ patch.frame, np.eye(3), atol=1e-12)
    assert np.linalg.det(patch.frame) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_array_equal(n, patch.normal)
    np.testing.assert_allclose(n, normal, atol=1e-12)
    np.testing.assert_allclose(y, np.cross(z, n), atol=1e-12)
    projected = reference - (reference @ normal) * normal
    np.testing.assert_allclose(z, projected / np.linalg.norm(projected), atol=1e-10)


def test_the_frame_of_a_wall_is_the_one_of_the_format():
    wall = flat(
        [[0, 0.4, 0], [0.1, 0.4, 0], [0, 0.4, 0.1]], normal=(0, -1, 0), shear_reference=(0, 0, 7)
    )
    np.testing.assert_array_equal(wall.frame.T, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(wall.centre_m, [0.1 / 3, 0.4, 0.1 / 3])


def test_what_a_patch_keeps_is_its_own_and_read_only():
    vertices = np.array(TRIANGLE)
    patch = flat(vertices)
    vertices[0] = 9.0
    np.testing.assert_array_equal(patch.vertices_m, TRIANGLE)
    for name in ("vertices_m", "normal", "shear_reference"):
        with refuses("read-only", kind=ValueError):
            getattr(patch, name)[0] = 1.0
    with pytest.raises(AttributeError):
        patch.friction = 0.3


@given(SEEDS, st.integers(3, 9))
@settings(max_examples=60)
def test_a_convex_border_is_accepted_from_any_corner_either_way_round_and_no_other_order_is(
    seed, count
):
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    border = np.column_stack([rng.uniform(0.5, 2.0) * np.cos(angle), np.sin(angle), 0.0 * angle])
    border = np.roll(border, int(rng.integers(count)), axis=0)[:: rng.choice([-1, 1])]
    assert len(flat(border).vertices_m) == count
    if count > 3:
        swapped = border.copy()
        swapped[[0, 1]] = border[[1, 0]]
        assert_names(refusal(flat, swapped), "vertices_m")


def test_a_corner_on_a_straight_edge_is_allowed():
    assert len(flat([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [0, 1, 0]]).vertices_m) == 4


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (TRIANGLE[:2], "vertices_m: expected 3 or more vertices, got 2"),
        ([], "vertices_m: expected shape (any, 3), got (0,)"),
        ([[0, 0], [1, 0], [0, 1]], "vertices_m: expected shape (any, 3), got (3, 2)"),
        ([[0, 0, 0]] * 3, "vertices_m: expected a patch with an area, got one of diameter 0 m"),
        (
            [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
            "vertices_m: expected a patch with an area, got 0 m² on 2 m",
        ),
        (
            [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]],
            "vertices_m: expected a patch with an area, got 0 m² on 1.41 m",
        ),
        ([[0, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0]], NOT_CONVEX),
        ([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0]], NOT_CONVEX),
        ([[0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0]], NOT_CONVEX),
        (star(5, 2), NOT_CONVEX),
        (star(7, 3), NOT_CONVEX),
        (SQUARE + SQUARE, NOT_CONVEX),
        (
            [[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]],
            "vertices_m: expected a plane with the given normal, got vertices 75 mm off it",
        ),
    ],
)
def test_what_is_no_flat_convex_polygon_is_refused(vertices, message):
    assert refusal(flat, vertices) == message


@pytest.mark.parametrize("doubled", [(0,), (0, 2), (0, 1), (0, 1, 2, 3)])
def test_a_corner_given_twice_is_one_corner(doubled):
    patch = flat([corner for i, corner in enumerate(SQUARE) for _ in range(1 + (i in doubled))])
    assert len(patch.vertices_m) == 4 + len(doubled)


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        (
            {"normal": (0, 0.6, 0.8)},
            "vertices_m",
        ),
        ({"normal": (0, 0, 1.1)}, "normal"),
        ({"normal": (0, 0, np.nan)}, "normal"),
        (
            {"shear_reference": (0, 0, -3)},
            "shear_reference",
        ),
        (
            {"shear_reference": (1e-10, 0, 0)},
            "shear_reference",
        ),
        ({"friction": -0.5}, "friction"),
        ({"friction": np.inf}, "friction"),
        ({"friction": [0.5]}, "friction"),
        ({"friction": "smooth"}, "friction"),
    ],
)
def test_bad_surfaces_are_refused(rest, message):
    assert_names(refusal(flat, **rest), message)


def test_an_integer_beyond_all_floats_is_refused():
    assert_names(refusal(flat, friction=10**400), "friction")


def test_a_slightly_long_normal_is_normalised_once_and_for_all():
    patch = flat(normal=(0.0, 0.0, 1.0005))
    np.testing.assert_array_equal(patch.normal, [0.0, 0.0, 1.0])
    again = flat(normal=patch.normal, shear_reference=patch.shear_reference)
    assert again.normal.tobytes() == patch.normal.tobytes()


# ---------------------------------------------------------------------------------------------
# robot, contact, body


def test_the_hexapod_is_that_of_the_paper():
    robot = hexapod()
    assert (robot.name, robot.mass_kg) == ("hexapod", 10.0)
    assert robot.limb_names == ("LF", "LM", "LR", "RF", "RM", "RR")
    for limb in robot.limbs:
        x, y, z = limb.shoulder_m
        assert (np.hypot(x, y), z, limb.reach_m) == (pytest.approx(0.18), 0.0, 0.35)
        assert np.sign(y) == (1.0 if limb.name[0] == "L" else -1.0)
        assert np.rad2deg(np.arctan2(abs(y), x)) == pytest.approx(
            {"F": 30.0, "M": 90.0, "R": 150.0}[limb.name[1]]
        )


def test_limbs_are_selected_in_the_order_asked_for():
    assert [limb.name for limb in hexapod().select(["RR", "LF"])] == ["RR", "LF"]
    assert_names(refusal(hexapod().select, ["LF", "tail"]), "leg")


def test_bad_robots_are_refused():
    limb = Limb(name="a", shoulder_m=[0, 0, 0], reach_m=1.0)
    none = "robot r: expected one or more limbs of different names, got "
    assert refusal(Robot, name="r", mass_kg=1.0, limbs=()) == none + "[]"
    assert refusal(Robot, name="r", mass_kg=1.0, limbs=(limb, limb)) == none + "['a', 'a']"
    assert_names(refusal(Robot, name="r", mass_kg=0.0, limbs=(limb,)), "robot r", "mass_kg")
    assert_names(refusal(Limb, name="a", shoulder_m=[0, 0, 0], reach_m=-1.0), "limb a", "reach_m")
    assert_names(refusal(Limb, name="a", shoulder_m=[0, 0], reach_m=1.0), "limb a", "shoulder_m")


def test_the_scales_default_to_the_weight_and_the_leg_span(drawn):
    problem = drawn("ground-3", 1)
    assert problem.force_scale_n == problem.weight_n == 10.0 * 9.81
    assert problem.moment_scale_nm == 10.0 * 9.81 * 0.6
    assert problem.posture_with(mass_kg=4.0, force_scale_n=None).force_scale_n == 4.0 * 9.81
    assert replace(problem, force_scale_n=50.0).moment_scale_nm == 30.0


@pytest.mark.parametrize("mass", ["heavy", None, [1.0, 2.0], 10**400, -1.0])
def test_a_bad_mass_is_one_error_also_without_a_force_scale(drawn, mass):
    said = refusal(drawn("ground-3", 1).posture_with, mass_kg=mass, force_scale_n=None)
    assert said.startswith("mass_kg: expected ")
    assert "force_scale_n" not in said


def test_a_problem_without_contacts_or_with_one_leg_twice_is_refused(drawn):
    problem = drawn("ground-3", 1)
    assert_names(refusal(problem.posture_with, contacts=()), "contacts")
    twice = (*problem.contacts, problem.contacts[0])
    assert_names(refusal(problem.posture_with, contacts=twice), "contacts")


def test_invalid_input_is_both_an_error_of_the_house_and_a_value_error():
    assert issubclass(InvalidInput, StancekitError)
    assert issubclass(InvalidInput, ValueError)
    with refuses("friction"):
        flat(friction=-1.0)
