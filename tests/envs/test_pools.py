"""Data sets that ship: whole, of their class, and found by name where there is no folder of that
name.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import folder_of, pools
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses

SELECTION = "stancekit.envs:stancekit/EnvelopeSelection-v0"


@pytest.mark.parametrize("name", ["pool-ground-3", "pool-wall-3", "pool-wall-4", "pool-wall-5"])
def test_a_pool_is_half_feasible_and_its_proofs_hold(name: str) -> None:
    data = Dataset.open(name)
    assert data.problem_class == name.removeprefix("pool-")
    assert (len(data.feasible), len(data.infeasible), len(data)) == (250, 250, 500)
    for row in data.select(np.concatenate([data.feasible[:3], data.infeasible[:3]])).rows():
        if row.posture is not None:
            assert check_plan(row.posture).accepted
        else:
            assert row.certificate is not None
            assert check_certificate(row.certificate).accepted


def test_an_environment_draws_from_a_pool_by_its_name() -> None:
    env = gymnasium.make(SELECTION, problem="wall-3", scenes="pool-wall-3")
    first, _ = env.reset(seed=0)
    again, _ = env.reset(seed=0)
    for name, seen in first.items():
        np.testing.assert_array_equal(seen, again[name])
    with refuses("pool-wall-5"):
        gymnasium.make(SELECTION, problem="wall-3", scenes="pool-wall-5")


def test_a_folder_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert folder_of("pool-wall-3") == pools()["pool-wall-3"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pool-wall-3").mkdir()
    assert folder_of("pool-wall-3") == Path("pool-wall-3")
    assert folder_of("wall-3") == Path("wall-3")
