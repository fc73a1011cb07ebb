"""Labelled rows as an environment's scenes."""

from __future__ import annotations

from stancekit.envs.scenes import Scene
from stancekit.planners.answer.outcome import Status

from .dataset import Dataset


def scenes_of(dataset: Dataset) -> list[Scene]:
    """The data set's feasible and hard infeasible rows as scenes."""
    return [
        Scene(
            problem=row.problem,
            feasible=row.status is Status.FEASIBLE,
            posture=row.posture,
            lower_bound=row.lower_bound,
        )
        for row in dataset.rows()
        if row.status is not Status.UNDECIDED and not row.trivial
    ]
