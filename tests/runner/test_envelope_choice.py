"""A selector as a policy: whom it is asked about, what is planned within its choice, and what happens to a bad one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stancekit.envs.distributions.postures import FIVE_LEGS
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.expert import expert_envelopes
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan
from stancekit.runner.control.closed_loop import Observation
from stancekit.runner.control.envelope_choice import EnvelopeOrLift, SelectorPolicy, chosen, triangular

LEARNED = expert_envelopes("wall")


class Always:
    """A selector with one answer; requests: the observations that it got."""

    def __init__(self, action: NDArray[Any]) -> None:
        self.action, self.requests = action, list[Mapping[str, NDArray[Any]]]()

    def predict(self, observation: Mapping[str, NDArray[Any]], state: Any = None) -> tuple[NDArray[Any], Any]:
        self.requests.append(observation)
        return self.action, state


WINDOW = read_course("walls", frames=3)


def seen(window: Any = WINDOW) -> Observation:
    return Observation(window=window, standing=None, state=None, friction_share=1.0, frame=0)


def vector(learned: EnvelopeSet) -> NDArray[Any]:
    return np.concatenate([box.to_vector() for box in learned.envelopes])


def test_it_is_asked_about_the_stances_of_its_legs_and_its_boxes_are_planned_with() -> None:
    selector = Always(vector(LEARNED))
    boxes = chosen(selector, LEARNED, WINDOW)
    names = WINDOW.robot.limb_names
    stances = [s for s in WINDOW.stances if {names[i] for i in s.limbs} == set(LEARNED.legs)]
    assert len(selector.requests) == len(stances) > 0
    assert selector.requests[0]["friction"].shape == (3,)
    assert selector.requests[0]["vertices"].shape == (3 * 3 * 3,)  # of triangles, as selectors learn from them
    assert len(boxes) == len(LEARNED.envelopes)
    np.testing.assert_allclose(boxes[0].to_vector(), LEARNED.envelopes[0].to_vector())
    policy = SelectorPolicy(selector, LEARNED)
    planner = policy(seen())
    assert isinstance(planner, EnvelopeOrLift)
    assert policy.answers == (0, 0)
    outcome = planner.solve(WINDOW)
    assert outcome.plan is not None
    assert check_plan(outcome.plan).accepted
    assert (policy.answers, outcome.plan.provenance["p1"]) == ((1, 0), LEARNED.problem_class)


def test_a_choice_within_which_there_is_no_plan_is_planned_without() -> None:
    tight = 1e-6 * np.tile(np.repeat([-1.0, 1.0], 9), 2)
    assert tight.size == vector(LEARNED).size // len(LEARNED.envelopes)
    policy = SelectorPolicy(Always(tight), LEARNED)
    outcome = policy(seen()).solve(WINDOW)
    assert outcome.plan is not None
    assert (policy.answers, outcome.plan.provenance["p1"]) == ((0, 1), "lift")


def test_what_is_planned_where_nothing_was_chosen_counts_as_planned_without() -> None:
    policy = SelectorPolicy(Always(vector(LEARNED)), expert_envelopes("wall", legs=FIVE_LEGS))
    outcome = policy(seen()).solve(WINDOW)
    assert outcome.plan is not None
    assert (policy.answers, outcome.plan.provenance["p1"]) == ((0, 1), "lift")


def test_a_selector_that_would_never_be_asked_is_refused() -> None:
    policy = SelectorPolicy(Always(vector(LEARNED)), expert_envelopes("wall", legs=FIVE_LEGS))
    with pytest.raises(InvalidInput, match="expected a selector for stances of walls, got one for RF, RM, RR, LF, LR"):
        policy.check_fits(WINDOW)
    SelectorPolicy(Always(vector(LEARNED)), LEARNED).check_fits(WINDOW)


def test_of_a_patch_with_more_corners_its_largest_triangle_is_observed() -> None:
    corners = np.array([[0.0, 0.0, 0.1], [0.3, 0.0, 0.1], [0.3, 0.1, 0.1], [0.1, 0.2, 0.1]])
    patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    np.testing.assert_array_equal(triangular(patch).vertices_m, corners[[0, 1, 3]])
    assert triangular(triangular(patch)).vertices_m.tolist() == triangular(patch).vertices_m.tolist()
