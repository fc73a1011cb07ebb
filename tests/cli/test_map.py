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


def test_a_file_means_what_its_options_say(stancekit, tmp_path):
    sideways = [f"v {y} 0 {x}" for x, y in ((-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5))]
    (tmp_path / "y.obj").write_text("\n".join([*sideways, "f 1 2 3", "f 1 3 4", ""]))
    np.save(tmp_path / "flat.npy", np.zeros((31, 31)))
    how = ("--spacing-m", "0.5", "--headings", "1", "--json")
    ran = stancekit("map", "y.obj", *how, "--up", "y", "--margin-m", "0.05")
    assert ran.code == 0
    assert ran.records[0]["options"]["up"] == "y"
    assert ran.records[0]["options"]["limits"]["margin_m"] == 0.05
    assert ran.records[0]["counts"]["feasible"] > 0
    ran = stancekit("map", "flat.npy", *how, "--grid-m", "0.1", "--offset-m=5,0,0")
    assert ran.code == 0
    assert ran.records[0]["options"] == {"spacing_m": 0.1, "offset_m": [5.0, 0.0, 0.0]}
    assert ran.records[0]["corner_m"][0] > 3.9


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--grid-m", "0"), "--grid-m: expected a number in (0, 200], got 0"),
        (("--up", "y"), "level.obj: expected footholds, got none"),
        (("--margin-m", "9"), "level.obj: expected footholds, got none"),
        (("--heights-m", "0,1"), "--heights-m: expected a .png with it, got level.obj"),
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
    over = stancekit(*where, "--map", "whole.npz")
    assert over.code == 0  # the map is of the robot as it stands, facing along x: it bars nothing
    ran = stancekit("plan", "walls", "--map", "half.npz")
    assert ran.code == 2
    assert ran.err.startswith("stancekit: error: --map: expected a terrain's file as COURSE")
    (tmp_path / "other.obj").write_bytes(b"# another\n" + (tmp_path / level).read_bytes())
    ran = stancekit("plan", "other.obj", *where[2:], "--map", "half.npz")
    assert ran.code == 2
    assert ran.err.startswith("stancekit: error: --map: expected a map of other-")
    ran = stancekit(*where, "--friction", "0.9", "--map", "half.npz")
    assert ran.code == 2
    assert "--map: expected a map at a friction of 0.9 or more, got 0.8" in ran.err
    (tmp_path / "no.npz").write_bytes(b"nothing")
    ran = stancekit(*where, "--map", "no.npz")
    assert ran.code == 2
    assert "expected a map of `stancekit map`" in ran.err
