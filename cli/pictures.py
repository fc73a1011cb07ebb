"""Pictures, films and pages of what a command found or executed."""

from __future__ import annotations

import dataclasses
import sys
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from reprlib import recursive_repr
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .console import progress

if TYPE_CHECKING:
    from stancekit import Motion
    from stancekit.runner.report import Execution


_PARSER = "scipy._lib._docscrape"
"""The module whose ``FunctionDoc`` parses and writes docstrings."""
_COPIES = "scipy._lib.array_api_compat._internal"
"""The module whose ``clone_module`` copies all names of an array library."""


class _Unparsed(defaultdict[str, list[Any]]):
    """A docstring in place of its sections: what is written into a section is lost."""

    def __init__(self, function: Any = None, *_: Any, **__: Any) -> None:
        super().__init__(list)
        self._text = getattr(function, "__doc__", None) or ""

    def __str__(self) -> str:
        return f"\n{self._text}"  # a signature is expected before it


def _names_at_hand(name: str, namespace: dict[str, Any]) -> list[str]:
    """Copy the public names that a module has already into a namespace, which asks the module for
    others; their names.

    In place of SciPy's ``clone_module``, which loads whatever the module would load for a name that
    is asked for.
    """
    module = import_module(name)
    public = set(getattr(module, "__all__", ()))
    objects = {
        each: value
        for each, value in vars(module).items()
        if each in public or not each.startswith("_")
    }

    def asked(each: str) -> Any:
        if each.startswith("_"):
            raise AttributeError(f"module {namespace['__name__']!r} has no attribute {each!r}")
        return getattr(module, each)

    namespace.update(objects, __getattr__=asked)
    return list(objects)


_INSTEAD: dict[str, tuple[str, Callable[[Any], Any]]] = {
    _PARSER: ("FunctionDoc", lambda _: _Unparsed),
    _COPIES: ("clone_module", lambda _: _names_at_hand),
}
"""By module, the name in it that is replaced, and what makes the other object of the first one."""


class _AsWritten(MetaPathFinder, Loader):
    """Finds the modules of ``_INSTEAD``, and puts the other objects in their places."""

    def __init__(self) -> None:
        self._loaders: dict[str, Loader] = {}

    def find_spec(
        self, fullname: str, path: Any, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module's, loaded by this; none for any other module."""
        if (
            fullname not in _INSTEAD
            or (spec := PathFinder.find_spec(fullname, path)) is None
            or spec.loader is None
        ):
            return None
        self._loaders[fullname] = spec.loader
        return ModuleSpec(fullname, self, origin=spec.origin)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Nothing but the usual one."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Load the module, then put the other object in its place."""
        self._loaders[module.__name__].exec_module(module)
        name, other = _INSTEAD[module.__name__]
        if hasattr(module, name):
            vars(module)[name] = other(vars(module)[name])


def keep_as_written() -> None:
    """Have modules of SciPy that are not imported yet leave their docstrings as they are, and
    NumPy's modules alone.
    """
    if not _INSTEAD.keys() & sys.modules.keys() and not any(
        isinstance(each, _AsWritten) for each in sys.meta_path
    ):
        sys.meta_path.insert(0, _AsWritten())


def _refusals(
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
        vars(dataclasses).update(_frozen_get_del_attr=_refusals, _repr_fn=shown)


def show(
    motion: Motion[Any],
    executed: Execution | None = None,
    *,
    picture: Path | None = None,
    video: Path | None = None,
    html: Path | None = None,
) -> list[Path]:
    """Write the picture, the film and the page that were asked for; their names.

    Arguments:
        executed: how a world had the motion, which is then shown.
    """
    written = [path for path in (picture, video, html) if path is not None]
    if not written:
        return []
    from stancekit import draw, film

    if picture is not None:
        draw(motion, executed=executed, out=picture)
    for path in (video, html):
        if path is not None:
            with progress(f"film {path}") as bar:
                film(motion, path, executed, progress=bar)
    return written
