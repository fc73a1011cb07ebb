"""SciPy without what commands do not need of it: its docstrings stay as they are written.

SciPy 1.17 parses the docstring of every public function while it is imported, and writes it anew with a table of array
libraries in it, which takes longer than the rest of the import. What SciPy computes is the same.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

PARSER = "scipy._lib._docscrape"
"""The module whose ``FunctionDoc`` parses and writes docstrings."""


class Unparsed(defaultdict[str, list[Any]]):
    """A docstring in place of its sections: what is written into a section is lost."""

    def __init__(self, function: Any = None, *_: Any, **__: Any) -> None:
        super().__init__(list)
        self._text = getattr(function, "__doc__", None) or ""

    def __str__(self) -> str:
        return f"\n{self._text}"  # a signature is expected before it


class AsWritten(MetaPathFinder, Loader):
    """Finds SciPy's parser of docstrings, and has it leave them as they are."""

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        """The parser's, loaded by this; none for any other module."""
        if fullname != PARSER or (found := PathFinder.find_spec(fullname, path)) is None or found.loader is None:
            return None
        self._loader = found.loader
        return ModuleSpec(fullname, self, origin=found.origin)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Nothing but the usual one."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Load the parser, then put the other class in its place."""
        self._loader.exec_module(module)
        if hasattr(module, "FunctionDoc"):
            vars(module)["FunctionDoc"] = Unparsed


def keep_as_written() -> None:
    """Have modules of SciPy that are not imported yet leave their docstrings as they are."""
    if PARSER not in sys.modules and not any(isinstance(each, AsWritten) for each in sys.meta_path):
        sys.meta_path.insert(0, AsWritten())
