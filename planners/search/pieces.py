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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array
from ..problem import Problem
from ..problem.problem import Foothold
from ..terrain.patch import Patch

_TURN = 0.8
"""Share of the largest turn to a key frame that a body takes to be as it is planned."""
STANDING_M = 1e-4
"""Distance that the COM of a robot that stands may be taken from where it is [m]: there a plan may
lie on the very border of what holds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """Pose of a robot at a key frame.

    Arguments:
        com_m, rotation_rad: shape (3,).
        toes_m: shape (N, 3) [m], each on the patch of the same index.
        yaws_rad: of soles [rad]; () for 0.
        angles_rad: of the joints, shape (J,), where they are known.
    """

    com_m: Array
    rotation_rad: Array
    toes_m: Array
    patches: tuple[Patch, ...]
    yaws_rad: tuple[float, ...] = ()
    angles_rad: Array | None = None

    @classmethod
    def at_end(cls, plan: Plan) -> Standing:
        """Pose at the end of a plan."""
        problem = plan.problem
        feet = [int(index) for index in problem.holds[-1]]
        yaws = [(problem.footholds[foot].yaws_rad, int(plan.choice[foot])) for foot in feet]
        return cls(
            com_m=plan.com_m[-1],
            rotation_rad=plan.rotation_rad[-1],
            toes_m=plan.toes_at(problem.frames - 1),
            patches=tuple(problem.patch(foot, plan.choice) for foot in feet),
            yaws_rad=tuple(each[chosen] if each else 0.0 for each, chosen in yaws)
            if problem.has_soles
            else (),
            angles_rad=None if plan.joints_rad is None else plan.joints_rad[-1],
        )


def _at(course: Problem, frames: Sequence[int]) -> dict[str, Any]:
    """Fields of a course that have a row per key frame, at these."""
    names = ("com_nominal_m", "com_radius_m", "standing_m", "wrench", "modes")
    rows = {name: getattr(course, name) for name in names}
    return {name: [row[k] for k in frames] for name, row in rows.items() if row is not None}


def course_window(
    course: Problem, first: int, last: int, standing: Standing | None = None
) -> Problem:
    """Key frames ``first`` to ``last`` of a course, as a course.

    The least progress is asked for as far as a body that stands off its nominal path can make it.

    Arguments:
        standing: the robot at frame ``first``, whose toes stay; without it toes and COM are free
            there as in the course, and ``first`` is 0. The goal is the course's at its end, else
            the nominal COM at ``last``.

    Raises:
        InvalidInput: for frames that there are not.
    """
    if course.has_soles and standing is not None and not standing.yaws_rad:
        raise InvalidInput("window: expected the yaws of the soles that stand, got none")
    if not 0 <= first <= last < course.frames or (standing is None and first > 0):
        raise InvalidInput(
            f"window: expected frames within 0 to {course.frames - 1}, got {first} to {last}"
        )
    fields, ends = _at(course, range(first, last + 1)), last == course.frames - 1
    com_m, radius_m = fields["com_nominal_m"], fields["com_radius_m"]
    begun = [foothold for foothold in course.footholds if foothold.frame == 0]
    steps = course.steps
    if standing is not None:
        com_m[0], radius_m[0] = standing.com_m, STANDING_M
        steps = replace(
            steps, progress_m=min(steps.progress_m, _room(course, first, com_m, radius_m))
        )
        each = enumerate(
            zip(course.robot.limb_names, standing.toes_m, standing.patches, strict=True)
        )
        begun = [
            Foothold(
                limb=limb,
                frame=0,
                candidates=(patch,),
                toe_m=toe,
                yaws_rad=standing.yaws_rad[i : i + 1],
            )
            for i, (limb, toe, patch) in each
        ]
    return replace(
        course,
        footholds=(
            *begun,
            *(
                replace(foothold, frame=foothold.frame - first)
                for foothold in course.footholds
                if first < foothold.frame <= last
            ),
        ),
        lifts=((), *course.lifts[first + 1 : last + 1]),
        next_lift=course.next_lift if ends else course.lifts[last + 1],
        goal_m=course.goal_m if ends else course.com_nominal_m[last],
        steps=steps,
        **fields,
    )


def with_pause(course: Problem, frame: int) -> Problem:
    """The course with a key frame more after this one, to which the body alone moves, as far as it
    may there.
    """
    again = [*range(frame + 1), frame, *range(frame + 1, course.frames)]
    return replace(
        course,
        footholds=tuple(
            replace(each, frame=each.frame + (each.frame > frame)) for each in course.footholds
        ),
        lifts=(*course.lifts[: frame + 1], (), *course.lifts[frame + 1 :]),
        **_at(course, again),
    )


def one_at_a_time(course: Problem, first: int, last: int) -> Problem:
    """The course on which limbs that are lifted together before key frames ``first`` to ``last``
    are lifted one after the other, in the robot's order, with a key frame each; the body has as far
    to go in all, and the least progress is a share of it.

    Raises InvalidInput for frames that there are not.
    """
    if not 1 <= first <= last < course.frames:
        raise InvalidInput(
            f"frames: expected within 1 to {course.frames - 1}, got {first} to {last}"
        )
    order, lifts, of = course.robot.limb_names, list[tuple[str, ...]](), list[int]()
    places, parts = dict[tuple[int, str], int](), list[float]()
    for frame, lifted in enumerate(course.lifts):
        turns = (
            [(name,) for name in order if name in lifted]
            if first <= frame <= last and lifted
            else [lifted]
        )
        for number, names in enumerate(turns, 1):
            places |= {(frame, name): len(lifts) for name in names}
            lifts.append(tuple(names))
            of.append(frame)
            parts.append(number / len(turns))
    before = np.maximum(np.array(of) - 1, 0)
    part = np.array(parts)[:, None]
    com_m = (1.0 - part) * course.com_nominal_m[before] + part * course.com_nominal_m[of]
    return replace(
        course,
        footholds=tuple(
            replace(each, frame=places[each.frame, each.limb] if each.frame else 0)
            for each in course.footholds
        ),
        lifts=tuple(lifts),
        steps=replace(course.steps, progress_m=course.steps.progress_m * min(parts)),
        **_at(course, of) | {"com_nominal_m": com_m},
    )


def _room(course: Problem, first: int, com_m: Array, radius_m: Array) -> float:
    """Room of the first step along its line [m]; 0 where the body stands ahead of where it should
    go next.
    """
    if len(com_m) < 2:
        return np.inf
    step = com_m[1] - com_m[0]
    return (
        float(np.linalg.norm(step) + radius_m[1])
        if step @ course.direction(first + 1) > 0.0
        else 0.0
    )


def turning_on(plan: Plan, rotation_rad: Array) -> Plan:
    """The plan with a body that turns from how it stands, shape (3,) [rad], to how the plan has it.

    Balance knows nothing of that; legs may not reach.
    """
    turned, most_rad = [rotation_rad], max(_TURN * plan.problem.steps.rotation_rad, 1e-12)
    for wanted in plan.rotation_rad[1:]:
        turn = wanted - turned[-1]
        turned.append(turned[-1] + turn / max(1.0, float(np.linalg.norm(turn)) / most_rad))
    return replace(plan, rotation_rad=np.array(turned))


def beginning(plan: Plan, last: int) -> Plan:
    """A plan up to key frame ``last``, where it may be gone on from.

    Raises InvalidInput for frames that there are not.
    """
    problem = course_window(plan.problem, 0, last)
    feet = [i for i, foothold in enumerate(plan.problem.footholds) if foothold.frame <= last]
    rows = {(stance.frame, stance.limbs): i for i, stance in enumerate(plan.problem.stances)}
    forces = plan.forces_n[[rows[stance.frame, stance.limbs] for stance in problem.stances]]
    return replace(
        plan,
        problem=problem,
        com_m=plan.com_m[: last + 1],
        rotation_rad=plan.rotation_rad[: last + 1],
        toes_m=plan.toes_m[feet],
        choice=plan.choice[feet],
        forces_n=forces,
        joints_rad=None if plan.joints_rad is None else plan.joints_rad[: last + 1],
        modes=None if plan.modes is None else plan.modes[: last + 1],
    )


def _spliced(course: Problem, frame: int, onward: Problem) -> Problem:
    """A course up to a key frame, and another one on from there, whose frame 0 is that frame.

    The limbs that lift first in the other one have to be those that would lift next. Raises
    InvalidInput else.
    """
    if onward.frames > 1 and onward.lifts[1] != course.lifts[frame + 1]:
        raise InvalidInput(
            f"frame {frame}: expected {course.lifts[frame + 1]} to lift next, got {onward.lifts[1]}"
        )
    both = [(course, slice(0, frame + 1)), (onward, slice(1, None))]
    later = [replace(each, frame=each.frame + frame) for each in onward.footholds if each.frame > 0]

    def put(name: str) -> Any:
        rows = [getattr(each, name) for each, _ in both]
        if any(row is None for row in rows):
            return None
        return np.concatenate([row[part] for row, (_, part) in zip(rows, both, strict=True)])

    return replace(
        onward,
        name=course.name,
        footholds=(*(each for each in course.footholds if each.frame <= frame), *later),
        lifts=(*course.lifts[: frame + 1], *onward.lifts[1:]),
        com_nominal_m=put("com_nominal_m"),
        com_radius_m=put("com_radius_m"),
        standing_m=put("standing_m"),
        wrench=put("wrench"),
        modes=None
        if course.modes is None or onward.modes is None
        else (*course.modes[: frame + 1], *onward.modes[1:]),
    )


def joined(course: Problem, plans: Sequence[Plan]) -> Plan:
    """The plans of neighbouring windows as one plan of the course, or of its beginning where they
    stop earlier.

    Joints are those of the windows where all have some.

    Arguments:
        plans: of windows from frame 0 on, each but the first begun from where the last one ended;
            what they say of their own first frames is left out. The first may be of frame 0 alone.
    """
    if course.has_soles:
        raise InvalidInput("windows: expected point feet to join plans of, got soles")
    toes, choice = dict[tuple[int, str], Array](), dict[tuple[int, str], int]()
    forces, first = dict[tuple[int, tuple[int, ...]], Array](), 0
    for number, plan in enumerate(plans):
        for index, foothold in enumerate(plan.problem.footholds):
            if foothold.frame > 0 or number == 0:
                toes[first + foothold.frame, foothold.limb] = plan.toes_m[index]
                choice[first + foothold.frame, foothold.limb] = int(plan.choice[index])
        for index, stance in enumerate(plan.problem.stances):
            if stance.frame > 0 or number == 0:
                forces[first + stance.frame, stance.limbs] = plan.forces_n[index]
        first += plan.problem.frames - 1
    own = [(plan, min(number, 1)) for number, plan in enumerate(plans)]
    joints = [each.joints_rad[begin:] for each, begin in own if each.joints_rad is not None]
    whole = course_window(course, 0, first)
    order = [(foothold.frame, foothold.limb) for foothold in whole.footholds]
    return Plan(
        problem=whole,
        com_m=np.vstack([each.com_m[begin:] for each, begin in own]),
        rotation_rad=np.vstack([each.rotation_rad[begin:] for each, begin in own]),
        toes_m=np.array([toes[key] for key in order]),
        choice=np.array([choice[key] for key in order]),
        forces_n=np.array([forces[stance.frame, stance.limbs] for stance in whole.stances]).reshape(
            -1, len(course.robot.limbs), 3
        ),
        joints_rad=np.vstack(joints) if len(joints) == len(plans) else None,
        provenance={"windows": len(plans)},
    )


LOG = logging.getLogger(__name__)
LONG, AT_ONCE = 40, 200
"""Courses of more key frames are planned in pieces; and are not tried as a whole where these have
failed, or for a robot of which no legs are known."""
PIECE, SHARED = 24, 8
"""Key frames of a piece, and how many of them the next one plans anew."""
LEAST = 6
"""A part of a piece that is kept where all of it fails has so many frames at least."""
_DETOURS = 4
"""Other ways of the body that are tried, all pieces together."""
EVERY_S = 2.0
"""What is planned is kept after the first piece, and then no more often than this: the whole plan is
written each time, and a run that is interrupted plans so much anew."""
_PATIENCE = 4.0
"""A piece may take so many times its share of the time that is left."""

_PlanPiece = Callable[[Problem, "Standing | None", float], Answer[Plan]]
"""Planner of a piece: its course, how the robot stands where it begins, and when to be done."""
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
    most = LONG if course.robot.joint_names else AT_ONCE
    return course.frames > most and not course.has_soles and not course.uncarried


def plan_pieces(
    course: Problem,
    piece: _PlanPiece,
    *,
    detour: Detour | None = None,
    kept: Kept | None = None,
    progress: Progress | None = None,
    until: float = math.inf,
    deadline: float = math.inf,
) -> Pieces:
    """Plan a course piece by piece.

    Arguments:
        detour: None where there is no other way.
        kept: holds what was planned before, and what is planned meanwhile, every ``EVERY_S``.
        until: when to be done while no half of it is planned (``time.perf_counter()``).
        deadline: when to be done.
    """
    cycle, begun = _cycle(course), None if kept is None else kept.begun(course)
    if begun is not None and begun.problem.frames < course.frames:
        whole = (begun.problem.frames - 1) // cycle * cycle  # where another way may begin
        begun = beginning(begun, whole) if whole else None
    keep = max(cycle, (PIECE - SHARED) // cycle * cycle)
    short = _multiple(max(LEAST, 0.5 * (PIECE - SHARED)), cycle)
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
        last, end = min(at + PIECE, course.frames - 1), course.frames - 1
        if end - last < SHARED // 2:
            last = end
        limit = deadline if 2 * at >= end else min(until, deadline)
        answer, most = _one(course, at, last, plans, piece, limit), keep
        count += 1
        LOG.info("plan: piece %d, frames %d to %d of %d: %s", count, at, last, end, answer.status)
        fails, late = answer.status is not Status.FEASIBLE, time.perf_counter() > limit
        if fails and answer.solution is not None and not late and at + short < end:
            soon = min(at + short + _multiple(SHARED // 2, cycle), end)
            shorter = _one(course, at, soon, plans, piece, limit)
            if shorter.status is Status.FEASIBLE:
                answer, most, last = shorter, short, soon
        if answer.status is Status.FEASIBLE and answer.solution is not None:
            add(
                answer.solution if last == end else beginning(answer.solution, min(most, last - at))
            )
            backed = backed and fails
            continue
        if late or detour is None or len(avoid) >= _DETOURS or not plans:
            if plans and not late and not backed and plans[-1].problem.frames - 1 > cycle:
                plans[-1] = beginning(
                    plans[-1], _multiple(0.5 * (plans[-1].problem.frames - 1), cycle)
                )
                backed = True
                continue
            return Pieces(
                course=course,
                plan=joined(course, plans) if plans else None,
                pieces=count,
                tried_m=tuple(tried),
                failed=answer,
            )
        avoid.append(_failed_place(answer, course, at, last))
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
        course = _spliced(course, so_far.problem.frames - 1, onward)
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
    course: Problem, at: int, last: int, plans: list[Plan], piece: _PlanPiece, deadline: float
) -> Answer[Plan]:
    """The answer of the piece from frame ``at`` to ``last``, whose steps are shorter by what the body
    may be off where it stands.
    """
    state, now = Standing.at_end(plans[-1]) if plans else None, time.perf_counter()
    left = max(1.0, (course.frames - 1 - at) / (PIECE - SHARED))
    until = min(deadline, now + _PATIENCE * (deadline - now) / left)
    window = course_window(course, at, last, state)
    if state is not None:
        steps, most_m = window.steps, max(course.steps.com_m - STANDING_M, 0.5 * course.steps.com_m)
        steps = replace(steps, com_m=most_m, progress_m=min(steps.progress_m, most_m))
        window = replace(window, steps=steps)
    return piece(window, state, until)


def _failed_place(answer: Answer[Plan], course: Problem, at: int, last: int) -> Array:
    """The body's place at the frame of the first violated group that names one in the report on a
    piece that failed, or else in its middle, shape (2,) [m].
    """
    groups = () if answer.report is None else answer.report.groups
    frames = [int(each.when) for each in groups if each.verdict == "violated" and each.when]
    frame = at + (frames[0] if frames else PIECE // 2)
    return np.asarray(course.com_nominal_m[min(frame, last)][:2])


def _cycle(course: Problem) -> int:
    """After how many frames the same limbs lift again."""
    lifts = course.lifts[1:]
    return next((n for n in range(1, len(lifts)) if lifts[n:] == lifts[:-n]), 1)


def _multiple(frames: float, cycle: int) -> int:
    """The whole number of cycles next to so many frames, one at least."""
    return max(1, round(frames / cycle)) * cycle
