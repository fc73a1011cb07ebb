"""Planning in a closed loop: a policy observes the coming key frames and chooses a planner, the
verifier judges.

Where there is no plan with the feet that the course lifts together, the coming ones are lifted one
at a time, first those of the next key frame, then all: five limbs hold what three could not. Where
there is none even so, the robot need not be able to go on from the course's end. Where joints or
bodies cannot do what contacts can, the plan is bent until they can (``projection.whole_body``).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.problem import Problem
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.pieces import Standing, one_at_a_time, with_pause
from stancekit.planners.search.plan_course import replan

from ..acceptance import Accepted
from ..run import Runner
from ..worlds.world import State
from .friction import FrictionEstimator
from .loop_settings import LoopSettings

NEAR = (0.94, 0.97)
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
        answer = partial(
            self._answer,
            frame=frame,
            share=share,
            standing=standing,
            shares=shares,
            limits=limits,
            horizon=horizon or self._settings.horizon,
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
        interval, shares = self._friction.interval, self._settings.shares
        share = interval.share if interval.slides else 1.0
        if (
            interval.planned_on < share
        ):  # the most likely comes last: where the lower end has no plan
            nearer = (*shares[:-1], *NEAR, shares[-1])
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

    def _answer(
        self,
        course: Problem,
        *,
        frame: int,
        share: float,
        standing: Standing | None,
        shares: tuple[float, ...],
        limits: WholeBodyLimits | None,
        horizon: int,
    ) -> Answer[Plan]:
        """Answer of a policy's planner to a course with this share of its friction."""

        def planner_of(window: Problem) -> Planner:
            observation = Observation(
                window=window,
                standing=standing,
                state=self._runner.state,
                friction_share=share,
                frame=frame,
            )
            return self._policy(observation)

        return replan(
            standing,
            slippery(course, share),
            frame=frame,
            horizon=horizon or None,
            planner=planner_of,
            shares=shares,
            limits=limits,
        )


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
