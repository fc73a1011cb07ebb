"""The report on a proof, of whatever kind its problem is."""

from __future__ import annotations

from ..answer.certificate import Certificate
from ..answer.report import Group, Report


def proof_report(
    certificate: Certificate,
    tolerance: float,
    bound: float,
    leaves: int,
    weakest: int,
    message: str,
) -> Report[Certificate]:
    """The report on a proof: one group, the least bound of its leaves, which has to exceed the
    tolerance.

    Arguments:
        certificate: what was judged.
        tolerance: above which a bound has to be.
        bound: the least.
        leaves: how many were checked.
        weakest: the leaf of that bound, −1 where there is none.
        message: the verdict in one line.
    """
    group = Group(
        name="bound",
        value=bound,
        limit=tolerance,
        where=f"leaf {weakest}" if weakest >= 0 else "",
        message=message,
        verdict="holds" if bound > max(tolerance, 0.0) else "violated",
    )
    return Report(
        groups=(group,),
        answer=certificate,
        tolerance=tolerance,
        figures={"lower_bound": bound, "leaves": leaves, "weakest": weakest},
    )
