"""Courses with leaps: where gaps are, and what a crossing is refused for."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.answer.crossing import Crossing
from stancekit.planners.errors import InvalidInput
from stancekit.planners.leap.crossing import stretches
from stancekit.planners.terrain.families import family_terrain

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


def test_a_crossing_begins_with_key_frames() -> None:
    with pytest.raises(InvalidInput, match=r"^crossing gap: expected parts of which the first is"):
        Crossing(name="gap", parts=())
