"""Answers about scenes: a fast one while a scene is changed, and all that commands say once it
rests, from a process of its own; and what a page says of them.
"""

from __future__ import annotations

import html
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

import numpy as np

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import WHOLE_BODY, Plan
from stancekit.planners.answer.report import Report, acceptance_word
from stancekit.planners.errors import NoPlace, PlanningFailed, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_between import LaidBetween
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.search.plan_course import plan_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import explain
from stancekit.planners.verify.explanation import Relaxation

from ..plans import PlanView, View
from ..sheet import leg_colour
from ..strips import cone_strip, torque_strip
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


GOOD, UNSURE, BAD = (
    f"light-dark({pair})" for pair in ("#1d6f62, #5cc4b3", "#7a5f00, #e0bd4a", "#b81c33, #ff8b99")
)
"""Colours of good news, of what nobody knows yet, and of bad news, on light and on dark; each is at
least 4.5 : 1."""
_QUIET, _RULE, _TROUGH = (
    f"light-dark({pair})" for pair in ("#5b6672, #a9b4c0", "#d5dae0, #4a525b", "#e3e7eb, #3d454e")
)
"""Colours of what is read last, of lines, and of the empty part of a bar. Text has the page's own
colour."""
_TIGHT = 0.95
"""A limit that is used this far is marked."""
_CARRIES_N = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class LimbLoad:
    """Load of one limb.

    Arguments:
        cone: of its friction cone, torque: of a joint's limit, both as shares; NaN where unknown.
        torque_nm: of the joint that has the least in hand [Nm].
    """

    name: str
    force_n: float
    cone: float
    torque_nm: float = float("nan")
    torque: float = float("nan")
    in_air: bool = False


def loads(
    view: View, now: Samples, solver: Kinematics | None = None, near: Array | None = None
) -> list[LimbLoad]:
    """Loads of every limb at a time.

    Arguments:
        solver: of the robot; without it no torque is known.
        near: angles that unknown ones are sought near, shape (J,) [rad].
    """
    limbs, pressed_n = view.robot.limb_names, now.along_n
    torques, shares = np.full((2, len(limbs)), np.nan)
    if solver is not None:  # of the joint that is nearest to its limit
        angles = now.angles_rad
        if angles is None:
            angles, _, _ = solver.solve(
                now.com_m, now.rotation_rad, now.toes_m, normals=now.normals, seed=near
            )
        torque = np.abs(solver.torques(angles, rotation_of(now.rotation_rad), now.forces_n))
        share = torque / solver.torque_nm
        of_limbs = (solver.joints_of(i) for i in range(len(limbs)))
        worst = [joints[int(share[joints].argmax())] for joints in of_limbs]
        torques, shares = torque[worst], share[worst]
    cones = now.across_n / np.maximum(now.friction * pressed_n, 1e-9)
    cones = np.where(now.across_n > 1e-6 * pressed_n, cones, 0.0)
    cones = np.where(pressed_n < _CARRIES_N, np.nan, cones)
    return [
        LimbLoad(
            name=name,
            force_n=float(np.linalg.norm(now.forces_n[i])),
            cone=float(cones[i]),
            torque_nm=float(torques[i]),
            torque=float(shares[i]),
            in_air=not now.stands[i],
        )
        for i, name in enumerate(limbs)
    ]


def verdict(answer: SceneAnswer, number: int, drawn_ms: float) -> str:
    """The verdict as HTML: a title in its colour, a sentence, and a quiet line.

    Arguments:
        number: of the change that it answers.
        drawn_ms: since that change.
    """
    colour, title, text = _words(answer)
    title, text = html.escape(title), html.escape(text)
    took = f"drawn after {drawn_ms:.0f} ms"
    if answer.patient:
        took = f"judged in {sum(answer.seconds):.1f} CPU-s"
    return (
        f'<div id="verdict" data-change="{number}" data-patient="{int(answer.patient)}" style="border-left:5px solid '
        f'{colour};padding:2px 0 4px 10px;margin:6px 2px;font:13px/1.45 system-ui,sans-serif">'
        f'<div style="font-size:15px;font-weight:700;color:{colour}">{title}</div>'
        f"<div>{text}</div>"
        f'<div style="color:{_QUIET};font-size:11.5px">change {number} · {took}</div></div>'
    )


def _words(answer: SceneAnswer) -> tuple[str, str, str]:
    """Colour, title and sentence."""
    if answer.course is None:
        return BAD, "Nothing to plan", answer.message
    if answer.status is Status.INFEASIBLE:
        return BAD, "No plan, and that is proved" if answer.patient else "No plan", answer.message
    if answer.accepted:
        assert answer.report is not None
        word = acceptance_word(answer.report.unchecked).partition(":")[0].capitalize()
        return GOOD, word, " ".join(filter(None, (_accepted(answer.report), answer.message)))
    if answer.plan is not None and not answer.patient:
        return (
            UNSURE,
            "Contacts hold",
            "Joints, torques and bodies are judged once nothing is changed.",
        )
    if answer.plan is not None:
        return BAD, "Not accepted", answer.message
    more = "" if answer.patient else "; the search goes on when nothing is changed"
    return UNSURE, "Undecided", f"{answer.message}{more}"


def _accepted(report: Report[Plan]) -> str:
    """Line on what was judged, and what could not be."""
    done = ["contacts", *(name for name in WHOLE_BODY if report.group(name).verdict == "holds")]
    finding = report.message.removeprefix(acceptance_word(report.unchecked)).lstrip(":; ")
    words = f"{finding}. Judged: {', '.join(done)}."
    if len(done) <= len(WHOLE_BODY):
        words += f" {report.body_message}."
    return words[0].upper() + words[1:]


def limb_table(rows: list[LimbLoad], title: str) -> str:
    """Forces, shares of cones, and torques of limbs as HTML, with bars against the limits."""
    cell = 'style="text-align:right;white-space:nowrap;padding:1px 4px"'
    head = "".join(
        f'<th style="text-align:{side};font-weight:600;padding:1px 4px;color:{_QUIET}">{words}</th>'
        for side, words in (
            ("left", "limb"),
            ("right", "force [N]"),
            ("left", "of its cone"),
            ("right", "torque [Nm]"),
            ("left", "of its limit"),
        )
    )
    lines = []
    for k, row in enumerate(rows):
        dot = f'<span style="display:inline-block;width:9px;height:9px;border-radius:5px;background:{leg_colour(k)}">'
        force = "in the air" if row.in_air else f"{row.force_n:.1f}"
        torque = "–" if np.isnan(row.torque_nm) else f"{row.torque_nm:.1f}"
        lines.append(
            f"<tr><td style='white-space:nowrap;padding:1px 4px'>{dot}</span> "
            f"{html.escape(row.name)}</td>"
            f"<td {cell}>{force}</td><td>{_bar(row.cone)}</td><td "
            f"{cell}>{torque}</td><td>{_bar(row.torque)}</td></tr>"
        )
    return (
        f'<div id="limbs" style="font:12px/1.5 system-ui,sans-serif;margin:4px 2px;'
        f'font-variant-numeric:tabular-nums"><b>{html.escape(title)}</b>'
        f'<table style="border-collapse:collapse;width:100%"><tr style="border-bottom:1px solid {_RULE}">{head}</tr>'
        f"{''.join(lines)}</table>"
        f'<div style="color:{_QUIET};font-size:11.5px">{html.escape(explained([row.name for row in rows]))}</div></div>'
    )


_SIDES, _PLACES = (
    {"L": "left", "R": "right"},
    {"F": "front", "M": "middle", "R": "rear", "H": "hind"},
)


def explained(limbs: list[str]) -> str:
    """The names of limbs in words, seen by the robot, and what the shares of the table are of."""
    names = [
        f"{name} {_SIDES[name[0]]} {_PLACES[name[1]]}"
        for name in limbs
        if len(name) == 2 and name[0] in _SIDES and name[1] in _PLACES
    ]
    seen = f"{', '.join(names)}, as the robot looks. " if names else ""
    return f"{seen}Cone: share of the friction that its force may use. Limit: of the joint with the least torque left."


def summary(answer: SceneAnswer, view: PlanView | None) -> str:
    """The plan in a few numbers, as HTML, empty without one: its reserves, the figures of the strips
    below its picture, what it was planned with, and where it ends.

    Arguments:
        view: of the plan.
    """
    if view is None:
        return ""
    plan, course, robot = view.plan, view.plan.problem, view.robot
    to_goal_mm = 1e3 * float(np.linalg.norm(plan.com_m[-1] - course.goal_m))
    strips = {"friction in hand": cone_strip(plan, view.keys)}
    if answer.report is not None:
        strips["torque in hand"] = torque_strip(plan)
    weight = f"{robot.mass_kg:.3g} kg ({robot.mass_kg * plan.gravity_m_s2:.1f} N)"
    reserves = [
        (
            name,
            f"{100 - used.values[used.worst]:.0f} % at least, at frame {used.at[used.worst]:.3g}",
        )
        for name, used in strips.items()
        if np.isfinite(used.values).any()
    ]
    ends = f"{to_goal_mm:.0f} mm from the goal, after {course.frames} key frames"
    share = float(plan.provenance.get("friction_share", 1.0))
    planned = ("planned with", f"{100 * share:.0f} % of the friction")
    rows = [("robot", f"{robot.name}, {weight}"), *reserves, planned, ("ends", ends)]
    return (
        '<table id="summary" style="font:12px/1.55 system-ui,sans-serif;margin:2px">'
        + "".join(
            f'<tr><td style="color:{_QUIET};padding-right:10px;white-space:nowrap">{html.escape(name)}</td>'
            f"<td>{html.escape(words)}</td></tr>"
            for name, words in rows
        )
        + "</table>"
    )


def _bar(share: float) -> str:
    """A share of a limit as a bar with its number; NaN is a dash."""
    if np.isnan(share):
        return f'<span style="color:{_QUIET}">–</span>'
    colour = BAD if share > 1.0 + 1e-6 else UNSURE if share > _TIGHT else GOOD
    return (
        f'<div style="display:flex;align-items:center;gap:5px"><div style="flex:1;min-width:34px;height:8px;'
        f'background:{_TROUGH};border-radius:4px;overflow:hidden"><div style="width:{100 * min(share, 1.0):.0f}%;'
        f'height:100%;background:{colour}"></div></div><span style="width:34px;text-align:right">{100 * share:.0f} %'
        "</span></div>"
    )
