"""The harness of benchmarks: rows as text, JSON and Markdown, intervals, lines that survive a kill,
and that scripts keep to it.
"""

from __future__ import annotations

import ast
import io
import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from scipy.stats import binomtest

from tests.refusals import refuses

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = {
    path.name: path.read_text(encoding="utf-8")
    for path in (ROOT / "benchmarks").rglob("*.py")
    if not path.name.startswith("_") and not {"referee", "published"} & {*path.parts}
}
ALONE = {
    "same_answers.py": "is run by other checkouts, which have another harness",
    "anymal_reach.py": "prints what a robot's file says",
    "anymal_urdf.py": "writes a robot's file",
    "stands.py": "has a command a table; each is of the harness",
}
"""Scripts that are not launched by the harness, and why."""
PAGES = [
    *ROOT.glob("*.md"),
    *(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts),
    *(ROOT / "tests").rglob("*.py"),
]


@pytest.fixture(scope="module")
def harness() -> Iterator[ModuleType]:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import _bench

    yield _bench
    sys.path.remove(str(ROOT / "benchmarks"))


def test_scripts_are_launched_by_the_harness() -> None:
    assert len(SCRIPTS) > 60
    others = {name for name, text in SCRIPTS.items() if "launch(" not in text}
    assert others == set(ALONE)
    parsed = {name for name, text in SCRIPTS.items() if "argparse" in text}
    assert parsed == set()


@pytest.mark.parametrize("name", ["anymal_reach.py", "anymal_urdf.py"])
def test_a_question_for_help_is_answered_and_writes_nothing(name: str) -> None:
    written = ROOT / "configs" / "robots" / "anymal.urdf"
    before = written.stat().st_mtime_ns
    asked = subprocess.run(
        [sys.executable, ROOT / "benchmarks" / name, "--help"], capture_output=True, text=True
    )
    assert asked.returncode == 0
    assert "usage" in asked.stdout
    assert written.stat().st_mtime_ns == before


def test_every_script_is_named_by_a_page_or_a_test() -> None:
    """But for the page that lists all of them, and the changelog."""
    texts = [
        page.read_text(encoding="utf-8")
        for page in PAGES
        if page.name not in ("CHANGELOG.md", Path(__file__).name)
    ]
    whole = "\n".join(texts)
    unnamed = {name for name in SCRIPTS if not re.search(rf"(?<![\w]){re.escape(name)}", whole)}
    assert unnamed == set()


def test_rows_are_text_json_or_markdown(
    harness: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [{"a": 1.23456, "b": "x|y"}, {"a": 2.0, "b": None}, {"c": [1, 2.5]}]

    def printed(**how: bool) -> str:
        options = harness.Options(**how)
        for row in rows:
            options.say(row)
        return capsys.readouterr().out

    assert printed() == "a 1.23456  b x|y\na 2.0  b None\nc [1, 2.5]\n"
    assert [json.loads(line) for line in printed(json=True).splitlines()] == rows
    assert printed(markdown=True) == (
        "| a | b |\n|---|---|\n| 1.235 | x\\|y |\n| 2 | None |\n\n| c |\n|---|\n| 1, 2.5 |\n"
    )
    options = harness.Options(markdown=True)
    options.list({"seconds": 0.5}, problem="wall-3")
    assert capsys.readouterr().out.endswith("| wall-3 | seconds | 0.5 |\n")


@pytest.mark.parametrize(("count", "of"), [(0, 7), (3, 10), (97, 100), (12, 12)])
def test_intervals_are_those_of_scipy(harness: ModuleType, count: int, of: int) -> None:
    found = re.findall(r"-?\d+\.\d", harness.share(count, of))
    theirs = binomtest(count, of).proportion_ci(method="wilson")
    for text, value in zip(found, (count / of, theirs.low, theirs.high), strict=True):
        assert float(text) == pytest.approx(100.0 * value, abs=0.06)
    exact = binomtest(count, of).proportion_ci(method="exact").high
    assert harness.upper_end(count, of) == pytest.approx(exact, abs=1e-9)
    assert harness.share(0, 0) == "0 of 0"


def test_lines_are_taken_up_where_a_kill_left_them(harness: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    lines = harness.Lines(path, "seed")
    lines.add(3, {"found": True})
    lines.add(4, {"found": False})
    path.write_text(path.read_text() + '{"seed": 5, "fou')
    again = harness.Lines(path, "seed")
    assert again.rows == {3: {"seed": 3, "found": True}, 4: {"seed": 4, "found": False}}
    again.add(5, {"found": True})
    assert [json.loads(line)["seed"] for line in path.read_text().splitlines()] == [3, 4, 5]


def test_the_code_of_a_table_is_that_of_the_process(
    harness: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["table", "--seed", "3", "--markdown"])
    seen = []
    harness.launch(seen.append, harness.Options, "A table.")
    assert (seen[0].seed, seen[0].markdown, seen[0].json) == (3, True, False)
    with pytest.raises(SystemExit) as end:
        harness.launch(lambda asked: 1, harness.Options, "A table.")
    assert end.value.code == 1


def test_tables_are_printed_of_kept_rows_of_the_same_script_and_options(
    harness: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, measured = tmp_path / "rows.jsonl", []

    def main(given) -> None:
        measured.append(given.seed)
        for value in (0.5, 0.25):
            given.say({"value": value})

    def launch(*words: object, script: str = "table.py", **tables) -> str:
        monkeypatch.setattr(sys, "argv", [script, *map(str, words), "--kept", str(path)])
        harness.launch(main, harness.Options, "A table.", **tables)
        return capsys.readouterr().out

    plain = "| value |\n|---|\n| 0.5 |\n| 0.25 |\n"
    assert launch("--seed", 3) == "value 0.5\nvalue 0.25\n" + plain
    head = json.loads(path.read_text().splitlines()[0])
    assert (head["script"], head["options"]) == ("table.py", {"seed": "3"})
    assert "stancekit" in head["software"]
    assert launch("--seed", 3) == plain
    two = {"sums": lambda rows: ["| sum |"], "counts": lambda rows: [f"| {len(rows)} |"]}
    assert launch("--seed", 3, **two) == "| sum |\n\n| 2 |\n"
    assert launch("--seed", 3, "--section", "counts", **two) == "| 2 |\n"
    assert measured == [3]
    for words, script, name in (
        ((), "table.py", "seed"),
        (("--seed", 3), "other.py", "other.py"),
        (("--seed", 3, "--section", "sum"), "table.py", "--section"),
    ):
        with refuses(name, kind=SystemExit):
            launch(*words, script=script, **two)
    assert measured == [3]


def test_a_cell_that_is_kept_is_read_back_whatever_its_numbers_are(
    harness: ModuleType, tmp_path: Path
) -> None:
    cell = {"status": "undecided", "residual": float("inf"), "solves": 3}
    path = tmp_path / "cells" / "one.json"
    for _ in range(2):  # measured, then read
        again = harness.kept(path, lambda: dict(cell))
        assert again == {"status": "undecided", "residual": None, "solves": 3}
        cell["solves"] = 4


@pytest.fixture(scope="module")
def scripts() -> Iterator[dict[str, ModuleType]]:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import _checkouts
    import _figures
    import _trip

    yield {"checkouts": _checkouts, "figures": _figures, "trip": _trip}
    sys.path.remove(str(ROOT / "benchmarks"))


ANSWER: dict[str, Any] = {
    "status": "feasible",
    "bound": math.nan,
    "plan": {"forces_n": [[1.0, -40.0], [0.5, math.inf]], "choice": [[0, 1], [2]]},
    "message": "it pulls 12.5 N at toe-3",
}


def changed(*path: str | int, to: Any) -> dict[str, Any]:
    """The answer with another value at a place."""

    def put(tree: Any, *path: str | int) -> Any:
        if not path:
            return to
        copy = dict(tree) if isinstance(tree, dict) else list(tree)
        copy[path[0]] = put(copy[path[0]], *path[1:])
        return copy

    return put(ANSWER, *path)


@pytest.mark.parametrize(
    ("path", "value", "where", "apart"),
    [
        (("plan", "forces_n", 0, 0), 1.0 + 4e-5, "plan.forces_n[0, 0]", 1e-6),
        (("plan", "choice", 1, 0), 3, "plan.choice[1][0]", 1 / 3),
        (("message",), "it pulls 12.6 N at toe-3", "message, numbers[0]", 0.1 / 12.6),
        (("plan", "forces_n", 1, 1), 7.0, "plan.forces_n[1, 1]", math.inf),
        (("bound",), 0.0, "bound", math.inf),
        (("status",), "undecided", "status", math.inf),
        (("message",), "it pushes 12.5 N at toe-3", "message", math.inf),
        (("plan", "forces_n"), [[1.0, -40.0]], "plan.forces_n", math.inf),
        (("plan",), None, "plan", math.inf),
    ],
)
def test_what_differs_is_measured_and_named(
    scripts: dict[str, ModuleType],
    path: tuple[str | int, ...],
    value: object,
    where: str,
    apart: float,
) -> None:
    found = scripts["figures"].furthest(ANSWER, changed(*path, to=value))
    assert found.where.startswith(where)
    assert found.apart == pytest.approx(apart, rel=1e-6)


def test_equal_answers_have_no_difference(scripts: dict[str, ModuleType]) -> None:
    assert scripts["figures"].furthest(ANSWER, changed("bound", to=math.nan)) is None


@pytest.mark.parametrize(("by", "code"), [(0.0, 0), (1e-9, 0), (1e-4, 1)])
def test_a_table_differs_beyond_its_tolerance(
    scripts: dict[str, ModuleType], by: float, code: int
) -> None:
    before = {"one": ANSWER, "two": 1.0, "gone": 3.0}
    now = {"one": changed("plan", "forces_n", 0, 0, to=1.0 + by), "two": 1.0, "new": 3.0}
    told = io.StringIO()
    assert scripts["figures"].report(before, now, 1e-9, "cases", told) == code
    said = told.getvalue()
    assert ("differs: one: plan.forces_n[0, 0]" in said) == bool(code)
    assert f"2 cases, {code} differ; {1 if by else 2} are equal to the last bit" in said
    assert "only before: gone" in said
    assert "only now: new" in said


def test_tables_without_a_common_answer_are_not_the_same(scripts: dict[str, ModuleType]) -> None:
    assert scripts["figures"].report({"a": 1}, {"b": 1}, 1e-9, "cases", io.StringIO()) == 1


@pytest.mark.parametrize("name", ["no-such-commit", "--all", "docs"])
def test_a_name_of_no_checkout_is_refused_in_one_line(
    scripts: dict[str, ModuleType], name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end, scripts["checkouts"].checkout(name):
        pass
    assert end.value.code == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "--against" in line
    assert repr(name) in line


def test_a_folder_is_taken_and_a_commit_is_written_out_for_a_while(
    scripts: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / ".editable" / "stancekit").mkdir(parents=True)
    with scripts["checkouts"].checkout(str(tmp_path)) as folder:
        assert folder == tmp_path.resolve()
    (tmp_path / "setup.py").write_text("from pathlib import Path\nPath('links').touch()\n")
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "setup.py"], [*who, "commit", "-qm", "one"]):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    monkeypatch.setattr(scripts["checkouts"], "ROOT", tmp_path)
    with scripts["checkouts"].checkout("HEAD") as folder:
        assert {path.name for path in folder.iterdir()} == {"setup.py", "links"}
    assert not folder.exists()


def test_a_trip_counts_what_is_called_and_made(
    scripts: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "walked"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "steps.py").write_text(
        "from dataclasses import dataclass\n"
        "@dataclass\nclass Step:\n    length_m: float\n"
        "def walk(count):\n    return [longer(Step(1.0)) for _ in range(count)]\n"
        "def longer(step):\n    return Step(2.0 * step.length_m)\n"
        "def unused():\n    pass\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    from walked import steps  # type: ignore[import-not-found]

    trip = scripts["trip"].Trip("walked", str(package))
    with trip.counted():
        steps.walk(3)
    assert trip.figures() == {"files": 1, "functions": 2, "types": 1, "objects": 6}


@cache
def names_in(module: str) -> set[object]:
    """Names that a module of the package has, however it comes by them."""
    tree = ast.parse(Path(find_spec(module).origin).read_text(encoding="utf-8"))
    return {
        getattr(each, key, None)
        for each in ast.walk(tree)
        for key in ("name", "asname", "id", "value")
    }


@pytest.mark.parametrize("file", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda f: f.stem)
def test_a_benchmark_imports_what_the_package_has(file: Path) -> None:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("stancekit."):
            for name in (each.name for each in node.names):
                assert name in names_in(node.module) or find_spec(f"{node.module}.{name}"), name
