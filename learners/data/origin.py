"""Whose a data set is, held against a robot's and a terrain's file, and against what a selector
learned from.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stancekit.envs.data.dataset import Dataset, Part
from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.robot_file import BUILT_IN, named_robot


def rows_of(
    source: Dataset | str | Path,
    part: Part = "all",
    robot: str | None = None,
    terrain: str | Path | None = None,
) -> Dataset:
    """The rows of a data set, of its folder, or of one that ships by its name; or a part of them.

    Arguments:
        robot, terrain: whose they have to be, where given.

    Raises:
        InvalidInput: for what is no data set, and for another's.
    """
    dataset = (source if isinstance(source, Dataset) else Dataset.open(source)).only(part)
    _check_of(dataset, robot, terrain)
    return dataset


def _check_of(dataset: Dataset, robot: str | None, terrain: str | Path | None) -> None:
    """Raise InvalidInput unless the rows are of this robot and this terrain's file, where they are
    given.
    """
    where = dataset.ledger.folder
    if robot is not None:
        identity = "" if robot in BUILT_IN else named_robot(robot).identity
        if identity != dataset.robot:
            wanted, got = (name or BUILT_IN[0] for name in (identity, dataset.robot))
            raise InvalidInput(f"{where}: robot: expected a data set of {wanted}, got one of {got}")
    if terrain is None:
        return
    from stancekit.envs.distributions.cut import identity_of  # loads scipy

    wanted = identity_of(terrain)
    if not dataset.problem_class.endswith(f"-on-{wanted}"):
        raise InvalidInput(
            f"{where}: terrain: expected a data set of {wanted}, got one of {dataset.problem_class}"
        )


def check_unseen(dataset: Dataset, provenance: Mapping[str, Any], where: str) -> None:
    """Raise InvalidInput where a selector learned from rows of this data set, or from draws of the
    same seed.

    Arguments:
        provenance: the selector's, with what ``Dataset.origin`` says of its rows, or the set
            alone. Two different parts of the split by hash have no row in common.
    """
    mine, theirs = (
        dataset.origin,
        {name: provenance.get(name) for name in ("dataset", "first_sample")},
    )
    if isinstance(provenance.get("calibration"), dict):
        check_unseen(dataset, provenance["calibration"], where)
    if {mine["part"], provenance.get("part", "all")} == {"train", "test"}:
        return
    same = [name for name, value in theirs.items() if value is not None and value == mine[name]]
    if same:
        origin = (
            "these rows"
            if same[0] == "dataset"
            else f"draws of the same seed, {dataset.header.plan.seed}"
        )
        raise InvalidInput(
            f"{where}: expected rows that it was not trained on, got {origin}: "
            f"{dataset.ledger.folder}; fit it to "
            "--part train and evaluate it on --part test, or label with another seed"
        )
