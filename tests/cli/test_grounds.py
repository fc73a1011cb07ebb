"""A ground is named alike for every command: one table, one line for a bad name."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from stancekit import FootholdLimits
from stancekit.cli.main import run
from stancekit.cli.options import FootholdOptions, TerrainFile
from stancekit.cli.terrain import Warp
from stancekit.planners.formats.motion_file import check_file
from stancekit.planners.problem.standing_map import StandingMap
from stancekit.planners.terrain.families import TERRAIN_FAMILIES
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.reference import named_terrain
from stancekit.planners.terrain.terrain_file import read_heights
from stancekit.planners.warp.spline_map import SplineMap
from stancekit.terrains import ground

ROOT = Path(__file__).resolve().parents[2]
SHORT = ("--goal", "0.2,0", "--duration-s", "3", "--raw")


def test_help_and_documentation_list_the_one_table(stancekit, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    said = stancekit("terrain", "--help").out
    told = re.sub(r"[│\s]+", " ", said)
    page = (ROOT / "docs" / "reference" / "grounds.md").read_text(encoding="utf-8")
    for name in TERRAIN_FAMILIES.names():
        level = " ".join((TERRAIN_FAMILIES.get(name).__doc__ or name).split("\n\n")[0].split())[:-1]
        assert f" {name} {level[0].lower()}{level[1:]} " in told
        assert f"| `{name}` | " in page


def test_a_walk_goes_over_the_ground_that_a_plan_stands_on(stancekit):
    assert stancekit("gait", "stairs:0.1:7", *SHORT, "--out", "walk.json").code == 0
    walked = check_file("walk.json").report.answer.problem.terrain
    assert walked.name == "stairs:0.1:7"
    assert stancekit("export", "walk.json", "--to", "csv").code == 0
    (record,) = stancekit(
        "verify", "walk.csv", "--robot", "anymal", "--terrain", walked.name, "--json"
    ).records  # over the heights that it was made on
    assert record["verdict"] == "accepted"
    stancekit(
        "plan", "stairs:0.1:7", "--out", "plan.json"
    )  # which the verifier refuses: bodies collide
    course = json.loads(Path("plan.json").read_text(encoding="utf-8"))["question"]
    corners = [np.array(patch["vertices_m"]) for patch in course["terrain"]]
    treads = [each for each in corners if np.ptp(each[:, 2]) == 0.0]
    assert len(treads) > 5
    for tread in treads:
        middle = tread.mean(axis=0)  # far from both edges, which are 0.24 m or more apart
        assert float(walked.height(middle[:2])) == pytest.approx(middle[2], abs=1e-3)


def test_key_frames_go_over_any_ground_by_its_name(stancekit):
    (smooth,) = stancekit("plan", "rough:0.2:1", "--frames", 3, "--json").records
    assert smooth["status"] == "feasible"
    (between,) = stancekit(
        "plan", "rough:0:1", "--start", "0,0", "--goal", "0.3,0", "--json"
    ).records
    assert between["status"] == "feasible"


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (
            ("gait", "walls:0.5:7", "--goal", "1,0"),
            "terrain: expected ground to walk on, got walls, whose surfaces are ",
        ),
        (
            ("gait", "lava:0.5:7", "--goal", "1,0"),
            "terrain: expected a file, one of ripple, cone, hill, pit, pit-84, ",
        ),
        (
            ("plan", "lava:0.5:7"),
            "family: expected one of stairs, stones, gaps, beams, rubble, slopes, walls, rough, ",
        ),
        (("gait", "stairs:1.5:7", "--goal", "1,0"), "level: expected a number in [0, 1], got 1.5"),
        (("plan", "rough:-0.1:7"), "level: expected a number in [0, 1], got -0.1"),
        (("terrain", "stones:nan:7"), "level: expected "),
        (
            ("warp", "rough:0.5:x"),
            "terrain: expected rough:LEVEL:SEED as in rough:0.5:7, got 'rough:0.5:x'",
        ),
        (
            ("plan", "waves:0.5:1.5"),
            "course: expected waves:LEVEL:SEED as in waves:0.5:7, got 'waves:0.5:1.5'",
        ),
        (
            ("sample", "terrain-3", "--terrain", "stairs:0.5:-1"),
            "seed: expected a whole number of 0 or more, got -1",
        ),
        (("terrain", "walls:0.5:7"), "walls:0.5:7: expected footholds, got none: "),
        (("plan", "ripple"), "course: expected one of "),
        (
            ("plan", "moon", "--start", "0,0", "--goal", "1,0"),
            "--start: expected a terrain's file as COURSE, .npy, ",
        ),
    ],
)
def test_what_is_no_ground_is_refused_in_one_line(asked, words, refusal):
    assert refusal(*asked).startswith(words)


def test_a_function_of_x_and_y_is_a_family_for_key_frames_too(stancekit):
    Path("mine.py").write_text(
        "import numpy as np\n\n\ndef rolling(level, rng):\n"
        '    """Height of the waves: 0.1 · level m."""\n'
        "    phase = rng.uniform(0.0, 6.0)\n    return lambda x, y: 0.1 * level * np.sin(2.0 * x + phase)\n\n\n"
        "def wrong(level, rng):\n    return 3\n"
    )
    made = ground("mine.py:rolling:0.5:3")
    np.testing.assert_array_equal(
        made.heights.heights_m, named_terrain("mine.py:rolling:0.5:3").heights_m
    )
    assert made.footholds
    assert stancekit("plan", "mine.py:rolling:0.2:3", "--json").code == 0


def test_a_mesh_that_no_map_has_so_far_away_is_refused_with_what_mends_it(refusal):
    corners = "".join(f"v {x} {y} 1000000\n" for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2)))
    Path("far.obj").write_text(f"{corners}f 1 2 3\nf 1 3 4\n")
    said = refusal("plan", "far.obj", "--start=0,0", "--goal", "0.1,0")
    assert said.startswith("far.obj: expected a terrain within 900000 m of the origin")
    assert "--offset-m moves it, by 0,0,-1000000" in said


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
    assert "push [N]" in ran.out
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
def test_bad_input_is_one_line(refusal, level, options, line):
    assert refusal("map", level, *options).startswith(line)


def test_a_plan_keeps_off_places_of_a_map(stancekit, level, tmp_path, refusal):
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
    assert refusal("plan", "walls", "--map", "half.npz").startswith(
        "--map: expected a terrain's file as COURSE"
    )
    (tmp_path / "other.obj").write_bytes(b"# another\n" + (tmp_path / level).read_bytes())
    assert refusal("plan", "other.obj", *where[2:], "--map", "half.npz").startswith(
        "--map: expected a map of other-"
    )
    assert "--map: expected a map at a friction of 0.9 or more, got 0.8" in refusal(
        *where, "--friction", "0.9", "--map", "half.npz"
    )
    (tmp_path / "no.npz").write_bytes(b"nothing")
    assert "expected a map of `stancekit map`" in refusal(*where, "--map", "no.npz")


QUICK = {"cells": "8,8,3"}


@pytest.fixture
def grid(tmp_path):
    x = np.linspace(-1.0, 1.0, 41)
    np.save(tmp_path / "grid.npy", 0.1 * np.sin(3.0 * x[:, None]) * np.cos(2.0 * x))
    return tmp_path / "grid.npy"


def test_a_map_is_made_written_and_reported(grid, tmp_path, capsys):
    assert (
        run(
            Warp(
                str(grid),
                **QUICK,
                out=tmp_path / "map.npz",
                picture=tmp_path / "map.png",
                json=True,
            )
        )
        == 0
    )
    (line,) = capsys.readouterr().out.splitlines()
    record = json.loads(line)
    assert record["least_det"] > 0.0
    assert record["match_max_mm"] < 1.0
    warp, field = SplineMap.from_file(tmp_path / "map.npz"), read_heights(grid)
    warp.check_fits(field)
    ground = warp.points(np.array([[0.3, -0.4, 0.0]]))[0]
    assert abs(ground[2] - field.height(ground[:2])) < 1e-3
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_without_json_there_is_a_table(grid, capsys):
    assert run(Warp(str(grid), **QUICK)) == 0
    assert "min det J" in capsys.readouterr().out


def test_a_published_map_that_folds_ends_with_one(capsys):
    assert run(Warp("hill", cells="12,12,4", method="local-global", iterations=15, json=True)) == 1
    assert json.loads(capsys.readouterr().out)["least_det"] < 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cells": "8,8"}, "--cells: expected 3 numbers with commas between them, got '8,8'"),
        ({"cells": "1,8,3"}, "--cells: expected three whole numbers in [2, 200], got (1, 8, 3)"),
        ({"height_m": -1.0}, "--height-m: expected a number in (0, 100], got -1"),
        ({"iterations": 0}, "--iterations: expected 1 to 10000, got 0"),
        ({"file": TerrainFile(heights_m="0,1")}, "--heights-m: expected a .png with it, got "),
        (
            {"file": TerrainFile(heights_m="0")},
            "--heights-m: expected 2 numbers with commas between them, got '0'",
        ),
        ({"file": TerrainFile(spacing_m=0.0)}, "--spacing-m: expected a number in (0, 200], got 0"),
    ],
)
def test_bad_options_are_one_line_and_two(grid, capsys, options, message):
    assert run(Warp(str(grid), **(QUICK | options))) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"stancekit: error: {message}")
    assert said.err.count("\n") == 1


def test_a_terrain_that_is_not_there_says_what_could_be(capsys):
    assert run(Warp("moon")) == 2
    assert capsys.readouterr().err.startswith(
        "stancekit: error: terrain: expected a file, one of ripple, cone"
    )


def test_options_have_the_defaults_of_what_they_stand_for() -> None:
    assert [
        each.name
        for kind, of in ((FootholdOptions, FootholdLimits), (TerrainFile, ImportOptions))
        for each in fields(kind)
        if each.default and getattr(of, each.name) != each.default
    ] == []
