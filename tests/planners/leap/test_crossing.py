"""Courses with leaps: where gaps are, and what a crossing is refused for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.certificate import Crossing
from stancekit.planners.leap.crossing import stretches, surface_of
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.terrain.families import family_terrain
from stancekit.planners.terrain.polygon import Surface
from tests.refusals import refuses

TOES = np.array(
    [[0.19, 0.13, -0.27], [0.19, -0.13, -0.27], [-0.19, 0.13, -0.27], [-0.19, -0.13, -0.27]]
)


def test_a_gap_wider_than_the_stance_parts_the_way_in_two() -> None:
    terrain = family_terrain("gaps", 0.4, 0)
    gap, middle = terrain.figures["gap_m"], terrain.figures["middle_m"]
    ends = np.array([[middle - 0.6, 0.0], [middle + 0.6, 0.0]])
    way = stretches(terrain, TOES, ends)
    assert way is not None
    (_, leaves), (lands, _) = way.spans_m
    front, hind = way.at(leaves)[0] + 0.14, way.at(lands)[0] - 0.14  # toes drawn in by 5 cm
    assert front == pytest.approx(middle - 0.5 * gap, abs=0.011)
    assert hind == pytest.approx(middle + 0.5 * gap, abs=0.011)


def test_a_gap_narrower_than_the_stance_has_a_stretch_above_it() -> None:
    terrain = family_terrain("gaps", 0.15, 0)
    middle = terrain.figures["middle_m"]
    way = stretches(terrain, TOES, np.array([[middle - 0.6, 0.0], [middle + 0.6, 0.0]]))
    assert way is not None
    assert len(way.spans_m) == 3


@pytest.mark.parametrize("goal", [-0.3, -0.5])
def test_a_way_without_a_gap_has_no_stretches(goal: float) -> None:
    terrain = family_terrain("gaps", 0.4, 0)
    assert stretches(terrain, TOES, np.array([[-0.55, 0.0], [goal, 0.0]])) is None


def test_a_goal_over_the_gap_is_no_place_to_land() -> None:
    terrain = family_terrain("gaps", 0.4, 0)
    middle = terrain.figures["middle_m"]
    assert stretches(terrain, TOES, np.array([[-0.5, 0.0], [middle, 0.0]])) is None


def test_a_leap_leaves_from_whole_surfaces_and_not_from_the_pieces_that_climbs_end_on() -> None:
    terrain = family_terrain("gaps", 0.4, 0)
    for _, patch in terrain.standing:
        place = patch.centre_m + 0.3 * (patch.vertices_m[0] - patch.centre_m)
        piece = Surface(patch, 0.0).window(place, 0.04)
        assert piece is not None
        assert surface_of(terrain, piece) is patch
        other = piece.with_friction(0.5 * patch.friction)
        assert surface_of(terrain, other) is other
        above = piece.with_vertices(piece.vertices_m + 0.01 * piece.normal)
        assert surface_of(terrain, above) is above


def test_of_two_surfaces_in_one_plane_a_leap_leaves_from_the_one_that_holds_the_piece() -> None:
    patch = family_terrain("gaps", 0.4, 0).standing[0][1]
    centre, side = patch.centre_m, np.array([0.1, 0.0, 0.0])
    short = patch.with_vertices(centre + 0.5 * (patch.vertices_m - centre))
    piece = Surface(short, 0.0).window(short.centre_m, 0.04)
    assert piece is not None
    reach = float(np.ptp(short.vertices_m[:, 0])) / 2.0
    piece = piece.with_vertices(piece.vertices_m + side * (reach - 0.01) / 0.1)
    ground = SimpleNamespace(standing=(("short", short), ("whole", patch)))
    assert surface_of(ground, piece) is patch


def test_a_crossing_begins_with_key_frames() -> None:
    with refuses("crossing gap"):
        Crossing(name="gap", parts=())


def test_a_straight_way_has_the_body_as_high_as_its_toes_are_below_it() -> None:
    """The way that is laid out straight ahead is over the same ground as the one that is looked for:
    with the body on the ground every proof and every climb from a landing is about another robot.
    """
    found = laid_between(stancekit.terrain("rough:0.2:1"), (0.0, 0.0), (0.2, 0.0), frames=2)
    straight = replace(found, straight=True)
    np.testing.assert_allclose(
        straight("inner").com_nominal_m[:, 2], found("inner").com_nominal_m[:, 2], atol=0.03
    )
