"""Maps as files: what is written is read, and what is damaged is refused in one line."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.standing_map import (
    FEASIBLE,
    INFEASIBLE,
    UNKNOWN,
    StandingMap,
)
from tests.refusals import refuses


def made(shape: tuple[int, int, int] = (4, 3, 2)) -> StandingMap:
    rng = np.random.default_rng(0)
    return StandingMap(
        terrain="blocks-0",
        robot="hexapod",
        identity="",
        friction=0.5,
        corner_m=np.array([-1.0, 2.0]),
        spacing_m=0.1,
        headings_rad=np.array([0.0, np.pi])[: shape[2]],
        verdict=rng.integers(0, 5, shape).astype(np.uint8),
        limit=rng.integers(0, 8, shape).astype(np.uint8),
        margin=np.where(rng.random(shape) < 0.5, np.nan, 0.02).astype(np.float32),
        support_m=np.where(rng.random(shape) < 0.5, np.nan, 0.02).astype(np.float32),
        push_n=np.full(shape, np.nan, dtype=np.float32),
        z_m=np.zeros(shape, dtype=np.float32),
        aside_m=0.2,
        error=0.01,
        confidence=0.95,
        seconds={"proving": 1.5},
        card={"limits": [None, 1.0]},
    )


def changed(**keys: object) -> np.ndarray:
    """The head of a map's file, with other keys."""
    found = made()
    head = {**found.to_json(), "headings_rad": found.headings_rad.tolist(), **keys}
    return np.array(json.dumps(head))


def test_a_way_that_is_planned_in_its_own_frame_keeps_off_where_the_map_says() -> None:
    verdict = np.full((81, 81, 1), FEASIBLE, dtype=np.uint8)
    verdict[40:55, 52:62] = INFEASIBLE
    whole = replace(
        made((81, 81, 1)), verdict=verdict, corner_m=np.array([-2.0, -2.0]), spacing_m=0.05
    )
    barred = np.array([[0.0, 0.6], [0.65, 1.1]])
    ways = list[bool]()
    for standing in (None, replace(whole, friction=0.8)):
        asked = laid_between("slopes:0:4", (0.0, 0.0), (0.7, 1.6), standing=standing)
        frame = asked.frame
        assert frame is not None
        way = frame.places(asked.local("inner").com_nominal_m)[:, :2]
        np.testing.assert_allclose(way[[0, -1]], [[0.0, 0.0], [0.7, 1.6]], atol=1e-9)
        ways.append(bool(np.all((way > barred[0]) & (way < barred[1]), axis=1).any()))
    assert ways == [True, False]


def test_a_map_comes_back_from_its_file(tmp_path: Path) -> None:
    found = made()
    found.save(tmp_path / "m.npz")
    again = StandingMap.read(tmp_path / "m.npz")
    assert again.to_json() == found.to_json()
    for name in ("verdict", "limit", "margin", "z_m", "headings_rad"):
        assert np.array_equal(getattr(again, name), getattr(found, name), equal_nan=True)
    found.save(tmp_path / "m.json")
    record = json.loads((tmp_path / "m.json").read_text())
    assert record["verdict"] == found.verdict.tolist()
    assert record["counts"] == found.counts()
    assert sum(found.counts().values()) == 24
    with refuses(".npz", ".json"):
        found.save(tmp_path / "m.tif")


def test_the_nearest_place_and_heading_answer(tmp_path: Path) -> None:
    found = made()
    assert found.at(np.array([-0.71, 2.19]), 0.1) == found.verdict[3, 2, 0]
    assert found.at(np.array([-0.71, 2.19]), -3.0) == found.verdict[3, 2, 1]
    beyond = found.at(np.array([[-1.06, 2.0], [5.0, 5.0], [-0.64, 2.0]]), 0.0)
    assert beyond.tolist() == [UNKNOWN] * 3
    assert found.place((3, 2, 1)) == pytest.approx((-0.7, 2.2, np.pi))


def test_what_is_in_the_way_is_counted_over_what_is_proved() -> None:
    found = made()
    assert sum(found.in_the_way().values()) == found.counts()["infeasible"]
    shares = found.shares()
    proved = np.isin(found.verdict, (FEASIBLE, INFEASIBLE)).mean()
    assert shares["proved"] == pytest.approx(float(proved))


def listed(content: bytes, at: int, value: int) -> bytes:
    """An archive with another byte in the first entry of its directory."""
    at += content.index(b"PK\x01\x02")
    return content[:at] + bytes([value]) + content[at + 1 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda c: c[:-30],
        lambda c: b"",
        lambda c: b"PK\x03\x04nothing",
        lambda c: c[: len(c) // 2] + c[len(c) // 2 + 9 :],
        lambda c: c[:120] + bytes(b ^ 0x5A for b in c[120:140]) + c[140:],
        lambda c: listed(c, 6, 0x99),  # version
        lambda c: listed(c, 8, 0x01),  # encrypted
        lambda c: listed(c, 10, 0x63),  # compression
    ],
)
def test_a_damaged_file_is_refused_in_one_line(damage, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    made().save(tmp_path / "m.npz")
    (tmp_path / "m.npz").write_bytes(damage((tmp_path / "m.npz").read_bytes()))
    with refuses():
        StandingMap.read(tmp_path / "m.npz")


def forged(tmp_path: Path, **changes: object) -> Path:
    made().save(tmp_path / "m.npz")
    with np.load(tmp_path / "m.npz") as held:
        arrays = {name: held[name] for name in held.files}
    np.savez(tmp_path / "f.npz", **{**arrays, **changes})  # type: ignore[arg-type]
    return tmp_path / "f.npz"


@pytest.mark.parametrize(
    "changes",
    [
        {"verdict": np.full((4, 3, 2), 9, dtype=np.uint8)},
        {"verdict": np.zeros((4, 3), dtype=np.uint8)},
        {"limit": np.zeros((4, 3, 1), dtype=np.uint8)},
        {"margin": np.zeros((4, 3, 2))},
        {"more": np.zeros(3)},
        {"head": np.array("{}")},
        {"head": np.array("[1]")},
        {"head": np.array(json.dumps({"format": "stancekit/standing-map/2"}))},
        {"head": np.array([object()], dtype=object)},
        {"head": np.array("[" * 100_000)},
        {"head": changed(spacing_m=10**400)},
        {"head": changed(seconds={"proving": 10**400})},
        {"head": changed(friction=math.nan)},
        {"head": np.array(str(changed()).replace('"spacing_m": 0.1', '"spacing_m": 1e999'))},
        {"head": changed(error=None)},
        {"head": changed(doubts="no lines of texts")},
        {
            name: np.zeros((0, 3, 2), dtype=kind)
            for name, kind in (("verdict", "u1"), ("limit", "u1"), ("margin", "f4"), ("z_m", "f4"))
        },
    ],
)
def test_a_forged_file_is_refused(changes: dict[str, object], tmp_path: Path) -> None:
    with refuses():
        StandingMap.read(forged(tmp_path, **changes))
