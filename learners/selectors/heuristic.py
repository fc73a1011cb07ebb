"""The expert's envelope of paper E §IV-A: workspace bounds and rule-of-thumb force bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stancekit.planners.problem import PostureProblem
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet

CLIMBING = ((0.0, 0.9), (-0.3, 0.3), (0.0, 0.4))
"""Bounds on f_n, f_y and the vertical shear f_z on a wall, in units of the robot's weight (paper E §IV-A)."""
WALKING = ((0.0, 0.5), (-0.15, 0.15), (-0.15, 0.15))
"""The same on the ground."""


def heuristic_envelope(problem_class: str, problems: Sequence[PostureProblem]) -> EnvelopeSet:
    """Bounds on p from the limbs' workspace, on f from CLIMBING where the mean normals are level, else from WALKING."""
    first = problems[0]
    length_m = first.length_scale_m
    shoulders = np.array([contact.shoulder_m for contact in first.contacts])
    reach = np.array([[contact.reach_m] for contact in first.contacts])
    normals = np.array([[contact.patch.normal for contact in problem.contacts] for problem in problems]).mean(axis=0)
    force = np.array([CLIMBING if abs(normal[2]) < 0.5 else WALKING for normal in normals])
    envelope = Envelope(
        low=np.concatenate([(shoulders - reach) / length_m, force[..., 0]], axis=1),
        high=np.concatenate([(shoulders + reach) / length_m, force[..., 1]], axis=1),
    )
    return EnvelopeSet.for_problems(
        problem_class, problems, [envelope], {"method": "heuristic", "source": "paper E §IV-A"}
    )
