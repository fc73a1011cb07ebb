"""The list of stands: its rows, its grounds, and lines of results that survive a kill."""

from __future__ import annotations

import json
import sys
import time
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


def test_the_settings_and_the_list_say_what_the_issue_fixes() -> None:
    settings = yaml.safe_load((ROOT / "benchmarks" / "stands" / "referee.yaml").read_text())
    assert settings["falls"] == {"com_m": 0.12, "rotation_rad": 0.6}
    listed = yaml.safe_load((ROOT / "benchmarks" / "stands" / "list.yaml").read_text())
    assert list(listed["grounds"]) == ["stairs-6", "stairs-10", "gap", "slope", "slabs", "blocks"]


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


def test_a_push_in_another_direction_goes_no_farther_than_the_worst_so_far(
    pushes: ModuleType, listed: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    class Row:
        def __init__(self, held_n: float) -> None:
            self.held_n = held_n

        def json(self) -> dict[str, float]:
            return {"held_n": self.held_n}

    def pushed(file, settings, wrong, each):  # type: ignore[no-untyped-def]
        for push in each:
            asked.append(push.most_n)
            yield Row(min(push.most_n, 20.0 - len(asked)))

    robot = type("Robot", (), {"mass_kg": 10.0})
    played = type("Played", (), {"robot": robot, "gravity_m_s2": 10.0})
    monkeypatch.setattr(pushes, "read", lambda file: played)
    monkeypatch.setattr(pushes, "said_n", lambda file: [1.0, 2.0])
    monkeypatch.setattr(pushes, "pushed", pushed)
    settings = type("Settings", (), {"sha256": "0" * 64})
    wrong = type("Wrong", (), {"said": dict})()
    file, lines = tmp_path / "stands" / "plans" / "a.json", listed.Lines(tmp_path / "lines.jsonl")
    for key, row in pushes.rows(file, [1], lines, settings, wrong, 1.0, False):
        lines.add(key, row)
    assert asked[:3] == [100.0, 19.0, 18.0]
    assert len(lines.rows) == len(pushes.TURNS_DEG)
    assert list(pushes.rows(file, [1], lines, settings, wrong, 1.0, False)) == []
    assert {row["said_n"] for row in lines.rows.values()} == {2.0}


def test_the_table_of_layouts_has_first_what_adds_most_by_what_is_missing(scripts: None) -> None:
    import _stand_layouts as layouts

    names = [each.message for each in layouts.ALTERNATIVES]
    hits = {("a", names[2]), ("b", names[2]), ("b", names[3]), ("c", names[4]), ("d", names[1])}
    found = [
        {
            "entry": entry,
            "layout": name,
            "missing": "" if not name else "contacts" if entry == "d" else "body",
            "accepted": (entry, name) in hits,
            "cpu_s": 2.0,
        }
        for entry in "abcd"
        for name in names
    ]
    tables = layouts.table(found)
    body, contacts = tables["body"], tables["contacts"]
    assert [row["layout"] for row in body[:3]] == [names[2], names[4], names[3]]
    assert [(row["accepted"], row["of"], row["adds"]) for row in body[:3]] == [
        (2, 3, 2),
        (1, 3, 1),
        (1, 3, 0),
    ]
    assert [row["layout"] for row in contacts] == [names[1], *names[2:]]
    assert contacts[0]["adds"] == 1


def test_an_order_is_judged_on_robots_that_it_was_not_made_from(scripts: None) -> None:
    import _stand_layouts as layouts

    names = [each.message for each in layouts.ALTERNATIVES]
    hits = {("go1-gap-1", names[3]), ("b1-gap-1", names[3]), ("hyq-gap-2", names[2])}
    found = [
        {
            "entry": entry,
            "layout": name,
            "missing": "body" if name else "",
            "accepted": (entry, name) in hits,
            "cpu_s": 10.0,
        }
        for entry in ("go1-gap-1", "b1-gap-1", "hyq-gap-2", "hyq-slabs-1")
        for name in names
    ]
    ways = layouts.orders(found, 25.0)
    # go1 from b1 and hyq: what either has is worth one each, and the order of the package decides
    assert ways["by the table"]["go1-gap-1"] == (True, 20.0)
    # hyq from go1 and b1: both have plans over names[3] alone, and its own comes behind what adds nothing
    assert ways["by the table"]["hyq-gap-2"] == (False, 25.0)
    assert ways["as listed"] == {
        "go1-gap-1": (False, 25.0),
        "b1-gap-1": (False, 25.0),
        "hyq-gap-2": (True, 20.0),
        "hyq-slabs-1": (False, 25.0),
    }
    assert layouts.by_robot(ways["as listed"]) == {"go1": "0/1", "b1": "0/1", "hyq": "1/2"}


def test_planners_count_processor_time_where_layouts_are_tried(scripts: None) -> None:
    import _stand_layouts as layouts

    from stancekit.planners.search.answer import Clock

    with layouts.processor_time():
        clock = Clock.start()
        time.sleep(0.2)
        assert clock.elapsed() < 0.1
    assert Clock.start().elapsed() < 0.1


def test_entries_that_were_planned_as_asked_are_not_tried_again(
    scripts: None, tmp_path: Path
) -> None:
    import stands

    (tmp_path / "plans").mkdir()
    layouts = {"a": "", "b": "body level", "c": None}
    for name, layout in layouts.items():
        made = {} if not layout else {"layout": layout}
        file = tmp_path / "plans" / f"{name}.json"
        if layout is not None:
            file.write_text(json.dumps({"provenance": made}))
    rows = [{"key": name, "accepted": layout is not None} for name, layout in layouts.items()]
    (tmp_path / "plans.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert stands.not_as_asked(tmp_path) == ["b", "c"]
