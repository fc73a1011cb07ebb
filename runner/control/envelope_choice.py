"""Selectors as policies: the envelopes that a trained selector chooses for the coming stances, and a planner in them.

Where P1 has no plan within the chosen envelopes, the lift plans, which needs none: a bad choice costs time only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.plan import PlanOutcome
from stancekit.planners.equilibrium.features import observe
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course import Course
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.search.answer import CoursePlanner
from stancekit.planners.search.enveloped import EnvelopeCoursePlanner
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain import Patch

from .closed_loop import Observation


class Predictor(Protocol):
    """Whatever predicts as policies of stable-baselines3 do: every selector, every trained agent."""

    def predict(self, observation: Mapping[str, NDArray[Any]], /) -> tuple[NDArray[Any], Any]:
        """From an observation of ``EnvelopeSelection-v0`` to its action, bounds of one or more envelopes, and a state,
        which is not looked at."""
        ...


class SelectorPolicy:
    """The policy that asks a selector about every coming stance of its legs, and plans within what it chooses.

    learned: of the selector's problem class: its legs, normals and scales count, its boxes do not. planners: what it
    answered so far.
    """

    def __init__(self, selector: Predictor, learned: EnvelopeSet, programs: Programs | None = None) -> None:
        self.learned, self.planners = learned, list[EnvelopeOrLift]()
        self._selector, self._programs = selector, programs or Programs()
        self._lift = TwoStageCoursePlanner(programs=self._programs)

    def __call__(self, observation: Observation) -> CoursePlanner:
        """The planner of the coming key frames."""
        boxes = chosen(self._selector, self.learned, observation.window)
        within = None
        if boxes:
            within = EnvelopeCoursePlanner(replace(self.learned, envelopes=boxes), programs=self._programs)
        self.planners.append(EnvelopeOrLift(within, self._lift))
        return self.planners[-1]

    def check_fits(self, course: Course) -> None:
        """Raise InvalidInput for a course of which no stance is by the selector's legs: it would never be asked."""
        names = course.robot.limb_names
        if not any({names[limb] for limb in stance.limbs} == set(self.learned.legs) for stance in course.stances):
            legs = ", ".join(self.learned.legs)
            raise InvalidInput(f"policy: expected a selector for stances of {course.name}, got one for {legs}")

    @property
    def answers(self) -> tuple[int, int]:
        """How many plans were made within what was chosen, and how many without."""
        planned = [planner for planner in self.planners if planner.within_last is not None]
        inside = sum(bool(planner.within_last) for planner in planned)
        return inside, len(planned) - inside


def chosen(selector: Predictor, learned: EnvelopeSet, course: Course) -> tuple[Envelope, ...]:
    """The different envelopes that a selector chooses for the stances of a course by these legs, first candidates."""
    names, found = course.robot.limb_names, dict[bytes, Envelope]()
    first = np.zeros(len(course.footholds), dtype=int)
    for stance in course.stances:
        if {names[limb] for limb in stance.limbs} != set(learned.legs):
            continue
        problem = course.posture_problem(stance, first)
        by_leg = {contact.leg: contact for contact in problem.contacts}
        contacts = (by_leg[leg] for leg in learned.legs)
        ordered = replace(
            problem, contacts=tuple(replace(contact, patch=triangular(contact.patch)) for contact in contacts)
        )
        action = np.asarray(selector.predict(observe(Scaled.of(ordered)))[0], dtype=float)
        for row in action.reshape(-1, 12 * len(learned.legs)):
            found.setdefault(row.tobytes(), Envelope.from_vector(row))
    return tuple(found.values())


def triangular(patch: Patch) -> Patch:
    """The largest triangle of a patch's corners: selectors learn from triangles, and observations hold no more."""
    corners = patch.vertices_m
    _, across, up = patch.frame.T
    best, found = -1.0, (0, 1, 2)
    for i in range(len(corners) - 2):
        away = corners[i + 1 :] - corners[i]
        areas = np.triu(np.abs(np.outer(away @ across, away @ up) - np.outer(away @ up, away @ across)), 1)
        j, k = divmod(int(areas.argmax()), len(away))
        if areas[j, k] > best * (1.0 + 1e-12):
            best, found = float(areas[j, k]), (i, i + 1 + j, i + 1 + k)
    return replace(patch, vertices_m=corners[list(found)])


class EnvelopeOrLift:
    """Plans within envelopes, and without where there are none, that fails, or they are not for the course.

    within_last: whether the last plan is within them; None before there is one.
    """

    name = "two-stage"

    def __init__(self, within: EnvelopeCoursePlanner | None, lift: TwoStageCoursePlanner) -> None:
        self.within, self.lift = within, lift
        self.within_last: bool | None = None

    def solve(self, course: Course) -> PlanOutcome:
        """Answer one course."""
        try:
            outcome = None if self.within is None else self.within.solve(course)
        except InvalidInput:
            outcome = None
        if outcome is not None and outcome.plan is not None:
            self.within_last = True
            return outcome
        outcome = self.lift.solve(course)
        self.within_last = None if outcome.plan is None else False
        return outcome
