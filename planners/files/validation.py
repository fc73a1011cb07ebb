"""Phrases of refusals: what came, in few letters however large it is, and what pydantic refused in
a file.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import lru_cache
from typing import Any, TypeVar, cast, get_args, get_type_hints

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, create_model

from ..errors import InvalidInput

MOST_ERRORS = 20
"""So many are told of a file; that there are more is said."""

Value = TypeVar("Value")


class _Shown(reprlib.Repr):
    """``repr`` that looks at no more of a value than it shows: what is cut off is never made into
    text.
    """

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most, self.maxlevel = most, 4
        self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdict = (
            self.maxdeque
        ) = most // 2
        self.left = 4 * most  # parts that may still be looked at

    def repr1(self, x: Any, level: int) -> str:
        self.left -= 1
        return super().repr1(x, level) if self.left > 0 else "…"

    def repr_str(self, x: str, level: int) -> str:
        return repr(x[: self.most])

    def repr_bytes(self, x: bytes, level: int) -> str:
        return repr(x[: self.most])

    def repr_int(self, x: int, level: int) -> str:
        return repr(x) if x.bit_length() < 10_000 else f"an integer of {x.bit_length()} bits"

    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        if level <= 0:
            return "{…}"
        pairs = zip(x.items(), range(self.maxdict), strict=False)
        return (
            "{"
            + ", ".join(
                f"{self.repr1(k, level - 1)}: {self.repr1(v, level - 1)}" for (k, v), _ in pairs
            )
            + "}"
        )


def shown(value: Any, most: int = 60) -> str:
    """Text of a value in one line, as Python writes it, cut after ``most`` letters; its cost does
    not grow with the value.
    """
    return " ".join(_Shown(most).repr(value)[:most].splitlines())


def validated(kind: type[Value], data: Any, where: str = "", *, key: str = "") -> Value:
    """Read a file or a mapping as a pydantic model, or as a dataclass whose fields say what they
    may be.

    Arguments:
        where: the file, which the message begins with.
        key: what every key in it begins with.

    Raises:
        InvalidInput: with every key that is wrong.
    """
    try:
        value: Value = _reader(cast(Any, kind)).validate_python(data)
    except ValidationError as error:
        message = "; ".join(key + line for line in validation_errors(error, kind))
        raise InvalidInput(f"{where}: {message}" if where else message) from None
    return value


def typed(kind: type[Value], given: Mapping[str, Any], where: str) -> Value:
    """The settings of a dataclass from a mapping, whose wrong keys are refused by name.

    Arguments:
        kind: the dataclass.
        where: what every key begins with.

    Raises:
        InvalidInput: with every key that is wrong.
    """
    prefix = f"{where}." if where else ""
    known = [field.name for field in fields(cast(Any, kind))]
    for name in given:
        if name not in known:
            wanted = f"one of {', '.join(known)}"
            raise InvalidInput(
                f"{prefix}{name}: expected {wanted}, got an unknown "
                f"key{neighbour(str(name), known)}"
            )
    return validated(kind, dict(given), key=prefix)


def check_fields(value: Any, key: str = "") -> None:
    """Check a dataclass's fields against their annotations, as pydantic reads them; called in
    ``__post_init__``.

    Arguments:
        key: what every key begins with.

    Raises:
        InvalidInput: with every field that is wrong.
    """
    try:
        _model(cast(Any, type(value))).model_validate(vars(value))
    except ValidationError as error:
        raise InvalidInput(
            "; ".join(key + line for line in validation_errors(error, type(value)))
        ) from None


@lru_cache(maxsize=64)
def _model(kind: type[Any]) -> type[BaseModel]:
    fields: dict[str, Any] = {
        name: (hint, ...) for name, hint in get_type_hints(kind, include_extras=True).items()
    }
    strict = ConfigDict(strict=True, arbitrary_types_allowed=True, protected_namespaces=())
    return create_model(kind.__name__, __config__=strict, **fields)


@lru_cache(maxsize=64)
def _reader(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def neighbour(name: str, known: Iterable[str]) -> str:
    """Hint that follows "unknown key" in a refusal: the known one that is most like it, if one
    is.
    """
    near = get_close_matches(name, sorted(known), n=1)
    return f", did you mean {near[0]!r}?" if near else ""


def validation_errors(error: ValidationError, kind: Any) -> Iterator[str]:
    """One "key: what was expected, got what" for everything wrong in a file, up to ``MOST_ERRORS``.

    Arguments:
        kind: what was read. Where a dataclass refused its values (InvalidInput), what it said, with
            its place before it. Of a file of another format, that alone.
    """
    errors = error.errors(include_url=False)
    other = [
        item
        for item in errors
        if item["loc"] == ("format",) and str(item["input"]).startswith("stancekit/")
    ]
    if other:  # another kind of file: its keys are right, there
        yield f"format: {other[0]['msg'].replace('Input should be', 'expected')}, got {shown(other[0]['input'])}"
        return
    for item in errors[:MOST_ERRORS]:
        key = "".join(
            f"[{part}]" if isinstance(part, int) else f".{part}" for part in item["loc"]
        ).lstrip(".")
        cause = item.get("ctx", {}).get("error")
        if isinstance(cause, InvalidInput):
            parts = _SAID.split(str(cause)) if key else [str(cause)]
            yield "; ".join(_placed(key, part) for part in parts)
        elif item["type"] in ("missing", "missing_argument"):
            yield f"{key}: expected this key, got nothing"
        elif item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            yield f"{key}: unknown key{neighbour(str(item['loc'][-1]), _known(kind, item['loc'][:-1]))}"
        elif item["type"] in (
            "union_tag_invalid",
            "union_tag_not_found",
        ):  # of a union told apart by one of its keys
            context = item["ctx"]
            name = str(context["discriminator"]).strip("'")
            by = f"{key}.{name}".lstrip(".")
            if "tag" in context:
                yield f"{by}: expected one of {context['expected_tags']}, got {shown(context['tag'])}"
            else:
                yield f"{by}: expected this key, got nothing"
        elif item["type"] in ("tuple_type", "list_type"):
            yield f"{key}: expected a list in brackets, got {shown(item['input'])}"
        else:
            wanted = (
                item["msg"].replace("Input should be", "expected").partition(" or instance of ")[0]
            )
            yield f"{key}: {wanted}, got {shown(item['input'])}".removeprefix(": ")
    if error.error_count() > MOST_ERRORS:
        yield f"and {error.error_count() - MOST_ERRORS} more"


_SAID = re.compile(r"; (?=[a-z_]+[\w\[\].]*: expected)")
"""Between things that a class says are wrong with its values."""


def _placed(key: str, said: str) -> str:
    """Sentence about the value of a key, or about a key or an entry in it, or about a value by its
    name.
    """
    if not key or said.startswith(f"{key} "):  # as in "robot go1: ..."
        return said
    return (
        f"{key}{': ' if said.startswith('expected') else '' if said.startswith('[') else '.'}{said}"
    )


def _known(kind: Any, place: Sequence[int | str]) -> set[str]:
    """The keys that a file may have at a place in it, as pydantic names places."""
    kinds = _kinds(kind)
    for part in place:
        hints = [_hints(each) for each in kinds]
        inside = [hint[part] for hint in hints if part in hint]
        known = {  # a branch of a union, by what one of its keys has to be
            each
            for each, hint in zip(kinds, hints, strict=True)
            if any(part in get_args(one) for one in hint.values())
        }
        kinds = set[type]().union(*map(_kinds, inside)) or known or kinds
    return {name for each in kinds for name in _hints(each)}


def _kinds(hint: Any) -> set[type]:
    """Classes with fields that an annotation stands for, alone or as an element."""
    alone = isinstance(hint, type) and (is_dataclass(hint) or issubclass(hint, BaseModel))
    return set[type]([hint] if alone else []).union(*map(_kinds, get_args(hint)))


def _hints(kind: Any) -> dict[str, Any]:
    """Types of the fields of a class; nothing where names are in them that only a type checker
    knows.
    """
    names = kind.__dataclass_fields__ if is_dataclass(kind) else kind.model_fields
    try:
        return {
            name: hint
            for name, hint in get_type_hints(kind, include_extras=True).items()
            if name in names
        }
    except NameError:
        return {}
