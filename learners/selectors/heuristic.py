"""The expert's envelope of Lin et al. §IV-A: workspace bounds and rule-of-thumb force bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.expert import rule_of_thumb


def heuristic_envelope(problem_class: str, problems: Sequence[Problem]) -> EnvelopeSet:
    """Bounds on p from the limbs' workspace, on f for climbing where the mean normals are level,
    else for walking.
    """
    first = problems[0]
    shoulders = np.array([contact.shoulder_m for contact in first.contacts])
    reach = np.array([contact.reach_m for contact in first.contacts])
    normals = np.array(
        [[contact.patch.normal for contact in problem.contacts] for problem in problems]
    ).mean(axis=0)
    envelope = rule_of_thumb(shoulders, reach, np.abs(normals[:, 2]) < 0.5, first.length_scale_m)
    return EnvelopeSet.for_problems(
        problem_class, problems, [envelope], {"method": "heuristic", "source": "paper E §IV-A"}
    )
