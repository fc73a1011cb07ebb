"""The public names with their signatures, as text: a change of what users call is seen in a diff.

``python tests/api/test_signatures.py`` writes ``signatures.txt`` anew.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path

import stancekit

TEXT = Path(__file__).with_name("signatures.txt")


def signatures() -> Iterator[str]:
    """One line per public name, and one per public attribute or method of a public class."""
    for name in sorted(dir(stancekit)):
        if name.startswith("__"):
            continue
        thing = getattr(stancekit, name)
        if not inspect.isclass(thing):
            yield f"{name}{inspect.signature(thing)}"
        elif issubclass(thing, enum.Enum):
            yield f"{name}: {' | '.join(each.value for each in thing)}"
        else:
            yield f"{name}{'' if issubclass(thing, Exception) else inspect.signature(thing)}"
            fields = (
                {field.name for field in dataclasses.fields(thing)}
                if dataclasses.is_dataclass(thing)
                else set()
            )
            yield from (f"{name}.{line}" for line in members(thing, fields))


def members(thing: type, fields: set[str]) -> Iterator[str]:
    """The public attributes and methods of a class that are its own, but for the fields of its
    constructor.
    """
    for name, value in sorted(vars(thing).items()):
        if name.startswith("_") or name in fields:
            continue
        function = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        yield f"{name}{inspect.signature(function)}" if inspect.isfunction(function) else name


def test_what_users_call_is_what_the_snapshot_says() -> None:
    found = list(signatures())
    assert len(found) > 80
    assert found == TEXT.read_text(encoding="utf-8").splitlines()


if __name__ == "__main__":
    TEXT.write_text("".join(f"{line}\n" for line in signatures()), encoding="utf-8")
    sys.stdout.write(f"{TEXT}\n")
