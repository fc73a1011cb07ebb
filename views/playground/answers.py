"""Answers about scenes: a fast one while a scene is changed, and all that commands say once it
rests, from a process of its own.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import wait
from typing import Any

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import Report
from stancekit.planners.errors import NoPlace, PlanningFailed, StancekitError
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_between import LaidBetween
from stancekit.planners.search.plan_course import plan_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import explain
from stancekit.planners.verify.explanation import Relaxation

from .scenario import Scenario

_SHARES = (0.8, 1.0)
"""Shares of the friction, that a plan is looked for with while the scene is changed."""
_QUICK_S, _QUICK_NODES, _QUICK_STEPS = 0.15, 20, 6
"""Time, nodes and steps of SCP of the search over patches while the scene is changed, for each
share."""
_PATIENT_S = 60.0
"""Time for all of an answer once the scene stays unchanged: that of ``stancekit plan``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneAnswer:
    """Answer about a scene.

    Arguments:
        course: what is asked for; None where it makes no sense.
        plan: accepted by the verifier as far as its contacts go.
        status: None where the question makes no sense; undecided where no way was found for a
            course.
        message: why there is no plan, or what is wrong with it; empty where nothing is.
        lack: what would have to change, where that is proved.
        report: on all of the plan, once it was judged.
        patient: whether all was looked at.
        seconds: CPU time of the layout and of the search.
    """

    course: Problem | None = None
    status: Status | None = None
    plan: Plan | None = None
    message: str = ""
    lack: Relaxation | None = None
    report: Report[Any] | None = None
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
    planner = TwoStage(
        time_limit_s=_QUICK_S,
        max_nodes=_QUICK_NODES,
        cuts=False,
        steps=_QUICK_STEPS,
    )

    def search() -> Answer[Any]:
        return plan_course(scenario.question, planner, shares=_SHARES, presses=(), limits=None)

    return _answered(scenario, search, patient=False)


def patient_answer(scenario: Scenario) -> SceneAnswer:
    """The answer of ``stancekit plan``: with a reserve of friction, joints, torques, bodies, and
    where no plan over the layout that is asked for is accepted, one over another; between places
    that no balanced motion of a robot that does not leap joins, infeasible. Raises nothing.
    """

    def search() -> Answer[Any]:
        deadline = time.perf_counter() + _PATIENT_S
        planner = TwoStage(time_limit_s=_PATIENT_S)
        return plan_course(scenario.question, planner, layouts=scenario.layouts, deadline=deadline)

    answer = _answered(scenario, search, patient=True)
    if not (isinstance(scenario.given, LaidBetween) and answer.status is Status.UNDECIDED):
        return answer
    from stancekit.planners.search.flood import flood  # slow to import

    passage = scenario.between.local.passage()
    if passage.robot.own or flood(passage) is None:
        return answer
    return replace(answer, status=Status.INFEASIBLE, plan=None, report=None)


def _answered(
    scenario: Scenario, search: Callable[[], Answer[Any]], *, patient: bool
) -> SceneAnswer:
    """The answer that a search gives, with the time that it took; a patient one looks for other
    layouts where the one that is asked for has no place.
    """
    begin, asked = time.process_time(), None
    nowhere = (NoPlace, PlanningFailed) if scenario.kind == "between" else ()
    try:
        with suppress(*(nowhere if patient else ())):
            asked = scenario.course()
        laid = time.process_time()
        outcome = search()
    except StancekitError as error:
        return SceneAnswer(
            status=Status.UNDECIDED if isinstance(error, nowhere) else None,
            message=str(error),
            patient=patient,
            seconds=(time.process_time() - begin, 0.0),
        )
    message, plan, lack = outcome.message, outcome.solution, None
    if outcome.certificate is not None and outcome.problem is not None:
        explanation = explain(outcome.certificate)
        message, lack = explanation.message, next(iter(explanation.relaxations), None)
        if outcome.sets is not None:
            message += f", over the {outcome.sets} sets of its legs"
    elif outcome.report is not None and not outcome.report.accepted:
        message = outcome.report.message
    of_plan = {} if plan is None else plan.provenance
    if layout := of_plan.get("layout"):
        message = f"laid out differently, since no plan was accepted as asked: {layout}"
    return SceneAnswer(
        course=outcome.problem if isinstance(outcome.problem, Problem) else asked,
        status=outcome.status,
        plan=plan,
        message=message,
        lack=lack,
        report=outcome.report,
        patient=patient,
        share=float(of_plan.get("friction_share", 1.0)),
        seconds=(laid - begin, time.process_time() - laid),
    )


class Judge:
    """The process that judges scenes, one at a time; it starts with the first.

    number: of the change that is judged, None while it waits for one; pipe: where it answers.
    """

    def __init__(self) -> None:
        self.number: int | None = None
        self.pipe: Any = None
        self._process: Any = None

    def ask(self, number: int, scenario: Scenario) -> None:
        """Have a scene judged."""
        if self._process is None:
            context = multiprocessing.get_context("spawn")
            self.pipe, there = context.Pipe()
            self._process = context.Process(target=_serve, args=(there,), daemon=True)
            self._process.start()
            there.close()
        self.number = number
        with suppress(OSError):  # one that has ended says so where it is heard
            self.pipe.send(scenario)

    def heard(self) -> SceneAnswer:
        """What it says next, waited for."""
        try:
            answer: SceneAnswer = self.pipe.recv()
        except (EOFError, OSError):
            self.end()
            return SceneAnswer(
                message="the process that judges plans has ended; any change starts it anew"
            )
        self.number = None
        return answer

    def end(self) -> None:
        """End the process, also in the middle of its work."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
        self._process = self.number = None


def _serve(pipe: Any) -> None:
    """The process's whole life: it ends with its parent, who alone minds Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            pipe.send(patient_answer(pipe.recv()))


_REST_S = 0.35
"""A scene that was not changed for so long is judged."""
log = logging.getLogger(__name__)


class Session:
    """on_answer(number, scenario, answer, since): called in the session's own thread for every
    answer that is drawn; since: time of the change [s], as time.perf_counter has it. scenario,
    number: the newest, and the number of its change, 0 before the first.
    """

    def __init__(
        self,
        scenario: Scenario,
        on_answer: Callable[[int, Scenario, SceneAnswer, float], None],
        *,
        judges: bool = True,
        rest_s: float = _REST_S,
    ) -> None:
        self._on_answer, self._rest_s = on_answer, rest_s
        self._lock, (self._news, self._bell) = threading.Lock(), multiprocessing.Pipe(duplex=False)
        self.scenario, self.number, self._since = scenario, 0, time.perf_counter()
        self._answered, self._judged = -1, -1
        self._judge = Judge() if judges else None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="playground", daemon=True)

    def start(self) -> None:
        """Answer the first scene, and all that follow."""
        self._thread.start()

    def change(self, edit: Callable[[Scenario], Scenario]) -> int:
        """Another scene, made of the newest by ``edit``; its number.

        Raises what ``edit`` raises.

        A slow edit, such as loading a robot, does not block others: it is repeated on the newest
        scene, and keeps their changes.
        """
        while True:
            with self._lock:
                base, number, since = self.scenario, self.number, time.perf_counter()
            edited = edit(base)
            with self._lock:
                if number != self.number:
                    continue
                self.scenario, self._since = edited, since
                self.number += 1
            self._bell.send_bytes(b"changed")  # may wait for a full pipe, so without the lock
            return number + 1

    def close(self) -> None:
        """End thread and process."""
        self._closed = True
        self._bell.send_bytes(b"closed")
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _work(self) -> None:
        judge = self._judge
        while not self._closed:
            spoken = self._spoken()
            with self._lock:
                number, scenario, since = self.number, self.scenario, self._since
            if number != self._answered:
                self._say(number, scenario, quick_answer(scenario), since)
                self._answered = number
            elif judge is not None and spoken:
                of, answer = judge.number, judge.heard()
                if of == number:
                    self._say(number, scenario, answer, since)
            elif judge is not None and self._patience_s() == 0.0:
                self._judged = number
                judge.ask(number, scenario)
        if judge is not None:
            judge.end()

    def _spoken(self) -> bool:
        """Wait for a change, for the judge, or until the scene has rested; whether the judge has
        spoken.
        """
        judge, lines = self._judge, [self._news]
        if judge is not None and judge.number is not None:
            lines.append(judge.pipe)
        ready = wait(lines, self._patience_s())
        while self._news.poll():
            self._news.recv_bytes()
        return any(line is not self._news for line in ready)

    def _patience_s(self) -> float | None:
        """Time until the scene counts as settled; None where there is nothing to wait for."""
        if self.number != self._answered:
            return 0.0
        if self._judge is None or self._judge.number is not None or self._judged == self.number:
            return None
        return max(self._rest_s - (time.perf_counter() - self._since), 0.0)

    def _say(self, number: int, scenario: Scenario, answer: SceneAnswer, since: float) -> None:
        try:
            self._on_answer(number, scenario, answer, since)
        except Exception:  # a page that cannot draw one answer draws the next
            log.exception("an answer could not be drawn")
