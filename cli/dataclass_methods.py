"""Dataclasses whose methods are compiled when they are first called.

Python before 3.13 compiles the comparison, the text, the hash and the guards of every dataclass by
themselves while it is imported: some 900 functions for `stancekit plan`, most of which nobody calls.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

COMPILER = "_create_fn"
"""The function of ``dataclasses`` that compiles a method; from 3.13 on there is none."""


def compile_when_called() -> None:
    """Have the dataclasses of this process that are made from now on compile no method but
    ``__init__``, whose signature is read, before it is called.
    """
    compiled: Callable[..., Any] | None = getattr(dataclasses, COMPILER, None)
    if compiled is not None and compiled.__module__ == dataclasses.__name__:
        setattr(dataclasses, COMPILER, _when_called(compiled))


def _when_called(compiled: Callable[..., Any]) -> Callable[..., Any]:
    """The compiler of methods that waits for the first call of each."""

    def method_of(name: str, *told: Any, **named: Any) -> Callable[..., Any]:
        if name == "__init__":
            method: Callable[..., Any] = compiled(name, *told, **named)
            return method
        made: list[Callable[..., Any]] = []

        def waiting(*given: Any) -> Any:
            if not made:
                made.append(compiled(name, *told, **named))
            return made[0](*given)

        waiting.__name__ = name
        return waiting

    return method_of
