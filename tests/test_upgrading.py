"""The page on upgrading: every old name that it says still works does, and none that works is left
out.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import stancekit
from stancekit.planners.answer import answer, report
from stancekit.planners.formats import plan_file, proof_file, trajectory_file

PAGE = (Path(__file__).parents[1] / "docs" / "upgrading.md").read_text(encoding="utf-8")
NAME = re.compile(r"`(stancekit[.\w]*)`")


def rows(section: str) -> list[tuple[list[str], list[str]]]:
    """Old and new names of the table of a section, row by row."""
    text = PAGE[PAGE.index(f"## {section}\n") :]
    text = text[: text.index("\n## ", 3)]
    cells = [line.split("|")[1:3] for line in text.splitlines() if line.startswith("|")][2:]
    return [(NAME.findall(old), NAME.findall(new)) for old, new in cells]


def thing(name: str) -> Any:
    """What a dotted name is; raises ImportError or AttributeError where it is nothing."""
    module, _, attribute = name.rpartition(".")
    try:
        return import_module(name)
    except ModuleNotFoundError:
        return getattr(import_module(module), attribute)


STILL = [(old, new) for olds, new in rows("Names that still import") for old in olds]
MOVED = rows("Modules that moved")


@pytest.mark.parametrize(("old", "new"), STILL, ids=[old for old, _ in STILL])
def test_an_old_name_warns_and_is_the_new_one(old: str, new: list[str]) -> None:
    vars(stancekit).pop(old.rpartition(".")[2], None)  # it is kept at the first use
    with pytest.warns(DeprecationWarning, match=f"{old.rpartition('.')[2]} is old: "):
        was = thing(old)
    if isinstance(was, type) and type(was).__name__ == "OldName":
        assert was.made.__qualname__.split(".")[0] == new[0].rpartition(".")[2] or old.endswith(
            ".Posture"
        )
    else:
        things = [thing(name) for name in new]
        assert getattr(was, "func", was) in things or type(was) in map(type, things)


def test_every_old_name_of_the_code_is_on_the_page() -> None:
    assert len(STILL) >= 14
    attributes = [
        *answer._OLD,
        *report.OLD_NAMES,
        *report.OLD_FIGURES,
        "subject",
        "joints_message",
        "trajectory",
    ]
    missing = [
        name
        for name in (*stancekit._OLD, *attributes)
        if not re.search(rf"`[^`]*\b{name}\b[^`]*`", PAGE)
    ]
    assert missing == []
    for each in (plan_file.OLDER, plan_file.PAIRED, proof_file.OLD):
        assert f"`{each}`" in PAGE
    for each in (trajectory_file.OLDER, trajectory_file.PAIRED):
        assert f"`{each}`" in PAGE


def test_modules_that_moved_are_where_the_page_says() -> None:
    assert len(MOVED) >= 6
    for olds, news in MOVED:
        for name in news:
            assert thing(name)
        for name in olds:
            with pytest.raises((ImportError, AttributeError)):
                thing(name)
