"""Test for a plan that is about to tip: the limit on the least margin of push that ``plan`` and
``run`` share.

The verifier reports margins and refuses none: a file that was accepted stays accepted.
"""

from __future__ import annotations

from ..answer.plan import Plan
from ..answer.report import Group

LEAST_PUSH = 0.01
"""Share of the weight that a push has which every stance of a plan for a robot's own legs bears, or
it is not accepted: simulated, plans below it fall, and most of those above stand."""


def tipping(plan: Plan, share: float = LEAST_PUSH, group: Group | None = None) -> str:
    """Why a plan for a robot's own legs is about to tip though the verifier accepts it; empty where
    it is not.

    Arguments:
        plan: of any robot; of those whose legs are not their file's nothing is said.
        share: push that every stance has to bear, as a share of the weight; 0 for none.
        group: the verifier's word on the plan's margins, where it is known.
    """
    course = plan.problem
    if not course.robot.source.own or course.uncarried or share <= 0.0:
        return ""
    if group is None:
        from .margins import borne_share, margin_group, verdict_yields_m  # Clarabel, of this alone

        if borne_share(plan, (share,), verdict_yields_m(plan)):
            return ""
        group = margin_group(plan)
    least_n = share * course.weight_n
    push_n = group.figures["push_n"]
    if push_n >= least_n:
        return ""
    return (
        f"margin: {group.where} at frame {group.figures['push_frame']} bear a push of "
        f"{round(push_n, 2):g} N, "
        f"expected {round(least_n, 2):g} N or more, {100.0 * share:.2g} % of the weight"
    )
