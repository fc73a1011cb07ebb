"""Remainder of a leap that is under way, from a measured state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..answer.plan import LeapPlan
from ..errors import InvalidInput
from ..problem.foothold import Foothold
from ..problem.leap import BodyState, Leap


def remaining_leap(plan: LeapPlan, time_s: float, state: BodyState) -> Leap:
    """The rest of a leap: the phases that are left, toes that stand as they are, from where the
    body is measured.

    Arguments:
        plan: that is under way.
        time_s: since its beginning, before its end [s].
        state: of the body at that time.

    Returns:
        A ``Leap`` with the timing of the plan, for ``find_leap``. It may begin in the air.

    Raises:
        InvalidInput: for a time that is not within the plan.
    """
    leap, ends = plan.problem, plan.times_s
    if not 0.0 <= time_s < ends[-1]:
        raise InvalidInput(
            f"time_s: expected 0 or more, and less than {ends[-1]:g} s, got {time_s:g}"
        )
    k = int(np.searchsorted(ends, time_s, side="right")) - 1
    first = int(leap.interval_phases[k])
    borders = np.concatenate([[0], np.cumsum([phase.intervals for phase in leap.phases])])
    left = int(borders[first + 1]) - k
    phases = (replace(leap.phases[first], intervals=left), *leap.phases[first + 1 :])
    timing = leap.timings_s[plan.timing]
    lasts = (float(ends[borders[first + 1]] - time_s), *timing[first + 1 :])
    footholds = []
    for j, foothold in enumerate(leap.footholds):
        stands = j in leap.holds[first]
        if stands:
            patch = leap.patch(j, plan.choice)
            foothold_left = Foothold(
                limb=foothold.limb, frame=0, candidates=(patch,), toe_m=plan.toes_m[j]
            )
            footholds.append(foothold_left)
        elif foothold.frame > first:
            footholds.append(replace(foothold, frame=foothold.frame - first))
    return replace(
        leap,
        phases=phases,
        timings_s=(lasts,),
        duration_s=None,
        footholds=tuple(footholds),
        start=state,
    )
