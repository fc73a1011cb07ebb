"""Stretches of a course, planned one after the other: what a planner with a shorter horizon is
asked, and the walk that its answers make together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import Problem
from ..problem.problem import Foothold
from ..terrain.patch import Patch

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
        return cls(
            com_m=plan.com_m[-1],
            rotation_rad=plan.rotation_rad[-1],
            toes_m=plan.toes_at(plan.problem.frames - 1),
            patches=tuple(
                plan.problem.patch(int(index), plan.choice) for index in plan.problem.holds[-1]
            ),
            yaws_rad=_yaws(plan) if plan.problem.has_soles else (),
            angles_rad=None if plan.joints_rad is None else plan.joints_rad[-1],
        )


def _yaws(plan: Plan) -> tuple[float, ...]:
    """Yaw of every foot at the end of a plan [rad]."""
    puts = [
        (plan.problem.footholds[index].yaws_rad, int(plan.choice[index]))
        for index in plan.problem.holds[-1]
    ]
    return tuple(yaws[chosen] if yaws else 0.0 for yaws, chosen in puts)


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
    window, ends = slice(first, last + 1), last == course.frames - 1
    com_m, radius_m = np.array(course.com_nominal_m[window]), np.array(course.com_radius_m[window])
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
    footholds = [
        replace(foothold, frame=foothold.frame - first)
        for foothold in course.footholds
        if first < foothold.frame <= last
    ]
    return replace(
        course,
        footholds=(*begun, *footholds),
        lifts=((), *course.lifts[first + 1 : last + 1]),
        next_lift=course.next_lift if ends else course.lifts[last + 1],
        com_nominal_m=com_m,
        com_radius_m=radius_m,
        goal_m=course.goal_m if ends else course.com_nominal_m[last],
        steps=steps,
        modes=None if course.modes is None else course.modes[window],
        standing_m=None if course.standing_m is None else course.standing_m[window],
        wrench=None if course.wrench is None else course.wrench[window],
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
        com_nominal_m=course.com_nominal_m[again],
        com_radius_m=course.com_radius_m[again],
        modes=None if course.modes is None else tuple(course.modes[k] for k in again),
        standing_m=None if course.standing_m is None else course.standing_m[again],
        wrench=None if course.wrench is None else course.wrench[again],
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
    return replace(
        course,
        footholds=tuple(
            replace(each, frame=places[each.frame, each.limb] if each.frame else 0)
            for each in course.footholds
        ),
        lifts=tuple(lifts),
        com_nominal_m=(1.0 - part) * course.com_nominal_m[before] + part * course.com_nominal_m[of],
        com_radius_m=course.com_radius_m[of],
        steps=replace(course.steps, progress_m=course.steps.progress_m * min(parts)),
        modes=None if course.modes is None else tuple(course.modes[k] for k in of),
        standing_m=None if course.standing_m is None else course.standing_m[of],
        wrench=None if course.wrench is None else course.wrench[of],
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


def spliced(course: Problem, frame: int, onward: Problem) -> Problem:
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
    names = course.robot.limb_names
    com, rotation = [plans[0].com_m], [plans[0].rotation_rad]
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
        if number:
            com.append(plan.com_m[1:])
            rotation.append(plan.rotation_rad[1:])
        first += plan.problem.frames - 1
    joints = [
        plan.joints_rad if number == 0 else plan.joints_rad[1:]
        for number, plan in enumerate(plans)
        if plan.joints_rad is not None
    ]
    whole = course_window(course, 0, first)
    order = [(foothold.frame, foothold.limb) for foothold in whole.footholds]
    return Plan(
        problem=whole,
        com_m=np.vstack(com),
        rotation_rad=np.vstack(rotation),
        toes_m=np.array([toes[key] for key in order]),
        choice=np.array([choice[key] for key in order]),
        forces_n=np.array([forces[stance.frame, stance.limbs] for stance in whole.stances]).reshape(
            -1, len(names), 3
        ),
        joints_rad=np.vstack(joints) if len(joints) == len(plans) else None,
        provenance={"windows": len(plans)},
    )
