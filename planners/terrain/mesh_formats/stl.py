"""STL files, binary and text."""

from __future__ import annotations

import re
import struct

import numpy as np

from .numbers import Surface, blocks, broken, check_count, reals

HEAD, FACET = 84, 50
"""Bytes of a binary file's header, count included, and of one facet."""
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(content: bytes, most: int) -> Surface:
    """Every facet with three corners of its own.

    Raises InvalidInput for what is neither kind of STL.

    A file is binary where its count of facets fits its size; zeros and blanks after them are left
    out.
    """
    count = struct.unpack("<I", content[80:HEAD])[0] if len(content) >= HEAD else -1
    rest = content[HEAD + FACET * count :] if count >= 0 else b""
    if (
        0 <= count <= (len(content) - HEAD) // FACET
        and len(rest) < FACET
        and not rest.strip(b"\0 \r\n\t")
    ):
        check_count(count, most)
        kind = np.dtype(
            {"names": ["corners"], "formats": [("<f4", (3, 3))], "offsets": [12], "itemsize": FACET}
        )
        facets = np.frombuffer(content, dtype=kind, count=count, offset=HEAD)["corners"]
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
