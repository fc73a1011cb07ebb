"""Course files: laid out as they say, climbable where they come with the package, refused key by
key and by frame.
"""

from __future__ import annotations

import contextlib
import copy
import warnings

import numpy as np
import pytest
import yaml
from hypothesis import given, settings, strategies as st

from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.contact import CandidatePatches
from stancekit.planners.problem.course_file import (
    builtin_courses,
    read_course,
    read_spec,
    spec_from,
)
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.course_terrain import Terrain
from stancekit.planners.robot import hexapod
from stancekit.planners.search.methods import PlannerOptions, make_planner
from stancekit.planners.terrain import Patch
from tests.refusals import assert_names

FIVE = ("ground-to-wall", "icy-walls", "stairs", "tube", "walls")
TRIPODS = ({"RF", "RR", "LM"}, {"LF", "LR", "RM"})
FLOOR = {
    "name": "floor",
    "frames": 3,
    "start_m": [0.0, 0.0, 0.2],
    "goal_m": [0.1, 0.0, 0.2],
    "terrain": {"kind": "flat", "friction": 0.6},
}


def floor(**changes):
    return spec_from(copy.deepcopy(FLOOR) | changes)


def laid_out(**changes):
    return build_course(floor(**changes))


def polygons(*corners, **rest):
    return {
        "kind": "polygons",
        "polygons": [{"vertices_m": [list(c) for c in each]} for each in corners],
        **rest,
    }


def square(x, y, z, side):
    half = 0.5 * side
    return [
        (x - half, y - half, z),
        (x + half, y - half, z),
        (x + half, y + half, z),
        (x - half, y + half, z),
    ]


def refusal(make, *values, **named):
    with pytest.raises(InvalidInput) as error:
        make(*values, **named)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture(scope="module")
def exact():
    return make_planner("exact", PlannerOptions(time_limit_s=600.0))


@pytest.fixture
def write(tmp_path):
    def written(text):
        path = tmp_path / "course.yaml"
        path.write_text(text if isinstance(text, str) else yaml.safe_dump(text))
        return path

    return written


def gripping(course):
    """Of every foothold the first candidate with friction."""
    return [
        next(i for i, patch in enumerate(p.candidates) if patch.friction > 0.0)
        for p in course.footholds
    ]


# ----------------------------------------------------------------------------------------------------------
# built-ins


def test_five_courses_come_with_the_package():
    assert builtin_courses() == FIVE


@pytest.mark.parametrize("name", FIVE)
def test_every_stance_of_a_built_in_course_holds_even_on_small_patches_with_a_third_less_friction(
    name, exact
):
    spec = read_spec(name)
    narrow = spec.model_copy(
        update={
            "terrain": spec.terrain.model_copy(update={"friction": 0.67 * spec.terrain.friction}),
            "candidates": spec.candidates.model_copy(update={"window_m": 0.10}),
            "body": spec.body.model_copy(update={"com_radius_m": 0.02}),
        }
    )
    course = build_course(narrow)
    choice = gripping(course)
    assert len(course.stances) >= course.frames
    for stance in course.stances:
        outcome = exact.solve(course.posture_problem(stance, choice))
        assert outcome.status is Status.FEASIBLE, (stance, outcome.bound)


@pytest.mark.parametrize("name", FIVE)
def test_candidates_lie_in_the_window_on_the_surface_and_within_reach(name):
    course, spec = read_course(name), read_spec(name)
    limbs = {limb.name: limb for limb in course.robot.limbs}
    for foothold in course.footholds:
        assert 1 <= len(foothold.candidates) <= spec.candidates.count
        index = course.robot.limb_names.index(foothold.limb)
        here = course.holds[:, index] == course.footholds.index(foothold)
        shoulder = course.com_nominal_m[here].mean(axis=0) + limbs[foothold.limb].shoulder_m
        for patch in foothold.candidates:
            assert (
                np.abs(patch.vertices_m - patch.centre_m).max()
                <= 0.5 * np.sqrt(2.0) * spec.candidates.window_m
            )
            under = [
                t
                for t in course.terrain
                if np.allclose(t.normal, patch.normal) and t.friction == patch.friction
            ]
            heights = [np.abs((patch.vertices_m - t.centre_m) @ t.normal).max() for t in under]
            assert min(heights) < 1e-9
            corners = patch.vertices_m - shoulder
            assert (
                np.linalg.norm(corners, axis=1).min()
                < limbs[foothold.limb].reach_m + spec.candidates.window_m
            )
            assert patch.normal @ (shoulder - patch.centre_m) > 0.0  # the robot is in front of it


def test_half_of_the_toes_of_the_icy_walls_would_go_to_ice_without_looking():
    course = read_course("icy-walls")
    nearest = [foothold.candidates[0].friction for foothold in course.footholds]
    assert 0.35 <= np.mean(np.array(nearest) == 0.0) <= 0.65
    panels = np.array([patch.friction for patch in course.terrain])
    assert np.mean(panels == 0.0) == pytest.approx(0.5, abs=0.1)
    assert max(len(foothold.candidates) for foothold in course.footholds) == 4


def test_the_ground_to_wall_course_changes_its_mode_once():
    course = read_course("ground-to-wall")
    assert list(np.diff(course.modes)).count(1) == 1
    assert (course.modes[0], course.modes[-1]) == (0, 1)
    switch = course.modes.index(1)
    walls = {(p.frame >= switch, abs(p.candidates[0].normal[2]) < 0.5) for p in course.footholds}
    assert walls == {(False, False), (True, True)}


@pytest.mark.parametrize("name", FIVE)
@pytest.mark.parametrize("frames", [1, 2, 5, 32])
def test_the_number_of_frames_can_be_another_one_at_the_same_stride(name, frames):
    course, usual = read_course(name, frames=frames), read_course(name)
    assert course.frames == frames
    shared = min(frames, usual.frames)
    np.testing.assert_allclose(
        course.com_nominal_m[:shared], usual.com_nominal_m[:shared], atol=1e-12
    )
    np.testing.assert_array_equal(course.goal_m, course.com_nominal_m[-1])


def test_the_tripods_alternate():
    course = read_course("walls")
    assert [set(lifted) for lifted in course.lifts[1:]] == [TRIPODS[k % 2] for k in range(7)]
    assert set(course.next_lift) == TRIPODS[1]


# --------------------------------------------------------------------------------------------------------------
# files


def test_a_file_says_what_the_course_is(write):
    course = read_course(
        write(FLOOR | {"gait": "wave", "weights": {"goal": 2.0}, "body": {"com_radius_m": 0.04}})
    )
    assert course.lifts == ((), ("LR",), ("LM",))
    assert course.next_lift == ("LF",)
    assert (course.weights.goal, course.weights.com_step) == (2.0, 0.2)
    np.testing.assert_array_equal(course.com_radius_m, [0.02, 0.04, 0.04])
    np.testing.assert_allclose(course.com_nominal_m[:, 0], [0.0, 0.05, 0.1])
    assert course.modes == (0, 0, 0)


def test_all_limbs_may_move_at_once():
    course = laid_out(gait="all")
    assert [len(lifted) for lifted in course.lifts] == [0, 6, 6]
    assert [stance.limbs for stance in course.stances] == [tuple(range(6))] * 3


@pytest.mark.parametrize(
    ("limbs", "shifts"),
    [
        ("LF LM LR RF RM RR", []),
        ("LF LR RF RR", [1, 4]),
    ],  # of four feet two supports meet in a diagonal twice a cycle
)
def test_a_wave_moves_the_body_on_all_feet_where_two_supports_share_a_line_alone(limbs, shifts):
    along, aside = {"F": 0.15, "M": 0.0, "R": -0.15}, {"L": 0.1, "R": -0.1}
    placed = {
        name: {"shoulder_m": [along[name[1]], aside[name[0]], 0.0], "reach_m": 0.5}
        for name in limbs.split()
    }
    robot = {"name": "dog", "mass_kg": 20.0, "limbs": placed}
    course = laid_out(robot=robot, gait="wave", frames=9)
    assert [k for k in range(1, 7) if not course.lifts[k]] == shifts
    cycle = course.lifts[1 : 1 + len(placed) + len(shifts)]
    assert sorted(name for lifted in cycle for name in lifted) == sorted(placed)


def test_a_gait_may_be_written_out():
    course = laid_out(gait=[["RF"], ["LR", "LF"]], frames=4)
    assert course.lifts == ((), ("RF",), ("LF", "LR"), ("RF",))
    assert course.next_lift == ("LF", "LR")


def test_the_path_goes_through_its_via_points_and_the_stance_changes_there():
    high = {"outward_m": 0.10, "down_m": 0.15}
    course = laid_out(
        frames=5, via_m=[{"at_m": [0.1, 0.0, 0.2], "stance": high}], goal_m=[0.1, 0.1, 0.2]
    )
    np.testing.assert_allclose(
        course.com_nominal_m[:, :2], [[0, 0], [0.05, 0], [0.1, 0], [0.1, 0.05], [0.1, 0.1]]
    )
    for frame, outward in ((1, 0.15), (3, 0.10)):
        foothold = next(p for p in course.footholds if p.frame == frame and p.limb == "LM")
        middle = course.com_nominal_m[frame : frame + 2].mean(axis=0)
        np.testing.assert_allclose(
            foothold.candidates[0].centre_m, [middle[0], middle[1] + 0.18 + outward, 0.0]
        )


def test_single_limbs_may_have_their_own_offset():
    course = laid_out(stance={"limbs": {"RM": [0.05, -0.1, -0.2]}})
    foothold = next(p for p in course.footholds if p.frame == 0 and p.limb == "RM")
    np.testing.assert_allclose(
        foothold.candidates[0].centre_m, [0.05 + 0.025, -0.28, 0.0], atol=1e-12
    )


def test_a_toe_out_of_comfortable_reach_is_drawn_towards_its_shoulder():
    course = laid_out(stance={"outward_m": 0.35}, candidates={"window_m": 0.02})
    for foothold in course.footholds:
        limb = hexapod().select([foothold.limb])[0]
        index = course.robot.limb_names.index(foothold.limb)
        here = course.holds[:, index] == course.footholds.index(foothold)
        shoulder = course.com_nominal_m[here].mean(axis=0) + limb.shoulder_m
        arm = foothold.candidates[0].centre_m - shoulder
        assert np.linalg.norm(arm) == pytest.approx(0.85 * 0.35, abs=1e-9)
        assert np.cross(arm, limb.shoulder_m)[2] == pytest.approx(0.0, abs=1e-9)  # outward still


def test_a_robot_of_the_file_walks_too():
    limbs = {
        f"leg {i}": {"shoulder_m": [x, y, 0.0], "reach_m": 0.4}
        for i, (x, y) in enumerate([(0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1)])
    }
    course = laid_out(robot={"name": "dog", "mass_kg": 20.0, "limbs": limbs}, gait="wave", frames=4)
    assert course.robot.mass_kg == 20.0
    assert course.lifts[1:] == (
        (),
        ("leg 2",),
        ("leg 0",),
    )  # first the body, then the left side, from the back


def test_polygons_become_terrain_and_only_footing_carries_toes():
    panel = [(-1.0, 0.35, 0.0), (1.0, 0.35, 0.0), (1.0, 0.35, 0.4), (-1.0, 0.35, 0.4)]
    for footing, stands_on in (
        (True, 0.35),
        (False, 0.33),
    ):  # the middle of LM's window, 2 cm from its shoulder's place
        spec = polygons(square(0.0, 0.0, 0.0, 2.0), panel, friction=0.4)
        spec["polygons"][1] |= {"footing": footing, "friction": 0.9}
        course = laid_out(terrain=spec, stance={"down_m": 0.10})
        assert [patch.friction for patch in course.terrain] == [0.4, 0.9]
        foothold = next(p for p in course.footholds if p.limb == "LM")
        assert foothold.candidates[0].centre_m[1] == pytest.approx(stands_on, abs=1e-9)


def test_a_surface_that_other_terrain_hides_is_not_offered():
    floors = [square(0.0, 0.0, z, 3.0) for z in (-0.05, 0.0)]
    course = laid_out(terrain=polygons(*floors), candidates={"count": 4})
    assert {len(p.candidates) for p in course.footholds} == {1}
    assert {float(v) for p in course.footholds for v in p.candidates[0].vertices_m[:, 2]} == {0.0}
    hidden = polygons(*floors)
    hidden["polygons"][1]["footing"] = False
    assert refusal(laid_out, terrain=hidden).endswith(
        "is 0.25 m away (terrain patch 0, which other terrain hides)"
    )


@pytest.mark.parametrize(("over_m", "upper"), [(0.008, [0.0, 0.008]), (0.012, [0.012])])
def test_terrain_within_a_centimetre_of_a_place_does_not_hide_it(over_m, upper):
    """Straight below its shoulder a toe is offered both of two floors, or the upper one alone."""
    normal, reference = [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]
    floors = tuple(
        Patch(
            vertices_m=square(0.0, 0.0, z, 3.0),
            normal=normal,
            shear_reference=reference,
            friction=0.5,
        )
        for z in (0.0, over_m)
    )
    limb, shoulder, toe = hexapod().limbs[0], np.array([0.0, 0.0, 0.25]), np.zeros(3)
    offered = CandidatePatches(Terrain(floors, (True, True)), 0.01).candidates(
        limb, shoulder, toe, 4, 0.1
    )
    assert sorted(float(piece.vertices_m[0, 2]) for _, piece in offered) == upper


def test_toes_asked_for_at_once_get_what_they_get_one_by_one():
    course = read_course("icy-walls")
    patches = course.terrain
    footing = CandidatePatches(Terrain(patches, (True,) * len(patches)), 0.01)
    rng, toes = np.random.default_rng(2), []
    for limb in course.robot.limbs * 3:
        shoulder = course.com_nominal_m[0] + limb.shoulder_m + 0.1 * rng.normal(size=3)
        toes.append((limb, shoulder, shoulder + 0.2 * rng.normal(size=3), 0.1))
    toes.append((course.robot.limbs[0], np.full(3, 50.0), np.zeros(3), 0.1))  # near nothing
    together = footing.candidates_of(toes, 3)
    assert together[-1] == []
    assert any(len(each) > 1 for each in together)
    for (limb, shoulder, toe, side), found in zip(toes, together, strict=True):
        alone = footing.candidates(limb, shoulder, toe, 3, side)
        assert [index for index, _ in found] == [index for index, _ in alone]
        for (index, piece), (_, other) in zip(found, alone, strict=True):
            np.testing.assert_allclose(piece.vertices_m, other.vertices_m, rtol=0.0, atol=1e-15)
            window = footing.surfaces[index].patch
            assert np.ptp(piece.vertices_m @ window.normal) < 1e-9  # in the plane of its surface


def test_a_surface_seen_from_behind_carries_no_toe():
    message = refusal(laid_out, terrain=polygons(square(0.0, 0.0, 0.0, 2.0)[::-1]))
    assert message.startswith(
        "frame 0, limb LF: expected a surface within its reach of 0.35 m of its shoulder at ("
    )
    assert message.endswith("the nearest is 0.2 m away (terrain patch 0, which faces away)")


# -----------------------------------------------------------------------------------------------------------
# refusals


def test_every_wrong_key_is_named_with_the_file(write):
    path = write(
        FLOOR | {"frames": 0, "gate": "tripod", "candidates": {"count": 0}, "start_m": [0.0]}
    )
    message = refusal(read_course, path)
    assert message.startswith(f"{path}: ")
    for part in (
        "frames: expected greater than or equal to 1, got 0",
        "gate: unknown key, did you mean 'gait'?",
        "candidates.count:",
        "start_m[1]: expected this key, got nothing",
        "start_m[2]: expected this key, got nothing",
    ):
        assert part in message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gait": "trot"}, "gait: expected 'all', 'tripod' or 'wave', got 'trot'"),
        ({"gait": [["RF"], "x"]}, "gait[1]: expected a list in brackets, got 'x'"),
        (
            {"robot": {"mass_kg": 0, "limbs": {"a": {"shoulder_m": [0, 0, 0]}}}},
            "robot.mass_kg: expected greater than 0, got 0; robot.limbs.a.reach_m: expected this key, got nothing",
        ),
        (
            {"via_m": [[0, 0, 0], {"at": [1, 2, 3]}]},
            "via_m[1].at_m: expected this key, got nothing; via_m[1].at: unknown key, did you mean 'at_m'?",
        ),
        (
            {"terrain": {"kind": "flat", "frction": 0.5}},
            "terrain.frction: unknown key, did you mean 'friction'?",
        ),
        (
            {"terrain": {"kind": "flat", "apart_n": 0.5}},
            "terrain.apart_n: unknown key",
        ),  # one of walls
        (
            {
                "robot": {
                    "mass_kg": 1,
                    "limbs": {"a": {"shoulder_m": [0, 0, 0], "reach_m": 1, "reech_m": 1}},
                }
            },
            "robot.limbs.a.reech_m: unknown key, did you mean 'reach_m'?",
        ),
        (
            {"terrain": {"kind": "walls", "apart_m": -1, "colour": "red"}},
            "terrain.apart_m: expected greater than 0, got -1; terrain.colour: unknown key",
        ),
        (
            {"terrain": {"kind": "icy-walls", "left": ["#."], "right": ["# ."]}},
            "terrain.right[0]: String should match pattern '^[#.]+$', got '# .'",
        ),
        (
            {"steps": {"com_m": 0.1, "progress_m": 0.2}, "start_m": [0.0, float("nan"), 0.0]},
            "start_m[1]: expected a finite number, got nan; "
            "steps.progress_m: expected at most steps.com_m = 0.1, the largest step, got 0.2",
        ),
    ],
)
def test_keys_are_named_as_they_stand_in_the_file(changes, message):
    assert refusal(floor, **changes) == message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"terrain": {"kind": "sea"}},
            "terrain.kind",
        ),
        ({"terrain": {"friction": 0.5}}, "terrain.kind"),
        (
            {"gait": [["RF", "XX"]]},
            "gait[0]",
        ),
        (
            {"steps": {"com_m": 0.05, "progress_m": 0.1}},
            "steps.progress_m",
        ),
        (
            {"steps": {"progress_m": 0.14}},
            "steps.progress_m",
        ),
        (
            {"goal_m": [1.0, 0.0, 0.2]},
            "goal_m",
        ),
        ({"frames": 1}, "frames"),
        ({"stride_m": 0.3}, "goal_m"),
        (
            {"stride_m": 0.1, "goal_m": [0.0, 0.0, 0.2]},
            "goal_m",
        ),
        (
            {"via_m": [[0.25, 0.0, 0.2]], "goal_m": [0.0, 0.0, 0.2], "steps": {"com_m": 0.05}},
            "frame 1",
        ),
        (
            {"start_m": [0.0, 0.0, 0.6], "goal_m": [0.1, 0.0, 0.6]},
            "limb LF",
        ),
        (
            {"candidates": {"margin_m": 2.0}},
            "limb LF",
        ),
        (
            {"terrain": polygons(square(0.0, 0.0, 0.0, 0.0))},
            "terrain.polygons[0].vertices_m",
        ),
        (
            {"terrain": polygons([(0, 0, 0), (1, 0, 0), (0.1, 0.1, 0), (0, 1, 0)])},
            "terrain.polygons[0].vertices_m",
        ),
        (
            {"terrain": polygons(square(0.0, 0.0, 0.0, 1.0), friction=-0.1)},
            "terrain.friction",
        ),
        (
            {"robot": {"mass_kg": 5.0, "limbs": {"a": {"shoulder_m": [0, 0, 0], "reach_m": 0.4}}}},
            "gait",
        ),
        (
            {"terrain": {"kind": "stairs", "run_m": 1e-5}},
            "terrain",
        ),
    ],
)
def test_a_course_that_cannot_be_is_refused_with_what_is_wrong(changes, message):
    assert_names(refusal(laid_out, **changes), message)


def test_a_limb_whose_own_surface_is_missing_is_named_with_its_frame():
    held = [square(x, y, 0.0, 0.2) for x in (-0.2, 0.0, 0.2) for y in (-0.25, 0.25)]
    message = refusal(
        laid_out, terrain=polygons(*held), frames=6, stride_m=0.1, goal_m=[0.6, 0.0, 0.2]
    )
    assert message.startswith("frame ")
    assert "limb LF: expected a surface within its reach of 0.35 m" in message


def test_two_limbs_on_one_patch_too_small_for_two_toes_are_named():
    spot = square(0.0, 0.0, 0.0, 0.012)
    message = refusal(
        laid_out,
        terrain=polygons(spot),
        candidates={"margin_m": 0.0},
        gait="all",
        frames=1,
        goal_m=[0.0, 0.0, 0.2],
    )
    assert message == (
        "frame 0, limbs LF and LM: expected room for two toes, got nothing but terrain patch 0, 17 mm wide"
    )


def test_an_unknown_name_gets_the_names_there_are():
    message = refusal(read_course, "wals")
    known = ", ".join(FIVE)
    assert (
        message == f"course: expected one of {known}, FAMILY:LEVEL:SEED or a YAML file, got 'wals'"
    )


@pytest.mark.parametrize("frames", [0, -1, 1001, 2.5, True])
def test_another_number_of_frames_is_checked_too(frames):
    assert_names(refusal(read_course, "walls", frames=frames), "walls", "frames")


@pytest.mark.parametrize("text", ["[1, 2]", "name: [", "just a text", "a: b: c"])
def test_a_file_that_is_no_mapping_is_refused_in_one_line(text, write):
    path = write(text)
    assert_names(refusal(read_course, path), path)


NUMBERS = [0, -1, 1e-9, 1e9, 1e308, float("nan"), float("inf"), 3, 0.5]
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([*NUMBERS, "", "x"]),
    st.dictionaries(st.sampled_from("ab"), st.none()),
    st.lists(st.sampled_from([0.0, 1.0, -1e3, "a", None]), max_size=4),
)


def places(data, path=()):
    """Where the values of a nested mapping are."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


@given(st.sampled_from(FIVE), st.data())
@settings(max_examples=150)
def test_whatever_is_put_into_a_file_gives_a_course_or_a_refusal_in_one_line(name, draw):
    described = read_spec(name).model_dump(mode="json")
    described["frames"] = 3
    for place in draw.draw(
        st.lists(st.sampled_from(list(places(described))), min_size=1, max_size=2)
    ):
        inside = described
        for key in place[:-1]:
            inside = (
                inside[key]
                if isinstance(inside, dict | list) and key in [k for k, *_ in places(inside)]
                else {}
            )
        with contextlib.suppress(
            IndexError, TypeError
        ):  # a place that the first change has taken away
            inside[place[-1]] = draw.draw(JUNK)
    message = ""
    try:
        build_course(spec_from(described))
    except InvalidInput as error:
        message = str(error)
    assert "\n" not in message


def test_reading_the_built_in_courses_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [read_course(name).name for name in FIVE] == list(FIVE)
