"""The verifier of postures: it knows the problem and the posture, not how the posture was made.

It recomputes contact frames, rotation, balances, cones and reach from the problem's own numbers (``stances``).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from ..answer.outcome import Posture
from ..answer.report import GROUPS, PLAN_GROUPS, GroupViolation, Report, refused
from ..files.arrays import Array
from ..problem import PostureProblem
from .defects import posture_defect
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
"""What the columns of a group are called."""
NOTHING = {group: GroupViolation(group, 0.0, 0.0, unit) for group, unit in PLAN_GROUPS.items()}
"""Groups in which nothing is violated."""


def check_posture(problem: PostureProblem, posture: Posture, *, tolerance: float = 1e-6) -> Report:
    """Check every constraint of the problem at the posture; never raises for a bad posture.

    tolerance: largest violation allowed in any group, with lengths in the length scale, forces in the force scale,
    moments in their product and angles in rad. The two balances are judged by the Euclidean norm of what is left over.
    """
    defect = posture_defect(problem, posture)
    if defect:
        return refused(problem, posture, tolerance, defect)
    with np.errstate(all="ignore"):
        at = Stances.of_postures((problem,), (posture,))
        limb = Schedule.of_posture(row_counts(problem.contacts), counts_of(problem.contacts)).limb
        zeros = np.zeros(len(limb), dtype=np.intp)
        groups = worst_groups(at, violations(at), zeros, zeros, limb, problem.legs)
    worst = max(group.worst for group in groups.values())
    if not math.isfinite(worst):
        return refused(problem, posture, tolerance, "the numbers overflow")
    exact, linear = exact_and_linear(at.rotation_rad[at.owner], at.shoulders_m)
    out = length(at.toes_m - at.com_m[at.owner] - exact) - at.reach_m
    return Report(
        accepted=worst <= tolerance, worst=worst, groups=tuple(groups.values()), tolerance=tolerance, subject=problem,
        answer=posture, residual_nm=groups["moment_balance"].value, linearisation_m=float(length(exact - linear).max()),
        exact_reach_m=max(0.0, float(out.max())),
    )  # fmt: skip


def check_postures(
    problems: Sequence[PostureProblem], postures: Sequence[Posture], *, without: Collection[str] = ()
) -> Array:
    """The ``worst`` of ``check_posture`` for many at once, shape (B,); inf for what is no posture.

    Problems may have any number of contacts. without: groups that are left out, e.g. the moment balance for points of
    P̄. Who has the numbers as arrays can ask ``worst_of`` a ``Stances``.
    """
    worst = np.full(len(problems), np.inf)
    whole = [not posture_defect(*pair) for pair in zip(problems, postures, strict=True)]
    rows = np.flatnonzero(whole).tolist()
    if rows:
        with np.errstate(all="ignore"):
            at = Stances.of_postures([problems[k] for k in rows], [postures[k] for k in rows])
            found = violations(at)
            worst[rows] = worst_of(at, {group: values for group, values in found.items() if group not in without})
    return worst


def worst_groups(
    at: Stances, found: dict[str, Array], frame: Index, share: Array | Index, limb: Index, names: Sequence[str]
) -> dict[str, GroupViolation]:
    """The worst violation of every group and where it is. frame, share: of each stance; limb: of each contact."""
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
        if value <= 0.0:
            worst[group] = NOTHING[group]
            continue
        size = value / float(units[unit][stance])
        worst[group] = GroupViolation(
            group, size if size == size else math.inf, value, unit, int(frame[stance]),
            names[limb[row]] if group in OF_CONTACTS else "",
            PARTS[group][column] if group in PARTS else "", float(share[stance]),
        )  # fmt: skip
    return worst
