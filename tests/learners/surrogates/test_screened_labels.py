"""Labels whose draws are screened: what is kept is proved, and the same whoever decides it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data import shards
from stancekit.learners.surrogates.surrogate import Surrogate
from stancekit.planners.errors import InvalidInput
from tests.refusals import assert_names, refuses


@pytest.fixture(scope="module")
def surrogate(tmp_path_factory: pytest.TempPathFactory) -> Surrogate:
    rows = stancekit.label("wall-3", tmp_path_factory.mktemp("rows") / "train", rows=(120, 120))
    return stancekit.fit(rows, "surrogate", epochs=20, batch=32)


def screened(folder: Path, surrogate: Surrogate, **more: object) -> stancekit.Dataset:
    how = {"rows": (10, 30), "seed": 4, "shard_size": 20, "screen_error": 0.2} | more
    return stancekit.label("wall-3", folder, screen=surrogate, **how)  # type: ignore[arg-type]


def files(folder: Path) -> list[str]:
    return [
        hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("shard-*"))
    ]


def test_kept_rows_are_proved_and_of_the_default_stream(
    surrogate: Surrogate, tmp_path: Path
) -> None:
    rows = screened(tmp_path / "s", surrogate)
    assert (len(rows.feasible), len(rows.infeasible)) == (10, 30)
    assert stancekit.verify(rows).accepted
    summary = rows.summary()
    assert summary.screened is not None
    assert summary.screened.feasible > 0
    assert (summary.screened.infeasible, summary.screen_error) == (0, 0.2)
    plain = LabelPlan(distribution="wall-3", feasible=10, infeasible=30, shard_size=20, seed=4)
    for shard in range(2):
        mine = [row for row in rows.rows() if row.shard == shard]
        stream = shards.samples(plain, shard)
        drawn = [next(stream) for _ in range(max(row.sample for row in mine) + 1)]
        assert all(row.problem.to_json() == drawn[row.sample].to_json() for row in mine)
    tally = rows.ledger.tallies[0]
    assert tally.screened is not None
    last = max(row.sample for row in rows.rows() if row.shard == 0)
    assert tally.drawn.total + tally.screened.total == last + 1


def test_rows_do_not_depend_on_blocks_and_workers(
    surrogate: Surrogate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    screened(tmp_path / "a", surrogate)
    screened(tmp_path / "b", surrogate, workers=2)
    for name, size in (("BLOCK", 7), ("SCREENED", 11)):
        monkeypatch.setattr(shards, name, size)
    screened(tmp_path / "c", surrogate)
    assert files(tmp_path / "a") == files(tmp_path / "b") == files(tmp_path / "c")


def test_without_a_screen_headers_and_shards_say_nothing_of_it(tmp_path: Path) -> None:
    rows = stancekit.label("wall-3", tmp_path / "p", rows=(3, 3))
    assert "screen" not in (tmp_path / "p" / "header.json").read_text()
    assert "screen" not in (tmp_path / "p" / "timing-00000.json").read_text()
    assert b"screened" not in (tmp_path / "p" / "shard-00000.parquet").read_bytes()
    assert "screened" not in json.dumps(rows.summary().to_json())


def test_a_screened_set_teaches_and_never_calibrates(surrogate: Surrogate, tmp_path: Path) -> None:
    rows = screened(tmp_path / "s", surrogate)
    plain = stancekit.label("wall-3", tmp_path / "p", rows=(20, 20), seed=7)
    both = stancekit.fit([plain, rows], "surrogate", epochs=1, calibration=None)
    card = both.provenance
    assert sum(card["calibrated_on"].values()) == round(0.35 * 20) * 2
    assert sum(card["learned_from"].values()) == 80 - round(0.35 * 20) * 2
    with refuses("calibration"):
        stancekit.fit(plain, "surrogate", epochs=1, calibration=rows)
    with refuses("calibration"):
        stancekit.fit(rows, "surrogate", epochs=1)


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"screen_error": 0.0}, "screen_error"),
        ({"screen_error": 1.0}, "screen_error"),
        ({"natural": True}, "screen"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(
    surrogate: Surrogate, tmp_path: Path, more: dict[str, object], line: str
) -> None:
    with pytest.raises(InvalidInput) as caught:
        screened(tmp_path / "x", surrogate, **more)
    assert_names(str(caught.value), line)


def test_a_surrogate_of_another_class_is_refused(surrogate: Surrogate, tmp_path: Path) -> None:
    with refuses("screen"):
        stancekit.label("ground-3", tmp_path / "g", rows=(2, 2), screen=surrogate)
    with refuses("screen_error"):
        stancekit.label("wall-3", tmp_path / "w", rows=(2, 2), screen_error=0.1)


def test_a_set_is_gone_on_with_by_the_same_surrogate_alone(
    surrogate: Surrogate, tmp_path: Path
) -> None:
    screened(tmp_path / "s", surrogate)
    (tmp_path / "s" / "shard-00001.parquet").unlink()
    with refuses("screen_error"):
        screened(tmp_path / "s", surrogate, screen_error=0.1)
    with refuses("screen"):
        stancekit.label("wall-3", tmp_path / "s", rows=(10, 30), seed=4, shard_size=20)
    assert np.all(screened(tmp_path / "s", surrogate).labels != "undecided")
