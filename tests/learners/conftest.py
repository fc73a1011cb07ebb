"""What these tests share: walks of one task are written once, and small sets of labels are made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data.labelling import label


@pytest.fixture(autouse=True)
def _once(each_gait_is_written_once: None) -> None:
    """Also here."""


@pytest.fixture(scope="session")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Dataset]:
    """``labelled(feasible, infeasible, seed)``: rows of three limbs between walls."""

    def made(feasible: int, infeasible: int, seed: int, **others: int) -> Dataset:
        path: Path = tmp_path_factory.mktemp("labels") / "set"
        plan = LabelPlan(
            distribution="wall-3", feasible=feasible, infeasible=infeasible, seed=seed, **others
        )
        label(plan, path)
        return Dataset.open(path)

    return made
