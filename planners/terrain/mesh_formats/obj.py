"""OBJ files: their vertices and faces, whatever else is in them."""

from __future__ import annotations

import numpy as np

from .numbers import Surface, blocks, broken, fans, reals, wholes


def read_obj(content: bytes, most: int) -> Surface:
    """Vertices and faces, counted from 1 or, below 0, back from the last vertex.

    Raises InvalidInput.
    """
    if b"\\" in content:
        content = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    corners, triangles = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int_)]
    before, left = 0, most
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
        triangles.append(fans(counts, np.where(numbers < 0, back + numbers, numbers - 1), left))
        before += len(points)
        left -= len(triangles[-1])
    return np.concatenate(corners), np.concatenate(triangles)
