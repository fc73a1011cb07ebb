"""docs/equations.md: every equation of both papers is tied to code, every tie resolves, and the
page is up to date.
"""

import importlib
import importlib.util
import re
import sys
from functools import reduce
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
OLD_FORM = re.compile(r"\b[Ee]qs?\. ?\(?\d|\bAlgorithms? \d")
"""How equations were cited before there was one form."""


@pytest.fixture(scope="module")
def equations() -> ModuleType:
    spec = importlib.util.spec_from_file_location("equations", ROOT / "docs" / "equations.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["equations"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def found(equations: ModuleType) -> dict[str, list[Any]]:
    """What the docstrings tie, read once."""
    return equations.ties()


def test_every_numbered_equation_and_algorithm_is_tied(found: dict[str, list[Any]]) -> None:
    wanted = {f"E{k}" for k in range(1, 12)} | {f"W{k}" for k in range(1, 15)}
    wanted |= {"Algorithm E1", "Algorithm E2", "Algorithm W1"}
    assert set(found) == wanted
    assert [name for name, ties in found.items() if not ties] == []


def test_every_tie_is_a_function_or_class_that_can_be_called(found: dict[str, list[Any]]) -> None:
    ties = {tie for each in found.values() for tie in each}
    assert len(ties) > 40
    for tie in ties:
        thing = reduce(getattr, tie.name.split("."), importlib.import_module(tie.module))
        assert callable(thing) or hasattr(thing, "func") or isinstance(thing, property), tie


def test_the_page_is_what_the_docstrings_say_by_its_own_check(
    equations: ModuleType, found: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(equations, "ties", lambda: found)
    monkeypatch.setattr(sys, "argv", ["equations.py", "--check"])
    assert equations.main() == 0


def test_what_is_cited_is_read_off_the_text(equations: ModuleType) -> None:
    text = (
        "Σ f = 0 (E5), E2–E4 and Algorithm W1; not A4, E.5, HE11 or E12a; the dynamics (W2, W11)."
    )
    assert list(equations.cited(text)) == ["E5", "E2", "E3", "E4", "Algorithm W1", "W2", "W11"]


def test_equations_are_cited_in_one_form(equations: ModuleType) -> None:
    files = [path for folder in equations.FOLDERS for path in (ROOT / folder).rglob("*.py")]
    assert len(files) > 150
    old = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in files
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if OLD_FORM.search(line)
    ]
    assert old == []
