"""The verifier's word on a plan of a leap: groups of constraints, and a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .leap_plan import LeapPlan
from .report import GroupViolation

TOLERANCE = 1e-3
"""Largest violation that is accepted, non-dimensional (``verify.leaps``)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapReport:
    """The verifier's word on one leap.

    Arguments:
        accepted: the worst violation is at most the tolerance.
        worst: largest non-dimensional violation of all groups.
        groups: the worst violation of each group; ``frame`` is its interval.
        plan: what was judged.
        tolerance: largest violation that is accepted.
        momentum_error: largest distance of a claimed L from the one that was integrated, in units of the limit of L.
        defect: why there was nothing to check; empty when there was.
    Source:
        Newton and Euler for one rigid body; docs/concepts/leaps.md.
    Example:
        >>> import stancekit
        >>> from stancekit.planners.problem.leap_json import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
        >>> stancekit.verify(stancekit.plan(leap).plan).accepted
        True
    """

    accepted: bool
    worst: float
    groups: tuple[GroupViolation, ...]
    plan: LeapPlan = field(repr=False)
    tolerance: float = TOLERANCE
    momentum_error: float = math.inf
    defect: str = ""

    @property
    def message(self) -> str:
        """One line: the verdict, and the worst group, where and by how much."""
        verdict = "accepted" if self.accepted else "rejected"
        if self.defect:
            return f"{verdict}: {self.defect}"
        group = max(self.groups, key=lambda one: one.worst)
        if group.worst <= 0.0:
            return f"{verdict}: no constraint is violated"
        place = f"interval {group.frame}" + (f", limb {group.limb}" if group.limb else "")
        return f"{verdict}: the worst is {group.group} at {place}, off by {group.value:.3g} {group.unit}".rstrip()
