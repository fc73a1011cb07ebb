"""Reason that a certificate gives, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """The least value of one parameter, the others as they are, at which a certificate stops
    refuting its problem.

    It is necessary, not sufficient: below ``needed`` the problem stays infeasible.

    Arguments:
        needed: inf beyond the caps.
        leg: empty for parameters of the body, and of a course, whose parameters say where
            themselves.
        now, needed: in ``unit`` (SI; 1 for friction).
    """

    parameter: str
    leg: str
    now: float
    needed: float
    unit: str

    @property
    def relative(self) -> float:
        """Growth over the value now; inf where that is 0."""
        return (self.needed - self.now) / self.now if self.now > 0.0 else math.inf


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Why a problem is infeasible, as ``explain`` says it.

    Arguments:
        relaxations: what each single parameter would have to become, the cheapest growth first.
        message: the first of them in one line.
    Source:
        Lagrangian bounds of E1-E11.

    Example:
        >>> import stancekit
        >>> outcome = stancekit.solve(stancekit.sample("wall-3", rng=8)[0])
        >>> stancekit.explain(outcome).relaxations[0].leg
        'RR'
    """

    relaxations: tuple[Relaxation, ...]
    message: str

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; an infinite ``needed`` becomes null."""
        rows = [
            {**vars(r), "needed": r.needed if math.isfinite(r.needed) else None}
            for r in self.relaxations
        ]
        return {"relaxations": rows, "message": self.message}
