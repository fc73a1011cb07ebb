"""Data classes of a command behave as Python's own; a user's own process is not touched."""

from __future__ import annotations

import copy
import dataclasses
import subprocess
import sys
from dataclasses import dataclass, field
from typing import Any

import pytest

from stancekit.cli.pictures import share_methods


def made() -> list[type[Any]]:
    """Classes with and without fields, with values that hold each other, slots, and heirs."""

    @dataclass(frozen=True)
    class Empty:
        pass

    @dataclass(frozen=True, kw_only=True)
    class Base:
        number: int = 1
        hidden: str = field(default="h", repr=False)
        others: list[Any] = field(default_factory=list)

    @dataclass(frozen=True)
    class Heir(Base):
        π: float = 3.14

    class Plain(Base):
        """An heir that is no data class: its own attributes can be set."""

    @dataclass(frozen=True, slots=True)
    class Narrow:
        x: float = 0.5

    @dataclass
    class Open:
        text: str = "a\nb"

    return [Empty, Base, Heir, Plain, Narrow, Open]


def told(cls: type[Any]) -> list[str]:
    """How an instance of a class is shown, and what becomes of it when it is changed."""
    one = cls()
    if hasattr(one, "others"):
        one.others.append(one)
    said = [repr(one), repr(copy.copy(one)) if not hasattr(one, "others") else ""]
    for name in ("number", "x", "text", "π", "new", "hidden"):
        for change in (
            lambda name=name: setattr(one, name, 2),
            lambda name=name: delattr(one, name),
        ):
            try:
                change()
                said.append(f"{name}: {sorted(getattr(one, '__dict__', {}))}")
            except (AttributeError, TypeError) as error:
                said.append(f"{name}: {type(error).__name__}: {error}")
    return [each.replace(f"{hex(id(one))}", "") for each in said]


def test_fields_are_refused_and_shown_as_by_python(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = [told(cls) for cls in made()]
    theirs = dataclasses._repr_fn  # type: ignore[attr-defined]  # what is replaced
    for name in ("_repr_fn", "_frozen_get_del_attr"):
        monkeypatch.setattr(dataclasses, name, getattr(dataclasses, name))
    share_methods()
    assert (dataclasses._repr_fn is theirs) == (sys.version_info >= (3, 13))  # type: ignore[attr-defined]
    assert [told(cls) for cls in made()] == expected
    assert any(
        "FrozenInstanceError: cannot assign to field 'number'" in each for each in expected[2]
    )
    assert any("..." in each for each in expected[1])


def test_who_imports_the_package_has_pythons_own() -> None:
    line = "import dataclasses as d; a = d._repr_fn; import stancekit; stancekit.plan; print(a is d._repr_fn)"
    answer = subprocess.run(
        [sys.executable, "-c", line], capture_output=True, text=True, check=True
    )
    assert answer.stdout == "True\n"
