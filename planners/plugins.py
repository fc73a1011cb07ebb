"""Plugins: things by name, from the package, from other packages, and from a file on the command
line.

A kind of thing (worlds, selectors, charts, …) has one ``Registry``. A thing comes in by one
registration:

- in the package: a line NAME → "module:attribute" in the registry's table;
- in another package: an entry point NAME in the registry's group, e.g. ``stancekit.worlds``;
- in a running program: ``registry.register(NAME, thing)``;
- on the command line, with none at all: ``FILE.py:NAME``.

A name is enough to list a thing; it is imported when it is asked for, and nothing else is.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import inspect
import io
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib.machinery import PathFinder
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from threading import RLock
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from .errors import InvalidInput, StancekitError
from .files.documents import read_text, shown

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
FILE = "stancekit_file_"
"""What the names of modules that were run from a FILE.py begin with."""
_RUNNING = RLock()
"""Held while a FILE.py runs: a second thread waits for it, and finds a whole module. So does a
fork."""
if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_RUNNING.acquire, after_in_parent=_RUNNING.release, after_in_child=_RUNNING.release
    )


class Registry(Generic[T]):
    """The things of one kind, by name.

    >>> worlds = Registry("world", "stancekit.worlds", {"mujoco": "stancekit.runner.worlds.mujoco:MujocoWorld"})
    >>> worlds.names()
    ('mujoco',)
    >>> worlds.register("mine", "mypackage.worlds:MyWorld")  # or the class itself
    >>> worlds.get("mine.py:MyWorld")  # doctest: +SKIP

    Arguments:
        kind: what messages call one, e.g. "world".
        group: of the entry points of other packages, e.g. "stancekit.worlds".
        table: those of this package, name → the thing, or "module:attribute".
        expected, accepts: what a thing must be, in words and as a test of what was found; what
            fails it is refused.
        further: what else names one, in words.
    """

    def __init__(
        self,
        kind: str,
        group: str,
        table: Mapping[str, str | T],
        *,
        expected: str = "something to call",
        accepts: Callable[[Any], bool] = callable,
        further: tuple[str, ...] = (),
    ) -> None:
        self.kind, self.group, self.expected = kind, group, expected
        self._accepts = accepts
        self._further = further
        self._things: dict[str, str | T] = dict(table)
        self._right: dict[str, T] = {}

    def register(self, name: str, thing: str | T) -> None:
        """Add a thing, or where it is to be found, "module:attribute".

        A name that is there already is taken over.
        """
        self._things[name] = thing

    def registered(self) -> tuple[str, ...]:
        """The names of this package, and those that were registered in this process."""
        return tuple(self._things)

    def names(self) -> tuple[str, ...]:
        """All names: of this package, as its table has them, then of others.

        Nothing is imported.
        """
        return tuple(dict.fromkeys([*self._things, *(point.name for point in self._points())]))

    def get(self, name: str, *, known: Sequence[str] = ()) -> T:
        """The thing of this name, or of "FILE.py:NAME".

        A file is run once a process, under a module name of its own; other processes are best told
        the same text. Raises InvalidInput, one line, for an unknown name, a file that is not
        there or does not run, a name that it lacks, and a thing of the wrong kind.

        Arguments:
            known: the names to say in place of all.
        """
        thing, where = self._things.get(name), f"{self.kind} {name}"
        if thing is None:
            thing = self._elsewhere(name, known)
        elif isinstance(thing, str):
            module, _, attribute = thing.partition(":")
            thing = _attribute(_imported(module, where), attribute, where)
        if self._right.get(name) is not thing:
            if not self._accepts(thing):
                came = (
                    f"the class {thing.__qualname__}" if isinstance(thing, type) else shown(thing)
                )
                raise InvalidInput(f"{where}: expected {self.expected}, got {came}")
            self._right[name] = cast(T, thing)
        return cast(T, thing)

    def _elsewhere(self, name: str, known: Sequence[str]) -> Any:
        """From a file, or from another package."""
        path, colon, attribute = name.rpartition(":")
        if colon and path.endswith(".py"):
            return _attribute(_ran(Path(path)), attribute, path)
        if name.endswith(".py"):
            raise InvalidInput(f"{self.kind}: expected FILE.py:NAME, got no name after {name}")
        for point in self._points():
            if point.name == name:
                where = f"{self.kind} {name} of {point.value}"
                return _attribute(_imported(point.module, where), point.attr, where)
        raise self.unknown(name, known)

    def unknown(self, name: Any, known: Sequence[str] = ()) -> InvalidInput:
        """Error to raise for an unknown name.

        Arguments:
            known: as for ``get``.
        """
        names = ", ".join([*(known or self.names()), *self._further])
        return InvalidInput(
            f"{self.kind}: expected one of {names}, or FILE.py:NAME, got {shown(name)}"
        )

    def _points(self) -> Iterable[EntryPoint]:
        return _installed(tuple(map(str, sys.path)), self.group)


@lru_cache(maxsize=8)
def _installed(path: tuple[str, ...], group: str) -> tuple[EntryPoint, ...]:
    """Entry points of a group in packages on a path, which are read once."""
    return tuple(entry_points_of(group))


def entry_points_of(group: str) -> Sequence[EntryPoint]:
    """The entry points of a group.

    Where no installed package's file of entry points says the group's name, which is the usual
    case, nothing more is read: to read the metadata of every package takes longer.
    """
    if not _may_have(group):
        return ()
    from importlib.metadata import entry_points  # loads the parser of mails

    return tuple(entry_points(group=group))


def _may_have(group: str) -> bool:
    """Tell whether an installed package may have entry points of this group."""
    finders = (finder for finder in sys.meta_path if hasattr(finder, "find_distributions"))
    if any(finder is not PathFinder for finder in finders):
        return True  # packages that are elsewhere than in folders
    wanted = group.encode()
    for place in sys.path:
        try:
            names = os.listdir(place or ".")
        except NotADirectoryError:
            return True
        except OSError:
            continue
        for name in names:
            if name.endswith((".dist-info", ".egg-info")):
                with (
                    suppress(OSError),
                    open(f"{place or '.'}/{name}/entry_points.txt", "rb") as file,
                ):
                    if wanted in file.read():
                        return True
    return False


def split_name(name: str) -> tuple[str, list[str]]:
    """A name, and what stands behind it, parted by colons.

    >>> split_name("rough:0.5:7"), split_name("mine.py:Rough:0.5:7")
    (('rough', ['0.5', '7']), ('mine.py:Rough', ['0.5', '7']))
    """
    first, *rest = name.split(":")
    return (f"{first}:{rest[0]}", rest[1:]) if rest and first.endswith(".py") else (first, rest)


def takes(thing: Any, count: int) -> bool:
    """Tell whether a thing can be called with so many arguments; True where the thing does not
    say.
    """
    try:
        inspect.signature(thing).bind(*[None] * count)
    except TypeError:  # not to be called at all, or otherwise
        return False
    except ValueError:
        pass
    return True


def made_or_class(thing: Any, method: str) -> bool:
    """Tell whether a thing has a method, and, if it is a class, is made without arguments."""
    return callable(getattr(thing, method, None)) and (
        not isinstance(thing, type) or takes(thing, 0)
    )


def _imported(module: str, where: str) -> ModuleType:
    """An installed module."""
    with foreign(f"{where}: cannot be imported"):
        return importlib.import_module(module)


def of_file(thing: Any) -> bool:
    """Tell whether a thing was defined in a FILE.py, or its class was."""
    kind = thing if isinstance(thing, type | FunctionType) else type(thing)
    return kind.__module__.startswith(FILE)


def packed(thing: Any) -> bytes:
    """A thing as a pickle in which classes and functions of a FILE.py go by the file and their
    name.

    So another process, which has not run the file, can load it: ``pickle.loads`` runs the file
    first.
    """
    content = io.BytesIO()
    _Pickler(content).dump(thing)
    return content.getvalue()


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        """See ``packed``."""
        if isinstance(obj, type | FunctionType) and of_file(obj):
            return _named_in_file, (str(sys.modules[obj.__module__].__file__), obj.__qualname__)
        return NotImplemented


def _named_in_file(path: str, name: str) -> Any:
    """Object of this name in a FILE.py.

    Raises InvalidInput.
    """
    return _attribute(_ran(Path(path)), name, path)


def _ran(path: Path) -> ModuleType:
    """A file as a module, run where it has not been yet; by one thread at a time."""
    with _RUNNING:
        return _ran_alone(path)


def _ran_alone(path: Path) -> ModuleType:
    read_text(path)  # whatever is wrong with the file itself
    name = f"{FILE}{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path.resolve())
    assert spec is not None
    assert spec.loader is not None
    sys.modules[name] = module = module_from_spec(
        spec
    )  # before it runs: dataclasses look for their module there
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)  # as of a script
    try:
        with foreign(f"{path}: cannot be run"):
            vars(module)[_CODE] = _code(path.resolve())
            spec.loader.exec_module(module)
    except BaseException:  # a module that failed is not kept
        del sys.modules[name]
        raise
    finally:
        sys.path.remove(folder)
        if folder not in sys.path:
            sys.path.append(folder)  # for what its functions import when they are called
    for file in vars(module)[_CODE]:
        other = getattr(sys.modules.get(file[:-3].replace("/", ".")), "__file__", None)
        if other is not None and Path(other).resolve() != Path(folder, file):
            raise InvalidInput(f"{path}: expected {file} of its folder, got {other}: rename it")
    return module


_CODE = "__stancekit_code__"
"""Name in the module of a FILE.py of its ``_code`` when it was run."""


def code_of(*names: str) -> dict[str, str]:
    """SHA-256 of every file that runs as these FILE.py:NAMEs: of each FILE.py, and of what it
    imports from its folder, by the path from there; none for other names.

    Raises InvalidInput where a file is no more what this process has run.
    """
    found: dict[str, str] = {}
    for name in names:
        file, is_file, _ = name.partition(".py:")
        if is_file:
            path = Path(f"{file}.py")
            ran = vars(_ran(path))[_CODE]
            with foreign(f"{path}: cannot be read"):
                now = _code(path.resolve())
            if differs := differing(ran, now):
                raise InvalidInput(
                    f"{path}: expected the code that this process has run, got {differs} edited "
                    "since: begin another process"
                )
            found |= now
    return found


def differing(one: Mapping[str, str], other: Mapping[str, str]) -> str:
    """The files that two ``code_of`` do not have alike, in words; empty where there are none."""
    return ", ".join(sorted(each for each in {**one, **other} if one.get(each) != other.get(each)))


def _code(path: Path) -> dict[str, str]:
    """SHA-256 of a file and of all that it imports from its folder, by the path from there."""
    folder, left, found = path.parent, [path], dict[str, str]()
    while left:
        file = left.pop()
        content = file.read_bytes()
        found[file.relative_to(folder).as_posix()] = hashlib.sha256(content).hexdigest()
        for node in ast.walk(ast.parse(content)):
            if isinstance(node, ast.Import):
                start, modules = folder, [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                start = file.parents[node.level - 1] if node.level else folder
                whole = node.module or ""
                modules = [f"{whole}.{alias.name}".strip(".") for alias in node.names]
            else:
                continue
            for parts in (module.split(".") for module in modules):
                for k in range(1, len(parts) + 1):
                    place = start.joinpath(*parts[:k])
                    for each in (place.with_suffix(".py"), place / "__init__.py"):
                        named = each.is_file() and each.is_relative_to(folder)
                        if named and each.relative_to(folder).as_posix() not in found:
                            left.append(each)
    return dict(sorted(found.items()))


def _attribute(module: ModuleType, attribute: str, where: str) -> Any:
    """Attribute of a module; dots lead into classes."""
    value: Any = module
    for part in attribute.split("."):
        try:
            value = getattr(value, part)
        except AttributeError:
            has = [
                name
                for name, it in vars(module).items()
                if getattr(it, "__module__", "") == module.__name__
            ]
            message = f"; it defines {', '.join(has[:8])}" if has else ""
            raise InvalidInput(
                f"{where}: expected {shown(attribute)} in it, found no such name{message}"
            ) from None
    return value


def blamed(error: BaseException) -> str:
    """An error that came through a FILE.py in one line, with the last place there; empty where it
    came through none.
    """
    place, trace = "", error.__traceback__
    while trace is not None:
        frame = trace.tb_frame
        if str(frame.f_globals.get("__name__", "")).startswith(FILE):
            place = f"{frame.f_code.co_filename} line {trace.tb_lineno}: {_told(error)}"
        trace = trace.tb_next
    return place


@contextmanager
def foreign(where: str) -> Iterator[None]:
    """Whatever another's code raises within, and be it SystemExit, is an InvalidInput: one line
    that begins so.

    Errors of this package pass, as those of a user who interrupts do.
    """
    try:
        yield
    except (StancekitError, KeyboardInterrupt):
        raise
    except BaseException as error:  # another's code may raise anything
        raise InvalidInput(f"{where}: {_told(error)}") from error


def _told(error: BaseException) -> str:
    """An error in one line."""
    try:
        text = str(error)
    except Exception:  # another's code, again
        text = shown(error)
    return f"{type(error).__name__}: {' '.join(text.split()):.200}"
