"""What is wrong with a contact sequence from elsewhere: every stance holds, with its margins, or the
one limit to blame; and the nearest sequence that holds.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..answer.report import Group, Report
from ..files.arrays import Array
from ..problem import Problem
from ..problem.contact import Stance
from ..problem.sequence import (
    OFF_M,
    Rows,
    grounded,
    headings,
    held_rows,
    places_of,
    seen_from,
    sequence_course,
)
from ..projection.whole_body import WholeBodyLimits
from ..robot.model import Robot
from ..terrain.families import Terrain
from ..terrain.patch import Frame
from ..verify import explain
from ..verify.margins import stance_margins
from .plan_course import plan_course
from .two_stage import TwoStage
from .witness import with_whole_body

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets

ROOMS = (0.025, 0.05, 0.1, 0.2)
"""How far footholds may move to mend a sequence, in reaches, one after the other."""
_CONTACTS_S = 10.0
"""Contacts of a sequence, whose footholds are points, are found by then, or not at all [s]."""
_AHEAD_RAD, _TURN_RAD = 0.1, 0.35
"""A robot that faces along x but for so much is planned in the world; feet that are turned by less than
the second on the way may be those of a body that is not."""
_NEXT = ("", " before the next")
"""What a key frame is of its step: where it ends, or where the feet of the next one are about to lift."""
Lay = Callable[..., Problem]


def diagnosed(
    rows: Rows,
    robot: Robot,
    ground: Terrain | None,
    *,
    mend: bool = False,
    deadline: float = math.inf,
) -> Report[Any]:
    """The report on a contact sequence: a group per stance, and those of the plan that completes it,
    which is the report's answer; where it is refused, maybe the plan of the nearest that holds, as
    the remark says.

    Plans face along one direction, that of the first step; of a sequence that turns, stances alone
    are judged, each as it faces.

    Arguments:
        ground: its terrain; None for a piece of ground under every foot.
        mend: look for the nearest sequence that holds, footholds within a fifth of the reach.
        deadline: when the answer is wanted (``time.perf_counter()``).

    Raises:
        InvalidInput: for rows that are no sequence of this robot.
    """
    guesses = headings(rows, robot)
    first = np.arctan2(np.median(np.sin(guesses[0])), np.median(np.cos(guesses[0])))
    off_rad = (guesses - first + np.pi) % (2.0 * np.pi) - np.pi
    heads = (
        first + np.take_along_axis(off_rad, np.abs(off_rad).argmin(axis=1)[:, None], axis=1)[:, 0]
    )
    frame, turn_rad = _frame(first), float(np.abs(heads - first).max())
    groups, proofs = list[Group](), list[Certificate]()
    if ground is not None:
        rows, off_m = grounded(rows, ground)
        groups += _off_ground(rows, off_m)
        patches = tuple(patch.moved(frame.inverse) for patch in ground.patches)
        ground = replace(ground, patches=patches, footholds=None)
    there = seen_from(rows, frame)
    still = np.zeros(len(rows["foot"]))
    lay = partial(sequence_course, there, robot, ground, still)
    course, plan = lay("inner"), None
    answer = Answer[Plan](
        status=Status.UNDECIDED,
        method="two-stage",
        message=f"it turns by {math.degrees(turn_rad):.0f}°, and stances alone were judged",
    )
    if turn_rad < _TURN_RAD:
        soon = min(deadline, time.perf_counter() + _CONTACTS_S)
        answer = plan_course(lay, TwoStage(), limits=None, deadline=soon)
        if answer.solution is not None:
            answer = with_whole_body(answer, WholeBodyLimits(), None, deadline=deadline)
        plan = answer.solution
    where = f"in a frame turned by {frame.heading_rad:.3g} rad" if frame.heading_rad else ""
    if answer.status is Status.FEASIBLE and plan is not None and answer.report is not None:
        groups += (*_held(plan), *answer.report.groups)
        return replace(answer.report, groups=tuple(groups), remark=where)

    @cache
    def laid(heading_rad: float, sets: Sets) -> Problem:
        """The course as the robot faces in a step, over points alone."""
        return sequence_course(seen_from(rows, _frame(heading_rad)), robot, None, still, sets)

    everybody = tuple(range(len(robot.limbs)))
    for stance in (*(Stance(2 * k, everybody) for k in range(len(heads))), *course.stances):
        facing = heads[stance.frame // 2 if turn_rad >= _TURN_RAD else 0]
        group, proof = _judged(partial(laid, facing), stance)
        groups.append(group)
        proofs += [] if proof is None else [proof]
    groups = sorted({g.name: g for g in groups}.values(), key=lambda group: group.when or 0.0)
    blamed = [group for group in groups if group.verdict == "violated"]
    defect = ""
    if not blamed:
        groups += _whole(answer)
        first = next((each for each in groups if each.verdict == "not checked"), None)
        if first and all(group.verdict != "violated" for group in groups):
            defect = f"nothing completes it, and nothing is proved; {first.name}: {first.message}"
    mended = None
    if mend and turn_rad < _TURN_RAD:
        mended = _mended(there, robot, ground, blamed, deadline)
    if mended is not None:
        where = "; ".join(filter(None, (_moved(there, mended), where)))
    found = (
        mended
        or plan
        or next(iter(proofs), None)
        or Plan(  # the sequence as it came, without forces
            problem=course,
            com_m=course.com_nominal_m,
            rotation_rad=np.zeros((course.frames, 3)),
            toes_m=np.array([each.candidates[0].centre_m for each in course.footholds]),
            choice=np.zeros(len(course.footholds), dtype=int),
            forces_n=np.zeros((len(course.stances), len(course.robot.limbs), 3)),
        )
    )
    return Report(
        groups=tuple(groups),
        answer=found,
        tolerance=0.0,
        defect=defect,
        remark=where,
        more_doubts=course.doubts,
    )


def _frame(heading_rad: float) -> Frame:
    """The frame whose x points where a robot faces; the world where that is near its x."""
    near = abs(heading_rad) < _AHEAD_RAD
    return Frame(origin_m=np.zeros(3), heading_rad=0.0 if near else float(heading_rad))


def _off_ground(rows: Rows, off_m: Array) -> Iterator[Group]:
    """What is refused of feet that stand on nothing."""
    for row in np.flatnonzero(off_m > OFF_M):
        foot, step, place = rows["foot"][row], rows["step"][row], places_of(rows)[row]
        near = f"the nearest is {off_m[row]:.3g} m off" if np.isfinite(off_m[row]) else "none about"
        yield Group(
            f"ground under {foot} at step {step}",
            value=float(off_m[row]),
            limit=OFF_M,
            unit="m",
            where=str(foot),
            when=float(step),
            message=f"no surface at ({place[0]:.3g}, {place[1]:.3g}, {place[2]:.3g}), {near}",
        )


def _held(plan: Plan) -> list[Group]:
    """The stances of a plan that holds, with what each bears beyond its weight."""
    found = stance_margins(plan, ("push_n", "support_m"))
    return [
        Group(
            _called(plan.problem, stance),
            unit="m",
            when=float(stance.frame // 2),
            message=f"bears a push of {push_n:.3g} N, the centre of mass {1e3 * support_m:.0f} mm inside",
            verdict="holds",
            figures={"push_n": push_n, "support_m": support_m},
        )
        for stance, push_n, support_m in zip(
            plan.problem.stances, *(values.tolist() for values in found.values()), strict=True
        )
    ]


def _called(course: Problem, stance: Stance) -> str:
    """Name of a stance's group."""
    step, lifts = divmod(stance.frame, 2)
    if len(stance.limbs) == len(course.robot.limbs):
        return f"step {step}{_NEXT[lifts]} on all feet"
    names = ", ".join(course.robot.limb_names[limb] for limb in stance.limbs)
    return f"step {step}{_NEXT[lifts]} on {names}"


def _judged(lay: Lay, stance: Stance) -> tuple[Group, Certificate | None]:
    """One stance: held with its margins, or the limit to blame, and the proof over the outer sets."""
    course, step = lay("inner"), float(stance.frame // 2)
    name = _called(course, stance)
    found = TwoStage().solve(_posture(course, stance))
    if found.solution is not None:
        return replace(_held(found.solution)[0], name=name, when=step), None
    proof, proved = found.certificate, True
    if course.robot.own:
        outer = TwoStage().solve(_posture(lay("outer"), stance)).certificate
        proof, proved = outer or proof, outer is not None
    if proof is None:
        why = "no forces were found, and nothing is proved"
        return Group(name, when=step, message=why, verdict="not checked"), None
    told = explain(proof)
    first = told.relaxations[0]
    said = re.sub(r" at frame 0 on [^:]*", "", told.message.removeprefix("infeasible: "))
    proved &= first.parameter != "tilt_limit"
    within = _level(proof) + ("" if proved else " and the inner sets of its legs: not proved")
    group = Group(
        name,
        when=step,
        where=first.leg,
        limb=first.leg,
        message=f"{said}; {within}",
        verdict="violated" if proved else "not checked",
        figures={"limit": first.parameter, "now": first.now, "needed": first.needed},
    )
    return group, proof if proved else None


def _level(proof: Certificate) -> str:
    """Of what bodies a proof speaks, in words."""
    problem = proof.refuted
    assert isinstance(problem, Problem)
    most = f"{math.degrees(problem.tilt_limit_rad):.0f}°"
    return f"with the body within {most} of level and of its heading"


def _posture(course: Problem, stance: Stance) -> Problem:
    """The posture problem of a stance, whose other feet are where they are and bear nothing."""
    chosen = [0] * len(course.footholds)
    everybody = Stance(stance.frame, tuple(range(len(course.robot.limbs))))
    posture = course.posture_problem(everybody, chosen)
    contacts = [
        contact
        if limb in stance.limbs
        else replace(contact, force_min=np.zeros(3), force_max=np.zeros(3))
        for limb, contact in enumerate(posture.contacts)
    ]
    return posture.posture_with(contacts=contacts)


def _whole(answer: Answer[Plan]) -> list[Group]:
    """What is refused of a sequence all of whose stances hold by themselves."""
    name, message = "the steps together", answer.message
    if answer.certificate is not None:
        message = explain(answer.certificate).message.removeprefix("infeasible: ")
        said = f"{_in_steps(message)}; {_level(answer.certificate)}"
        return [Group(name, message=said, verdict="violated")]
    if answer.report is not None and answer.report.refused:
        each = answer.report.groups
        return [replace(group, message=_in_steps(group.message)) for group in each]
    return [Group(name, message=_in_steps(message), verdict="not checked")]


def _in_steps(said: str) -> str:
    """A sentence on key frames as one on steps."""
    return re.sub(
        r"frame (\d+)", lambda found: f"step {int(found[1]) // 2}{_NEXT[int(found[1]) % 2]}", said
    )


def _mended(
    rows: Rows, robot: Robot, ground: Terrain | None, blamed: list[Group], deadline: float
) -> Plan | None:
    """The plan of the nearest sequence that holds: the feet to blame move, or all of their stances,
    or all.
    """
    holds, names = held_rows(rows, robot), robot.limb_names
    reach = float(np.mean([limb.reach_m for limb in robot.limbs]))
    feet = [int(holds[group.frame, names.index(group.limb)]) for group in blamed if group.limb]
    stances = holds[[group.frame for group in blamed]].ravel().tolist()
    for moving in [rows_of for rows_of in (feet, stances, holds.ravel().tolist()) if rows_of]:
        free = np.zeros(len(rows["foot"]))
        free[np.unique(moving)] = reach
        for share in ROOMS:
            if time.perf_counter() > deadline:
                return None
            lay = partial(sequence_course, rows, robot, ground, share * free)
            answer = plan_course(lay, TwoStage(), deadline=deadline)
            if answer.status is Status.FEASIBLE:
                return answer.solution
    return None


def _moved(rows: Rows, plan: Plan) -> str:
    """Which feet of a sequence moved, and how far, in words."""
    course, places = plan.problem, places_of(rows)
    far: list[tuple[float, str]] = []
    for row, (foot, step) in enumerate(zip(rows["foot"], rows["step"], strict=True)):
        j = course.holds[2 * step, course.robot.limb_names.index(foot)]
        off_m = float(np.linalg.norm(plan.toes_m[j] - places[row]))
        if off_m > 1.5e-3:
            far.append((off_m, f"{foot} of step {step} by {1e3 * off_m:.0f} mm"))
    moved = ", ".join(words for _, words in sorted(far, reverse=True))
    return f"it holds with {moved}" if moved else "it holds with all feet within 2 mm"
