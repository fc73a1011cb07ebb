"""What compares two checkouts: answers to a tolerance, commits and folders by their names, the
figures of a trip.
"""

from __future__ import annotations

import io
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


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
