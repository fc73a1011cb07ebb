"""The changes that commands make to other packages' inner modules, all of them to begin sooner: what
is computed is the same, and a process that only imports the package is not touched.

- SciPy 1.17 parses the docstring of every public function while it is imported, and writes it anew
  with a table of array libraries in it (https://github.com/scipy/scipy/pull/22609), which takes
  two fifths of the time that special, spatial and stats take. Docstrings stay as they are written.
- SciPy's copy of array-api-compat takes all names of NumPy, and so loads the modules that NumPy
  loads only when somebody asks for them, a compiler for Fortran and helpers of tests among them.
  NumPy is not loaded whole.
- Up to Python 3.12 ``dataclass`` writes every method of every class as text and compiles it, up to
  six for each of the hundreds of classes that a command imports: a tenth of its time
  (https://github.com/python/cpython/issues/109870, solved in 3.13). How a frozen class refuses to
  be changed, and how it is shown, is the same for all of them but for the names.
"""

from __future__ import annotations

import dataclasses
import sys
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from reprlib import recursive_repr
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
