"""Selectors as policies: the envelopes that a trained selector chooses for the coming stances, and a planner in them.

Where P1 has no plan within the chosen envelopes, the lift plans, which needs none: a bad choice costs time only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.contact.envelope import Envelope, EnvelopeSet
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.keyframes.enveloped import EnvelopeCoursePlanner
from stancekit.planners.keyframes.planner import CoursePlanner
from stancekit.planners.keyframes.twostage import CourseModels, TwoStageCoursePlanner
from stancekit.planners.outcome import InvalidInput
from stancekit.planners.plan import PlanOutcome
from stancekit.planners.scene.course import Course

from ..selection import observe
from .policy import Observation, Policy

Predict = Callable[[Mapping[str, NDArray[Any]]], NDArray[Any]]
"""From an observation of ``EnvelopeSelection-v0`` to its action, bounds of one or more envelopes."""


def selector_policy(predict: Predict, learned: EnvelopeSet, models: CourseModels | None = None) -> Policy:
    """The policy that asks a selector about every coming stance of its legs, and plans within what it chooses.

    learned: of the selector's problem class: its legs, normals and scales count, its boxes do not.
    """
    shared = models or CourseModels()
    lift = TwoStageCoursePlanner(models=shared)

    def policy(observation: Observation) -> CoursePlanner:
        boxes = chosen(predict, learned, observation.window)
        if not boxes:
            return lift
        within = replace(learned, envelopes=boxes)
        return EnvelopeOrLift(EnvelopeCoursePlanner(within, models=shared), lift)

    return policy


def chosen(predict: Predict, learned: EnvelopeSet, course: Course) -> tuple[Envelope, ...]:
    """The different envelopes that a selector chooses for the stances of a course by these legs, first candidates."""
    names, found = course.robot.limb_names, dict[bytes, Envelope]()
    first = np.zeros(len(course.placements), dtype=int)
    for stance in course.stances:
        if {names[limb] for limb in stance.limbs} != set(learned.legs):
            continue
        problem = course.posture_problem(stance, first)
        by_leg = {contact.leg: contact for contact in problem.contacts}
        ordered = replace(problem, contacts=tuple(by_leg[leg] for leg in learned.legs))
        action = np.asarray(predict(observe(ScaledProblem.of(ordered))), dtype=float)
        for row in action.reshape(-1, 12 * len(learned.legs)):
            found.setdefault(row.tobytes(), Envelope.from_vector(row))
    return tuple(found.values())


class EnvelopeOrLift:
    """Plans within envelopes, and without where that fails or they are not for the course."""

    name = "two-stage"

    def __init__(self, within: EnvelopeCoursePlanner, lift: TwoStageCoursePlanner) -> None:
        self.within, self.lift = within, lift
        self.lifted = 0

    def solve(self, course: Course) -> PlanOutcome:
        """Answer one course. lifted: how often the lift had to."""
        try:
            outcome = self.within.solve(course)
        except InvalidInput:
            outcome = None
        if outcome is not None and outcome.plan is not None:
            return outcome
        self.lifted += 1
        return self.lift.solve(course)
