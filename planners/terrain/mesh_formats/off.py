"""OFF files, as text."""

from __future__ import annotations

import re

import numpy as np

from .numbers import Surface, broken, fans, reals, wholes

HEAD = re.compile(rb"\A\s*(?:ST)?C?N?4?n?OFF\b(?!\s*BINARY)", re.IGNORECASE)


def read_off(content: bytes, most: int) -> Surface:
    """Vertices and faces, colours left out.

    Raises InvalidInput.
    """
    head = HEAD.match(content.removeprefix(b"\xef\xbb\xbf"))
    if head is None:
        raise broken("expected OFF, as text, as its first word")
    body = content.removeprefix(b"\xef\xbb\xbf")[head.end() :]
    lines = [
        line for line in (part.partition(b"#")[0] for part in body.splitlines()) if line.strip()
    ]
    sizes = wholes(lines[0].split()[:2]) if lines else np.zeros(0, dtype=np.int64)
    if len(sizes) < 2 or not sizes.min() >= 0 or sum(sizes.tolist()) > len(lines) - 1:
        raise broken(
            f"its header declares {sizes.tolist()} vertices and faces in {len(lines)} lines"
        )
    vertices, faces = sizes.tolist()
    points = [line.split(None, 3)[:3] for line in lines[1 : 1 + vertices]]
    if any(len(point) < 3 for point in points):
        raise broken("expected three coordinates per vertex")
    polygons = [line.split() for line in lines[1 + vertices : 1 + vertices + faces]]
    counts = wholes(polygon[0] for polygon in polygons)
    if any(
        not 0 <= count < len(polygon)
        for count, polygon in zip(counts.tolist(), polygons, strict=True)
    ):
        raise broken("expected as many corners per face as its line declares")
    corners = wholes(
        number
        for count, polygon in zip(counts.tolist(), polygons, strict=True)
        for number in polygon[1 : 1 + count]
    )
    return reals(number for point in points for number in point).reshape(-1, 3), fans(
        counts, corners, most
    )
