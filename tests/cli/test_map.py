"""`stancekit map`, and `stancekit plan --map` along what it says."""

import numpy as np
import pytest

from stancekit.planners.problem.standing_map import StandingMap

LEVEL = """v -1.5 -1.5 0
v 1.5 -1.5 0
v 1.5 1.5 0
v -1.5 1.5 0
f 1 2 3
f 1 3 4
"""


@pytest.fixture
def level(tmp_path):
    (tmp_path / "level.obj").write_text(LEVEL)
    return "level.obj"


def test_a_map_is_written_drawn_and_said(stancekit, level, tmp_path):
    ran = stancekit(
        "map",
        level,
        "--spacing-m",
        "0.5",
        "--headings",
        "2",
        "--out",
        "m.npz",
        "--picture",
        "m.png",
    )
    assert ran.code == 0
    assert "proved" in ran.out
    assert "wrote m.png" in ran.out
    assert (tmp_path / "m.png").stat().st_size > 1000
    ran = stancekit("map", level, "--spacing-m", "0.5", "--headings", "2", "--json")
    (record,) = ran.records
    assert record["counts"] == StandingMap.read(tmp_path / "m.npz").counts()
    assert record["shares"]["proved"] == 1.0


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--error", "0"), "--error: expected a number above 0 and below 1, got 0"),
        (("--error", "1"), "--error: expected a number above 0 and below 1, got 1"),
        (("--spacing-m", "9"), "--spacing-m: expected a grid of one cell or more"),
        (("--headings", "0"), "--headings: expected 1 to 3600, got 0"),
        (("--time-limit-s", "0"), "--time-limit-s: expected a number above 0"),
        (("--out", "m.tif"), "--out: expected a name that ends in .npz or .json, got m.tif"),
        (("--robot", "nobody.urdf"), "nobody.urdf: expected a file, found nothing there"),
    ],
)
def test_bad_input_is_one_line(stancekit, level, options, line):
    ran = stancekit("map", level, *options)
    assert ran.code == 2
    assert ran.err.startswith(f"stancekit: error: {line}")
    assert ran.err.count("\n") == 1


def test_a_plan_keeps_off_places_of_a_map(stancekit, level, tmp_path):
    stancekit("map", level, "--spacing-m", "0.1", "--headings", "1", "--out", "m.npz")
    found = StandingMap.read(tmp_path / "m.npz")
    x = found.corner_m[0] + found.spacing_m * np.arange(found.shape[0])
    y = found.corner_m[1] + found.spacing_m * np.arange(found.shape[1])
    wall = (np.abs(x) < 0.15)[:, None] & (y < 0.3)[None]
    found.verdict[wall] = 2
    found.save(tmp_path / "half.npz")
    found.verdict[np.abs(x) < 0.15] = 2
    found.save(tmp_path / "whole.npz")
    where = ("plan", level, "--start=-0.6,-0.2", "--goal=0.6,-0.2", "--json")
    straight, round_it = stancekit(*where), stancekit(*where, "--map", "half.npz")
    assert (straight.code, round_it.code) == (0, 0)
    highest = [
        max(row[1] for row in ran.records[0]["plan"]["com_m"]) for ran in (straight, round_it)
    ]
    assert highest[0] < 0.0
    assert highest[1] > 0.2
    barred = stancekit(*where, "--map", "whole.npz")
    assert barred.code == 1
    assert "places of the map where hexapod cannot stand" in barred.err
    ran = stancekit("plan", "walls", "--map", "half.npz")
    assert ran.code == 2
    assert ran.err.startswith("stancekit: error: --map: expected a terrain's file as COURSE")
    (tmp_path / "no.npz").write_bytes(b"nothing")
    ran = stancekit(*where, "--map", "no.npz")
    assert ran.code == 2
    assert "expected a map of `stancekit map`" in ran.err
