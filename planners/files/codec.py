"""JSON forms of values, written and read by the fields that their classes say, and by nothing else.

A value is an object whose keys are its fields, in their order; arrays and tuples are lists. What a
file needs beside that, a class says once:

* in the metadata of a field: ``LATER``, ``UNWRITTEN``, ``INLINE``, ``{"key": NAME}``;
* by ``FORMAT``, the value of the first key, ``format``, if it is a file of its own;
* if its form in files is another one, by a method ``to_json`` and by ``KEYS``, the class of that form, whose method
  ``value`` gives the value.
"""

from __future__ import annotations

import base64
import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import lru_cache, partial
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field as Key,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainValidator,
    Strict,
    WithJsonSchema,
    create_model,
)
from pydantic_core import CoreSchema, core_schema

from ..errors import InvalidInput, located
from .arrays import LARGEST, Array, archive_of, checked, collect_errors
from .documents import shown, validated

_Index = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Columns:
    """A sparse matrix by columns, as Clarabel reads one; importing ``scipy.sparse`` takes longer
    than most solves.

    Arguments:
        data, indices: values and rows of the entries, in order.
        indptr: where each column begins and the last one ends.
    """

    data: Array
    indices: _Index
    indptr: _Index
    shape: tuple[int, int]
    has_canonical_format: ClassVar[bool] = True

    @property
    def columns(self) -> _Index:
        """The column of every entry."""
        return np.repeat(np.arange(self.shape[1]), np.diff(self.indptr))

    def transposed_times(self, z: Array) -> Array:
        """A'z."""
        return np.bincount(
            self.columns, self.data * z[self.indices], minlength=self.shape[1]
        ).astype(np.float64, copy=False)


def embedded(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Arrays by name as the text of a compressed archive; equal arrays give equal texts."""
    return base64.b64encode(archive_of(arrays)).decode("ascii")


def extracted(text: str, where: str) -> bytes:
    """The archive that ``embedded`` made a text of.

    Raises InvalidInput for a text that is no base64.
    """
    try:
        return base64.b64decode(text, validate=True)
    except ValueError as error:
        raise InvalidInput(f"{where}: expected base64 text: {error}") from None


LATER: Mapping[str, Any] = types.MappingProxyType({"later": True})
"""Metadata of a field that is written only where it is not its default."""
UNWRITTEN: Mapping[str, Any] = types.MappingProxyType({"unwritten": True})
"""Metadata of a field that no file has: it follows from others, or is of the running process."""

INLINE: Mapping[str, Any] = types.MappingProxyType({"inline": True})
"""Metadata of a field that is a value whose own keys stand among those of this one."""

Value = TypeVar("Value")
_PLAIN = ConfigDict(
    extra="forbid", arbitrary_types_allowed=True, protected_namespaces=(), defer_build=True
)


def to_json(value: Any) -> Any:
    """JSON-ready values of a value: of a dataclass, an array, a tuple, a mapping, or plain as it
    is.
    """
    if type(value) in (float, int, str, bool, types.NoneType):
        return value
    if isinstance(value, np.ndarray):
        return value.tolist()
    if is_dataclass(value):
        method = getattr(value, "to_json", None)
        return fields_to_json(value) if method is None else method()
    if isinstance(value, list | tuple):
        return [to_json(each) for each in value]
    if isinstance(value, Mapping):
        return {name: to_json(each) for name, each in value.items()}
    return value


def fields_to_json(value: Any, leave: tuple[str, ...] = ()) -> dict[str, Any]:
    """JSON-ready values of a dataclass, field by field.

    Arguments:
        leave: fields that are not written.
    """
    record: dict[str, Any] = {"format": value.FORMAT} if hasattr(value, "FORMAT") else {}
    for name, key, default in _written(cast(Any, type(value))):
        member = getattr(value, name)
        usual = default is not MISSING and not isinstance(member, np.ndarray) and member == default
        if usual or name in leave:
            continue
        if key is None:
            record |= to_json(member)
        else:
            record[key] = to_json(member)
    return record


def from_json(kind: type[Value], data: Any, *, whole: bool = True, where: str = "") -> Value:
    """The value of a class that ``to_json`` wrote.

    Arguments:
        kind: the class.
        data: what a file holds.
        whole: every key has to be there but those of ``LATER``, as in files that programs write;
            else a key that is not there has its default, as in files that people write.
        where: the file, which the message begins with.

    Raises:
        InvalidInput: with every key that is wrong, separated by "; ".
    """
    file_format = getattr(kind, "FORMAT", "")
    if file_format and not isinstance(data, Mapping):
        raise InvalidInput(
            f"expected a JSON object with format {file_format!r}, got {type(data).__name__}"
        )
    keys = validated(keys_of(cast(Any, kind), whole=whole), data, where)
    with located(where):
        return cast(Value, _value(kind, keys))


@lru_cache(maxsize=128)
def keys_of(kind: Any, *, whole: bool = True) -> type[BaseModel]:
    """The keys of a class as pydantic checks them; arguments as of ``from_json``."""
    form = _form(kind)
    keys: dict[str, Any] = (
        {"format": (Literal[form.FORMAT], ...)} if hasattr(form, "FORMAT") else {}
    )
    made: type[BaseModel] = create_model(
        form.__name__,
        __config__=_PLAIN,
        __doc__=form.__doc__,
        __module__=form.__module__,
        **keys,
        **_keys(form, whole),
    )
    return made


def _form(kind: Any) -> type[Any]:
    """The class whose fields are the keys of a class."""
    form: type[Any] = getattr(kind, "KEYS", kind)
    return form


def _keys(kind: Any, whole: bool) -> dict[str, Any]:
    """Annotation and default of every key of a class, as pydantic makes models of them."""
    hints, keys = get_type_hints(kind, include_extras=True), dict[str, Any]()
    for field in _in_files(kind):
        if "inline" in field.metadata:
            keys |= _keys(hints[field.name], whole)
            continue
        needed = whole and "later" not in field.metadata
        alias = field.metadata.get("key")
        if field.default_factory is not MISSING and not needed:
            key = Key(default_factory=field.default_factory, alias=alias)
        else:
            optional = field.default is not MISSING and not needed
            key = Key(field.default if optional else ..., alias=alias)
        keys[field.name] = _key_of(hints[field.name], whole=whole), key
    return keys


def _key_of(hint: Any, *, whole: bool = True) -> Any:
    """An annotation of a field as a file has it: numbers strictly, lists for tuples and arrays,
    objects for values.
    """
    part = partial(_key_of, whole=whole)
    if hint in (float, int, str, bool):
        return Annotated[hint, Strict()]
    origin, of = get_origin(hint), get_args(hint)
    if origin is np.ndarray:
        return Annotated[Any, PlainValidator(lambda value: numbers(value)), _NUMBERS]
    if origin is Annotated:
        return Annotated[part(of[0]), *of[1:]]
    if origin in (Union, types.UnionType):
        return Union[tuple(map(part, of))]  # noqa: UP007 - of as many as there are
    if origin is tuple:
        return tuple[*(each if each is ... else part(each) for each in of)]  # type: ignore[misc]
    if is_dataclass(hint):
        return Annotated[
            keys_of(cast(Any, hint), whole=whole), AfterValidator(partial(_value, hint))
        ]
    return hint


class _Keys:
    """Metadata of a field of a pydantic model that is a value, read by its class's keys.

    Arguments:
        whole: all keys have to be there.
    """

    def __init__(self, *, whole: bool) -> None:
        self._whole = whole

    def __get_pydantic_core_schema__(self, kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        def read(data: Any, of_keys: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return data if isinstance(data, kind) else of_keys(data)

        written = core_schema.plain_serializer_function_ser_schema(to_json)
        keys = handler.generate_schema(_key_of(kind, whole=self._whole))
        return core_schema.no_info_wrap_validator_function(read, keys, serialization=written)


KEYS = _Keys(whole=False)
"""``Annotated[Class, KEYS]`` in a pydantic model: a value of that class by its keys, or as it is;
keys that are not there have their defaults."""
ALL_KEYS = _Keys(whole=True)
"""The same where all keys have to be there."""
_NUMBERS = WithJsonSchema({"type": "array", "items": {"type": "number"}})
"""Words of the reference of keys for arrays, of whatever shape."""


def numbers(value: Any, deepest: int = 8) -> Any:
    """Lists of numbers as a file has them, of which a class makes its array.

    Raises InvalidInput for anything else in them: also for truth values and texts, which NumPy
    takes for numbers.
    """
    if not isinstance(value, list | tuple):
        raise InvalidInput(f"expected a list in brackets, got {shown(value)}")
    if not deepest:
        raise InvalidInput("expected lists of numbers, got lists that are nested too deep")
    for index, each in enumerate(value):
        if type(each) not in (float, int):
            try:
                numbers(each, deepest - 1)
            except InvalidInput as error:
                inner = str(error)
                if not isinstance(each, list | tuple):
                    inner = f"expected a valid number, got {shown(each)}"
                raise InvalidInput(
                    f"[{index}]{': ' if inner.startswith('expected') else ''}{inner}"
                ) from None
    return value


@dataclass(frozen=True, kw_only=True)
class Within:
    """Limits of a number, given as the metadata of its field; the class that has the field, the
    reader of its files and the reference of keys all take the limits from here.

    Arguments:
        above: the number must be larger than this; None for no such limit.
        least, most: the number must lie in [least, most].
    """

    above: float | None = None
    least: float = -LARGEST
    most: float = LARGEST

    def check(self, number: Any, where: str = "") -> float:
        """The number, where it is within.

        Raises InvalidInput.
        """
        try:
            return checked(number, where, above=self.above, least=self.least, most=self.most)
        except InvalidInput as error:
            raise InvalidInput(str(error).removeprefix(": ")) from None

    def __get_pydantic_core_schema__(self, kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(kind))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        least = {"minimum": self.least} if self.above is None else {"exclusiveMinimum": self.above}
        return handler(schema) | least | {"maximum": self.most}


def check_limits(value: Any) -> None:
    """Check the fields of a dataclass that say ``Within``, but for None where it may be.

    Raises InvalidInput with all that is wrong.
    """
    collect_errors(
        *(
            partial(limits.check, getattr(value, name), name)
            for name, limits in _limits(cast(Any, type(value))).items()
            if getattr(value, name) is not None or name not in _optional(cast(Any, type(value)))
        )
    )


@lru_cache(maxsize=128)
def _optional(kind: Any) -> frozenset[str]:
    """Names of the fields that may be None."""
    hints = get_type_hints(kind)
    return frozenset(name for name, hint in hints.items() if type(None) in get_args(hint))


@lru_cache(maxsize=128)
def _limits(kind: Any) -> dict[str, Within]:
    """The limits of the fields that say some, by name."""
    result = dict[str, Within]()
    for name, hint in get_type_hints(kind, include_extras=True).items():
        several = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
        for limits in (each for part in several for each in getattr(part, "__metadata__", ())):
            if isinstance(limits, Within):
                result[name] = limits
    return result


def _value(kind: Any, keys: BaseModel) -> Any:
    """The value of these keys, whatever its form.

    Raises InvalidInput.
    """
    form = _form(kind)
    made = _made(form, keys)
    return made if form is kind else made.value()


def _made(kind: Any, keys: BaseModel) -> Any:
    """The value of these keys.

    Raises InvalidInput with all that is wrong with it and with what is inline.
    """
    inline, wrong = _inline(kind), list[str]()
    members = {
        field.name: getattr(keys, field.name)
        for field in _in_files(kind)
        if field.name not in inline
    }
    for name, of in inline.items():
        try:
            members[name] = _made(of, keys)
        except InvalidInput as error:
            wrong.append(str(error))
            members[name] = None
    try:
        made = kind(**members)
    except InvalidInput as error:
        wrong += [text for text in str(error).split("; ") if not text.startswith(tuple(inline))]
        if not inline:
            raise
    if wrong:
        raise InvalidInput("; ".join(wrong))
    return made


@lru_cache(maxsize=128)
def _inline(kind: Any) -> dict[str, Any]:
    """The classes of the fields whose keys stand among those of the class."""
    names = [field.name for field in _in_files(kind) if "inline" in field.metadata]
    hints = get_type_hints(kind) if names else {}
    return {name: hints[name] for name in names}


@lru_cache(maxsize=128)
def _in_files(kind: Any) -> tuple[Field[Any], ...]:
    """The fields that files have."""
    return tuple(field for field in fields(kind) if "unwritten" not in field.metadata)


@lru_cache(maxsize=128)
def _written(kind: Any) -> tuple[tuple[str, str | None, Any], ...]:
    """Name, key (None where the value's own stand in its place), and the default that is not
    written (or ``MISSING``) of each field.
    """
    return tuple(
        (
            field.name,
            None if "inline" in field.metadata else field.metadata.get("key", field.name),
            field.default if "later" in field.metadata else MISSING,
        )
        for field in _in_files(kind)
    )
