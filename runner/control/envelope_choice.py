"""Selectors as policies: the envelopes that a trained selector chooses for the coming stances, and
a planner in them.

Where P1 has no plan within the chosen envelopes, the lift plans, which needs none: a bad choice
costs time only.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled, observe
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import shown
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Stance
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.relaxation.boxes import (
    MIRROR,
    StanceBoxes,
    boxes_of,
    check_fits_one,
    mirrored,
    mirrored_box,
)
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.pieces import Standing, one_at_a_time, with_pause
from stancekit.planners.search.plan_course import replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch

from ..acceptance import Accepted
from ..run import Runner
from ..settings import LoopSettings
from ..worlds.world import State
from .estimation import FrictionEstimator, nearest_on

_NEAR = (0.94, 0.97)
"""More shares of the lower end, between the last two, once feet slid: every bit of reserve counts
then."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """Observation of a policy.

    Arguments:
        window: the coming key frames as a course, from where the robot stands (``standing``, None
            at the beginning).
        state: measured last, None at the beginning.
        friction_share: of the course's friction, the most likely by what feet felt so far.
        frame: of the whole course.
    """

    window: Problem
    standing: Standing | None
    state: State | None
    friction_share: float
    frame: int


Policy = Callable[[Observation], Planner]


class Replanner:
    """Plans of one course, of its friction as feet felt it so far.

    Arguments:
        course: as it is known by now, with the key frames that were put in. plans: made;
            planned_share: of the course's friction that the last one was made with; counted: that
            it counts on; plan_s: time that all took.
    """

    def __init__(
        self,
        course: Problem,
        policy: Policy,
        settings: LoopSettings,
        runner: Runner,
        friction: FrictionEstimator,
    ) -> None:
        self.course, self.plans, self.planned_share, self.counted, self.plan_s = (
            course,
            0,
            1.0,
            1.0,
            0.0,
        )
        self._policy, self._settings, self._runner, self._friction = (
            policy,
            settings,
            runner,
            friction,
        )

    def plan(
        self,
        frame: int,
        standing: Standing | None,
        *,
        slid: bool = False,
        limits: WholeBodyLimits | None = None,
        horizon: int = 0,
    ) -> Accepted[Plan]:
        """Observe, choose, plan, verify.

        Arguments:
            frame: of the course, at which the robot stands so, None at the beginning; its patches
                with the course's own friction.
            slid: feet did, so that the body may first move to where there is more reserve, before
                anybody lifts.
            limits: of joints and bodies, to which the plan is bent.
            horizon: key frames, 0 for the settings'.

        Raises:
            PlanningFailed: where there is none, InvalidInput where the verifier rejects it.
        """
        begin = time.perf_counter()
        share, shares = self._shares()
        if standing is not None:
            patches = tuple(
                patch.with_friction(share * patch.friction) for patch in standing.patches
            )
            standing = replace(standing, patches=patches)

        def planner_of(window: Problem) -> Planner:
            planner = self._policy(
                Observation(
                    window=window,
                    standing=standing,
                    state=self._runner.state,
                    friction_share=share,
                    frame=frame,
                )
            )
            if not callable(getattr(planner, "solve", None)):
                raise InvalidInput(
                    f"policy: expected a planner with solve(problem), got {shown(planner)}"
                )
            return planner

        def answer(course: Problem) -> Answer[Plan]:
            return replan(
                standing,
                slippery(course, share),
                frame=frame,
                horizon=horizon or self._settings.horizon or None,
                planner=planner_of,
                shares=shares,
                limits=limits,
            )

        outcome, course = answer(self.course), self.course
        if standing is not None:
            if slid and any(course.lifts[frame + 1 : frame + 2]) and _counts(outcome) > shares[0]:
                outcome = self._rather(outcome, with_pause(course, frame), "body first", answer)
            for what, other in _easier(course, frame):
                if np.isinf(_counts(outcome)) or (slid and _counts(outcome) >= 1.0):
                    outcome = self._rather(outcome, other, what, answer)
        self.plan_s += time.perf_counter() - begin
        if outcome.solution is None or np.isinf(_counts(outcome)):
            raise PlanningFailed(
                f"frame {frame}: {outcome.message or outcome.claim or outcome.status.value}"
            )
        accepted = Accepted.verified(outcome.solution, f"plan {self.plans + 1}")
        self.plans, self.planned_share, self.counted = (
            self.plans + 1,
            share,
            share * _counts(outcome),
        )
        if standing is not None:  # a log begins with its plan
            self._runner.decide(
                "planned", f"counting on {self.counted:.2f} of the course's friction"
            )
        return accepted

    def _shares(self) -> tuple[float, tuple[float, ...]]:
        """Most likely friction, as a share of the course's; and the shares of that which are
        planned with, in their order.
        """
        interval, shares = self._friction.interval, tuple(self._settings.shares)
        share = interval.share if interval.slides else 1.0
        if (
            interval.planned_on < share
        ):  # the most likely comes last: where the lower end has no plan
            nearer = (*shares[:-1], *_NEAR, shares[-1])
            shares = (*(cautious * interval.planned_on / share for cautious in nearer), 1.0)
        return share, shares

    def _rather(
        self,
        outcome: Answer[Plan],
        course: Problem,
        what: str,
        answer: Callable[[Problem], Answer[Plan]],
    ) -> Answer[Plan]:
        """Prefer the outcome of another course, which takes this one's place, where it has a plan
        that counts on less friction.
        """
        other = answer(course)
        if _counts(other) >= _counts(outcome):
            return outcome
        self.course = course
        before = "no plan" if np.isinf(_counts(outcome)) else f"counting on {_counts(outcome):.2f}"
        self._runner.decide(
            what, f"{before} otherwise, now counting on {_counts(other):.2f} of the friction"
        )
        return other


def _easier(course: Problem, frame: int) -> Iterator[tuple[str, Problem]]:
    """Courses that ask for less from this key frame on, and in what."""
    for last in dict.fromkeys((min(frame + 1, course.frames - 1), course.frames - 1)):
        if any(len(lifted) > 1 for lifted in course.lifts[frame + 1 : last + 1]):
            yield "one foot at a time", one_at_a_time(course, frame + 1, last)
    if course.next_lift:
        yield "no step after the last", replace(course, next_lift=())


def _counts(outcome: Answer[Plan]) -> float:
    """Share of its course's friction that a plan counts on; inf where there is none that joints and
    bodies can do.
    """
    if outcome.solution is None or outcome.status is Status.UNDECIDED:
        return np.inf
    return float(outcome.solution.provenance.get("friction_share", 1.0))


_ROOM = 0.05
"""By which boxes are widened on every side, non-dimensional: they are learned for one stance, and
the stances of a window share toes and a body that steps."""
NODES = 20
"""Most choices of candidates that are looked at within boxes before the lift is asked, which is
quicker."""
_RADIUS = 0.1
"""Radius of the triangles that are shown of larger patches, of a course's length scale: about the
mean of what is learned."""


class Predictor(Protocol):
    """Whatever predicts as policies of stable-baselines3 do: every selector, every trained
    agent.
    """

    def predict(
        self,
        observation: Mapping[str, NDArray[Any]],
        state: Any = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """From an observation of ``EnvelopeSelection-v0``, or a batch of them, to its action,
        bounds of one or more envelopes, and a state, which is not looked at.
        """
        ...


class SelectorPolicy:
    """The policy that asks a selector about every coming stance of its legs, and plans within what
    it chooses.

    Arguments:
        learned: of the selector's problem class: its legs, normals and scales count, its boxes do
            not. planners: what it answered so far.
    """

    def __init__(
        self, selector: Predictor, learned: EnvelopeSet, programs: Programs | None = None
    ) -> None:
        self.learned, self.planners = learned, list[EnvelopeOrLift]()
        self._selector, self._programs = selector, programs or Programs()
        self._lift = TwoStage(programs=self._programs)

    def __call__(self, observation: Observation) -> Planner:
        """The planner of the coming key frames."""
        within = None
        with suppress(InvalidInput):  # legs or patches that nothing was learned of
            within = _within_chosen(
                self._selector, self.learned, observation.window, self._programs
            )
        self.planners.append(EnvelopeOrLift(within, self._lift))
        return self.planners[-1]

    def check_fits(self, course: Problem) -> None:
        """Raise InvalidInput for a course of which no stance is by the selector's legs: it would
        never be asked.
        """
        names = course.robot.limb_names
        if not any(
            {names[limb] for limb in stance.limbs} == set(self.learned.legs)
            for stance in course.stances
        ):
            legs = ", ".join(self.learned.legs)
            raise InvalidInput(
                f"policy: expected a selector for stances of {course.name}, got one for {legs}"
            )

    @property
    def answers(self) -> tuple[int, int]:
        """Number of plans that were made within the chosen envelopes, and without."""
        planned = [planner for planner in self.planners if planner.within_last is not None]
        inside = sum(bool(planner.within_last) for planner in planned)
        return inside, len(planned) - inside


class SelectorPlanner:
    """The planner that asks a selector about every stance of its course, and plans within what it
    chooses.

    Arguments:
        learned: as for ``SelectorPolicy``.

    Raises:
        InvalidInput: for a course with a stance that is not by its legs.
    """

    name = "two-stage"
    reserve = True

    def __init__(
        self, selector: Predictor, learned: EnvelopeSet, *, programs: Programs | None = None
    ) -> None:
        self._selector, self._learned, self._programs = selector, learned, programs or Programs()

    def check_fits(self, course: Problem) -> None:
        """Raise InvalidInput for a course without a stance by legs and on patches that were learned
        for.
        """
        check_fits_one(course, self._learned)

    def solve(self, course: Problem) -> Answer[Plan]:
        """Answer one course."""
        return _within_chosen(self._selector, self._learned, course, self._programs).solve(course)


def _within_chosen(
    selector: Predictor, learned: EnvelopeSet, course: Problem, programs: Programs
) -> TwoStage:
    """A planner within the boxes that a selector chooses for a course, widened by ``_ROOM``.

    Raises InvalidInput for a course with legs or patches that nothing was learned of.
    """
    boxes_of(course, learned)
    boxes = chosen(selector, learned, course)
    if boxes is None:
        legs = ", ".join(learned.legs)
        raise InvalidInput(
            f"{course.name}: expected stances by {legs} or the legs opposite to them, got other limbs"
        )
    boxes = replace(boxes, boxes=tuple(box.widened(_ROOM) for box in boxes.boxes))
    return TwoStage(envelopes=boxes, max_nodes=NODES, programs=programs)


def chosen(selector: Predictor, learned: EnvelopeSet, course: Problem) -> StanceBoxes | None:
    """The boxes that a selector chooses for every stance of a course; None where one is not by its
    legs.

    It is asked about the first candidate of every toe that grips, with which a search within boxes
    begins, too. A stance by the legs on the other side is shown to it in the mirror, and its box
    mirrored back. What it sees is as what it learned from: from the nominal centre of mass, the
    legs in its order.
    """
    names, (legs, image) = course.robot.limb_names, _sides(learned, course)
    rows = []
    for stance in course.stances:
        standing = [names[limb] for limb in stance.limbs]
        same_legs = set(standing) == set(legs)
        if not same_legs and set(standing) != set(image):
            return None
        action = np.asarray(
            selector.predict(_seen(course, stance, legs if same_legs else image, not same_legs))[0],
            dtype=float,
        )
        boxes = [Envelope.from_vector(row) for row in action.reshape(-1, 12 * len(legs))]
        columns = [(legs if same_legs else image).index(name) for name in standing]
        turned = boxes if same_legs else [mirrored_box(box) for box in boxes]
        rows.append([(box.low[columns], box.high[columns]) for box in turned])
    each = [
        Envelope(
            **{
                end: np.concatenate([row[e][k] for row in rows])
                for k, end in enumerate(("low", "high"))
            }
        )
        for e in range(len(rows[0]))
    ]
    return StanceBoxes(problem_class=learned.problem_class, boxes=tuple(each))


def _seen(
    course: Problem, stance: Stance, legs: Sequence[str], mirror: bool
) -> dict[str, NDArray[np.float32]]:
    """The observation of a stance as ``EnvelopeSelection-v0`` has it, or of its mirror image.

    Arguments:
        legs: in this order.
    """
    choice = [
        int(np.argmax([patch.friction > 0.0 for patch in each.candidates]))
        for each in course.footholds
    ]
    problem = course.posture_problem(stance, choice)
    by_leg, turn = (
        {contact.leg: contact for contact in problem.contacts},
        MIRROR if mirror else np.ones(3),
    )
    contacts, radius = [], _RADIUS * course.length_scale_m
    for leg in legs:
        contact = by_leg[leg]
        toe = course.footholds[
            int(course.holds[stance.frame, course.robot.limb_names.index(leg)])
        ].toe_m
        corners = about(
            contact.patch,
            problem.com_nominal_m[0] + contact.shoulder_m if toe is None else toe,
            radius,
        )
        way = -1 if mirror else 1  # in the mirror a border goes round the other way
        patch = replace(
            contact.patch,
            vertices_m=(turn * (corners - problem.com_nominal_m[0]))[::way],
            normal=turn * contact.patch.normal,
            shear_reference=turn * contact.patch.shear_reference,
        )
        contacts.append(replace(contact, patch=patch, shoulder_m=turn * contact.shoulder_m))
    return observe(
        Scaled.of(problem.posture_with(contacts=tuple(contacts), com_nominal_m=np.zeros(3)))
    )


def _sides(learned: EnvelopeSet, course: Problem) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The legs that were learned for, and those opposite to them in the same order; none of a robot
    without such.
    """
    try:
        return learned.legs, mirrored(learned, course.robot).legs
    except InvalidInput:
        return learned.legs, ()


def about(patch: Patch, point_m: Array, radius_m: float) -> Array:
    """A triangle as selectors learn from, for where on a patch a toe will be, shape (3, 3) [m].

    The largest of the patch's corners, where its circumradius is no larger than radius_m; else an
    equilateral one of that radius about the point of the patch that is nearest to ``point_m``.
    """
    largest = triangular(patch).vertices_m
    sides = np.linalg.norm(np.roll(largest, -1, axis=0) - largest, axis=1)
    double = float(np.linalg.norm(np.cross(largest[1] - largest[0], largest[2] - largest[0])))
    if float(np.prod(sides)) <= 2.0 * double * radius_m:  # R = abc / 4A
        return largest
    angles = 2.0 * np.pi / 3.0 * np.arange(3)[:, None]
    _, across, up = patch.frame.T
    return np.asarray(
        nearest_on(patch, point_m) + radius_m * (np.cos(angles) * across + np.sin(angles) * up)
    )


def triangular(patch: Patch) -> Patch:
    """The largest triangle of a patch's corners: selectors learn from triangles, and observations
    hold no more.
    """
    corners = patch.vertices_m
    _, across, up = patch.frame.T
    best, result = -1.0, (0, 1, 2)
    for i in range(len(corners) - 2):
        away = corners[i + 1 :] - corners[i]
        areas = np.triu(
            np.abs(np.outer(away @ across, away @ up) - np.outer(away @ up, away @ across)), 1
        )
        j, k = divmod(int(areas.argmax()), len(away))
        if areas[j, k] > best * (1.0 + 1e-12):
            best, result = float(areas[j, k]), (i, i + 1 + j, i + 1 + k)
    return replace(patch, vertices_m=corners[list(result)])


class EnvelopeOrLift:
    """Plans within envelopes, and without where there are none, that fails, or they are not for the
    course.

    within_last: whether the last plan is within them; None before there is one.
    """

    name = "two-stage"
    reserve = True

    def __init__(self, within: TwoStage | None, lift: TwoStage) -> None:
        self.within, self.lift = within, lift
        self.within_last: bool | None = None

    def solve(self, course: Problem) -> Answer[Plan]:
        """Answer one course."""
        try:
            outcome = None if self.within is None else self.within.solve(course)
        except InvalidInput:
            outcome = None
        if outcome is not None and outcome.solution is not None:
            self.within_last = True
            return outcome
        outcome = self.lift.solve(course)
        self.within_last = None if outcome.solution is None else False
        return outcome
