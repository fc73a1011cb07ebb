"""Labelled rows as an environment's scenes, and a pool of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import InvalidInput

from ..scenes import LabelledScene
from .dataset import Dataset, Part
from .labelled_posture import LabelledPosture


def scenes_of(dataset: Dataset) -> list[LabelledScene]:
    """The data set's feasible and hard infeasible rows as scenes."""
    return [
        scene_of(row)
        for row in dataset.rows()
        if row.status is not Status.UNDECIDED and not row.trivial
    ]


def scene_of(row: LabelledPosture) -> LabelledScene:
    """A decided row as a scene."""
    return LabelledScene(
        problem=row.problem,
        feasible=row.status is Status.FEASIBLE,
        posture=row.posture,
        lower_bound=row.lower_bound,
    )


class ScenePool:
    """Scenes of a labelled data set, drawn at random; all are in memory, and keep their scaled
    numbers once drawn.

    Arguments:
        balanced: toss a coin for the label, then any row of it is as likely, the trivially
            infeasible left out; else any row of all.

    Raises:
        InvalidInput: for undecided rows, and where no rows of a label are there to draw.
    """

    def __init__(self, dataset: Dataset, *, balanced: bool = True) -> None:
        where = f"{dataset.ledger.folder}: part {dataset.part}"
        if undecided := int((dataset.labels == "undecided").sum()):
            raise InvalidInput(
                f"{where}: expected labelled rows, got {undecided} undecided of {len(dataset)}"
            )
        parts = {"infeasible": dataset.infeasible, "feasible": dataset.feasible}
        for name, rows in (parts if balanced else {"any": dataset.chosen}).items():
            if not len(rows):
                raise InvalidInput(
                    f"{where}: expected rows of the label {name}, got none of {len(dataset)}"
                )
        sets = [dataset.select(rows) for rows in parts.values()] if balanced else [dataset]
        self._scenes = tuple(tuple(scene_of(row) for row in rows.rows()) for rows in sets)

    @classmethod
    def open(
        cls,
        folder: str | Path,
        *,
        of: str,
        legs: Sequence[str],
        part: Part = "train",
        balanced: bool = True,
    ) -> ScenePool:
        """The pool of a folder of ``stancekit label``.

        Arguments:
            of, legs: the class of problems that it has to be of, which names the robot, too.
            part: see ``Dataset.only``.

        Raises:
            InvalidInput: for a folder that is none, of another version or of other problems, or
                with undecided rows.
        """
        dataset = Dataset.open(folder)
        if (dataset.problem_class, tuple(dataset.header.legs)) != (of, tuple(legs)):
            got = f"{dataset.problem_class} on the legs {', '.join(dataset.header.legs)}"
            raise InvalidInput(
                f"{folder}: expected scenes of {of} on the legs {', '.join(legs)}, got some of "
                f"{got}"
            )
        return cls(dataset.only(part), balanced=balanced)

    def __len__(self) -> int:
        return sum(map(len, self._scenes))

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return a scene."""
        scenes = self._scenes[int(rng.integers(2)) if len(self._scenes) > 1 else 0]
        return scenes[int(rng.integers(len(scenes)))]
