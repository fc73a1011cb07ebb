"""Long courses in overlapping pieces: each is planned and judged from where the one before ends,
and all together are one plan, which the verifier judges as a whole.

A piece looks ``SHARED`` frames farther than it is kept, so that the next one begins where there is
a way on; what it costs depends on its own frames alone. Where a piece fails, a shorter part of it
is tried, then another way of the body round the place, from a few frames earlier, and the way from
there once more, before the whole fails.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array
from ..problem import Problem
from .plan_window import Standing, beginning, course_window, joined, spliced

LOG = logging.getLogger(__name__)
LONG, AT_ONCE = 40, 200
"""Courses of more key frames are planned in pieces; and are not tried as a whole where these have
failed, or for a robot of which no legs are known."""
PIECE, SHARED = 24, 8
"""Key frames of a piece, and how many of them the next one plans anew."""
LEAST = 6
"""A part of a piece that is kept where all of it fails has so many frames at least."""
DETOURS = 4
"""Other ways of the body that are tried, all pieces together."""
EVERY_S = 2.0
"""What is planned is kept after the first piece, and then no more often than this: the whole plan is
written each time, and a run that is interrupted plans so much anew."""
PATIENCE = 4.0
"""A piece may take so many times its share of the time that is left."""

PlanPiece = Callable[[Problem, "Array | None", float], Answer[Plan]]
"""Planner of a piece: its course, the joints of the robot that stands where it begins, and when to
be done."""
Detour = Callable[[Standing, "list[Array]"], Problem]
"""Layout of the course on from where a robot stands, another way than by these places."""


class Kept(Protocol):
    """Keeper of the plan of a course's beginning, so that an interrupted run can go on
    (``formats.partial_plan``).
    """

    def begun(self, course: Problem) -> Plan | None:
        """The plan of the course's beginning that is kept."""
        ...

    def keep(self, plan: Plan) -> None:
        """Keep the plan of a beginning."""
        ...

    def remove(self) -> None:
        """Keep nothing any more."""
        ...


Progress = Callable[[int, int], object]
"""Progress after every piece: key frames that are planned, and all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A course that was planned piece by piece.

    Arguments:
        course: as it was planned in the end, after detours.
        plan: of its beginning, or of all; None for nothing.
        pieces: how many were planned.
        tried_m: nominal paths that were left, each from where the plan left it, shape (L, 3) [m].
        failed: the answer of the piece that had no plan, None where all have.
    """

    course: Problem
    plan: Plan | None
    pieces: int
    tried_m: tuple[Array, ...]
    failed: Answer[Plan] | None


def in_pieces(course: Problem) -> bool:
    """Tell whether a course is planned in pieces: from fewer key frames on where there are legs,
    whose joints and bodies take the most time.
    """
    most = LONG if course.robot.source.joint_names else AT_ONCE
    return course.frames > most and not course.has_soles and not course.uncarried


def plan_pieces(
    course: Problem,
    piece: PlanPiece,
    *,
    detour: Detour | None = None,
    kept: Kept | None = None,
    progress: Progress | None = None,
    deadline: float = math.inf,
) -> Pieces:
    """Plan a course piece by piece.

    Arguments:
        detour: None where there is no other way.
        kept: holds what was planned before, and what is planned meanwhile, every ``EVERY_S``.
        deadline: when to be done (``time.perf_counter()``).
    """
    cycle, begun = _cycle(course), None if kept is None else kept.begun(course)
    if begun is not None and begun.problem.frames < course.frames:
        whole = (
            (begun.problem.frames - 1) // cycle * cycle
        )  # where a cycle ends another way may begin
        begun = beginning(begun, whole) if whole else None
    keep = max(cycle, (PIECE - SHARED) // cycle * cycle)
    plans, count, avoid, tried = ([] if begun is None else [begun]), 0, list[Array](), list[Array]()
    backed, shares = False, list[Mapping[str, Any]]([] if begun is None else [begun.provenance])
    if begun is not None and progress is not None:
        progress(begun.problem.frames - 1, course.frames - 1)

    kept_at = -math.inf

    def add(part: Plan) -> None:
        nonlocal kept_at
        plans.append(part)
        shares.append(part.provenance)
        if kept is not None and time.perf_counter() - kept_at > EVERY_S:
            kept.keep(_said(joined(course, plans), shares))
            kept_at = time.perf_counter()
        if progress is not None:
            progress(sum(plan.problem.frames - 1 for plan in plans), course.frames - 1)

    while True:
        at = sum(plan.problem.frames - 1 for plan in plans)
        if plans and at >= course.frames - 1:
            return Pieces(
                course=course,
                plan=_said(joined(course, plans), shares),
                pieces=count,
                tried_m=tuple(tried),
                failed=None,
            )
        last = min(at + PIECE, course.frames - 1)
        if course.frames - 1 - last < SHARED // 2:
            last = course.frames - 1
        answer = _one(course, at, last, plans, piece, deadline)
        count += 1
        accepted = answer.status is Status.FEASIBLE and answer.solution is not None
        LOG.info(
            "plan: piece %d, frames %d to %d of %d: %s",
            count,
            at,
            last,
            course.frames - 1,
            answer.status,
        )
        if accepted:
            assert answer.solution is not None
            part = (
                answer.solution
                if last == course.frames - 1
                else beginning(answer.solution, min(keep, last - at))
            )
            add(part)
            backed = False
            continue
        late = time.perf_counter() > deadline
        shorter = None if late else _shorter(answer, course, at, cycle, plans, piece, deadline)
        if shorter is not None:
            add(shorter)
            continue
        place = course.com_nominal_m[min(at + PIECE // 2, last)]
        where = _failed_frame(answer)
        if where is not None:
            place = course.com_nominal_m[min(at + int(where), last)]
        if late or detour is None or len(avoid) >= DETOURS or not plans:
            if plans and not late and not backed and plans[-1].problem.frames - 1 > cycle:
                plans[-1] = beginning(
                    plans[-1], _multiple(0.5 * (plans[-1].problem.frames - 1), cycle)
                )
                backed = True
                continue
            plan = joined(course, plans) if plans else None
            return Pieces(
                course=course, plan=plan, pieces=count, tried_m=tuple(tried), failed=answer
            )
        avoid.append(np.asarray(place[:2]))
        if plans[-1].problem.frames - 1 > cycle:  # room to turn off before
            plans[-1] = beginning(plans[-1], _multiple(0.5 * (plans[-1].problem.frames - 1), cycle))
        so_far = joined(course, plans)
        try:
            onward = detour(Standing.at_end(so_far), avoid)
        except (InvalidInput, PlanningFailed) as error:
            failed = replace(answer, message=f"{answer.message}; another way: {error}")
            return Pieces(
                course=course, plan=so_far, pieces=count, tried_m=tuple(tried), failed=failed
            )
        tried.append(course.com_nominal_m[so_far.problem.frames - 1 :])
        course = spliced(course, so_far.problem.frames - 1, onward)
        plans = [replace(so_far, problem=course_window(course, 0, so_far.problem.frames - 1))]


def _said(plan: Plan, pieces: list[Mapping[str, Any]]) -> Plan:
    """The plan, which says of all of it what holds of every piece: the largest share of the
    friction, and the least push that stances bear.
    """
    friction = [float(each["friction_share"]) for each in pieces if "friction_share" in each]
    pushes = [float(each.get("push_share", 0.0)) for each in pieces]
    provenance: dict[str, Any] = {"pieces": sum(int(each.get("pieces", 1)) for each in pieces)}
    provenance |= (
        {"friction_share": max(friction)} if friction and len(friction) == len(pieces) else {}
    )
    provenance |= {"push_share": min(pushes)} if pushes and min(pushes) > 0.0 else {}
    torques = {each["torque_nm"] for each in pieces if "torque_nm" in each}
    provenance |= {"torque_nm": min(torques)} if torques else {}
    return replace(plan, provenance=provenance)


def _one(
    course: Problem, at: int, last: int, plans: list[Plan], piece: PlanPiece, deadline: float
) -> Answer[Plan]:
    """The answer of the piece from frame ``at`` to ``last``."""
    state = Standing.at_end(plans[-1]) if plans else None
    window = course_window(course, at, last, state)
    now = time.perf_counter()
    left = max(1.0, (course.frames - 1 - at) / (PIECE - SHARED))
    until = (
        deadline
        if math.isinf(deadline)
        else min(deadline, now + PATIENCE * (deadline - now) / left)
    )
    return piece(window, None if state is None else state.angles_rad, until)


def _shorter(
    answer: Answer[Plan],
    course: Problem,
    at: int,
    cycle: int,
    plans: list[Plan],
    piece: PlanPiece,
    deadline: float,
) -> Plan | None:
    """An accepted plan of the first part of a piece that failed; None for none."""
    length = _multiple(max(LEAST, 0.5 * (PIECE - SHARED)), cycle)
    if answer.solution is None or at + length >= course.frames - 1:
        return None
    last = min(at + length + _multiple(SHARED // 2, cycle), course.frames - 1)
    other = _one(course, at, last, plans, piece, deadline)
    if other.status is not Status.FEASIBLE or other.solution is None:
        return None
    return beginning(other.solution, length)


def _failed_frame(answer: Answer[Plan]) -> float | None:
    """The frame of the first violated group that names one in the report on a piece; None if there
    is no report or no such group.
    """
    if answer.report is None:
        return None
    frames = [
        float(group.when)
        for group in answer.report.groups
        if group.verdict == "violated" and group.when
    ]
    return frames[0] if frames else None


def _cycle(course: Problem) -> int:
    """After how many frames the same limbs lift again."""
    lifts = course.lifts[1:]
    return next((n for n in range(1, len(lifts)) if lifts[n:] == lifts[:-n]), 1)


def _multiple(frames: float, cycle: int) -> int:
    """The whole number of cycles next to so many frames, one at least."""
    return max(1, round(frames / cycle)) * cycle
