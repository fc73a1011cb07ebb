"""Answers about a scene: at once from its contacts alone, and, once nobody changes it any more, of
the whole body.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import programs_of_this_thread
from stancekit.planners.errors import PlanningFailed, StancekitError
from stancekit.planners.problem import Problem
from stancekit.planners.problem.candidates import NoPlace
from stancekit.planners.search.plan_course import LayOut, plan_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import Report, explain

from .between_scenario import BetweenScenario
from .scenario import Scenario

SHARES = (0.8, 1.0)
"""Shares of the friction, that a plan is looked for with while the scene is changed."""
QUICK_S, QUICK_NODES, QUICK_STEPS = 0.15, 20, 6
"""Time, nodes and steps of SCP of the search over patches while the scene is changed, for each
share."""
PATIENT_S = 60.0
"""Time for all of an answer when nobody changes it any more: that of ``stancekit plan``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneAnswer:
    """Answer about a scene.

    Arguments:
        course: what is asked for; None where it makes no sense.
        plan: accepted by the verifier as far as its contacts go.
        status: None where the question makes no sense; undecided where no way was found for a course.
        message: why there is no plan, or what is wrong with it; empty where nothing is.
        report: on all of the plan, once it was judged.
        patient: whether all was looked at.
        seconds: CPU time of the layout and of the search.
    """

    course: Problem | None = None
    status: Status | None = None
    plan: Plan | None = None
    message: str = ""
    report: Report[Plan] | None = None
    patient: bool = False
    share: float = 1.0
    seconds: tuple[float, float] = (0.0, 0.0)

    @property
    def accepted(self) -> bool:
        """Tell whether the verifier accepted all of a plan."""
        return self.report is not None and self.report.accepted and self.status is Status.FEASIBLE


def quick_answer(scenario: Scenario) -> SceneAnswer:
    """A fast answer for the display, which looks at contacts alone; undecided if it would take
    longer. Raises nothing.
    """
    planner = TwoStagePlanner(
        time_limit_s=QUICK_S,
        max_nodes=QUICK_NODES,
        cuts=False,
        steps=QUICK_STEPS,
        programs=programs_of_this_thread(),
    )
    return _planned(
        scenario,
        partial(
            plan_course,
            planner=planner,
            shares=SHARES,
            presses=(),
            limits=None,
            stated=not isinstance(scenario, BetweenScenario),
        ),
    )


def patient_answer(scenario: Scenario) -> SceneAnswer:
    """The answer of ``stancekit plan``: with a reserve of friction, joints, torques, bodies, and
    where no plan over the layout that is asked for is accepted, one over another. Raises
    nothing.
    """

    def plan(question: LayOut) -> Answer[Plan]:
        planner = TwoStagePlanner(time_limit_s=PATIENT_S, programs=programs_of_this_thread())
        deadline = time.perf_counter() + PATIENT_S
        return plan_course(
            question,
            planner,
            layouts=scenario.layouts,
            stated=not isinstance(scenario, BetweenScenario),
            deadline=deadline,
        )

    return _planned(scenario, plan, patient=True)


def _planned(
    scenario: Scenario, plan: Callable[[LayOut], Answer[Plan]], *, patient: bool = False
) -> SceneAnswer:
    """The answer that a way to plan gives, with the time that it took."""
    begin = time.process_time()
    try:
        course = scenario.course()
        laid = time.process_time()
        outcome = plan(scenario.course)
    except StancekitError as error:
        nowhere = isinstance(scenario, BetweenScenario) and isinstance(
            error, NoPlace | PlanningFailed
        )
        return SceneAnswer(
            status=Status.UNDECIDED if nowhere else None,
            message=str(error),
            patient=patient,
            seconds=(time.process_time() - begin, 0.0),
        )
    seconds = (laid - begin, time.process_time() - laid)
    return _answer(outcome, course, seconds, patient=patient)


def _answer(
    outcome: Answer[Plan], asked: Problem, seconds: tuple[float, float], *, patient: bool = False
) -> SceneAnswer:
    """The answer that an outcome is.

    Arguments:
        asked: the scene's own course, where the outcome is not of a problem.
    """
    message, report = outcome.message, outcome.report
    if outcome.certificate is not None and outcome.problem is not None:
        message = explain(outcome.certificate).message
        if outcome.sets is not None:
            message += f", over the {outcome.sets} sets of its legs"
    elif report is not None and not report.accepted:
        message = report.message + (f"; {report.failures}" if report.failures else "")
    share = (
        1.0
        if outcome.solution is None
        else float(outcome.solution.provenance.get("friction_share", 1.0))
    )
    if outcome.solution is not None and (layout := outcome.solution.provenance.get("layout")):
        message = (
            f"laid out in another way than asked for, over which no plan was accepted: {layout}"
        )
    return SceneAnswer(
        course=outcome.problem if isinstance(outcome.problem, Problem) else asked,
        status=outcome.status,
        plan=outcome.solution,
        message=message,
        report=report,
        patient=patient,
        share=share,
        seconds=seconds,
    )
