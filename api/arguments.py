"""Arguments of the library's verbs, held against their annotations: what does not fit is one line that says so."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, Protocol, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown
from stancekit.planners.problem import PostureProblem

P = ParamSpec("P")
R = TypeVar("R")
PLAIN = (NoneType, bool, int, float, str)
"""What a message shows itself; of other things it shows the type."""
WORDS = {
    NoneType: "None", bool: "True or False", int: "an integer", float: "a number", str: "text", Path: "a Path",
    type: "a class", np.ndarray: "an array",
}  # fmt: skip


class Sampler(Protocol):
    """Anything that draws posture problems."""

    def sample(self, rng: np.random.Generator) -> PostureProblem:
        """Draw one."""
        ...


def checked(verb: Callable[P, R]) -> Callable[P, R]:
    """The same function, which raises InvalidInput for an argument of a type that its annotation does not name.

    Names (``Literal``) are left to whoever knows them all. A protocol is fulfilled by an instance with its methods.
    """
    signature = inspect.signature(verb)
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    single = [name for name, parameter in signature.parameters.items() if parameter.kind not in kinds]

    @functools.wraps(verb)
    def held(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            hints, given = _hints(verb), signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(f"stancekit.{verb.__name__}: {error}; it takes {', '.join(signature.parameters)}") from None
        for name in single:
            if name in given and not _fits(given[name], hints[name]):
                raise InvalidInput(f"{name}: expected {_expected(hints[name])}, got {_came(given[name])}")
        return verb(*args, **kwargs)

    return held


@functools.cache
def _hints(verb: Callable[..., Any]) -> dict[str, Any]:
    return get_type_hints(verb)


def _fits(value: Any, hint: Any) -> bool:
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any or origin is Literal:
        return True
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is Sequence:
        several = isinstance(value, Sequence) and not isinstance(value, str)
        return several and all(_fits(one, parts[0]) for one in value)
    if hint in (int, float):
        return isinstance(value, Integral if hint is int else Real) and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if methods := _methods(hint):
        return not isinstance(value, type) and all(callable(getattr(value, name, None)) for name in methods)
    return isinstance(value, origin or hint)


def _methods(hint: Any) -> list[str]:
    """What a protocol asks for."""
    names = vars(hint) if getattr(hint, "_is_protocol", False) else {}
    return [name for name in names if not name.startswith("_") and callable(names[name])]


def _expected(hint: Any) -> str:
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Literal:
        return f"one of {', '.join(map(str, parts))}"
    if origin in (Union, UnionType):
        words = list(dict.fromkeys(_expected(part) for part in parts))
        return " or ".join([", ".join(words[:-1]), words[-1]]) if words[1:] else words[0]
    if origin is Sequence:
        return f"a sequence ({_expected(parts[0])} each)"
    if methods := _methods(hint):
        return f"something with {', '.join(f'{name}(...)' for name in methods)}"
    kind = origin or hint
    return WORDS.get(kind) or _articled(kind.__name__)


def _came(value: Any) -> str:
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return shown(value) if isinstance(value, PLAIN) else _articled(type(value).__name__)


def _articled(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
