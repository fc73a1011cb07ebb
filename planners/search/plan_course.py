"""Plan a course: contacts with friction in reserve, a proof over the outer sets of the legs,
joints, and a verdict.

Plans keep to the inner sets of a robot's legs, which its feet surely reach, and proofs hold for the
outer ones, which hold all that they might reach: that there is no plan within inner sets says
nothing of the robot.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from ..answer.answer import Answer, Effort, Status
from ..answer.plan import Plan
from ..answer.report import LATE
from ..errors import InvalidInput, NoPlace, PlanningFailed
from ..files.arrays import Array
from ..problem import Problem
from ..problem.course_keys import (
    AS_ASKED,
    HIGHER,
    KNEES_BENT,
    LEANING,
    LEVEL_RAD,
    LOW,
    STRIDES,
    Alternative,
    ordered,
)
from ..problem.posture import TILT_LIMIT_RAD
from ..projection.centre import at_clear_places, walls_of, with_room_for_legs
from ..projection.held import PRESSES, PUSHES, pushed
from ..projection.whole_body import WholeBodyLimits
from ..robot.model import hexapod
from ..verify.geometry import LEAST_PUSH
from ..verify.margins import borne_share
from .answer import Planner
from .friction_margin import (
    SHARES,
    check_push,
    in_time,
    knows_pushes,
    plan_with_reserve,
    quick,
    slippery,
)
from .pieces import (
    AT_ONCE,
    Detour,
    Kept,
    Pieces,
    Progress,
    Standing,
    course_window,
    in_pieces,
    plan_pieces,
    turning_on,
)
from .two_stage import TwoStage

if TYPE_CHECKING:
    from ..problem.course_between import LaidBetween
    from ..robot.reach_sets import Sets


LayOut = Callable[["Sets", Alternative], Problem]
"""A function that lays a course out over the inner or the outer sets of the robot's legs, in one of
several ways."""
_FIRST = 0.6
"""Fraction of the time that the layout that was asked for has, where others can be tried."""
_LEAST_S = 8.0
"""Processor time that every layout has at least, while there is any [s]; in less than that few
plans are found, and on a busy computer shares of what is left are soon shares of nothing."""
_PAUSE_S = 1.0
"""What a processor does in less time says nothing [s]."""
_SEARCH = 0.75
"""Fraction of the time within which contacts are to be found, so that they can still be bent and
judged."""
_ALL_FRICTION = (1.0,)
"""Shares of the friction for a plan without a reserve."""
_CUTS, _CLEAR, _ANEW, _FIRM, _FIRMEST = 5, 2, 0.5, 0.5, (0.4, 0.3, 0.2, 0.1)
"""So often contacts are searched anew with room for legs that went through walls, and then at places where
legs are clear of them, at most; the fraction of the time that each such search has; that of it for
contacts that bear a push; and the shares of the weight of pushes that are preferred, the largest first."""
_NEARER, _LOOKS = 0.9, 0.6
"""Contacts are searched anew while plans are nearer to holding by so much than those before, and no
longer than this fraction of the time once there is one that can be bent."""
_PIECES = 0.9
"""Fraction of the time within which all pieces of a long course are to be planned, so that the
whole can be judged."""
_STEEP = 0.4
"""Gradient of the ground from which on layouts are looked at before any plan is bent (22°)."""
_LOOK_S = 6.0
"""Processor time that such a look at a layout takes at most [s]."""
_NEAR_M = 0.003
"""A plan with no more than that missing between its bodies and on its feet's paths is bent in few
steps [m]: no further layout is looked at."""
_SHALLOW_M, _DEEP_M = 0.03, 0.08
"""A plan beside walls whose bodies lack more than the first is bent only after another layout had no
plan, and one whose bodies lack more than the second, for a robot of size 1, is not bent [m]."""
_AGAIN = replace(AS_ASKED)
"""The layout that was asked for, whose plan is bent though it is deep in walls."""
_BENT_M = 0.015
"""The same of a plan whose legs step over things."""
_LAID = "no plan over this layout, which is one of many"
"""Of a proof about a layout that a planner chose, which proves nothing of what was asked."""
UNPROVED = (
    "no plan in the inner sets of the legs, and no proof in the outer ones that there is none"
)
_NO_TIME = "no plan in the inner sets of the legs, and the time limit ended before the outer ones were searched"


def plan_course(
    question: Problem | LayOut,
    planner: Planner,
    *,
    shares: Sequence[float] | None = None,
    presses: Sequence[float] | None = None,
    limits: WholeBodyLimits | None = WholeBodyLimits(),
    start_rad: Array | None = None,
    push_n: float = 0.0,
    wrench: Array | None = None,
    layouts: Sequence[Alternative] = (AS_ASKED,),
    stated: bool = True,
    kept: Kept | None = None,
    progress: Progress | None = None,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """Answer a course: a plan that was judged, a proof that there is none, or what is known when
    the time ends.

    Arguments:
        question: the course, or a function that lays it out; a function may choose other candidates
            for a proof, which is then one about all that the robot may reach, while a course is
            answered with the candidates that it has.
        planner: planner of contacts and forces.
        shares: of the friction, see ``plan_with_reserve``; None for 0.8, 0.9 and 1 where the
            planner has a true ``reserve``, as two-stage planners have, and all of it with others.
        presses: likewise; None for the usual ones with a reserve.
        limits: of joints and bodies, to which the plan is bent, and then judged with all of the
            whole body; None leaves it at contacts.
        start_rad: joints of a robot that stands already, as for ``plan_angles``, shape (J,).
        push_n: horizontal push that every stance has to bear, where the course does not ask for
            more [N].
        wrench: on the body beside its weight and what the course has already, at every frame, shape
            (6,).
        layouts: ways in which a function lays the course out, the first before all others, which
            are tried while there is time in the order that the table of successes gives
            (``course_keys.ordered``), where over none before a plan was accepted; its provenance
            says which. *Infeasible* is said of the first alone, and only where that is stated.
        stated: whether whoever asks states the first layout; False where a planner has laid it out
            between two places, so that a proof that it has no plan says nothing of the question.
        kept: of a long course, which is planned in pieces, holds the beginning that an interrupted
            run had planned.
        progress: called after every piece with the key frames that are planned, and all.
        deadline: when the answer is wanted (``time.perf_counter()``), with what is known then.

    Returns:
        The outcome with its ``problem``, over outer sets where it is infeasible and the robot has
        legs of its own, and its ``report``.

    Raises:
        InvalidInput: where the planner is not made for the course, or torques are asked for of a
            robot whose joints are not known.
    """
    stated = stated and not hasattr(question, "onward")
    limits = limits and replace(limits, reaching=limits.reaching or not stated)
    unlearned = isinstance(planner, TwoStage) and planner.envelopes is None
    turned = unlearned and getattr(question, "frame", None) is not None
    between = cast("LaidBetween", question) if turned else None
    if between is not None:
        question, wrench = between.local, between.turned(wrench)
    if shares is None:
        shares = SHARES if getattr(planner, "reserve", False) else _ALL_FRICTION
    if presses is None:
        presses = PRESSES if len(shares) > 1 else ()
    search = _CourseSearch(
        question=_loaded(question, wrench),
        planner=planner,
        shares=shares,
        presses=presses,
        limits=limits,
        start_rad=start_rad,
        push_n=push_n,
        stated=stated,
        kept=kept,
        progress=progress,
        deadline=deadline,
    )
    try:
        outcome = search.outcome(layouts)
    except (InvalidInput, PlanningFailed):
        if between is not None:
            between("inner")  # which says where in the world
        raise
    return outcome if between is None else _moved_back(outcome, between)


def firmest(
    search: Callable[..., Answer[Plan]], planner: Planner, *, deadline: float
) -> Answer[Plan]:
    """The answer of a search; of those that are accepted the one whose stances bear the largest
    push of ``_FIRMEST``, while there is time.

    Arguments:
        search: ``plan_course`` of a question, which takes ``planner``, ``push_n`` and a deadline.

    Raises:
        InvalidInput: for a planner that knows no pushes.
    """
    from .witness import judged  # slow to import

    if not knows_pushes(planner):
        raise InvalidInput(f"prefer_margin: expected false with {planner.name}, got true")
    best = search(planner=planner, deadline=deadline)
    if best.solution is None or best.status is not Status.FEASIBLE:
        return best
    asked, held = best.solution.problem, borne_share(best.solution, _FIRMEST)
    for share in _FIRMEST:
        push_n, end = share * asked.weight_n, _search_end(deadline, _FIRM)
        if share <= held or push_n <= asked.push_n or end <= time.perf_counter():
            break
        firm = search(planner=quick(planner), push_n=push_n, kept=None, progress=None, deadline=end)
        if firm.solution is not None and firm.status is Status.FEASIBLE:
            firmer = replace(
                firm.solution,
                problem=replace(firm.solution.problem, push_n=asked.push_n),
                provenance={**firm.solution.provenance, "push_share": share},
            )
            return judged(replace(firm, problem=firmer.problem, solution=firmer, bound=best.bound))
    return best


@dataclass(frozen=True, kw_only=True)
class _CourseSearch:
    """The search for an answer to a course: its arguments are those of ``plan_course``.

    Arguments:
        spent: on the contacts of every piece.
        brief: contacts are searched for briefly, as there are other ways.
        deep: contacts that may be bent again.
        steep: whether the ground is, where bending is dear and tried last.
    """

    question: Problem | LayOut
    planner: Planner
    shares: Sequence[float]
    presses: Sequence[float]
    limits: WholeBodyLimits | None
    start_rad: Array | None
    push_n: float
    stated: bool
    kept: Kept | None
    progress: Progress | None
    deadline: float
    brief: bool = False
    spent: list[Effort] = field(default_factory=list)
    deep: list[Answer[Plan]] = field(default_factory=list)
    steep: bool = False

    def outcome(self, layouts: Sequence[Alternative]) -> Answer[Plan]:
        """The answer over the ways in which the course is laid out."""
        question, search, deadline = self.question, self, self.deadline
        if not callable(question):
            return self.answered(question, deadline)
        if not self.stated and self.limits is not None and len(layouts) > 1:
            steep = _on_steep_ground(question)
            if steep is not None:
                own, search = steep.robot.own, replace(self, steep=True)
                found, layouts = _leaning(question, layouts, self.at_a_glance, own, deadline)
                if found is not None:
                    return found
        shares = [*dict.fromkeys((self.shares[0], self.shares[-1]))]
        brief = replace(search, planner=quick(self.planner, brief=True), shares=shares, brief=True)
        return _laid_out(question, layouts, search.answered, brief.answered, deadline, self.stated)

    def answered(
        self, course: Problem, end: float, alternative: Alternative = AS_ASKED
    ) -> Answer[Plan]:
        """The answer over one course, piece by piece where it is long, which goes on beyond its end
        once half of them have plans.
        """
        course, limits = self._bearing_pushes(course), self.limits
        so_far: Answer[Plan] | None = None
        whole = alternative.striding or self.start_rad is not None
        if limits is not None and in_pieces(course) and not whole:
            pieces = plan_pieces(
                course,
                self._piece,
                detour=_detour(self.question, alternative, self.push_n),
                kept=self.kept,
                progress=self.progress,
                until=_search_end(end, _PIECES),
                deadline=_search_end(self.deadline, _PIECES),
            )
            so_far = _whole(pieces, self.planner.name, self.spent, self.deadline)
            if self.kept is not None and so_far.status is Status.FEASIBLE:
                self.kept.remove()
            ends = course.frames > AT_ONCE or time.perf_counter() > end
            if pieces.failed is None or ends or (self.brief and pieces.failed.solution is None):
                return so_far
            if pieces.plan is None:
                so_far = None  # which says no more than the whole does
        search_end = end if limits is None else _search_end(end)
        striding = alternative.striding and limits is not None and not course.has_soles
        if alternative is _AGAIN:
            outcome = self.deep.pop()
        else:
            outcome = self._firmly(course, end) if striding else self._contacts(course, search_end)
        if outcome.certificate is not None and not self.stated:
            outcome = _undecided(outcome, _LAID + _slipping(outcome, alternative))
        elif outcome.certificate is not None and course.robot.own and outcome.sets != "outer":
            outcome = _refuted(outcome, self.question, self.planner, self.shares[-1], end)
        if striding and outcome.solution is not None:
            outcome = self._striding(course, outcome, end)
        elif limits is not None and outcome.solution is not None:
            from .witness import with_whole_body  # slow to import

            unbent = replace(limits, steps=0)
            if alternative == AS_ASKED and not self.stated and walls_of(course):
                self.deep.append(outcome)
                most_m = _DEEP_M * course.robot.size if alternative is _AGAIN else _SHALLOW_M
                limits = replace(limits, deepest_m=most_m)
            for within in (unbent, limits) if self.steep else (limits,):
                judged = with_whole_body(outcome, within, self.start_rad, deadline=end)
                if judged.status is Status.FEASIBLE:
                    break
            outcome = judged
        decided = outcome.status in (Status.FEASIBLE, Status.INFEASIBLE)
        return outcome if decided or so_far is None else so_far

    def at_a_glance(self, course: Problem, end: float, *, firmly: bool) -> Answer[Plan]:
        """The answer over one course without bending, as it is found first."""
        from .witness import with_whole_body  # slow to import

        assert self.limits is not None
        asked, pressed = self._bearing_pushes(course), self.presses if firmly else ()
        found = plan_with_reserve(
            quick(self.planner), asked, self.shares[:1], pressed, deadline=end
        )
        return with_whole_body(found, replace(self.limits, steps=0), self.start_rad, deadline=end)

    def _piece(self, course: Problem, state: Standing | None, end: float) -> Answer[Plan]:
        from .witness import with_whole_body  # slow to import

        outcome = self._contacts(course, _search_end(end))
        self.spent.append(outcome.effort)
        if outcome.certificate is not None:  # of this piece from this posture, and of nothing else
            outcome = _undecided(outcome, "no plan of contacts from where the piece begins")
        elif outcome.solution is not None and state is not None and course.robot.own:
            outcome = replace(outcome, solution=turning_on(outcome.solution, state.rotation_rad))
        assert self.limits is not None
        angles = None if state is None else state.angles_rad
        return with_whole_body(outcome, self.limits, angles, deadline=end)

    def _striding(self, course: Problem, outcome: Answer[Plan], end: float) -> Answer[Plan]:
        """The answer over a course, from a plan of contacts: where legs go through walls contacts are
        searched anew with room for them, then at places where they are clear, and of all plans that in
        which least is too near is bent.
        """
        from .witness import with_whole_body  # slow to import

        assert self.limits is not None
        limits, asked = self.limits, course
        own, seen = course.robot.own, list[tuple[float, int, Answer[Plan]]]()
        looks_end = _search_end(end, _LOOKS)

        def search_end() -> float:
            return looks_end if min(seen)[0] < _BENT_M else end

        def looked_at(found: Answer[Plan]) -> Answer[Plan]:
            judged = with_whole_body(found, replace(limits, steps=0), self.start_rad, deadline=end)
            tips = judged.report is not None and judged.report.accepted
            seen.append((math.inf if tips else _short_m(judged), len(seen), found))
            return judged

        def anew(cut: Problem) -> Answer[Plan]:
            return self._firmly(cut, _search_end(search_end(), _ANEW), only=own)

        def goes_on() -> bool:
            nearer = seen[-1][0] <= _NEARER * min(seen[:-1], default=seen[-1])[0]
            return (nearer or len(seen) == 1) and time.perf_counter() < search_end()

        judged = looked_at(outcome)
        for _ in range(_CUTS):
            if judged.status is Status.FEASIBLE or judged.solution is None:
                return judged
            if not goes_on():
                break
            cut = with_room_for_legs(course, judged.solution, limits.clearance_m)
            found = outcome if cut is course else anew(cut)
            if cut is course or found.solution is None:
                break
            course, judged = cut, looked_at(found)
        com_m, rotation_rad = asked.com_nominal_m, np.zeros_like(asked.com_nominal_m)
        for _ in range(_CLEAR if min(seen)[0] > _NEAR_M and walls_of(asked) else 0):
            if judged.status is Status.FEASIBLE:
                return judged
            if time.perf_counter() > search_end():
                break
            found = anew(at_clear_places(asked, com_m, rotation_rad, limits.clearance_m))
            if found.solution is None:
                break
            judged = looked_at(found)
            com_m, rotation_rad = found.solution.com_m, found.solution.rotation_rad
        if judged.status is Status.FEASIBLE:
            return judged
        return with_whole_body(
            min(seen)[2], replace(limits, deepest_m=_BENT_M), self.start_rad, deadline=end
        )

    def _firmly(self, course: Problem, end: float, *, only: bool = False) -> Answer[Plan]:
        """Contacts whose stances bear a push; any where none do, unless only those are asked for."""
        found: Answer[Plan] | None = None
        for share in (PUSHES[0], 1.5 * LEAST_PUSH) if self.presses else ():
            firm, search = pushed(course, share), quick(self.planner, hasty=only)
            firm_end = _search_end(end, _FIRM)
            found = plan_with_reserve(search, firm, self.shares[:1], (), deadline=firm_end)
            if found.solution is not None:
                return replace(
                    found, problem=course, solution=replace(found.solution, problem=course)
                )
        if only and found is not None:
            return found
        return self._contacts(course, _search_end(end))

    def _contacts(self, course: Problem, end: float) -> Answer[Plan]:
        return plan_with_reserve(self.planner, course, self.shares, self.presses, deadline=end)

    def _bearing_pushes(self, course: Problem) -> Problem:
        if self.push_n > course.push_n:
            course = replace(course, push_n=self.push_n)
        check_push(course, self.planner)
        return course


def _moved_back(answer: Answer[Plan], question: LaidBetween) -> Answer[Plan]:
    """The answer in the frame of a question, in the world's, and judged there."""
    from .witness import judged  # slow to import

    robot, frame = question.robot or hexapod(), question.frame
    problem, plan, report = answer.problem, answer.solution, answer.report
    assert frame is not None
    answer = replace(answer, message=frame.in_world(answer.message))
    if plan is None:
        assert isinstance(problem, Problem)
        return replace(answer, problem=problem.moved(frame, robot))
    there = plan.moved(frame, robot)
    moved = replace(answer, problem=there.problem, solution=there)
    if report is None or not report.accepted or report.late:
        return replace(moved, report=report and replace(report, answer=there))
    return judged(moved)


def _search_end(end: float, share: float = _SEARCH) -> float:
    """When a search has to end whose plan is to be bent and judged by then."""
    now = time.perf_counter()
    return now + share * max(end - now, 0.0)


def _detour(question: Problem | LayOut, alternative: Alternative, push_n: float) -> Detour | None:
    """Detour that lays the course out anew from where a robot stands; None where the question
    cannot.
    """
    onward = getattr(question, "onward", None)
    if onward is None:
        return None

    def detour(standing: Standing, avoid_m: list[Array]) -> Problem:
        course: Problem = onward(standing.com_m, avoid_m, alternative)
        return replace(course, push_n=max(push_n, course.push_n))

    return detour


def _whole(pieces: Pieces, method: str, spent: Sequence[Effort], end: float) -> Answer[Plan]:
    """The answer to a course that was planned in pieces, with one verdict on all of it.

    Arguments:
        spent: on the contacts of every piece, also of those that failed.
        end: when to be done (``time.perf_counter()``).
    """
    from .witness import judged  # slow to import

    details = {"pieces": float(pieces.pieces), "detours": float(len(pieces.tried_m))}
    answer: Answer[Plan] = Answer(
        status=Status.FEASIBLE,
        method=method,
        problem=pieces.course,
        solution=pieces.plan,
        details=details,
        effort=Effort(
            **{each.name: sum(getattr(one, each.name) for one in spent) for each in fields(Effort)}
        ),
    )
    if pieces.failed is None and pieces.plan is not None:
        tried = [np.round(path, 3).tolist() for path in pieces.tried_m]
        made = {
            **pieces.plan.provenance,
            "planner": method,
            **({"tried_m": tried} if tried else {}),
        }
        return judged(replace(answer, solution=replace(pieces.plan, provenance=made)), deadline=end)
    failed = pieces.failed
    done = 0 if pieces.plan is None else pieces.plan.problem.frames - 1
    assert failed is not None
    place = pieces.course.com_nominal_m[done]
    message = (
        f"planned to key frame {done} of {pieces.course.frames - 1}, at ({place[0]:.2f}, "
        f"{place[1]:.2f}), in pieces; "
        f"the next piece: {failed.message or (failed.report.message if failed.report else '')}"
    )
    return replace(
        answer,
        status=Status.UNDECIDED,
        solution=failed.solution,
        report=failed.report if failed.solution is not None else None,
        message=message,
    )


def _loaded(question: Problem | LayOut, wrench: Array | None) -> Problem | LayOut:
    """The course, or what lays it out, with a wrench on every frame."""
    if wrench is None:
        return question
    if not callable(question):
        return question.loaded(wrench)

    def loaded(sets: Sets, alternative: Alternative) -> Problem:
        return question(sets, alternative).loaded(wrench)

    return loaded


def _leaning(
    question: LayOut,
    layouts: Sequence[Alternative],
    seen: Callable[..., Answer[Plan]],
    own: bool,
    deadline: float,
) -> tuple[Answer[Plan] | None, Sequence[Alternative]]:
    """On steep ground the answer over the first layout that is looked at, where its plan holds as
    it is found, else None; and the layouts, those first whose plans are nearest to holding.

    Arguments:
        seen: the answer over a course at a glance, with feet that press or without.
        own: whether the robot has legs of its own.
    """
    began, short_m = (time.perf_counter(), time.process_time()), dict[Alternative, float]()
    first = AS_ASKED if own else LEANING[0]  # whose belly is known to be high
    for alternative in sorted(LEANING, key=lambda each: each is not first):
        try:
            course = question("inner", alternative)
        except (InvalidInput, PlanningFailed):
            continue
        end = min(time.perf_counter() + _wall_s(began, _LOOK_S), deadline)
        outcome = seen(course, end, firmly=alternative is first)
        if alternative is first and outcome.status is Status.FEASIBLE:
            return _of_layout(outcome, alternative), layouts
        if outcome.report is not None and not outcome.report.late:
            short_m[alternative] = _short_m(outcome)
            if short_m[alternative] < _NEAR_M:
                break
    nearest = sorted(short_m, key=lambda each: short_m[each])
    return None, [*nearest, *(each for each in layouts if each not in nearest)]


def _short_m(outcome: Answer[Plan]) -> float:
    """What is missing most between an answer's bodies and on its feet's paths [m]."""
    groups = () if outcome.report is None else outcome.report.groups
    return max((float(group.figures.get("short_m", 0.0)) for group in groups), default=0.0)


def _on_steep_ground(question: LayOut) -> Problem | None:
    """The course as it is laid out first where the ground is steep, else None."""
    try:
        course = question("inner", AS_ASKED)
    except (InvalidInput, PlanningFailed):
        return None
    normals = np.abs([each.candidates[0].normal for each in course.footholds])
    gradient = np.median(np.hypot(*normals[:, :2].T) / np.maximum(normals[:, 2], 1e-9))
    return None if gradient < _STEEP or in_pieces(course) else course


def _laid_out(
    question: LayOut,
    layouts: Sequence[Alternative],
    answered: Callable[[Problem, float, Alternative], Answer[Plan]],
    briefly: Callable[[Problem, float, Alternative], Answer[Plan]],
    deadline: float,
    stated: bool,
) -> Answer[Plan]:
    """The answer over the first layout that has a plan; else over the first of all, which says how
    many were tried where it is not stated.

    Where it is not stated and legs are known, contacts are searched for briefly, and at last, while
    there is time, once more over the layouts that had none.

    Raises NoPlace or PlanningFailed where that one has no place for a toe or no way, and no other
    has a plan.
    """
    first: Answer[Plan] | None = None
    refusal: InvalidInput | PlanningFailed | None = None
    began = time.perf_counter(), time.process_time()
    left, laid_s, tried, asked = list(layouts), 0.0, 0, layouts[0]
    hurried, last = list[Alternative](), False
    others = not stated and len(layouts) > 1
    if others:
        left += STRIDES
    while left or hurried:
        if not left:
            left, hurried, last = hurried, [], True
        alternative, now = left.pop(0), time.perf_counter()
        if (last or alternative is not asked) and now + laid_s >= deadline:
            break
        try:
            course = question("inner", alternative)
            laid_s = time.perf_counter() - now
        except (InvalidInput, PlanningFailed) as error:
            if alternative is asked:
                if not isinstance(error, NoPlace | PlanningFailed):
                    raise
                left = ordered(left, "contacts")
                if others:
                    from ..problem.guide_path import Overhead  # slow to import

                    left = [*left, *LOW]
                    said = error.args[0]
                    if isinstance(
                        said() if callable(said) else said, Overhead
                    ):  # the highest first
                        left.sort(key=lambda each: (each.height >= 1.0, -min(each.height, 1.0)))
            refusal = refusal or error
            continue
        least_s = 0.0 if alternative.striding and alternative.height == 1.0 else _LEAST_S
        share_s = max(_FIRST * (deadline - now), _wall_s(began, least_s))
        tried += not last
        brief = others and not last and course.robot.own and not course.has_soles
        end = min(now + share_s, deadline) if left or hurried else deadline
        outcome = (briefly if brief else answered)(course, end, alternative)
        if outcome.status is Status.FEASIBLE:
            return _of_layout(outcome, alternative)
        if brief and outcome.solution is None:
            hurried.append(alternative)
        if alternative is asked:
            first = outcome
            if outcome.status is not Status.UNDECIDED:
                return outcome
            left = ordered(left, "contacts" if outcome.solution is None else "body")
            if _cannot_lift(outcome):
                left.sort(key=lambda each: each is not HIGHER)
            if left and course.has_soles:
                left.insert(0, KNEES_BENT)
            elif outcome.solution is not None and not stated and walls_of(course):
                left.sort(key=lambda each: (not each.striding, each.free))
                if (
                    asked is AS_ASKED
                    and not in_pieces(course)
                    and _SHALLOW_M < _short_m(outcome) <= _DEEP_M * course.robot.size
                ):
                    left.insert(1, _AGAIN)
            elif outcome.report is not None and outcome.report.accepted:  # it tips
                left = [*left[:1], *(e for e in left if e.striding), *left[1:]]
    if first is None:
        assert refusal is not None
        raise refusal
    if stated or tried < 2:
        return first
    late = f" until {LATE}" if time.perf_counter() + laid_s >= deadline else ""
    return replace(first, message=f"{first.message}; {tried} layouts tried{late}")


def _wall_s(began: tuple[float, float], processor_s: float) -> float:
    """Wall time that computing for so long takes, as it has gone since then [s].

    Arguments:
        began: wall time and processor time of this process [s].
    """
    wall_s, own_s = time.perf_counter() - began[0], time.process_time() - began[1]
    return processor_s * max(wall_s / max(own_s, 1e-9), 1.0) if wall_s > _PAUSE_S else processor_s


def _cannot_lift(outcome: Answer[Plan]) -> bool:
    """Tell whether nothing collides in the answer's motion and a foot stays from its path all the
    same.
    """
    groups = () if outcome.report is None else outcome.report.groups
    motion = [group for group in groups if group.name == "motion" and group.verdict == "violated"]
    return any("worst" in group.figures and group.figures["worst"] is None for group in motion)


def _of_layout(outcome: Answer[Plan], alternative: Alternative) -> Answer[Plan]:
    """The answer, whose plan says in which way the course was laid out, if another than was asked for."""
    if not alternative.message or outcome.solution is None:
        return outcome
    provenance = {**outcome.solution.provenance, "layout": alternative.message}
    plan = replace(outcome.solution, provenance=provenance)
    return replace(
        outcome, solution=plan, report=outcome.report and replace(outcome.report, answer=plan)
    )


def _refuted(
    inner: Answer[Plan], question: Problem | LayOut, planner: Planner, share: float, deadline: float
) -> Answer[Plan]:
    """The proof over outer sets, with this share of the friction; the course is undecided where
    there is none.
    """
    try:
        outer = question("outer", AS_ASKED) if callable(question) else question
        if outer is question and outer.tilt_limit_rad == LEVEL_RAD:  # as where it is laid out
            outer = replace(outer, tilt_limit_rad=TILT_LIMIT_RAD)
        outer = replace(outer, robot=outer.robot.sets("outer", outer.tilt_limit_rad))
    except InvalidInput as error:  # legs that nobody can measure
        return _undecided(inner, f"{UNPROVED}: {error}")
    limited = in_time(planner, deadline)
    outcome = None if limited is None else limited.solve(slippery(outer, share))
    if outcome is not None and outcome.certificate is not None:
        return outcome
    return _undecided(inner, _NO_TIME if outcome is None else UNPROVED)


def _slipping(refuted: Answer[Plan], alternative: Alternative) -> str:
    """What friction feet would need that slip in every layout, said of the one that was asked for;
    empty where they hold.
    """
    if alternative != AS_ASKED or refuted.certificate is None:
        return ""
    from ..verify.explanation import explain  # slow to import

    first = next(iter(explain(refuted.certificate).relaxations), None)
    if first is None or not first.parameter.startswith("friction everywhere"):
        return ""
    return f": feet slip: {first.parameter} would have to rise from {first.now:.3g} to {first.needed:.3g}"


def _undecided(inner: Answer[Plan], message: str) -> Answer[Plan]:
    """The outcome without the certificate, which is one over inner sets."""
    return replace(
        inner, status=Status.UNDECIDED, certificate=None, bound=math.nan, message=message, claim=""
    )


def replan(
    state: Standing | None,
    course: Problem,
    *,
    frame: int = 0,
    horizon: int | None = None,
    planner: Planner | Callable[[Problem], Planner] | None = None,
    shares: Sequence[float] = _ALL_FRICTION,
    presses: Sequence[float] = (),
    limits: WholeBodyLimits | None = None,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """Plan key frames ``frame`` to ``frame + horizon`` of a course from where the robot stands.

    Returns the planner's outcome over the window, whose plan begins at ``state``;
    ``pieces.joined`` puts windows together. It comes of ``plan_course``, so that a proof is
    one over the outer sets of legs. With limits it is one of the whole body, with its joint angles:
    ``details`` say in how many steps, from what torque to what and from what depth of a collision
    to what (``with_whole_body``), and where that does not do it is undecided with the reason. The
    answer depends on the arguments alone: no program, guess or earlier plan is kept. Raises
    InvalidInput for frames that there are not, and where the planner is not made for the window.

    Arguments:
        state: pose and toes at ``frame``, whose toes stay, and joints, where they are known; None
            at the beginning, where they are free as in the course.
        horizon: how many frames ahead; None for all that are left.
        planner: one, or what chooses one for the window (a policy); by default the two-stage
            planner over the lift.
        shares: of the friction, tried in this order until there is a plan
            (``friction_margin.plan_with_reserve``).
        presses: likewise.
        limits: of joints and bodies, to which the window's plan is bent; None: contacts alone.
        deadline: as for ``plan_course``.
    """
    last = course.frames - 1 if horizon is None else min(frame + horizon, course.frames - 1)
    window = course_window(course, frame, last, state)
    if planner is None:
        planner = TwoStage()
    chosen: Planner = planner if hasattr(planner, "solve") else planner(window)  # type: ignore[assignment]
    return plan_course(
        window,
        chosen,
        shares=shares,
        presses=presses,
        limits=limits,
        start_rad=None if state is None else state.angles_rad,
        deadline=deadline,
    )
