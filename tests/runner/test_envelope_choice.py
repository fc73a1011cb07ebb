"""A selector as a policy: whom it is asked about, what is planned within its choice, and what
happens to a bad one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.envs.distributions.postures import FIVE_LEGS
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.boxes import boxes_of
from stancekit.planners.relaxation.envelope import EnvelopeSet, expert_envelopes
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan
from stancekit.runner.control.envelope_choice import (
    EnvelopeOrLift,
    Observation,
    SelectorPolicy,
    about,
    chosen,
    triangular,
)
from tests.refusals import refuses

LEARNED = expert_envelopes("wall")


class Always:
    """A selector with one answer; requests: the observations that it got."""

    def __init__(self, action: NDArray[Any]) -> None:
        self.action, self.requests = action, list[Mapping[str, NDArray[Any]]]()

    def predict(
        self, observation: Mapping[str, NDArray[Any]], state: Any = None
    ) -> tuple[NDArray[Any], Any]:
        self.requests.append(observation)
        return self.action, state


WINDOW = read_course("walls", frames=3)


def seen(window: Any = WINDOW) -> Observation:
    return Observation(window=window, standing=None, state=None, friction_share=1.0, frame=0)


def vector(learned: EnvelopeSet) -> NDArray[Any]:
    return np.concatenate([box.to_vector() for box in learned.envelopes])


def test_it_is_asked_about_every_stance_of_its_legs_or_their_images_and_its_boxes_are_planned_with() -> (
    None
):
    selector = Always(vector(LEARNED))
    found = chosen(selector, LEARNED, WINDOW)
    assert found is not None
    assert len(selector.requests) == len(WINDOW.stances) > 2
    assert selector.requests[0]["friction"].shape == (3,)
    assert selector.requests[0]["vertices"].shape == (
        3 * 3 * 3,
    )  # of triangles, as selectors learn from them
    for mine, other in zip(found.boxes, boxes_of(WINDOW, LEARNED), strict=True):
        np.testing.assert_array_equal(mine.low, other.low)
        np.testing.assert_array_equal(mine.high, other.high)
    policy = SelectorPolicy(selector, LEARNED)
    planner = policy(seen())
    assert isinstance(planner, EnvelopeOrLift)
    assert policy.answers == (0, 0)
    outcome = planner.solve(WINDOW)
    assert outcome.solution is not None
    assert check_plan(outcome.solution).accepted
    assert (policy.answers, outcome.solution.provenance["p1"]) == ((1, 0), LEARNED.problem_class)


def test_a_stance_on_the_other_side_is_shown_in_the_mirror_and_all_from_the_nominal_com() -> None:
    selector = Always(vector(LEARNED))
    chosen(selector, LEARNED, WINDOW)
    shoulders = (
        np.array([limb.shoulder_m for limb in WINDOW.robot.select(LEARNED.legs)])
        / WINDOW.length_scale_m
    )
    sides = np.sign(shoulders[:, 1])
    for seen in selector.requests:
        np.testing.assert_allclose(seen["shoulders"].reshape(-1, 3), shoulders, atol=1e-6)
        frames, corners = seen["frames"].reshape(-1, 3, 3), seen["vertices"].reshape(-1, 3, 3)
        np.testing.assert_array_equal(np.sign(frames[:, 1, 0]), -sides)  # walls face the robot
        np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-6)
        around = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(around, axis=1)
        np.testing.assert_allclose(np.abs(np.vecdot(around, frames[:, :, 0])), length, rtol=1e-5)
        assert np.all(
            np.abs(corners.mean(axis=1) - shoulders)[:, [0, 2]] < 0.4
        )  # beside the legs, wherever the frame


def test_of_a_large_patch_a_triangle_about_where_the_toe_will_be_is_observed() -> None:
    square = Patch(
        vertices_m=np.array(
            [[-0.5, -0.5, 0.1], [0.5, -0.5, 0.1], [0.5, 0.5, 0.1], [-0.5, 0.5, 0.1]]
        ),
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=0.5,
    )
    corners = about(square, np.array([0.2, 0.7, 0.9]), 0.06)
    np.testing.assert_allclose(np.linalg.norm(corners - [0.2, 0.5, 0.1], axis=1), 0.06)
    np.testing.assert_allclose(corners.mean(axis=0), [0.2, 0.5, 0.1])
    small = square.with_vertices(np.array([[0.0, 0.0, 0.1], [0.06, 0.0, 0.1], [0.0, 0.06, 0.1]]))
    np.testing.assert_array_equal(about(small, np.zeros(3), 0.06), small.vertices_m)


def test_a_choice_within_which_there_is_no_plan_is_planned_without() -> None:
    tight = 1e-6 * np.tile(np.repeat([-1.0, 1.0], 9), 2)
    assert tight.size == vector(LEARNED).size // len(LEARNED.envelopes)
    policy = SelectorPolicy(Always(tight), LEARNED)
    outcome = policy(seen()).solve(WINDOW)
    assert outcome.solution is not None
    assert (policy.answers, outcome.solution.provenance["p1"]) == ((0, 1), "lift")


def test_what_is_planned_where_nothing_was_chosen_counts_as_planned_without() -> None:
    policy = SelectorPolicy(Always(vector(LEARNED)), expert_envelopes("wall", legs=FIVE_LEGS))
    outcome = policy(seen()).solve(WINDOW)
    assert outcome.solution is not None
    assert (policy.answers, outcome.solution.provenance["p1"]) == ((0, 1), "lift")


def test_a_selector_that_would_never_be_asked_is_refused() -> None:
    policy = SelectorPolicy(Always(vector(LEARNED)), expert_envelopes("wall", legs=FIVE_LEGS))
    with refuses("selector"):
        policy.check_fits(WINDOW)
    SelectorPolicy(Always(vector(LEARNED)), LEARNED).check_fits(WINDOW)


def test_of_a_patch_with_more_corners_its_largest_triangle_is_observed() -> None:
    corners = np.array([[0.0, 0.0, 0.1], [0.3, 0.0, 0.1], [0.3, 0.1, 0.1], [0.1, 0.2, 0.1]])
    patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    np.testing.assert_array_equal(triangular(patch).vertices_m, corners[[0, 1, 3]])
    assert (
        triangular(triangular(patch)).vertices_m.tolist() == triangular(patch).vertices_m.tolist()
    )
