"""Margins of a stance beyond its own weight: a push, a body that is elsewhere, and less friction.

With toes and body held, the contacts of a stance balance a set of horizontal pushes at the centre
of mass, and they carry the weight from a set of places of it. Both sets are convex, shadows of the
forces within cones and bounds:

    Σ f = w e_z − F,  Σ (p − c − y F / w) × f = 0   pushes F = (F_x, F_y, 0) of a body that
                                                    gives way by y F / w
    Σ f = w e_z,      Σ (p − c − t) × f = 0         places c + t, t = (t_x, t_y, 0)

Of a course with a wrench on the body it is the loaded robot's: the weight is w e_z less the force,
the moment on the right −M, and the wrench goes where the centre of mass goes.

``stance_margin`` has their distance from the origin to the border from both sides; what is reported
is the lower one, which the contacts hold in every direction, and 0 where it is negative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..answer.motion import Motion
from ..answer.plan import Plan
from ..answer.report import Group, Report
from ..files.arrays import Array, cross
from ..problem.problem import Stance
from .stance_margin import Margins, Stances, places, pushes

_CLOSE, _SLICK, _TINY, _OUTLINE = 0.02, 1e-6, 1e-9, 24
"""A share that is left open of distances that are only compared; friction of a patch that has none; a
part of the weight, or a length [m], that is none; directions of a support region that is drawn."""
YIELDS = 0.12
"""Way that a body on its legs gives under a horizontal push as large as its weight, in units of a
leg's reach: its weight then bears nearer to the side that it tips over. Of pushes that a simulation
held the median is .14."""


MARGINS = ("push_n", "support_m", "friction_left")
"""Margins of a stance beyond its own weight, for any forces that its contacts may have: the largest
horizontal push at the centre of mass that is balanced in every direction [N], how far the centre of
mass may move horizontally in every direction before the contacts no longer carry it [m], and the
share of the friction that could be missing."""


def stance_margins(
    plan: Plan | Sequence[Plan],
    names: Sequence[str] = MARGINS,
    *,
    yields_m: float = 0.0,
    unknown: float = 0.0,
) -> dict[str, Array]:
    """The margins of every stance of a plan, in the order of ``Problem.stances``, shape (S,) each.

    Arguments:
        plan: the plan, or plans of one robot, whose stances follow each other.
        names: which of ``MARGINS``.
        yields_m: how far the body gives way under a push as large as its weight [m]; 0 for one that
            stays where it is.
        unknown: what a margin is of which nothing is known: 0 holds of it, nan says so.
    """

    def least(found: Margins) -> Array:
        return np.where(np.isposinf(found.upper), unknown, found.lower)

    plans = [plan] if isinstance(plan, Motion) else plan
    at, weight_n = Stances.together(list(map(stances_of, plans))), plans[0].problem.weight_n
    measures = {
        "push_n": lambda: weight_n * least(at.margins(pushes(at.borne, yields_m))),
        "support_m": lambda: least(at.margins(places(at.borne))),
        "friction_left": at.friction_left,
    }
    return {name: np.maximum(0.0, measures[name]()) for name in names}


def support_region(plan: Plan, stance: Stance) -> Array:
    """Region of the centre of mass, in the plane, in which a stance carries it; corners in order.

    Returns shape (K, 2) [m], empty where the stance carries it nowhere.
    """
    at, index = stances_of(plan), plan.problem.stances.index(stance)
    asked: dict[str, Any] = {"which": np.arange(len(at.counts)) == index, "first": _OUTLINE}
    corners = at.margins(places(at.borne), tolerance=1e-5, close=math.inf, **asked).ends[index]
    return np.asarray(plan.com_m[stance.frame, :2] + corners[np.isfinite(corners[:, 0])])


def verdict_yields_m(plan: Plan) -> float:
    """Distance that the verdict lets a plan's body give way under a push as large as its weight
    [m].
    """
    return YIELDS * float(np.mean([limb.reach_m for limb in plan.problem.robot.limbs]))


def borne_share(plan: Plan, shares: Sequence[float], yields_m: float = 0.0) -> float:
    """The largest of some shares of the weight, the largest first, that a push may have which every
    stance of a plan bears; 0 for none.

    Arguments:
        yields_m: as of ``stance_margins``.
    """
    at = stances_of(plan)
    shifts = pushes(at.borne, yields_m)
    sure = _sure_distances(plan, at, shifts)
    weakest = np.isin(np.arange(len(sure)), sure.argsort()[:1])  # where one fails, this mostly does
    for share in shares:
        if all(
            (at.margins(shifts, decide=share, which=which).lower[which] >= share).all()
            for which in ((sure < share) & weakest, (sure < share) & ~weakest)
        ):
            return share
    return 0.0


def with_margins(report: Report[Plan]) -> Report[Plan]:
    """The report with the group of margins measured, and with what they are in words."""
    group, plan = margin_group(report.answer), report.answer
    others = tuple(each for each in report.groups if each.name != group.name)
    at, posture = group.figures, plan.problem.is_posture
    every = "it" if posture else "every stance"
    push, support, friction = (
        "" if posture else f" (frame {at[f'{name}_frame']})"
        for name in ("push", "support", "friction")
    )
    pushed = f"the push that {every} bears is not known"
    inside = "how far inside the centre of mass is is not known"
    if at["push_n"] is not None:
        share = at["push_n"] / plan.problem.weight_n
        pushed = f"{every} bears a push of {at['push_n']:.3g} N, {share:.1%} of the weight"
    if at["support_m"] is not None:
        inside = f"the centre of mass is {1e3 * at['support_m']:.0f} mm inside"
    remark = (
        f"{pushed}{push}; {inside}{support}; {1.0 - at['friction_left']:.0%} of the friction would be "
        f"enough{friction}"
    )
    return replace(report, groups=(*others, group), remark=remark if report.accepted else "")


def margin_group(plan: Plan, *, measured: bool = True) -> Group:
    """The verifier's word on margins: the least of each over all stances, and where it is.

    Arguments:
        measured: measure them all; else no more than the push that the course asks for is judged.

    It is violated where the course asks for a push that some stance does not balance, the body
    where it is: that is what is planned. The push that is reported is one that moves the body.
    """
    course, wanted = plan.problem, plan.problem.push_n
    names = MARGINS if measured else ()
    found = stance_margins(plan, names, yields_m=verdict_yields_m(plan), unknown=np.nan)
    figures: dict[str, Any] = {}
    for name, values in found.items():
        frame = course.stances[int(values.argmin())].frame
        least = None if np.isnan(values).any() else float(values.min())
        figures |= {name: least, f"{name.rpartition('_')[0]}_frame": frame}
    pushes_n = (
        np.array([wanted])
        if not measured and borne_share(plan, (wanted / course.weight_n,)) > 0.0
        else found["push_n"]
        if wanted == 0.0
        else stance_margins(plan, ("push_n",), unknown=np.nan)["push_n"]
    )
    weakest, least_n = course.stances[int(pushes_n.argmin())], float(pushes_n.min())
    short = max(0.0, wanted - float(np.nan_to_num(least_n)))
    there = "a push that is not known" if np.isnan(least_n) else f"{least_n:.3g} N"
    limbs = " ".join(course.robot.limb_names[limb] for limb in weakest.limbs)
    return Group(
        "margin",
        value=short,
        unit="N",
        where=limbs,
        when=float(weakest.frame),
        message=f"{limbs} at frame {weakest.frame}: {there}, expected {wanted:.3g} N"
        if short > 0.0
        else "",
        scale=course.weight_n,
        verdict="violated" if short > 0.0 else "holds",
        figures=figures,
    )


def stances_of(plan: Plan, least: float = 0.0) -> Stances:
    """The contacts of all stances of a plan, on the patches that were chosen.

    Tangential forces are kept within their bounds by friction that is as small as these ask for at
    the largest normal force, which is cautious.

    Arguments:
        least: share of the weight with which every contact presses at least.
    """
    course = plan.problem
    rows = [
        (index, of.frame, foot, offset)
        for index, of in enumerate(course.stances)
        for foot in course.holds[of.frame][list(of.limbs)].tolist()
        for offset in course.offsets_m[foot][int(plan.choice[foot])]
    ]
    index, frames, feet, offsets = (np.array([row[k] for row in rows]) for k in range(4))
    chosen = plan.patches
    low, high = (course.force_n / course.weight_n * bounds[feet] for bounds in course.force_bounds)
    aside = np.minimum(-low[:, 1:], high[:, 1:]).min(axis=1) / np.maximum(high[:, 0], _SLICK)
    friction = np.array([patch.friction for patch in chosen])[feet]
    borne = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(course.stances), 1))
    if course.wrench is not None:
        borne -= course.wrench[[of.frame for of in course.stances]] / course.weight_n
    return Stances(
        arms_m=plan.toes_m[feet] + offsets - plan.com_m[frames],
        normals=np.array([patch.normal for patch in chosen])[feet],
        friction=np.maximum(np.minimum(friction, aside), _SLICK),
        low=np.maximum(low[:, 0], least),
        high=high[:, 0],
        counts=np.bincount(index, minlength=len(course.stances)),
        borne=borne,
    )


def _sure_distances(plan: Plan, every: Stances, shifts: Array) -> Array:
    """Distances that the origin surely has from the border of each stance's set of shifts, less the
    share that ``_CLOSE`` leaves open.

    The plan's forces f, made to balance, and those that balance a shift t by K t, the larger the
    normal force is: f − K t are within their bounds and cones for every t of that length. 0 where
    there are none, or these do not balance.

    Arguments:
        shifts: what a unit of each shift adds to the balances, shape (S, 6, 2).

    Returns shape (S,).
    """
    course, end, sure = plan.problem, 0, np.zeros(len(every.counts))
    for index, (of, count) in enumerate(zip(course.stances, every.counts.tolist(), strict=True)):
        part, end, shift = slice(end, end + count), end + count, shifts[index]
        feet = course.holds[of.frame][list(of.limbs)].tolist()
        points = [len(course.offsets_m[foot][int(plan.choice[foot])]) for foot in feet]
        normals, friction = every.normals[part], every.friction[part]
        turns = cross(every.arms_m[part, None], np.eye(3)).reshape(-1, 3).T
        balance = np.concatenate([np.tile(np.eye(3), count), turns])
        whole = plan.forces_n[index][list(of.limbs)] / np.array(points)[:, None]
        force = np.repeat(whole, points, axis=0).ravel() / course.weight_n
        press = np.maximum((force.reshape(-1, 3) * normals).sum(axis=1), _TINY)
        across = np.repeat(press, 3)[:, None] * balance.T
        answer = across @ np.linalg.pinv(balance @ across, hermitian=True)
        force = force + answer @ (every.borne[index] - balance @ force)
        change = answer @ shift
        off = np.abs(
            balance @ np.column_stack([change, force])
            - np.column_stack([shift, every.borne[index]])
        )
        force, change = force.reshape(-1, 3), change.reshape(-1, 3, 2)
        press, lift = (force * normals).sum(axis=1), (change * normals[:, :, None]).sum(axis=1)
        slope = np.maximum(np.linalg.norm(lift, axis=1), _TINY)
        inside = np.minimum(every.high[part] - press, press - every.low[part]) / slope
        used = np.linalg.norm(change - lift[:, None] * normals[:, :, None], axis=(1, 2))
        slide = np.linalg.norm(force - press[:, None] * normals, axis=1)
        cones = (friction * press - slide) / np.maximum(used + friction * slope, _TINY)
        sure[index] = np.minimum(inside, cones).min() if off.max() < _TINY else 0.0
    return (1.0 - _CLOSE) * np.maximum(0.0, sure)
