"""What the tables say of limbs, and from where a scene is seen: left is left."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.verify.explain import Relaxation, _change
from stancekit.views.playground.page_parts import explained, from_behind


def test_limbs_are_explained_by_their_letters_and_other_names_are_not_guessed():
    said = explained(["LF", "RM", "LH", "FL_foot"])
    assert said.startswith("LF left front, RM right middle, LH left hind, as the robot looks. ")
    assert explained(["arm"]).startswith("Cone: ")


@pytest.mark.parametrize("goal", [(1.0, 0.0), (-1.0, 0.0), (0.3, -2.0), (0.0, 0.0)])
@pytest.mark.parametrize("towards", [(-0.75, -0.45, 0.35), (0.75, 0.45, 0.35), (0.0, 1.0, 0.2)])
def test_what_is_left_of_the_robot_is_left_on_the_page(goal, towards):
    ahead = np.array([*goal, 0.0]) if any(goal) else np.array([1.0, 0.0, 0.0])
    eye = from_behind(np.array(towards), np.zeros(3), np.array([*goal, 0.2]))
    assert np.linalg.norm(eye) == pytest.approx(np.linalg.norm(towards))
    left_of_robot, right_of_page = np.cross([0.0, 0.0, 1.0], ahead), np.cross([0.0, 0.0, 1.0], eye)
    assert left_of_robot @ right_of_page <= 1e-12


@pytest.mark.parametrize(
    ("now", "needed", "words"),
    [
        (0.05, 0.30405, "rise from 0.05 to at least 0.304"),
        (0.05, 0.30399, "rise from 0.05 to at least 0.303"),
        (0.9, 0.4111, "fall from 0.9 to at most 0.412"),
        (0.3, 0.3004, "rise from 0.3"),
        (0.0, 12.345, "rise from 0 to at least 12.3"),
    ],
)
def test_a_change_is_said_with_its_way_and_its_bound(now, needed, words):
    assert (
        _change(Relaxation(parameter="friction", leg="", now=now, needed=needed, unit="")) == words
    )
