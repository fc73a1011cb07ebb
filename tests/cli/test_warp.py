"""``stancekit warp``: what it writes, what it says, and its exit codes."""

import json

import numpy as np
import pytest

from stancekit.cli.main import run
from stancekit.cli.options import TerrainFile
from stancekit.cli.warp import Warp
from stancekit.planners.terrain.terrain_file import read_heights
from stancekit.planners.warp.spline_map import SplineMap

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
