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


@pytest.fixture(scope="module")
def pushes(scripts: None) -> ModuleType:
    import _stand_pushes

    return _stand_pushes


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


def test_meshes_of_grounds_point_outward(listed: ModuleType, tmp_path: Path) -> None:
    import trimesh

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


def test_pushes_compare_what_is_said_with_the_worst_direction(pushes: ModuleType) -> None:
    """Of three stances one is sound, one bears less than is said, and one was not pushed everywhere
    yet.
    """
    held = {"a:0": [30.0, 12.0] + [20.0] * 6, "b:1": [9.0] * 8, "c:2": [1.0] * 3}
    said = {"a:0": 10.0, "b:1": 12.0, "c:2": 10.0}
    lines = [
        {
            "key": f"{stance}:{turn:.0f}",
            "stance": int(stance[-1]),
            "towards_deg": turn,
            "said_n": said[stance],
            "held_n": value,
            "weight_n": 100.0,
        }
        for stance, values in held.items()
        for turn, value in zip(pushes.TURNS_DEG, values, strict=False)
    ]
    found = pushes.summary(lines)
    assert (found["stances"], found["above"], found["far_above"]) == (2, 1, 1)
    assert found["ratio"] == [0.75, 0.975, 1.2]
    assert found["said"] == [0.1, 0.11, 0.12]
    assert found["held"] == [0.09, 0.105, 0.12]
    assert found["worst"] == ["b:1: said 12 N, held 9 N towards 90 deg"]
