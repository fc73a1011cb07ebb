"""Text, JSON, YAML and XML from files, in bounds: of size, of depth, and of how many values they
hold.

One reader a kind, for everything that people and other programs write: whatever is damaged, is too
large or grows out of proportion (YAML's aliases) is refused in one line, before the memory for it
is asked for.
"""

from __future__ import annotations

import errno
import json
import os
import re
import reprlib
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, ClassVar, TypeVar, cast, get_args, get_type_hints
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError, ParserCreate

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, create_model

from ..errors import InvalidInput, require

NULL = "expected texts without null bytes, which no name and no path has, got one"


class Strict:
    """Base of data classes that files are read as: a key that is no field is refused."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


def yaml_of(data: Any, *, flow: bool | None = None, width: int = 110) -> str:
    """The YAML text from which ``read_yaml`` reads these values, in this order.

    Arguments:
        flow: None for lists and mappings without others in them on one line each, False for none.
        width: letters of a line.
    """
    import yaml  # few files are YAML

    from .yaml_text import Quoting

    return yaml.dump(data, Dumper=Quoting, sort_keys=False, default_flow_style=flow, width=width)


_MOST_ERRORS = 20
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
    if wrong := "; ".join(f"{key}{line}" for line in no_numbers(kind, data)):
        raise InvalidInput(f"{where}: {wrong}" if where else wrong)
    return value


def no_numbers(kind: Any, data: Any) -> Iterator[str]:
    """Truth values and texts in a document that stand where its kind has numbers, which pydantic
    takes for some.
    """
    if not _has_words(data):
        return
    try:
        _reader(kind).validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        for item in error.errors(include_url=False):
            if item["type"] in ("int_type", "float_type") and isinstance(item["input"], bool | str):
                key = "".join(
                    f"[{part}]" if isinstance(part, int) else f".{part}" for part in item["loc"]
                )
                yield f"{key.lstrip('.')}: expected a number, got {shown(item['input'])}"
    except (TypeError, ValueError):
        return  # values of a program, and no document


def _has_words(data: Any) -> bool:
    """Tell whether a document has truth values, or texts that may pass for numbers."""
    if isinstance(data, Mapping):
        return any(map(_has_words, data.values()))
    if isinstance(data, list | tuple):
        return any(map(_has_words, data))
    return isinstance(data, bool) or (isinstance(data, str) and data.strip()[:1] in "+-.0123456789")


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
            raise InvalidInput(
                f"{prefix}{name}: expected one of {', '.join(known)}, got an unknown "
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
    """One "key: what was expected, got what" for everything wrong in a file, up to ``_MOST_ERRORS``.

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
    for item in errors[:_MOST_ERRORS]:
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
    if error.error_count() > _MOST_ERRORS:
        yield f"and {error.error_count() - _MOST_ERRORS} more"


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


YAML = (".yaml", ".yml")
"""How the names of YAML files end."""
MOST_BYTES = 128_000_000
"""Largest size of any file."""
_MOST_JSON_BYTES, _MOST_YAML_BYTES = 32_000_000, 1_000_000
"""Largest size of one document. YAML is for what people write by hand, and slow to read."""
_MOST_VALUES, MOST_YAML_VALUES = 2_000_000, 200_000
"""Most keys, lists and values of a document, what aliases stand for counted wherever they stand."""
DEEPEST = 60
"""Deepest nesting of a document."""
_TOO_DEEP = f"expected {DEEPEST} levels of nesting or fewer, got more"
_MOST_ELEMENTS = 1_000_000
"""Elements and attributes of an XML document."""

_NO_FILE = "a pipe, a socket or a device"
_FOUND = {
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG), "nothing there"),
    errno.ENXIO: _NO_FILE,
}
"""What is there in place of a file, by the system's error."""


def file_or_named(path: str | Path, shipped: Mapping[str, Path]) -> Path:
    """A path as it is, or the file of what ships by that name.

    Raises InvalidInput for what is neither.
    """
    path = Path(path)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    require(
        path.name in shipped,
        f"{path}: expected a file, or one of {', '.join(shipped)}, found nothing",
    )
    return shipped[path.name]


@contextmanager
def open_file(path: str | Path) -> Iterator[IO[bytes]]:
    """A file, open to be read.

    Raises InvalidInput for what is missing, cannot be read or is no file: a folder, or a pipe or a
    device, which might be waited for.
    """
    path = Path(path)
    try:
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except ValueError:  # a name that no file can have
        raise InvalidInput(f"{shown(str(path))}: expected a file, found nothing there") from None
    except OSError as error:
        found = _FOUND.get(error.errno or 0)
        why = f"expected a file, found {found}" if found else f"cannot be read: {error.strerror}"
        raise InvalidInput(f"{path}: {why}") from None
    mode = os.fstat(number).st_mode
    if not stat.S_ISREG(mode):
        os.close(number)
        kind = "a folder" if stat.S_ISDIR(mode) else _NO_FILE
        raise InvalidInput(f"{path}: expected a file, found {kind}")
    with os.fdopen(number, "rb") as stream:
        yield stream


def read_bytes(path: str | Path, most: int = MOST_BYTES) -> bytes:
    """Return a file's bytes, ``most`` at most.

    Raises InvalidInput as ``open_file`` does, and for a larger file.
    """
    with open_file(path) as stream:
        try:
            content = stream.read(most + 1)
        except OSError as error:
            raise InvalidInput(f"{path}: cannot be read: {error.strerror}") from None
    require(len(content) <= most, f"{path}: expected a file of {most} bytes or fewer, got more")
    return content


def read_text(path: str | Path) -> str:
    """Return a file's text.

    Raises InvalidInput for a file that is missing, no file, too large, empty or not UTF-8.
    """
    text = decoded(read_bytes(path), str(path))
    require(text.strip(), f"{path}: expected some text, the file is empty")
    return text


def decoded(content: bytes, where: str) -> str:
    """Return UTF-8 bytes as text, without the byte order mark that some editors begin a file with.

    Raises InvalidInput for anything else.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{where}: expected UTF-8 text, byte {error.start} is not") from None


def read_json(path: str | Path) -> Any:
    """Parse a file that holds one JSON document.

    Raises InvalidInput.
    """
    return parse_json(read_text(path), str(path))


def parse_json(text: str, where: str) -> Any:
    """Parse one JSON document.

    Raises InvalidInput with line and column, for a key that an object has twice, for numbers that
    JSON does not have (NaN, Infinity), for halves of letters and null bytes, and for a document
    beyond the limits of this module.
    """
    require(
        len(text) <= _MOST_JSON_BYTES,
        f"{where}: expected {_MOST_JSON_BYTES} letters of JSON or fewer, got {len(text)}",
    )
    require(
        sum(map(text.count, ",[{")) <= _MOST_VALUES,
        f"{where}: expected {_MOST_VALUES} values or fewer, got more",
    )
    try:
        value = json.loads(text, object_pairs_hook=_object, parse_constant=_no_number)
        _check_depth(value)
        require(not re.search(r"(?<!\\)(\\\\)*\\u0000", text), NULL)
        if "\\ud" in text or "\\uD" in text:
            json.dumps(value, ensure_ascii=False).encode()
    except json.JSONDecodeError as error:
        raise InvalidInput(
            f"{where}: expected JSON, broken at line {error.lineno} column {error.colno}: "
            f"{error.msg}"
        ) from None
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None
    except RecursionError:
        raise InvalidInput(
            f"{where}: expected JSON: {DEEPEST} levels of nesting or fewer, got more"
        ) from None
    except UnicodeEncodeError:
        raise InvalidInput(
            f"{where}: expected whole letters, got half of a surrogate pair"
        ) from None
    except ValueError as error:
        raise InvalidInput(f"{where}: expected JSON: {error}") from None
    return value


def read_yaml(path: str | Path) -> dict[str, Any]:
    """The keys and values of a YAML file.

    Raises InvalidInput.
    """
    return parse_yaml(read_text(path), str(path))


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """The keys and values of a YAML document.

    Raises InvalidInput for anything else, for a key that is there twice (YAML would take the last),
    and for a document beyond the limits of this module.
    """
    require(
        len(text) <= _MOST_YAML_BYTES,
        f"{where}: expected {_MOST_YAML_BYTES} letters of YAML or fewer, got {len(text)}",
    )
    import yaml  # few files are YAML

    from .yaml_text import Once, check_growth

    try:
        check_growth(text, DEEPEST, MOST_YAML_VALUES)
        data = yaml.load(text, Loader=Once)
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None
    except Exception as error:  # PyYAML's constructors raise whatever struck them
        message = " ".join(str(error).split()) or type(error).__name__
        if "maximum nesting depth" in message:  # PyYAML 6.0.4 looks ahead, and finds it first
            raise InvalidInput(f"{where}: {_TOO_DEEP}") from None
        message = message.replace('in "<unicode string>", ', "at ")
        raise InvalidInput(f"{where}: expected YAML, it is broken: {message:.300}") from None
    if not isinstance(data, dict):
        raise InvalidInput(f"{where}: expected keys and values, got {type(data).__name__}")
    return data


def parse_xml(content: str | bytes, root: str, *, deepest: int = DEEPEST) -> Element:
    """The root of an XML document, which has to have this name, its namespace aside; any one where
    it is empty.

    Raises InvalidInput, which names no file, for anything else, for a document with a type and
    entities of its own, and for one that is nested deeper than ``deepest`` or has more than
    ``_MOST_ELEMENTS`` elements and attributes.
    """
    depth, count = 0, 0

    def begun(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        if count == 0 and root and name.rpartition(":")[2] != root:
            raise InvalidInput(f"expected a {root}, got {shown(name)}")
        depth, count = depth + 1, count + 1 + len(attributes)
        if depth > deepest:
            raise InvalidInput(f"expected {deepest} levels of elements or fewer, got more")
        if count > _MOST_ELEMENTS:
            raise InvalidInput(
                f"expected {_MOST_ELEMENTS} elements and attributes or fewer, got more"
            )

    def ended(_: str) -> None:
        nonlocal depth
        depth -= 1

    def declared(*_: Any) -> None:
        raise InvalidInput("expected XML without a document type and entities, got something else")

    parser = ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = (
        begun,
        ended,
        declared,
    )
    try:
        parser.Parse(content.encode() if isinstance(content, str) else content, True)
        return ElementTree.fromstring(content)
    except (
        ExpatError,
        ElementTree.ParseError,
        ValueError,
        LookupError,
    ) as error:  # encodings, halves of letters
        raise InvalidInput(str(error)) from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        twice, times = Counter(name for name, _ in pairs).most_common(1)[0]
        raise InvalidInput(f"{twice}: expected this key once, got it {times} times")
    return record


def _no_number(name: str) -> float:
    raise InvalidInput(f"expected numbers as JSON has them, got {name}")


def _check_depth(value: Any) -> None:
    """Raise RecursionError for lists and objects in one another beyond the limit, without
    recursion.
    """
    level = [value]
    for _ in range(DEEPEST + 1):
        parts = (
            part.values() if isinstance(part, dict) else part
            for part in level
            if isinstance(part, dict | list)
        )
        level = [item for part in parts for item in part if isinstance(item, dict | list)]
        if not level:
            return
    raise RecursionError
