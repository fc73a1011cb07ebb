"""Limit that is in the way of many posture problems at once, as their proofs have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..answer.certificate import Certificate
from ..files.arrays import Array
from ..problem import Problem
from .lagrangian import Leaves, Numbers, leaf_bounds
from .tree import Forest

LIMITS = ("friction", "force", "reach", "body", "tilt")
"""Limits of all limbs together: friction, largest normal force, reach, the room of the centre of
mass, and the body's tilt."""
GROWTHS = (0.1, 0.3, 1.0)
"""Shares by which every limit grows: the first that weakens a proof says which does most."""
SEVERAL = "several"
"""Where no single limit, twice as large, weakens the proof."""


def hindrances(certificates: Sequence[Certificate]) -> list[str]:
    """The limit per certificate whose growth by a share, with all else as it is, takes most of what
    is proved.

    The certificates are accepted ones of posture problems that differ in their patches alone. A
    body that has no tilt is not given one.
    """
    if not certificates:
        return []
    forest = Forest.of_postures([_problem(each) for each in certificates])
    leaves = forest.leaves({k: forest.replay(k, each) for k, each in enumerate(certificates)})
    numbers, names = forest.numbers, [SEVERAL] * len(certificates)
    now = _bounds(numbers, leaves)
    for share in GROWTHS:
        grown = np.array([_bounds(*_grown(numbers, leaves, name, share)) for name in LIMITS])
        least = grown.min(axis=0)
        for k in np.flatnonzero(least < now - 1e-12):
            if names[k] == SEVERAL:
                names[k] = LIMITS[int(grown[:, k].argmin())]
    return names


def _problem(certificate: Certificate) -> Problem:
    """The posture problem that a certificate refutes."""
    problem = certificate.refuted
    assert isinstance(problem, Problem)
    return problem


def _bounds(numbers: Numbers, leaves: Leaves) -> Array:
    """Bound that the weakest leaf of every problem proves, shape (Q,)."""
    starts = np.searchsorted(leaves.problem, np.arange(len(numbers.friction)))
    return np.asarray(np.minimum.reduceat(leaf_bounds(numbers, leaves), starts))


def _grown(numbers: Numbers, leaves: Leaves, name: str, share: float) -> tuple[Numbers, Leaves]:
    """Problems with one limit of all limbs larger by a share."""
    more = 1.0 + share
    if name == "friction":
        return replace(numbers, friction=more * numbers.friction), leaves
    if name == "reach":
        by = share * numbers.reach
        rows = numbers.row_bounds + by[:, numbers.schedule.row_limb]
        return replace(numbers, reach=numbers.reach + by, row_bounds=rows), leaves
    if name == "body":
        return replace(numbers, com_radius=more * numbers.com_radius), leaves
    if name == "tilt":
        return replace(numbers, tilt=more * numbers.tilt), leaves
    most = numbers.force_max[leaves.problem]
    outermost = np.zeros(leaves.upper.shape, dtype=bool)
    outermost[..., 0] = leaves.upper[..., 0] == most[..., 0]
    return numbers, replace(leaves, upper=np.where(outermost, more * leaves.upper, leaves.upper))
