"""Families of terrain: equal for equal seeds, what their figures say, harder only where the level
says so.
"""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.problem.contact import NoFooting
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.families import (
    SCENE,
    SMOOTH,
    TERRAIN_FAMILIES,
    WIDE,
    family_terrain,
    read_draw,
)
from stancekit.planners.terrain.footholds import ROUGHNESS_M, footholds_of
from stancekit.planners.terrain.heightfield import ROUND_M, SLOPE, SPACING_M
from stancekit.planners.terrain.polygon import STEEP, UPRIGHT, VOID_M, half_planes, nearest
from stancekit.planners.terrain.reference import named_surface, named_terrain
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses

SCENES = ("stairs", "stones", "gaps", "beams", "rubble", "slopes", "walls")
"""The families of polygons."""

FAMILIES = TERRAIN_FAMILIES.names()


def lines(spacing):
    """Grid lines over a scene, along x and y [m]."""
    return [np.arange(a, b + 1e-9, spacing) for a, b in SCENE.T[:2]]


@pytest.fixture(scope="module")
def planner():
    return TwoStage(programs=Programs(), time_limit_s=600.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_equal_seeds_give_equal_scenes_and_others_others(family):
    one, again, other = (family_terrain(family, 0.6, seed) for seed in (4, 4, 5))
    assert one.figures == again.figures != other.figures
    for patch, same in zip(one.patches, again.patches, strict=True):
        np.testing.assert_array_equal(patch.vertices_m, same.vertices_m)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_level_leaves_what_is_drawn_alone(family):
    easy, hard = (family_terrain(family, level, 3).figures for level in (0.2, 0.8))
    drawn = {"friction", "run_m", "offset_m"} | ({"middle_m"} if family == "gaps" else set())
    assert {name: easy[name] for name in drawn & set(easy)} == {
        name: hard[name] for name in drawn & set(hard)
    }
    assert any(easy[name] != hard[name] for name in easy)


@pytest.mark.parametrize("family", FAMILIES)
def test_level_0_always_has_a_plan(family, planner):
    for seed in range(2):
        outcome = planner.solve(read_course(f"{family}:0:{seed}"))
        assert outcome.status is Status.FEASIBLE
        assert check_plan(outcome.solution).accepted


@pytest.mark.parametrize("seed", range(4))
def test_a_slope_above_the_friction_angle_is_proved_to_have_no_plan(seed, planner):
    friction = family_terrain("slopes", 0.0, seed).figures["friction"]
    course = read_course(f"slopes:{(np.arctan(friction) + 0.02) / 0.8:.6f}:{seed}")
    outcome = planner.solve(course)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(course)).accepted


def test_a_gap_wider_than_a_shoulder_and_its_legs_reach_has_no_footing():
    with refuses("gaps:1:0", "frame 0", kind=NoFooting):
        read_course("gaps:1:0")


def test_walls_have_no_footing_just_where_one_is_out_of_reach_of_a_corner_leg():
    """The outermost of a front toe: its shoulder's y, moved by the COM's ball and √3 · tilt · ‖s‖,
    and its reach.
    """
    limb = hexapod().limbs[0]
    course = read_course("walls:0:0")
    moved = course.com_radius_m[0] + np.sqrt(3.0) * course.tilt_limit_rad * np.linalg.norm(
        limb.shoulder_m
    )
    most, seen = limb.shoulder_m[1] + moved + limb.reach_m, set()
    for seed in range(12):
        figures = family_terrain("walls", 1.0, seed).figures
        none = bool(0.5 * figures["apart_m"] + abs(figures["middle_m"]) > most)
        seen.add(none)
        with pytest.raises(NoFooting) if none else nullcontext():
            read_course(f"walls:1:{seed}")
    assert seen == {True, False}


@pytest.mark.parametrize("family", ["gaps", "beams"])
def test_harder_gaps_and_beams_have_less_to_stand_on_and_nothing_else(family):
    easy, hard = (family_terrain(family, level, 1).grid(*lines(0.05)) for level in (0.3, 0.7))
    assert np.all((hard == easy) | (hard == VOID_M))
    assert (hard == VOID_M).sum() > (easy == VOID_M).sum()


def test_what_a_scene_is_made_of_is_what_its_figures_say():
    stairs = family_terrain("stairs", 0.4, 2)
    x, y = lines(0.01)
    heights = stairs.grid(x, y)
    jumps = np.diff(heights[:, len(y) // 2])
    np.testing.assert_allclose(jumps[np.abs(jumps) > 1e-9], 0.2)
    slope = family_terrain("slopes", 0.5, 2)
    x, y = lines(0.05)
    heights = slope.grid(x, y)
    np.testing.assert_allclose(heights, np.tan(0.4) * x[:, None] * np.ones(len(y)), atol=1e-12)
    stones = family_terrain("stones", 0.5, 2)
    sides = [np.ptp(patch.vertices_m[:, :2], axis=0) for patch in stones.patches]
    np.testing.assert_allclose(sides, 0.15)
    assert stones.figures["apart_m"] == pytest.approx(0.3)


def test_all_that_a_limb_may_reach_is_offered():
    """Points of the terrain at random: one within a limb's reach of some place of its shoulder is
    in a candidate.
    """
    course = read_course("rubble:0.5:3")
    rng, foothold = np.random.default_rng(0), course.footholds[0]
    limb, offered = hexapod().limbs[0], 0
    for patch in course.terrain:
        corners = patch.vertices_m
        for _ in range(60):
            s, t = rng.uniform(0.06, 0.94, 2)  # inside the margin
            point = corners[0] + s * (corners[1] - corners[0]) + t * (corners[3] - corners[0])
            turned = np.cross(rng.uniform(-1.0, 1.0, 3) * course.tilt_limit_rad, limb.shoulder_m)
            moved = rng.uniform(-1.0, 1.0, 3) * course.com_radius_m[0] / np.sqrt(3.0)
            shoulder = course.com_nominal_m[0] + limb.shoulder_m + turned + moved
            if (
                np.linalg.norm(point - shoulder) > limb.reach_m
                or patch.normal @ (shoulder - point) <= 0.0
            ):
                continue
            offered += 1
            assert any(_holds(piece, point) for piece in foothold.candidates)
    assert offered > 30


def _holds(patch, point):
    flat = (patch.vertices_m - point) @ patch.frame
    if np.abs(flat[:, 0]).max() > 1e-9:
        return False
    ahead = np.roll(flat, -1, axis=0)
    turns = flat[:, 1] * ahead[:, 2] - flat[:, 2] * ahead[:, 1]
    return bool(np.all(turns >= 0.0) or np.all(turns <= 0.0))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("stairs:high", "course"),
        (
            "stairs:0.5:1:2",
            "course",
        ),
        ("gaps:0.5:-1", "seed"),
    ],
)
def test_a_name_that_is_none_is_refused_in_one_line(name, said):
    with refuses(said):
        read_course(name)


@pytest.mark.parametrize("level", ["1.5", "-0.1", "nan"])
def test_a_level_outside_0_to_1_is_refused(level):
    with refuses("level"):
        read_course(f"slopes:{level}:0")


def test_walls_are_no_height_field():
    assert family_terrain("walls", 0.5, 0).heights is None
    with refuses("terrain"):
        named_terrain("walls:0.5:0")


def under(pieces, rng, count=20):
    """Places at random under every patch that faces up, shape (K, 3) [m], and how far each is from
    its border [m].
    """
    places, borders = [], []
    for patch in pieces:
        if patch.normal[2] < UPRIGHT:
            continue
        corners = patch.vertices_m
        at = rng.dirichlet(np.ones(len(corners)), count) @ corners
        normals, offsets = half_planes(corners[:, :2])
        places.append(at)
        borders.append((offsets - at[:, :2] @ normals.T).min(axis=1))
    return np.concatenate(places), np.concatenate(borders)


def below_an_edge(places, patches):
    """Which places are where something higher falls off, within its drop over SLOPE, a radius and
    two grid lines.
    """
    found = np.zeros(len(places), dtype=bool)
    for patch in patches:
        if patch.normal[2] < UPRIGHT:
            continue
        on = nearest(patch.vertices_m[:, :2], places[:, :2])
        top = patch.centre_m[2] - (on - patch.centre_m[:2]) @ patch.normal[:2] / patch.normal[2]
        away = np.linalg.norm(places[:, :2] - on, axis=1)
        drop = top - places[:, 2]
        found |= (drop > 1e-6) & (away < drop / SLOPE + ROUND_M + 2.0 * SPACING_M)
    return found


@pytest.mark.parametrize("family", [name for name in SCENES if name != "walls"])
def test_heights_of_polygons_are_their_surface_but_for_rounded_edges(family):
    """1 mm farther than 5 cm from a patch's border, 8 mm up to it; at half the level, and all of it."""
    rng, looked = np.random.default_rng(0), 0
    for seed, level in ((1, 0.5), (3, 1.0)):
        scene, whole = (
            family_terrain(family, level, seed),
            family_terrain(family, level, seed, WIDE),
        )
        places, borders = under(scene.patches, rng, max(40, 280 // len(scene.patches)))
        kept = ~below_an_edge(places, whole.patches)
        off = np.abs(scene.heights.height(places[:, :2]) - places[:, 2])[kept]
        assert off.max(initial=0.0) < 8e-3, (seed, off.max())
        assert off[borders[kept] > 0.05].max(initial=0.0) < 1e-3, (
            seed,
            off[borders[kept] > 0.05].max(),
        )
        looked += len(off)
    assert looked > 100


@pytest.mark.parametrize("family", SMOOTH)
def test_patches_of_smooth_ground_keep_to_its_heights(family):
    """Footholds are planes within three times the roughness of a foothold, 18 mm; two draws."""
    rng, looked = np.random.default_rng(0), 0
    for seed, level in ((1, 0.5), (3, 1.0)):
        scene = family_terrain(family, level, seed)
        if not scene.footholds:
            continue
        places, _ = under(scene.footholds, rng, 30)
        off = np.abs(scene.heights.height(places[:, :2]) - places[:, 2])
        assert off.max() < 3.0 * ROUGHNESS_M, (seed, off.max())
        looked += len(off)
    assert looked > 100


@pytest.mark.parametrize("family", [*SCENES, "rough", "ramps"])
def test_the_ground_about_a_start_is_part_of_all_the_ground(family):
    other = 0.5 * SCENE if family in SMOOTH else WIDE  # of smooth ground in any box
    scene, whole = family_terrain(family, 0.4, 3), family_terrain(family, 0.4, 3, other)
    assert (scene.figures, scene.rise) == (whole.figures, whole.rise)
    if family in SMOOTH:
        np.testing.assert_array_equal(scene.heights.heights_m, whole.heights.heights_m)
        return
    if family in ("stones", "rubble"):
        theirs = {patch.vertices_m.tobytes() for patch in whole.patches}
        assert {patch.vertices_m.tobytes() for patch in scene.patches} <= theirs
    x, y = lines(0.05)
    if family != "walls":
        inside = scene.grid(x[1:-1], y[1:-1])
        np.testing.assert_allclose(whole.grid(x[1:-1], y[1:-1]), inside, atol=1e-12)


@pytest.mark.parametrize("name", ["stairs:0.3:7", "stones:0.2:7", "ramps:0.5:3"])
def test_a_name_is_one_ground_for_key_frames_walks_and_footholds(name):
    family, level, seed = read_draw(name, "course")
    scene, walked = family_terrain(family, level, seed), named_terrain(name)
    np.testing.assert_array_equal(walked.heights_m, scene.heights.heights_m)
    course = read_course(name)
    assert [patch.vertices_m.tolist() for patch in course.terrain] == [
        p.vertices_m.tolist() for p in scene.patches
    ]
    places, _ = under(
        [piece.patch for piece in footholds_of(named_surface(name)).pieces],
        np.random.default_rng(0),
        4,
    )
    places = places[walked.contains(places[:, :2])]  # stones go on over the end of the heights
    if family in SCENES:
        places = places[~below_an_edge(places, family_terrain(family, level, seed, WIDE).patches)]
    assert np.abs(walked.height(places[:, :2]) - places[:, 2]).max() < (
        8e-3 if family in SCENES else 18e-3
    )


@pytest.mark.parametrize(("family", "level"), [("rubble", 1.0), ("slopes", 1.0)])
def test_blocks_and_slopes_of_more_than_45_degrees_have_heights(family, level):
    scene = family_terrain(family, level, 3)
    assert min(patch.normal[2] for patch in scene.patches) < STEEP
    x, y = lines(0.05)
    assert not np.any(scene.grid(x[1:-1], y[1:-1]) == VOID_M)
