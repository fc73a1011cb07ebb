"""Exported scenes: what is read back is what was drawn, and the verdicts are those of the
courses.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from stancekit.cli.main import main
from stancekit.learners.data.leap_tries import export_scenes
from stancekit.planners.answer.answer import Status
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.terrain.families import family_terrain
from stancekit.planners.terrain.patch import Patch
from tests.refusals import refuses


@pytest.fixture(scope="module")
def planner():
    return TwoStagePlanner()


def test_scenes_are_read_back_as_they_were_drawn(tmp_path, planner):
    export_scenes(tmp_path / "set", "slopes", 0.7, count=4, planner=planner, seed=2, spacing_m=0.05)
    index = json.loads((tmp_path / "set" / "scenes.json").read_text())
    assert (index["format"], index["family"], index["level"]) == (
        "stancekit/scenes/1",
        "slopes",
        0.7,
    )
    assert {scene["status"] for scene in index["scenes"]} == {"feasible", "infeasible"}
    for number, scene in enumerate(index["scenes"], 2):
        drawn = family_terrain("slopes", 0.7, number)
        assert (scene["seed"], scene["figures"]) == (number, drawn.figures)
        heights = np.load(tmp_path / "set" / scene["heights"], allow_pickle=False)
        x = scene["corner_m"][0] + scene["spacing_m"] * np.arange(len(heights))
        np.testing.assert_allclose(
            heights, np.tan(0.56) * x[:, None] * np.ones(heights.shape[1]), atol=1e-12
        )
        (surface,) = scene["surfaces"]
        shape = {key: np.array(surface[key]) for key in ("vertices_m", "normal")}
        patch = Patch(
            **shape, friction=surface["friction"], shear_reference=np.array([1.0, 0.0, 0.0])
        )
        np.testing.assert_array_equal(patch.vertices_m, drawn.patches[0].vertices_m)
        status = planner.solve(read_course(f"slopes:0.7:{number}")).status
        assert scene["status"] == status.value
        assert (scene["proof"] == "certificate") == (status is Status.INFEASIBLE)


def test_the_command_writes_walls_as_surfaces_and_says_what_came(tmp_path, capsys):
    folder = tmp_path / "walls"
    with pytest.raises(SystemExit) as left:
        main(["sample", "walls:1.0", "--count", "3", "--export", str(folder), "--json"])
    assert left.value.code == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["scenes"], said["infeasible"]) == (3, 3)
    assert [path.name for path in folder.iterdir()] == ["scenes.json"]
    scenes = json.loads((folder / "scenes.json").read_text())["scenes"]
    assert all(len(scene["surfaces"]) == 2 and scene["proof"] for scene in scenes)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["wall-3", "--export", "new"],
            "--export: expected FAMILY:LEVEL as in stairs:0.6, got 'wall-3'",
        ),
        (
            ["stairs:high", "--export", "new"],
            "--export: expected FAMILY:LEVEL as in stairs:0.6, got 'stairs:high'",
        ),
        (["stairs:1.5", "--export", "new"], "level: expected"),
        (
            ["stairs:0.5", "--export", "new", "--robot", "r.urdf"],
            "--robot: expected none with --export, got r.urdf",
        ),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(
    tmp_path, monkeypatch, capsys, arguments, said
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["sample", *arguments])
    assert left.value.code == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_something_in_it_is_left_alone(tmp_path, planner):
    (tmp_path / "kept.txt").write_text("kept")
    with refuses():
        export_scenes(tmp_path, "slopes", 0.1, count=1, planner=planner)
    assert [path.name for path in tmp_path.iterdir()] == ["kept.txt"]
