"""SciPy without what commands do not need of it: docstrings stay as they are written, and NumPy is
not loaded whole.

SciPy 1.17 parses the docstring of every public function while it is imported, and writes it anew
with a table of array libraries in it, which takes longer than the rest of the import. Beside that
it copies all names of NumPy, and so loads the modules that NumPy loads only when somebody asks for
them, a compiler for Fortran and helpers of tests among them. What SciPy computes is the same.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

PARSER = "scipy._lib._docscrape"
"""The module whose ``FunctionDoc`` parses and writes docstrings."""
COPIES = "scipy._lib.array_api_compat._internal"
"""The module whose ``clone_module`` copies all names of an array library."""


class Unparsed(defaultdict[str, list[Any]]):
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


INSTEAD: dict[str, tuple[str, Callable[[Any], Any]]] = {
    PARSER: ("FunctionDoc", lambda _: Unparsed),
    COPIES: ("clone_module", lambda _: _names_at_hand),
}
"""By module, the name in it that is replaced, and what makes the other object of the first one."""


class AsWritten(MetaPathFinder, Loader):
    """Finds the modules of ``INSTEAD``, and puts the other objects in their places."""

    def __init__(self) -> None:
        self._loaders: dict[str, Loader] = {}

    def find_spec(
        self, fullname: str, path: Any, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module's, loaded by this; none for any other module."""
        if (
            fullname not in INSTEAD
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
        name, other = INSTEAD[module.__name__]
        if hasattr(module, name):
            vars(module)[name] = other(vars(module)[name])


def keep_as_written() -> None:
    """Have modules of SciPy that are not imported yet leave their docstrings as they are, and
    NumPy's modules alone.
    """
    if not INSTEAD.keys() & sys.modules.keys() and not any(
        isinstance(each, AsWritten) for each in sys.meta_path
    ):
        sys.meta_path.insert(0, AsWritten())
