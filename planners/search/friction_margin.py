"""Plans that keep a reserve of friction: found on a course that is made more slippery than it is.

A plan for less friction is one for more, as cones only grow; executed, its feet have something in
hand. So have those of a plan that does not balance on an edge (``held``).
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import Problem
from ..projection.held import PRESSES, PUSHES, pressing, push_share, pushed, steady
from ..robot.leg import Leg
from ..terrain.patch import Patch
from ..terrain.polygon import half_planes, sole_offsets, sole_region
from .answer import COURSE_LIMIT_S, Planner
from .two_stage import TwoStage

LOG = logging.getLogger(__name__)
SHARES = (0.8, 0.9, 1.0)
"""Shares of the friction that are planned with, the most cautious first."""
_CAUTION = 0.5
"""Fraction of the time that all shares but the last, and plans that press, may use together."""
_EACH = 0.5
"""Fraction of what is left of that which one of them may use."""
_SPARE, _SPARE_S = 1.0, 1.0
"""A push that nothing depends on, as of a robot whose legs are drawn up, is looked for as long as the
plan took, and at least so long [s]; what is begun is ended. Nobody executes a plan for a robot whose
legs are not known: it is not looked for."""
_BRIEF = 30
"""Convex solves of a brief search for contacts."""
_TIME_ENDED = "the time limit ended before the search for contacts began"


def slippery(course: Problem, share: float) -> Problem:
    """The course with this share of its friction everywhere."""
    if share == 1.0:
        return course

    @cache
    def dulled(patch: Patch) -> Patch:
        return patch.with_friction(share * patch.friction)

    footholds = tuple(
        replace(foothold, candidates=tuple(dulled(patch) for patch in foothold.candidates))
        for foothold in course.footholds
    )
    return replace(
        course, terrain=tuple(dulled(patch) for patch in course.terrain), footholds=footholds
    )


def plan_with_reserve(
    planner: Planner,
    course: Problem,
    shares: Sequence[float] = SHARES,
    presses: Sequence[float] = PRESSES,
    *,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """The answer for the most cautious share that has a plan; the plan is one of the course itself.

    Where some stance of that plan bears no push, one whose stances do is taken; and where there is
    none, and the plan balances on an edge, one in which every foot that carries presses with such a
    share of the weight, the first of ``presses`` that has one. Where no share has a plan, the
    answer for the last one, by default the course as it is: only that one proves anything of it.
    ``provenance`` says which of several shares of friction it was, with which share of the weight
    feet press, and which push, as a share of the weight, every stance bears.

    Arguments:
        deadline: when all of this has to end (``time.perf_counter()``), for planners whose time can
            be limited (``with_limit``), whose own limit is one for all shares, too. The more
            cautious shares and ``presses`` may take ``_CAUTION`` of the time, the last share the
            rest.

    Raises:
        InvalidInput: where the planner is not made for the course.
    """
    begin, own_s = time.perf_counter(), getattr(planner, "time_limit_s", math.inf)
    if len(shares) > 1:
        deadline = min(deadline, begin + (COURSE_LIMIT_S if own_s is None else own_s))
    cautious = begin + _CAUTION * (deadline - begin)
    outcome: Answer[Plan] | None = None
    for share in shares:
        limited = in_time(planner, deadline if share == shares[-1] else cautious)
        if limited is None:
            outcome = None  # that of a more slippery course proves nothing
            continue
        dulled = slippery(course, share)
        if course.has_soles and course.robot.own and len(shares) > 1:
            dulled = narrowed(dulled, _SOLES[min(shares.index(share), len(_SOLES) - 1)])
        outcome = limited.solve(dulled)
        LOG.info(
            "plan: contacts with %.0f %% of the friction: %s after %d solves, %.2f s",
            *(100.0 * share, outcome.status, outcome.effort.solves, outcome.effort.seconds),
        )
        if outcome.solution is not None:
            push = press = 0.0
            if presses and not dulled.has_soles:  # whose reserve is on their soles
                outcome, push = _braced(planner, dulled, outcome, cautious)
                if push == 0.0:
                    outcome, press = _firmer(planner, dulled, outcome, presses, cautious)
            assert outcome.solution is not None
            provenance = {
                **outcome.solution.provenance,
                **({"friction_share": share} if len(shares) > 1 or share < 1.0 else {}),
            }
            if press > 0.0:
                provenance["press_share"] = press
            if push > 0.0:
                provenance["push_share"] = push
            plan: Plan = replace(
                on_whole_soles(outcome.solution, course), problem=course, provenance=provenance
            )
            exact = (
                share >= 1.0 and outcome.problem is dulled
            )  # a bound of another course bounds nothing here
            return replace(
                outcome,
                solution=plan,
                problem=course,
                bound=outcome.bound if exact else float("nan"),
            )
    return outcome or Answer(
        status=Status.UNDECIDED, method=planner.name, problem=course, message=_TIME_ENDED
    )


_SOLES = (0.5, 0.65, 0.8)
"""Shares of soles within which plans with shares of the friction are made: what is left is their
distance from the edge over which the robot tips."""


_ANKLES, _ANKLE_SHARE, _INSIDE = 2, 0.85, 0.8
"""Joints of a leg that are its ankle, the share of their torque with which they hold the weight, and
how far from its middle to its edge a smaller sole's middle may be."""


def narrowed(course: Problem, share: float) -> Problem:
    """The course with soles that are so much smaller, which may be where those of the whole soles
    may.

    They are about their middles where ankles hold the whole weight on every point of them, else
    nearer to the ankles and still smaller.
    """
    soles = {limb.name: limb.sole_m for limb in course.robot.limbs}
    held = {name: (np.zeros(2), share) for name in soles}
    if course.robot.own:
        weight_n = course.robot.mass_kg * course.gravity_m_s2
        legs = course.robot.own_model().legs
        held |= {leg.name: _held(leg, weight_n, share) for leg in legs if leg.sole is not None}
    limbs = tuple(
        limb
        if (sole := limb.sole_m) is None
        else replace(
            limb, sole_m=held[limb.name][0] + held[limb.name][1] * (sole - held[limb.name][0])
        )
        for limb in course.robot.limbs
    )
    footholds = []
    for foothold in course.footholds:
        whole, candidates = soles[foothold.limb], foothold.candidates
        if whole is not None and share < 1.0:
            about, its = held[foothold.limb]
            candidates = tuple(
                sole_region(patch, sole_offsets((1.0 - its) * (whole - about), patch, yaw))
                for patch, yaw in zip(candidates, foothold.yaws_rad, strict=True)
            )
        footholds.append(replace(foothold, candidates=candidates))
    return replace(course, robot=replace(course.robot, limbs=limbs), footholds=tuple(footholds))


def _held(leg: Leg, weight_n: float, share: float) -> tuple[Array, float]:
    """The place on a leg's sole about which, and the share, of those up to this one, to which it is
    narrowed so that the ankle holds the weight on every point of it: shape (2,) [m].
    """
    sole = leg.sole
    assert sole is not None
    last = slice(-_ANKLES, None)
    turns = leg.chain.frames(leg.stance_rad[None])[0][0]
    lever = leg.chain.feet_and_jacobian(leg.stance_rad[None])[1][0, 2, last]
    axes = np.einsum("nij,nj->ni", turns[last], leg.chain.axes[last])
    ahead, left = (turns[-1] @ sole.rotation)[:2, :2].T
    slopes = np.stack([axes[:, 0] * of[1] - axes[:, 1] * of[0] for of in (ahead, left)], axis=1)
    limit = leg.torque_nm[last]
    most = _ANKLE_SHARE * np.where(limit > 0.0, limit, np.inf) / weight_n
    ankle = np.linalg.lstsq(slopes, -lever, rcond=None)[0]
    normals, offsets = half_planes(sole.points_m)
    ankle = ankle / max(1.0, float((normals @ ankle / offsets).max()) / _INSIDE)
    best = np.zeros(2), 0.0
    for about in np.linspace(0.0, 1.0, 11)[:, None] * ankle:
        room = most - np.abs(lever + slopes @ about)
        shares = room[:, None] / np.maximum(np.abs(slopes @ (sole.points_m - about).T), 1e-9)
        its = min(share, float(shares.min()))
        if its > best[1]:
            best = about, its
        if its >= share:
            break
    return best if best[1] > 0.0 else (np.zeros(2), share)


def on_whole_soles(plan: Plan, course: Problem) -> Plan:
    """The plan with the same forces and moments on the soles that the course has.

    A point of a smaller sole lies between that of the whole one and the place about which the sole
    was narrowed, and that place is a mean of points of the whole one: forces at the one are forces at
    the others, within the same cones.
    """
    if not course.has_soles or plan.points_m is None or plan.point_forces_n is None:
        return plan
    from scipy.optimize import nnls  # slow to import

    forces, points = np.array(plan.point_forces_n), np.array(plan.points_m)
    for i, (own, limb) in enumerate(zip(plan.problem.robot.limbs, course.robot.limbs, strict=True)):
        if limb.sole_m is None or own.sole_m is None or np.array_equal(own.sole_m, limb.sole_m):
            continue
        count = len(limb.sole_m)
        share = float(np.ptp(own.sole_m, axis=0).max() / np.ptp(limb.sole_m, axis=0).max())
        about = (own.sole_m - share * limb.sole_m).mean(axis=0) / (1.0 - share)
        mean = nnls(np.vstack([limb.sole_m.T, np.ones(count)]), np.array([*about, 1.0]))[0]
        its = forces[:, i, :count]
        middle = (1.0 - share) * mean[:, None] * its.sum(axis=1, keepdims=True)
        forces[:, i, :count] = share * its + middle
        for p, foothold in enumerate(course.footholds):
            if foothold.limb == limb.name:
                toe = plan.toes_m[p]
                points[p, :count] = toe + limb.sole_m @ np.linalg.pinv(own.sole_m) @ (
                    points[p, :count] - toe
                )
    return replace(plan, points_m=points, point_forces_n=forces)


def in_time(planner: Planner, deadline: float) -> Planner | None:
    """The planner with the time that is left to ``deadline`` (``time.perf_counter()``), None where
    none is.

    A planner whose time has no limit is returned as it is.
    """
    if math.isinf(deadline):
        return planner
    left_s = deadline - time.perf_counter()
    if left_s <= 0.0:
        return None
    limited: Planner = planner
    if hasattr(planner, "with_limit"):
        limited = planner.with_limit(left_s)
    return limited


def _braced(
    planner: Planner, course: Problem, outcome: Answer[Plan], deadline: float
) -> tuple[Answer[Plan], float]:
    """Replace an outcome in which some stance bears no push by one whose stances do, and tell the
    share of the weight that they bear: 0 for none.
    """
    assert outcome.solution is not None
    borne = push_share(outcome.solution)
    if not course.robot.joint_names:
        return outcome, borne
    patience_s = math.inf if course.robot.own else max(_SPARE_S, _SPARE * outcome.effort.seconds)
    deadline = min(deadline, time.perf_counter() + patience_s)
    for share in PUSHES:
        limited = None if share <= borne else in_time(quick(planner), _part_of_time(deadline))
        if limited is None:
            break
        braced = limited.solve(pushed(course, share))
        if braced.solution is not None:
            return braced, share
    return outcome, borne


def _firmer(
    planner: Planner,
    course: Problem,
    outcome: Answer[Plan],
    presses: Sequence[float],
    deadline: float,
) -> tuple[Answer[Plan], float]:
    """Improve an outcome in which some foot that carries does next to nothing to one in which none
    does, and tell the share of the weight with which its feet press at least: 0 for no such demand.
    """
    assert outcome.solution is not None
    if steady(outcome.solution, min(presses)):
        return outcome, 0.0
    for press in presses:
        limited = in_time(quick(planner), _part_of_time(deadline))
        if limited is None:
            break
        firmer = limited.solve(pressing(course, press))
        if firmer.solution is not None:
            return firmer, press
    return outcome, 0.0


def _part_of_time(deadline: float) -> float:
    """Time at which a try ends, so that later tries have time, too (``time.perf_counter()``)."""
    now = time.perf_counter()
    return now + _EACH * (deadline - now)


def quick(planner: Planner, *, hasty: bool = False, brief: bool = False) -> Planner:
    """The planner without proofs and cuts in space, which would take half a minute for a plan that
    is merely better.

    Arguments:
        hasty: the first guess of patches is all that it tries.
        brief: it tries few, as where there are other ways to lay the course out.
    """
    if isinstance(planner, TwoStage):
        return replace(
            planner,
            cuts=False,
            proves=False,
            max_nodes=0 if hasty else planner.max_nodes,
            max_solves=min(planner.max_solves or _BRIEF, _BRIEF) if brief else planner.max_solves,
        )
    return planner


def knows_pushes(planner: Planner) -> bool:
    """Tell whether a planner plans for pushes: two-stage alone, over the lift."""
    return isinstance(planner, TwoStage) and planner.envelopes is None


def check_push(course: Problem, planner: Planner) -> None:
    """Raise InvalidInput where a course asks for a push and the planner knows none, or no posture
    can bear it.
    """
    if course.push_n == 0.0:
        return
    if not knows_pushes(planner):
        over = " over envelopes" if planner.name == TwoStage.name else ""
        raise InvalidInput(
            f"push_n: expected 0 N with {planner.name}{over}, got {course.push_n:g} N: "
            "two-stage alone knows pushes, over the lift"
        )
    strongest = max(patch.friction for patch in course.terrain)
    most = (
        len(course.robot.limbs)
        * float(course.force_bounds[1].max())
        * max(strongest, 1.0)
        * course.force_n
    )
    if course.push_n > most:
        raise InvalidInput(
            f"push_n: expected at most {most:.4g} N, which all feet together can hold, got "
            f"{course.push_n:g}"
        )
