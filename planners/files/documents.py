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
import stat
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError, ParserCreate

from ..errors import InvalidInput
from .validation import shown

YAML = (".yaml", ".yml")
"""How the names of YAML files end."""
MOST_BYTES = 128_000_000
"""Largest size of any file."""
MOST_JSON_BYTES, MOST_YAML_BYTES = 32_000_000, 1_000_000
"""Largest size of one document. YAML is for what people write by hand, and slow to read."""
MOST_VALUES, MOST_YAML_VALUES = 2_000_000, 200_000
"""Most keys, lists and values of a document, what aliases stand for counted wherever they stand."""
DEEPEST = 60
"""Deepest nesting of a document."""
TOO_DEEP = f"expected {DEEPEST} levels of nesting or fewer, got more"
MOST_ELEMENTS = 1_000_000
"""Elements and attributes of an XML document."""

NO_FILE = "a pipe, a socket or a device"


def file_or_named(path: str | Path, shipped: Mapping[str, Path]) -> Path:
    """A path as it is, or the file of what ships by that name.

    Raises InvalidInput for what is neither.
    """
    path = Path(path)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    if path.name not in shipped:
        raise InvalidInput(
            f"{path}: expected a file, or one of {', '.join(shipped)}, found nothing"
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
        if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG):
            raise InvalidInput(f"{path}: expected a file, found nothing there") from None
        if error.errno == errno.ENXIO:
            raise InvalidInput(f"{path}: expected a file, found {NO_FILE}") from None
        raise InvalidInput(f"{path}: cannot be read: {error.strerror}") from None
    mode = os.fstat(number).st_mode
    if not stat.S_ISREG(mode):
        os.close(number)
        kind = "a folder" if stat.S_ISDIR(mode) else NO_FILE
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
    if len(content) > most:
        raise InvalidInput(f"{path}: expected a file of {most} bytes or fewer, got more")
    return content


def read_text(path: str | Path) -> str:
    """Return a file's text.

    Raises InvalidInput for a file that is missing, no file, too large, empty or not UTF-8.
    """
    text = decoded(read_bytes(path), str(path))
    if not text.strip():
        raise InvalidInput(f"{path}: expected some text, the file is empty")
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
    JSON does not have (NaN, Infinity), for halves of letters, and for a document beyond the limits
    of this module.
    """
    if len(text) > MOST_JSON_BYTES:
        raise InvalidInput(
            f"{where}: expected {MOST_JSON_BYTES} letters of JSON or fewer, got {len(text)}"
        )
    if sum(map(text.count, ",[{")) > MOST_VALUES:
        raise InvalidInput(f"{where}: expected {MOST_VALUES} values or fewer, got more")
    try:
        value = json.loads(text, object_pairs_hook=_object, parse_constant=_no_number)
        _check_depth(value)
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
    if len(text) > MOST_YAML_BYTES:
        raise InvalidInput(
            f"{where}: expected {MOST_YAML_BYTES} letters of YAML or fewer, got {len(text)}"
        )
    from .yaml_text import value_of  # slow to import

    try:
        data = value_of(text, deepest=DEEPEST, most=MOST_YAML_VALUES)
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None
    except Exception as error:  # PyYAML's constructors raise whatever struck them
        message = " ".join(str(error).split()) or type(error).__name__
        if "maximum nesting depth" in message:  # PyYAML 6.0.4 looks ahead, and finds it first
            raise InvalidInput(f"{where}: {TOO_DEEP}") from None
        message = message.replace('in "<unicode string>", ', "at ")
        raise InvalidInput(f"{where}: expected YAML, it is broken: {message:.300}") from None
    if not isinstance(data, dict):
        raise InvalidInput(f"{where}: expected keys and values, got {type(data).__name__}")
    return data


def parse_xml(content: str | bytes, root: str, *, deepest: int = DEEPEST) -> Element:
    """The root of an XML document, which has to have this name, its namespace aside.

    Raises InvalidInput, which names no file, for anything else, for a document with a type and
    entities of its own, and for one that is nested deeper than ``deepest`` or has more than
    ``MOST_ELEMENTS`` elements and attributes.
    """
    depth, count = 0, 0

    def begun(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        if count == 0 and name.rpartition(":")[2] != root:
            raise InvalidInput(f"expected a {root}, got {shown(name)}")
        depth, count = depth + 1, count + 1 + len(attributes)
        if depth > deepest:
            raise InvalidInput(f"expected {deepest} levels of elements or fewer, got more")
        if count > MOST_ELEMENTS:
            raise InvalidInput(
                f"expected {MOST_ELEMENTS} elements and attributes or fewer, got more"
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
