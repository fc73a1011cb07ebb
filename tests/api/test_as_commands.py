"""What only commands could do: the same functions answer from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stancekit
from tests.refusals import refuses


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[stancekit.Dataset]:
    folder, seen = tmp_path_factory.mktemp("rows"), list[tuple[int, int]]()

    def show(done: int, total: int) -> None:
        seen.append((done, total))

    train = stancekit.label("wall-3", folder / "train", rows=(4, 4), shard_size=4, progress=show)
    test = stancekit.label("wall-3", folder / "test", rows=(3, 3), natural=True, seed=1)
    assert seen == [(0, 8), (4, 8), (8, 8)]
    assert train.header.plan.shards == 2
    assert (test.header.plan.natural, len(test)) == (True, 6)
    return [train, test]


def test_selectors_are_fitted_and_compared_with_the_lift(rows: list[stancekit.Dataset]) -> None:
    train, test = rows
    seen = list[int]()
    fitted = stancekit.fit(train, "quantile", progress=lambda done, total: seen.append(done))
    scores = [
        stancekit.evaluate(
            one, test, projections=["fix-p"], progress=lambda done, total: seen.append(done)
        )
        for one in (fitted, "lift")
    ]
    assert [score.selector for score in scores] == ["selector", "lift"]
    assert seen[-1] == scores[0].p1_feasible.of + scores[0].p1_infeasible.of
    with refuses("workers"):
        stancekit.fit(train, "quantile", workers=2)
    with refuses("selector"):
        stancekit.evaluate(fitted, train)


def test_files_and_data_sets_are_verified_by_their_names(
    rows: list[stancekit.Dataset], tmp_path: Path
) -> None:
    problem = stancekit.sample("wall-3", rng=8)[0]
    certificate = stancekit.solve(problem).certificate
    assert certificate is not None
    proof = tmp_path / "proof.json"
    stancekit.save((problem, certificate), proof)
    check = stancekit.verify(proof)
    assert isinstance(check, stancekit.FileCheck)
    assert (check.kind, check.accepted, check.to_json()["verdict"]) == (
        "no-posture",
        True,
        "accepted",
    )
    report = stancekit.verify(rows[0].ledger.folder)
    assert report.accepted
    for name, asked in (
        ("tolerance", {"tolerance": 1e-3}),
        ("robot", {"robot": "hexapod"}),
        ("course", {"course": "x"}),
    ):
        for where in (proof, rows[0].ledger.folder):
            with refuses(name):
                stancekit.verify(where, **asked)
    with refuses("none"):
        stancekit.verify("none")


def test_heights_of_a_file_are_walked_over_and_flattened(tmp_path: Path) -> None:
    np.save(tmp_path / "level.npy", np.zeros((21, 21)))
    field = stancekit.heights(tmp_path / "level.npy", spacing_m=0.2)
    assert field.domain_m == ((-2.0, 2.0), (-2.0, 2.0))
    fit = stancekit.warp(field, cells=(4, 4, 2))
    fit.map.check_fits(field)
    assert fit.report.least_det > 0.0
    raw = stancekit.walk(
        field, (0.2, 0.0), robot="hexapod", duration_s=2.5, chart="decoupled", raw=True
    )
    assert raw.effort.solves == 1  # the second phase would take more
    for name, asked in (
        ("seeds", {"seeds": 0}),
        ("dynamics", {"dynamics": "none"}),
        ("raw", {"raw": 1}),
    ):
        with refuses(name):
            stancekit.walk(field, (0.2, 0.0), **asked)
    for name, asked in (("cells", {"cells": (1, 4, 2)}), ("iterations", {"iterations": 0})):
        with refuses(name):
            stancekit.warp(field, **asked)
    with refuses("unit"):
        stancekit.heights(tmp_path / "level.npy", unit=1)
