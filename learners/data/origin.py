"""Whose a data set is, held against a robot's and a terrain's file."""

from __future__ import annotations

from pathlib import Path

from stancekit.envs.distributions.cut import identity_of
from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.robot_file import BUILT_IN, named_robot

from .dataset import Dataset


def check_of(dataset: Dataset, robot: str | None, terrain: str | Path | None) -> None:
    """Raise InvalidInput unless the rows are of this robot and this terrain's file, where they are given."""
    where = dataset.ledger.folder
    if robot is not None:
        asked = "" if robot in BUILT_IN else named_robot(robot).identity
        if asked != dataset.robot:
            wanted, got = (name or BUILT_IN[0] for name in (asked, dataset.robot))
            raise InvalidInput(f"{where}: robot: expected a data set of {wanted}, got one of {got}")
    if terrain is not None and not dataset.problem_class.endswith(f"-on-{identity_of(terrain)}"):
        wanted = identity_of(terrain)
        raise InvalidInput(f"{where}: terrain: expected a data set of {wanted}, got one of {dataset.problem_class}")
