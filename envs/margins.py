"""Margins of what an environment finds, as entries of ``info``; zero unless its setting ``margins``
asks for them.
"""

from __future__ import annotations

from stancekit.planners.answer.plan import Plan
from stancekit.planners.verify.margins import least_margins

NAMES = "push_n", "support_m", "friction_left"


def margin_info(plan: Plan | None, prefix: str = "") -> dict[str, float]:
    """The least margins over the stances of a plan, under the names that they have in a report;
    zeros without a plan.

    Arguments:
        prefix: prefix of the keys.
    """
    least = {} if plan is None else least_margins(plan)
    return {
        f"{prefix}{name}": float(getattr(least[name], name)) if least else 0.0 for name in NAMES
    }
