"""The verifier of postures, plans of one frame: it knows the problem and the posture, not how the
posture was made.

It recomputes contact frames, rotation, balances, cones and reach from the problem's own numbers
(``stances``).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from ..answer.plan import Plan
from ..answer.report import GROUPS, PLAN_GROUPS, WHOLE_BODY, Group, Report
from ..files.arrays import Array
from .defects import plan_defect
from .geometry import exact_and_linear, length
from .half_spaces import row_counts
from .soles import counts_of
from .stances import BALANCES, OF_CONTACTS, Index, Schedule, Stances, units_of, violations, worst_of

PARTS = {
    "force_balance": ("x", "y", "z"),
    "moment_balance": ("x", "y", "z"),
    "tilt": ("x", "y", "z"),
    "force_bounds": ("n", "y", "z"),
}
"""Names of the columns of a group."""


def posture_report(posture: Plan, tolerance: float) -> Report[Plan]:
    """The report on the plan of a posture problem that has no defect.

    The two balances are judged by the Euclidean norm of what is left over.

    Arguments:
        tolerance: as of ``check_plan``, with lengths in the length scale, forces in the force
            scale, moments in their product and angles in rad.
    """
    problem = posture.problem
    with np.errstate(all="ignore"):
        at = Stances.of_postures((posture,))
        limb = Schedule.of_posture(row_counts(problem.contacts), counts_of(problem.contacts)).limb
        zeros = np.zeros(len(limb), dtype=np.intp)
        groups = worst_groups(at, violations(at), zeros, zeros, limb, problem.legs, tolerance)
    if not all(math.isfinite(group.value) for group in groups.values()):
        return refused(posture, tolerance, "the numbers overflow")
    exact, linear = exact_and_linear(at.rotation_rad[at.owner], at.shoulders_m)
    out = length(at.toes_m - at.com_m[at.owner] - exact) - at.reach_m
    figures = {
        "residual_nm": groups["moment_balance"].value,
        "linearisation_m": float(length(exact - linear).max()),
        "exact_reach_m": max(0.0, float(out.max())),
    }
    return Report(
        groups=tuple(groups.values()), answer=posture, tolerance=tolerance, figures=figures
    )


def check_postures(postures: Sequence[Plan], *, without: Collection[str] = ()) -> Array:
    """The ``worst`` of ``check_plan`` for many plans of posture problems at once, shape (B,); inf
    for what is none.

    Problems may have any number of contacts.

    Who has the numbers as arrays can ask ``worst_of`` a ``Stances``.

    Arguments:
        without: groups that are left out, e.g. the moment balance for points of P̄.
    """
    worst = np.full(len(postures), np.inf)
    rows = [k for k, posture in enumerate(postures) if not plan_defect(posture)[0]]
    if rows:
        with np.errstate(all="ignore"):
            at = Stances.of_postures([postures[k] for k in rows])
            result = violations(at)
            worst[rows] = worst_of(
                at, {group: values for group, values in result.items() if group not in without}
            )
    return worst


def worst_groups(
    at: Stances,
    found: dict[str, Array],
    frame: Index,
    share: Array | Index,
    limb: Index,
    names: Sequence[str],
    tolerance: float,
) -> dict[str, Group]:
    """The worst violation of every group and where it is.

    Arguments:
        at: the stances.
        found: their ``violations``.
        frame, share: key frame of each stance, and how far it is on the way to the next.
        limb: of each contact, an index of ``names``.
        names: of the limbs.
        tolerance: largest violation that is accepted, without unit.
    """
    worst, units = {}, units_of(at)
    for group, unit in GROUPS.items():
        values = found[group]
        if group in BALANCES:
            sizes = length(values)
            row = int(sizes.argmax())
            value, column = float(sizes[row]), int(np.abs(values[row]).argmax())
        else:
            row, column = divmod(int(values.argmax()), values.shape[1] if values.ndim == 2 else 1)
            value = float(values[row] if values.ndim == 1 else values[row, column])
        stance = int(at.owner[row]) if group in OF_CONTACTS else row
        scale = float(units[unit][stance])
        if value <= 0.0:
            worst[group] = violation(group, 0.0, scale, tolerance, unit=unit)
            continue
        worst[group] = violation(
            group,
            value,
            scale,
            tolerance,
            unit=unit,
            limb=names[limb[row]] if group in OF_CONTACTS else "",
            part=PARTS[group][column] if group in PARTS else "",
            when=float(frame[stance] + share[stance]),
        )
    return worst


def violation(
    name: str,
    value: float,
    scale: float,
    tolerance: float,
    *,
    unit: str,
    limb: str = "",
    part: str = "",
    when: float | None = None,
) -> Group:
    """A group whose value is a violation, judged without its unit; no number is a violation without
    bound.

    Arguments:
        name: of the group.
        value: the violation, 0 or less where there is none, in ``unit``.
        scale: the violation that counts as 1, in ``unit``.
        tolerance: largest violation that is accepted, without unit.
        unit, limb, when: as of ``Group``.
        part: component of the force or axis of the world; empty where there is none.
    """
    value = value if value == value else math.inf
    holds = value / scale <= tolerance
    return Group(
        name=name,
        value=value,
        limit=tolerance * scale,
        unit=unit,
        where=f"{limb} {part}".strip(),
        limb=limb,
        when=when,
        scale=scale,
        verdict="holds" if holds else "violated",
    )


def refused(
    plan: Plan, tolerance: float, defect: str, *, frame: int = -1, limb: str = ""
) -> Report[Plan]:
    """The report on what is no plan of its problem at all: every group is violated without bound.

    Arguments:
        plan: what was to be judged.
        tolerance: as of ``Report``.
        defect: what is wrong, in words.
        frame, limb: where it is, −1 and empty where it is nowhere in particular.
    """
    when = None if frame < 0 else float(frame)
    figures = {"residual_nm": math.inf, "linearisation_m": math.nan, "exact_reach_m": math.nan}
    of_plan = not plan.problem.is_posture
    if of_plan:
        figures |= {"between": math.inf, "goal_m": math.nan, "proved": 0}
    body = [Group(name, verdict="not asked for") for name in WHOLE_BODY if of_plan]
    violated = [
        violation(name, math.inf, 1.0, tolerance, unit=unit, limb=limb, when=when)
        for name, unit in (PLAN_GROUPS if of_plan else GROUPS).items()
    ]
    return Report(
        groups=(*violated, *body), answer=plan, tolerance=tolerance, figures=figures, defect=defect
    )
