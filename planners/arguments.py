"""Arguments and settings, held against their annotations: what does not fit is one line that says
so.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from numbers import Integral, Real
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import (
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
    overload,
)

import numpy as np

from .errors import InvalidInput, UnknownArgument
from .files.documents import neighbour, shown

T = TypeVar("T")


class cached_property(functools.cached_property[T]):
    """Python's own as it is from 3.12 on: without the lock that all instances of a class share.

    A process that is forked off while another thread works a property out finds that lock held, and
    waits for ever. Two threads may work a value out at the same time; the one that was kept first
    is what both get.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> cached_property[T]: ...
    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> T: ...
    def __get__(
        self, instance: object | None, owner: type[Any] | None = None
    ) -> cached_property[T] | T:
        """The value, which is kept in the instance, where it is found without this the next
        time.
        """
        if instance is None:
            return self
        assert self.attrname is not None  # the class has given it its name
        value: T = vars(instance).setdefault(self.attrname, self.func(instance))
        return value


P = ParamSpec("P")
R = TypeVar("R")
Settings = TypeVar("Settings")
_PLAIN = (NoneType, bool, int, float, str)
"""What a message shows itself; of other things it shows the type."""
_WORDS = {
    NoneType: "None",
    bool: "True or False",
    int: "an integer",
    float: "a number",
    str: "text",
    Path: "a Path",
    type: "a class",
    np.ndarray: "an array",
    Mapping: "a mapping",
    Callable: "something to call",
}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Wrap the function: it raises InvalidInput for an argument of a type or a name that its
    annotation lacks.

    A protocol is fulfilled by an instance with its methods.
    """
    signature = inspect.signature(function)
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    single = [
        name for name, parameter in signature.parameters.items() if parameter.kind not in kinds
    ]

    @functools.wraps(function)
    def held(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            hints, arguments = hints_of(function), signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(
                f"stancekit.{function.__name__}: {error}; it takes "
                f"{', '.join(signature.parameters)}"
            ) from None
        for name in single:
            if name in arguments:
                check_argument(name, arguments[name], hints[name])
        with np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
            return function(*args, **kwargs)  # as NumPy is, whatever its user has set

    return held


def check_names(function: str, given: Mapping[str, Any], takes: Sequence[str]) -> None:
    """Raise TypeError, as a call of any function does, for the first name that a function with
    further arguments does not take.

    Arguments:
        function: the function's name.
        given: its further arguments.
        takes: all that it takes, for the message.
    """
    for name in given:
        if name not in takes:
            raise TypeError(
                f"stancekit.{function}: got an unexpected keyword argument {name!r}; it takes "
                f"{', '.join(takes)}"
            )


def check_argument(name: str, value: Any, hint: Any) -> None:
    """Raise InvalidInput, which begins with the name, for a value that an annotation does not
    allow; of a sequence it names the first entry that is wrong, e.g. ``envelopes[0][1]``.
    """
    if _fits(value, hint):
        return
    several = [part for part in (hint, *get_args(hint)) if get_origin(part) is Sequence]
    if len(several) == 1 and isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for index, one in enumerate(value):
            check_argument(f"{name}[{index}]", one, get_args(several[0])[0])
    raise InvalidInput(f"{name}: expected {_expected(hint)}, got {came(value)}")


def check_types(settings: Any, where: str = "") -> None:
    """Raise InvalidInput for the first field of a dataclass that its annotation does not allow.

    Arguments:
        where: what its name begins with.
    """
    hints = hints_of(cast(Any, type(settings)))
    for each in fields(settings):
        check_argument(where + each.name, getattr(settings, each.name), hints[each.name])


def settings_from(
    kind: type[Settings], given: Mapping[str, Any], *, beside: Sequence[str] = ()
) -> Settings:
    """A dataclass of settings from keyword arguments, each held against the annotation of its
    field.

    Arguments:
        kind: the dataclass.
        given: keyword arguments by name.
        beside: further arguments that the caller takes, for the message.

    Raises:
        InvalidInput: for a value that its field does not allow, and ``UnknownArgument``, for a name
            that no field has.
    """
    hints = hints_of(cast(Any, kind))
    known = [*beside, *(field.name for field in fields(kind))]  # type: ignore[arg-type]
    for name, value in given.items():
        if name not in known or name in beside:
            wanted = f"one of {', '.join(known)}"
            raise UnknownArgument(
                f"{name}: expected {wanted}, got an unexpected keyword argument {name!r}"
                f"{neighbour(name, known)}"
            )
        check_argument(name, value, hints[name])
    return kind(**given)


@functools.cache
def hints_of(of: Any) -> Mapping[str, Any]:
    """The annotations of a function or a class, resolved."""
    return MappingProxyType(get_type_hints(of))


def _fits(value: Any, hint: Any) -> bool:
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin is Literal:
        return isinstance(value, str) and value in parts
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is Sequence:
        several = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        return several and all(_fits(one, parts[0]) for one in value)
    if hint in (int, float):
        return isinstance(value, Integral if hint is int else Real) and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if members := _members(hint):
        return not isinstance(value, type) and all(
            hasattr(value, name)
            if isinstance(one, property)
            else callable(getattr(value, name, None))
            for name, one in members.items()
        )
    return isinstance(value, origin or hint)


def _members(hint: Any) -> dict[str, Any]:
    """The methods and properties that a protocol asks for, by name."""
    names = vars(hint) if getattr(hint, "_is_protocol", False) else {}
    public = {name: one for name, one in names.items() if not name.startswith("_")}
    return {name: one for name, one in public.items() if callable(one) or isinstance(one, property)}


def _expected(hint: Any) -> str:
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Literal:
        return f"one of {', '.join(map(str, parts))}"
    if origin in (Union, UnionType):
        words = list(dict.fromkeys(_expected(part) for part in parts))
        return " or ".join([", ".join(words[:-1]), words[-1]]) if words[1:] else words[0]
    if origin is Sequence:
        return f"a sequence ({_expected(parts[0])} each)"
    if members := _members(hint):
        names = (
            name if isinstance(one, property) else f"{name}(...)" for name, one in members.items()
        )
        return f"something with {', '.join(names)}"
    kind = origin or hint
    return _WORDS.get(kind) or _articled(kind.__name__)


def came(value: Any) -> str:
    """A value as messages show it: itself where it is plain, else its type."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, list | tuple) and value and all(isinstance(one, _PLAIN) for one in value):
        return shown(value)
    return shown(value) if isinstance(value, _PLAIN) else _articled(type(value).__name__)


def _articled(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
