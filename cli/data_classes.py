"""Data classes whose methods are not compiled from text where the same function does for all.

Up to Python 3.12 ``dataclass`` writes every method of every class as text and compiles it, up to six
for each of the hundreds of classes that a command imports: a tenth of its time. How a frozen class
refuses to be changed, and how it is shown, is the same for all of them but for the names.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from reprlib import recursive_repr
from typing import Any


def refusals(
    cls: type[Any], fields: list[dataclasses.Field[Any]], *_: Any
) -> tuple[Callable[[Any, str, Any], None], Callable[[Any, str], None]]:
    """The methods of a frozen class by which its fields are neither set nor deleted.

    Arguments:
        cls: the class; classes that derive from it may have other attributes.
        fields: the fields that cannot be changed in those, either.

    Returns ``__setattr__`` and ``__delattr__``.
    """
    names = frozenset(each.name for each in fields)

    def __setattr__(self: Any, name: str, value: Any) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: Any, name: str) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    return __setattr__, __delattr__


def shown(fields: list[dataclasses.Field[Any]], *_: Any) -> Callable[[Any], str]:
    """The ``__repr__`` of a class: its name, and each field with its value."""
    names = [each.name for each in fields]

    def __repr__(self: Any) -> str:
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{self.__class__.__qualname__}({values})"

    return recursive_repr()(__repr__)


def share_methods() -> None:
    """Have data classes that are made from here on share what needs no text; from Python 3.13 on
    all methods of a class are compiled at once, and stay as they are.
    """
    if sys.version_info < (3, 13):
        vars(dataclasses).update(_frozen_get_del_attr=refusals, _repr_fn=shown)
