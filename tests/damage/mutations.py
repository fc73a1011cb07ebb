"""What can befall a file: bytes that flip, go missing or come twice, and contents that are well
formed and wrong.
"""

from __future__ import annotations

import copy
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import yaml

Bytes = Callable[[bytes, np.random.Generator], bytes]

DEEP: Any = []
for _ in range(200):
    DEEP = [DEEP]
ODD: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    2**31,
    -(2**63),
    10**30,
    10**400,
    1e308,
    -1e308,
    5e-324,
    1e-9,
    0.5,
    float("nan"),
    float("inf"),
    "",
    "x",
    "x" * 3000,
    "[red]\x1b[31m",
    "<&\"'>",
    "$\\frac{",
    "\ud800",
    "../../x",
    "/dev/null",
    [],
    {},
    [[]],
    [None],
    [1, "a"],
    {"a": 1},
    {"": {}},
    [0.0] * 600,
    [[0.0, 0.0, 0.0]] * 600,
    DEEP,
)
"""Values in the place of others."""
NUMBERS = (
    b"0",
    b"-1",
    b"1",
    b"nan",
    b"inf",
    b"1e400",
    b"-1e300",
    b"99999999999",
    b"4294967295",
    b"1e-300",
    b"",
    b"x",
    b"0x7f",
)


def flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """One to eight bits turned."""
    found = bytearray(content)
    for _ in range(rng.integers(1, 9)):
        found[rng.integers(len(found))] ^= 1 << int(rng.integers(8))
    return bytes(found)


def cut(content: bytes, rng: np.random.Generator) -> bytes:
    """The end, or a piece within, gone."""
    first, last = np.sort(rng.integers(0, len(content) + 1, 2))
    return content[:first] if rng.random() < 0.5 else content[:first] + content[last:]


def inserted(content: bytes, rng: np.random.Generator) -> bytes:
    """Random bytes, or a piece again, somewhere."""
    at, length = int(rng.integers(len(content) + 1)), int(rng.integers(1, 200))
    begin = int(rng.integers(len(content)))
    new = rng.bytes(length) if rng.random() < 0.5 else content[begin : begin + length]
    return content[:at] + new + content[at:]


def swapped(content: bytes, rng: np.random.Generator) -> bytes:
    """Two pieces in each other's place."""
    a, b, c, d = np.sort(rng.integers(0, len(content) + 1, 4))
    return content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]


def overwritten(content: bytes, rng: np.random.Generator) -> bytes:
    """Two, four or eight bytes that may be a length or an index, as others: none, all, huge,
    negative.
    """
    width = int(rng.choice([1, 2, 4, 8]))
    at = int(rng.integers(max(len(content) - width, 1)))
    value = [b"\0" * width, b"\xff" * width, b"\xff" * (width - 1) + b"\x7f", rng.bytes(width)][
        rng.integers(4)
    ]
    return content[:at] + value + content[at + width :]


PLAIN: tuple[Bytes, ...] = (flipped, cut, inserted, swapped, overwritten)


def renumbered(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three numbers of a text as others."""
    for _ in range(rng.integers(1, 4)):
        spots = list(re.finditer(rb"-?\d+(\.\d*)?(e-?\d+)?", content))
        if not spots:
            return content
        spot = spots[rng.integers(len(spots))]
        content = (
            content[: spot.start()] + NUMBERS[rng.integers(len(NUMBERS))] + content[spot.end() :]
        )
    return content


def reordered(content: bytes, rng: np.random.Generator) -> bytes:
    """Lines, or tags, that go missing, come twice or come elsewhere."""
    parts = re.split(rb"(?<=[\n>])", content)
    for _ in range(rng.integers(1, 4)):
        i, j = rng.integers(len(parts), size=2)
        kind = rng.integers(3)
        if kind == 0 and len(parts) > 1:
            del parts[i]
        elif kind == 1:
            parts.insert(i, parts[min(j, len(parts) - 1)])
        else:
            j = min(j, len(parts) - 1)
            i = min(i, len(parts) - 1)
            parts[i], parts[j] = parts[j], parts[i]
        if not parts:
            return b""
    return b"".join(parts)


def spots(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) of a tree of lists and mappings."""
    stack = [tree]
    while stack:
        part = stack.pop()
        for key in list(part) if isinstance(part, dict) else range(len(part)):
            yield part, key
            if isinstance(part[key], dict | list):
                stack.append(part[key])


def changed(tree: Any, rng: np.random.Generator) -> Any:
    """The tree with one or two of its parts odd, gone, renamed, many times there, or in another's
    place.
    """
    tree = copy.deepcopy(tree)
    for _ in range(rng.integers(1, 3)):
        found = list(spots(tree)) if isinstance(tree, dict | list) else []
        if not found:
            return tree
        part, key = found[rng.integers(len(found))]
        other, place = found[rng.integers(len(found))]
        kind = rng.integers(7)
        odd = copy.deepcopy(ODD[rng.integers(len(ODD))])
        if kind <= 2:
            part[key] = odd
        elif kind == 3:
            del part[key]
        elif kind == 4 and isinstance(part, dict):
            part[str(odd)[:20].replace("\ud800", "")] = part[key]
        elif kind == 5 and isinstance(part, list):
            part[key:key] = [copy.deepcopy(part[key])] * int(rng.choice([1, 3, 700]))
        else:
            part[key] = copy.deepcopy(other[place]) if (other is not part or place != key) else odd
    return tree


def json_tree(content: bytes, rng: np.random.Generator) -> bytes:
    """A JSON document, or one of its lines, changed."""
    lines = content.splitlines()
    try:
        return json.dumps(changed(json.loads(content), rng)).encode()
    except ValueError:
        k = int(rng.integers(len(lines)))
        lines[k] = json.dumps(changed(json.loads(lines[k]), rng)).encode()
        return b"\n".join(lines)


def yaml_tree(content: bytes, rng: np.random.Generator) -> bytes:
    """A YAML document changed, sometimes with an alias to a part of it."""
    text = yaml.safe_dump(changed(yaml.safe_load(content), rng), allow_unicode=True)
    return (
        text + ("again: &a [*a]\n", "again: &a {b: 1}\nmore: *a\n", "", "")[rng.integers(4)]
    ).encode(errors="replace")


def arrays_of(content: bytes) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of an archive."""
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def other_arrays(content: bytes, rng: np.random.Generator) -> bytes:
    """An archive with one array of another kind, shape or content, one more, or one fewer."""
    arrays: dict[str, Any] = arrays_of(content)
    name = sorted(arrays)[rng.integers(len(arrays))]
    array = arrays[name]
    made: list[Callable[[], Any]] = [
        lambda: array.astype("f2"),
        lambda: array.astype("U"),
        lambda: array.astype(object),
        lambda: array[..., None],
        lambda: array.ravel(),
        lambda: array[:0],
        lambda: np.array(array.size),
        lambda: array.astype(">c16"),
        lambda: np.full_like(array, -1),
        lambda: np.where(np.arange(array.size).reshape(array.shape) % 3, array, np.nan),
        lambda: np.array([1e300] * 3),
        lambda: array.astype("i1"),
        lambda: np.array(["\ud800x"]),
        lambda: array.T,
    ]
    try:
        new = made[rng.integers(len(made))]()
    except (ValueError, TypeError, UnicodeError, IndexError):
        new = np.zeros((2, 2, 2))
    kind = rng.integers(6)
    if kind == 0:
        del arrays[name]
    else:
        arrays[name if kind > 1 else f"{name}_2"] = new
    packed = io.BytesIO()
    try:
        np.savez(packed, **arrays)
    except UnicodeError:
        return content[:-1]
    return packed.getvalue()


def other_header(content: bytes, rng: np.random.Generator) -> bytes:
    """An .npy array, or one of an archive's, whose header declares something else."""
    if content[:6] == b"\x93NUMPY":
        return _headed(content, rng)
    box = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as old,
        zipfile.ZipFile(box, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        names = old.namelist()
        spoilt = names[rng.integers(len(names))]
        for name in names:
            data = old.read(name)
            new.writestr(name, _headed(data, rng) if name == spoilt else data)
    return box.getvalue()


def _headed(content: bytes, rng: np.random.Generator) -> bytes:
    shapes = (
        "(1000000000000,)",
        "(4, 1000000000)",
        "()",
        "(-1,)",
        "(0, 99999999999)",
        "(2.0,)",
        "('a',)",
        "(" * 90,
    )
    kinds = (
        "|O",
        "<f8",
        "<U0",
        "<U999999999",
        "|V8",
        "<c16",
        "<M8[s]",
        ">f8",
        "|b1",
        "x",
        "<f99",
        "|S0",
    )
    head = f"{{'descr': '{kinds[rng.integers(len(kinds))]}', 'fortran_order': False, 'shape': (4, 4), }}"
    if rng.random() < 0.5:
        head = f"{{'descr': '<f8', 'fortran_order': True, 'shape': {shapes[rng.integers(len(shapes))]}, }}"
    text = (head + "\n").encode()
    length = struct.unpack("<H", content[8:10])[0]
    return content[:6] + b"\x01\x00" + struct.pack("<H", len(text)) + text + content[10 + length :]


def other_directory(content: bytes, rng: np.random.Generator) -> bytes:
    """A field of a zip file's headers as another: sizes, offsets, methods, flags, names."""
    found = bytearray(content)
    marks = [spot.start() for spot in re.finditer(rb"PK\x01\x02|PK\x03\x04|PK\x05\x06", content)]
    at = marks[rng.integers(len(marks))] + int(rng.integers(4, 46))
    width = int(rng.choice([1, 2, 4]))
    found[at : at + width] = (b"\xff" * width, b"\0" * width, rng.bytes(width))[rng.integers(3)]
    return bytes(found[: max(len(content), 1)])


def other_chunk(content: bytes, rng: np.random.Generator) -> bytes:
    """A PNG with a field of its head as another, and its sum right."""
    head = bytearray(content[16:29])
    at = int(rng.integers(13))
    head[at] = int(rng.integers(256))
    if rng.random() < 0.3:
        head[:8] = struct.pack(">II", 50_000, 50_000)
    return (
        content[:16]
        + bytes(head)
        + struct.pack(">I", zlib.crc32(b"IHDR" + bytes(head)))
        + content[33:]
    )


def other_records(content: bytes, rng: np.random.Generator) -> bytes:
    """An MCAP file with a record's length, kind or JSON as another, gone, twice, or cut off after
    it.
    """
    records, at = [], 8
    while at + 9 <= len(content) - 8:
        length = struct.unpack("<Q", content[at + 1 : at + 9])[0]
        records.append((content[at : at + 1], content[at + 9 : at + 9 + length]))
        at += 9 + length
    k = int(rng.integers(len(records)))
    kind, data = records[k]
    size = len(data)
    choice = rng.integers(7)
    if choice <= 2 and kind == b"\x05":
        data = data[:22] + json.dumps(changed(json.loads(data[22:]), rng)).encode()
        size = len(data)
    elif choice == 3:
        size = int(rng.choice([0, 1, size + 1, 2**31, 2**63 - 1, max(size - 1, 0)]))
    elif choice == 4:
        kind = bytes([rng.integers(256)])
    elif choice == 5:
        del records[k:]
    else:
        records.insert(k, records[rng.integers(len(records))])
    if k < len(records):
        records[k] = kind, data
    packed = [
        kind + struct.pack("<Q", size if i == k else len(data)) + data
        for i, (kind, data) in enumerate(records)
    ]
    return content[:8] + b"".join(packed) + content[-8:]


def other_metadata(content: bytes, rng: np.random.Generator) -> bytes:
    """A safetensors file with another header: offsets, shapes, types, or the JSON of the house in
    it.
    """
    size = struct.unpack("<Q", content[:8])[0]
    head = json.loads(content[8 : 8 + size])
    if rng.random() < 0.6:
        mine = changed(json.loads(head["__metadata__"]["stancekit"]), rng)
        head["__metadata__"]["stancekit"] = json.dumps(mine)
    else:
        head = changed(head, rng)
    text = json.dumps(head).encode()
    return struct.pack("<Q", len(text)) + text + content[8 + size :]
