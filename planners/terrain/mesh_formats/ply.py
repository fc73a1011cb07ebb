"""PLY files, text and binary of either byte order: vertices and faces; without faces they are
clouds.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...files.arrays import Array
from ...files.documents import shown
from .numbers import (
    MOST_TRIANGLES,
    Surface,
    blocks,
    broken,
    check_count,
    check_fields,
    polygons,
    reals,
    wholes,
)

_STL_HEAD, _FACET = 84, 50
"""Bytes of a binary file's header, count included, and of one facet."""
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(content: bytes, most: int) -> Surface:
    """Every facet with three corners of its own.

    Raises InvalidInput for what is neither kind of STL.

    A file is binary where its count of facets fits its size; zeros and blanks after them are left
    out.
    """
    count = struct.unpack("<I", content[80:_STL_HEAD])[0] if len(content) >= _STL_HEAD else -1
    rest = content[_STL_HEAD + _FACET * count :] if count >= 0 else b""
    if (
        0 <= count <= (len(content) - _STL_HEAD) // _FACET
        and len(rest) < _FACET
        and not rest.strip(b"\0 \r\n\t")
    ):
        check_count(count, most)
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        facets = np.frombuffer(content, dtype=kind, count=count, offset=_STL_HEAD)["corners"]
        return facets.reshape(-1, 3).astype(np.float64), np.arange(3 * count).reshape(-1, 3)
    if content.lstrip()[:5].lower() != b"solid":
        facts = f"its header declares {count} facets" if count >= 0 else "it is cut off"
        raise broken(f"{facts}, and it has {len(content)} bytes")
    return _read_text(content, most)


def _read_text(content: bytes, most: int) -> Surface:
    parts = [np.zeros((0, 3))]
    facets = 0
    for block in blocks(content, rb"(?i)endfacet"):
        ends = len(re.findall(rb"(?i)\bendfacet", block))
        facets += ends
        check_count(facets, most)
        vertices = VERTEX.findall(block)
        if len(vertices) != 3 * ends:
            raise broken(
                f"expected 3 corners per facet, got {len(vertices)} corners for {ends} facets"
            )
        parts.append(reals(token for corner in vertices for token in corner).reshape(-1, 3))
    corners = np.concatenate(parts)
    return corners, np.arange(len(corners)).reshape(-1, 3)


_OFF_HEAD = re.compile(rb"\A\s*(?:ST)?C?N?(4?)(n?)OFF\b[ \t]*(BINARY)?")


def read_off(content: bytes, most: int) -> Surface:
    """Vertices and faces, colours left out.

    Raises InvalidInput.
    """
    head = _OFF_HEAD.match(content.removeprefix(b"\xef\xbb\xbf"))
    if head is None:
        raise broken("expected OFF, as text, as its first word")
    check_fields(".off", [(each or b"").decode() for each in head.groups()])
    body = content.removeprefix(b"\xef\xbb\xbf")[head.end() :]
    lines = [
        line for line in (part.partition(b"#")[0] for part in body.splitlines()) if line.strip()
    ]
    sizes = wholes(lines[0].split()[:2]) if lines else np.zeros(0, dtype=np.int64)
    if len(sizes) < 2 or not sizes.min() >= 0 or sum(sizes.tolist()) > len(lines) - 1:
        raise broken(
            f"its header declares {sizes.tolist()} vertices and faces in {len(lines)} lines"
        )
    (vertices, faces), (corner, face) = sizes.tolist(), _header(_OFF)[1]
    places = _text_rows(lines[1 : 1 + vertices], corner)
    counts, corners = _text_lists(lines[1 + vertices : 1 + vertices + faces], face, 0)
    return places, polygons(counts, corners, places, most)


_FREE = re.compile(rb"^[ \t]*(surf|curv2?|cstype|call|csh)[ \t]", re.MULTILINE)


def read_obj(content: bytes, most: int) -> Surface:
    """Vertices and faces, counted from 1 or, below 0, back from the last vertex.

    Raises InvalidInput.
    """
    check_fields(".obj", [each.decode() for each in _FREE.findall(content)])
    if b"\\" in content:
        content = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    corners, sizes = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    named, before, left = [np.zeros(0, dtype=np.int64)], 0, most
    for block in blocks(content, rb"[\r\n]"):
        lines = [
            parts
            for parts in map(bytes.split, block.splitlines())
            if parts and parts[0] in (b"v", b"f")
        ]
        points = [parts[1:4] for parts in lines if parts[0] == b"v"]
        if any(len(point) < 3 for point in points):
            raise broken("expected three coordinates per vertex")
        corners.append(reals(number for point in points for number in point).reshape(-1, 3))
        known = before + np.cumsum([parts[0] == b"v" for parts in lines], dtype=np.int64)
        faces = [k for k, parts in enumerate(lines) if parts[0] == b"f"]
        counts = np.array([len(lines[k]) - 1 for k in faces], dtype=np.int64)
        numbers = wholes(corner.partition(b"/")[0] for k in faces for corner in lines[k][1:])
        back = np.repeat(known[faces], counts) if faces else numbers
        sizes.append(counts)
        named.append(np.where(numbers < 0, back + numbers, numbers - 1))
        before += len(points)
        left -= int(np.maximum(counts - 2, 0).sum())
        check_count(most - left, most)
    places = np.concatenate(corners)
    return places, polygons(np.concatenate(sizes), np.concatenate(named), places, most)


HEAD_BYTES = 65_536
"""Bytes within which a header ends."""
_MOST_PROPERTIES = 200
_ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
_KINDS = {
    b"char": "i1",
    b"int8": "i1",
    b"uchar": "u1",
    b"uint8": "u1",
    b"short": "i2",
    b"int16": "i2",
    b"ushort": "u2",
    b"uint16": "u2",
    b"int": "i4",
    b"int32": "i4",
    b"uint": "u4",
    b"uint32": "u4",
    b"float": "f4",
    b"float32": "f4",
    b"double": "f8",
    b"float64": "f8",
}
_REALS = (b"float", b"float32", b"double", b"float64")
_FACES = (b"vertex_indices", b"vertex_index")
_ROWS = 50_000
"""Lines of text that become objects of Python at once."""


@dataclass(frozen=True, kw_only=True)
class _Property:
    """A column: its type, and the type of its length where it is a list."""

    name: bytes
    kind: str
    length: str = ""


@dataclass(frozen=True, kw_only=True)
class _Element:
    name: bytes
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def xyz(self) -> list[int]:
        """The numbers of the columns x, y and z.

        Raises InvalidInput unless each is there, and none is a list.
        """
        names = [each.name for each in self.properties]
        if any(each.length for each in self.properties) or not all(
            names.count(axis) == 1 for axis in (b"x", b"y", b"z")
        ):
            raise broken("expected vertices of numbers, x, y and z among them")
        return [names.index(axis) for axis in (b"x", b"y", b"z")]

    @property
    def polygons(self) -> int:
        """The number of the column that lists the corners of a face.

        Raises InvalidInput where there is none.
        """
        columns = [
            k for k, each in enumerate(self.properties) if each.name in _FACES and each.length
        ]
        if len(columns) != 1 or self.properties[columns[0]].kind[0] == "f":
            raise broken("expected faces with a list of vertex_indices")
        return columns[0]


def read_ply(content: bytes, most: int = MOST_TRIANGLES) -> Surface:
    """Vertices and faces, none where the file has none.

    Raises InvalidInput.
    """
    order, elements, start = _header(content)
    check_fields(".ply", [element.name.decode(errors="replace") for element in elements])
    check_count(sum(element.count for element in elements if element.name == b"face"), most)
    lines = [line for line in content[start:].splitlines() if line.strip()] if not order else []
    corners, at = None, 0 if not order else start
    counts = numbers = np.zeros(0, dtype=np.int64)
    for element in elements:
        if (
            element.count > (len(content) - at) // max(_layout(element, order).itemsize, 1)
            if order
            else element.count > len(lines) - at
        ):
            name = shown(element.name.decode(errors="replace")).strip("'")
            raise broken(
                f"its header declares {element.count} of {name}, more than it has bytes for"
            )
        if element.name == b"vertex":
            corners = (
                _rows(content, at, element, order)
                if order
                else _text_rows(lines[at : at + element.count], element)
            )
        if element.name == b"face" and element.count:
            wanted = element.polygons
            if order:
                counts, numbers, at = _lists(content, at, element, order, wanted)
            else:
                counts, numbers = _text_lists(lines[at : at + element.count], element, wanted)
        elif order:
            at = (
                _lists(content, at, element, order, -1)[2]
                if any(each.length for each in element.properties)
                else at + element.count * _layout(element, order).itemsize
            )
        if not order:
            at += element.count
    if corners is None:
        raise broken("expected an element vertex in its header")
    return corners, polygons(counts, numbers, corners, most)


def _header(content: bytes) -> tuple[str, list[_Element], int]:
    """Byte order, empty for text; the elements; and the byte at which they begin."""
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\r|\n|\Z)", content[:HEAD_BYTES])
    if end is None or not re.match(rb"(\xef\xbb\xbf)?ply\s", content):
        raise broken("expected a header from ply to end_header")
    order, elements = None, list[_Element]()
    for line in content[: end.start()].splitlines()[1:]:
        parts = line.split()
        if not parts or parts[0] in (b"comment", b"obj_info"):
            continue
        if parts[0] == b"format" and len(parts) > 1 and parts[1] in _ORDERS:
            order = _ORDERS[parts[1]]
        elif parts[0] == b"element" and len(parts) == 3 and re.fullmatch(rb"\d{1,18}", parts[2]):
            elements.append(_Element(name=parts[1], count=int(parts[2])))
        elif (
            parts[0] == b"property" and elements and len(elements[-1].properties) < _MOST_PROPERTIES
        ):
            elements[-1].properties.append(_property(parts[1:]))
        else:
            raise broken(
                "its header has a line that is none of PLY's: "
                f"{line[:40].decode(errors='replace')!r}"
            )
    if order is None:
        raise broken(
            "expected a format of ascii, binary_little_endian or binary_big_endian in its header"
        )
    if len({element.name for element in elements}) < len(elements):
        raise broken("its header declares an element twice")
    return order, elements, end.end()


def _property(parts: list[bytes]) -> _Property:
    if len(parts) == 2 and parts[0] in _KINDS:
        return _Property(name=parts[1], kind=_KINDS[parts[0]])
    if (
        len(parts) == 4
        and parts[0] == b"list"
        and parts[1] in _KINDS
        and parts[2] in _KINDS
        and parts[1] not in _REALS
    ):
        return _Property(name=parts[3], kind=_KINDS[parts[2]], length=_KINDS[parts[1]])
    raise broken(
        "its header has a property that is none of PLY's: "
        f"{b' '.join(parts)[:40].decode(errors='replace')!r}"
    )


def _layout(element: _Element, order: str, length: int = 0) -> np.dtype[Any]:
    """Layout of binary rows: columns by their numbers, behind each list's length, "0 length"; every
    list is so long.
    """
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for k, each in enumerate(element.properties):
        if each.length:
            fields.append((f"{k} length", order + each.length, ()))
        fields.append((str(k), order + each.kind, (length,) if each.length else ()))
    return np.dtype(fields)


def _rows(content: bytes, at: int, element: _Element, order: str) -> Array:
    """The columns x, y and z of binary rows without lists, shape (count, 3)."""
    columns = element.xyz
    rows = np.frombuffer(content, _layout(element, order), element.count, at)
    return np.stack([rows[str(column)].astype(np.float64) for column in columns], axis=1)


def _lists(
    content: bytes, at: int, element: _Element, order: str, wanted: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Lengths and values of one column of lists, and the byte after the rows.

    Raises InvalidInput past the end.
    """
    even = _even_lists(content, at, element, order, wanted)
    if even is not None:
        return even
    kinds = [
        (each.length and np.dtype(order + each.length), np.dtype(order + each.kind))
        for each in element.properties
    ]
    counts, parts = list[int](), list[bytes]()
    for _ in range(element.count):
        for k, (length, kind) in enumerate(kinds):
            n = 1
            if length:
                n = int.from_bytes(
                    content[at : at + length.itemsize],
                    "big" if order == ">" else "little",
                    signed=length.kind == "i",
                )
                at += length.itemsize
            stop = at + n * kind.itemsize
            if n < 0 or stop > len(content):
                raise broken("a face has more corners than it has bytes for")
            if k == wanted:
                counts.append(n)
                parts.append(content[at:stop])
            at = stop
    values = np.frombuffer(b"".join(parts), dtype=kinds[wanted][1])
    return np.array(counts, dtype=np.int64), values.astype(np.int64), at


def _even_lists(
    content: bytes, at: int, element: _Element, order: str, wanted: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], int] | None:
    """Read rows whose lists are as long as the first row's; None for others."""
    lists = [k for k, each in enumerate(element.properties) if each.length]
    if len(lists) != 1 or not element.count:
        return None
    column, least = str(lists[0]), _layout(element, order)
    if at + least.itemsize > len(content):
        return None
    first = int(np.frombuffer(content, least, 1, at)[f"{column} length"][0])
    size = least.itemsize + first * np.dtype(element.properties[lists[0]].kind).itemsize
    if first < 0 or element.count * size > len(content) - at:
        return None
    rows = np.frombuffer(content, _layout(element, order, first), element.count, at)
    if np.any(rows[f"{column} length"] != first):
        return None
    values = rows[column].astype(np.int64).ravel() if wanted >= 0 else np.zeros(0, dtype=np.int64)
    return np.full(element.count, first, dtype=np.int64), values, at + element.count * size


def _text_rows(lines: list[bytes], element: _Element) -> Array:
    columns, parts = element.xyz, [np.zeros((0, 3))]
    for k in range(0, len(lines), _ROWS):
        rows = [line.split() for line in lines[k : k + _ROWS]]
        if any(len(row) < len(element.properties) for row in rows):
            raise broken(f"expected {len(element.properties)} numbers per vertex")
        parts.append(reals(row[column] for row in rows for column in columns).reshape(-1, 3))
    return np.concatenate(parts)


def _text_lists(
    lines: list[bytes], element: _Element, wanted: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    counts, values = list[int](), [np.zeros(0, dtype=np.int64)]
    for k in range(0, len(lines), _ROWS):
        result = list[bytes]()
        for line in lines[k : k + _ROWS]:
            row, at = line.split(), 0
            for column, each in enumerate(element.properties):
                stop = at + 1
                if each.length:
                    n = int(wholes(row[at:stop])[0]) if at < len(row) else -1
                    at, stop = at + 1, at + 1 + n
                if stop < at or stop > len(row):
                    raise broken("expected as many corners per face as its line declares")
                if column == wanted:
                    counts.append(stop - at)
                    result += row[at:stop]
                at = stop
        values.append(wholes(result))
    return np.array(counts, dtype=np.int64), np.concatenate(values)


_OFF = (
    b"ply\nformat ascii 1.0\nelement vertex 0\nproperty double x\nproperty double y\n"
    b"property double z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
)
"""Rows of an OFF as a PLY declares them."""
