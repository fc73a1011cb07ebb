"""The list of stands: its rows, its grounds, and lines of results that survive a kill."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def scripts() -> Iterator[None]:
    """Scripts of benchmarks/ import each other from their own folder."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    yield
    sys.path.remove(str(ROOT / "benchmarks"))


@pytest.fixture(scope="module")
def listed(scripts: None) -> ModuleType:
    import _stand_list

    return _stand_list


@pytest.fixture(scope="module")
def commands(scripts: None) -> ModuleType:
    import _stand_commands

    return _stand_commands


def test_the_list_has_sixteen_robots_on_six_grounds_in_three_draws(listed: ModuleType) -> None:
    rows = list(listed.entries())
    assert len({row.name for row in rows}) == len(rows) == 16 * 6 * 3
    assert set(Counter(row.robot for row in rows).values()) == {18}
    assert [row.draw for row in rows] == sorted(row.draw for row in rows)
    files = [row.source for row in rows if Path(row.source).suffix]
    assert files
    assert all(Path(file).exists() for file in files)


def test_rises_are_as_they_are_called_for_all_but_short_robots(listed: ModuleType) -> None:
    for row in listed.entries():
        if row.kind == "stairs-10":
            tops = np.unique(row.ground().solids[:, :, 2].max(axis=1).round(9))
            rise = 0.1 * min(1.0, row.height_m / 0.3)
            np.testing.assert_allclose(np.diff(tops), rise, atol=1e-9)


def test_grounds_are_the_same_whenever_they_are_drawn_and_differ_by_draw(
    listed: ModuleType,
) -> None:
    by_name = {row.name: row for row in listed.entries()}
    for kind in {row.kind for row in by_name.values()}:
        one, again, other = (by_name[f"go1-{kind}-{draw}"].ground() for draw in (0, 0, 1))
        np.testing.assert_array_equal(one.solids, again.solids)
        assert one.friction == again.friction != other.friction
        assert one.goal_m[0] > one.start_m[0]


def test_meshes_of_grounds_point_outward(listed: ModuleType, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    for row in list(listed.entries())[:6]:
        ground = row.ground()
        ground.write(tmp_path / "ground.obj")
        mesh = trimesh.load(tmp_path / "ground.obj", process=False)
        volumes = [
            np.linalg.det(
                mesh.vertices[mesh.faces[12 * k : 12 * k + 12]] - mesh.vertices[8 * k]
            ).sum()
            / 6.0
            for k in range(len(ground.solids))
        ]
        assert len(volumes) == len(ground.solids)
        assert min(volumes) > 0.0


def test_lines_go_on_after_a_kill_in_the_middle_of_one(listed: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    lines = listed.Lines(path)
    lines.add("a", {"x": 1})
    lines.add("b", {"x": 2})
    path.write_text(path.read_text() + '{"key": "c", "x"')
    again = listed.Lines(path)
    assert list(again.rows) == ["a", "b"]
    again.add("c", {"x": 3})
    assert [json.loads(line) for line in path.read_text().splitlines()] == [
        {"key": "a", "x": 1},
        {"key": "b", "x": 2},
        {"key": "c", "x": 3},
    ]


def test_margins_are_kept_wherever_a_verdict_has_them(commands: ModuleType) -> None:
    verdict = {
        "groups": [{"group": "push_n", "value": 12.5}, {"group": "patch", "value": 0.0}],
        "figures": {"support_m": 0.02},
        "friction_left": 0.3,
    }
    assert commands.margins(verdict) == {"push_n": 12.5, "support_m": 0.02, "friction_left": 0.3}
    assert commands.margins({}) == {}


def test_the_settings_and_the_list_say_what_the_issue_fixes() -> None:
    settings = yaml.safe_load((ROOT / "benchmarks" / "stands" / "referee.yaml").read_text())
    assert settings["falls"] == {"com_m": 0.12, "rotation_rad": 0.6}
    listed = yaml.safe_load((ROOT / "benchmarks" / "stands" / "list.yaml").read_text())
    assert list(listed["grounds"]) == ["stairs-6", "stairs-10", "gap", "slope", "slabs", "blocks"]
