"""A ground is named alike for every command: one table, one line for a bad name."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from stancekit.cli.main import main
from stancekit.planners.formats.trajectory_file import check_file
from stancekit.planners.terrain.families import (
    TERRAIN_FAMILIES,
    terrain_family,
)
from stancekit.planners.terrain.reference import named_terrain
from stancekit.terrains import ground

ROOT = Path(__file__).resolve().parents[2]
SHORT = ("--goal", "0.2,0", "--duration-s", "3", "--raw")


def test_help_and_documentation_list_the_one_table(stancekit, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    said = stancekit("terrain", "--help").out
    told = re.sub(r"[│\s]+", " ", said)
    page = (ROOT / "docs" / "terrain.md").read_text(encoding="utf-8")
    for name in TERRAIN_FAMILIES.names():
        assert f" {name} {terrain_family(name).quantity} " in told
        assert f"| `{name}` | " in page


def test_a_walk_goes_over_the_ground_that_a_plan_stands_on(stancekit):
    assert stancekit("gait", "stairs:0.1:7", *SHORT, "--out", "walk.json").code == 0
    walked = check_file("walk.json").answer.terrain
    assert walked.name == "stairs:0.1:7"
    stancekit(
        "plan", "stairs:0.1:7", "--out", "plan.json"
    )  # which the verifier refuses: bodies collide
    course = json.loads(Path("plan.json").read_text(encoding="utf-8"))["course"]
    corners = [np.array(patch["vertices_m"]) for patch in course["terrain"]]
    treads = [each for each in corners if np.ptp(each[:, 2]) == 0.0]
    assert len(treads) > 5
    for tread in treads:
        middle = tread.mean(axis=0)  # far from both edges, which are 0.24 m or more apart
        assert float(walked.height(middle[:2])) == pytest.approx(middle[2], abs=1e-3)


def test_key_frames_go_over_any_ground_by_its_name(stancekit):
    (smooth,) = stancekit("plan", "rough:0.2:1", "--json").records
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


def test_a_function_of_x_and_y_is_a_family_for_key_frames_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
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
    with pytest.raises(SystemExit) as ended:
        main(["plan", "mine.py:rolling:0.2:3", "--json"])
    assert ended.value.code == 0


def test_a_mesh_that_no_map_has_so_far_away_is_refused_with_what_mends_it(refusal):
    corners = "".join(f"v {x} {y} 1000000\n" for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2)))
    Path("far.obj").write_text(f"{corners}f 1 2 3\nf 1 3 4\n")
    said = refusal("plan", "far.obj", "--start=0,0", "--goal", "0.1,0")
    assert said.startswith("far.obj: expected a terrain within 900000 m of the origin")
    assert "--offset-m moves it, by 0,0,-1000000" in said
