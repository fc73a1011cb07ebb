"""Distance beyond its place that a foot comes down until it feels, on grounds that are known from
noisy heights.

Three deviations of the ground at a toe are once in 370 times too few, and a plan has tens of toes.
A foot comes down as many deviations as make *all* toes of a plan find their ground as often as
three make one, and no more than 2 cm.
"""

from __future__ import annotations

import math

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array

TOUCH_DOWN_M = 0.02
"""No foot comes down farther beyond its place [m]."""
ONE_IN = 1.0 + math.erf(-3.0 / math.sqrt(2.0))
"""How often a single toe is farther off than three deviations."""


def deviations(toes: int) -> float:
    """Number of standard deviations that a foot comes down, for as many toes; 3 for one, 3.9 for
    thirty.
    """
    from statistics import NormalDist  # loads decimals and fractions, and few grounds ask for it

    return -NormalDist().inv_cdf(0.5 * ONE_IN / max(toes, 1))


def touch_downs_m(plan: Plan) -> Array:
    """Distance beyond its place that each foot comes down along its patch's normal, 0 where the
    ground is exact, (P,) [m].
    """
    course = plan.problem
    patches = [course.patch(p, plan.choice) for p in range(len(course.footholds))]
    spread = np.zeros(len(patches))
    if all(patch.certainty is None for patch in patches):
        return spread
    for p, patch in enumerate(patches):
        if patch.certainty is not None:
            spread[p] = patch.normal[2] * float(patch.certainty.height_sd_m(plan.toes_m[p, :2]))
    known = sum(patch.certainty is not None for patch in patches)
    return np.asarray(np.minimum(deviations(known) * spread, TOUCH_DOWN_M))
