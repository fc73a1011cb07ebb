"""Small files that unfold: what a reader that believes them takes minutes, or all memory, over."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from typing import Any

import numpy as np


def aliases(key: str = "name", levels: int = 10) -> bytes:
    """YAML whose last key stands for ten to the power of ``levels`` values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, levels)]
    return "\n".join([*lines, f"{key}: *a{levels - 1}", ""]).encode()


def deep_yaml(levels: int = 5000) -> bytes:
    """YAML in so many brackets."""
    return b"name: " + b"[" * levels + b"]" * levels + b"\n"


def deep_json(levels: int = 5000) -> bytes:
    """JSON in so many brackets."""
    return b'{"format": ' + b"[" * levels + b"]" * levels + b"}"


def endless_yaml() -> bytes:
    """YAML that holds itself."""
    return b"name: &a [*a]\n"


def packed(name: str, megabytes: int, *, honest: bool) -> bytes:
    """An archive with zeros by the gigabyte, and a header that says so, or one that says they are
    few.
    """
    count = megabytes * 125_000
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (count if honest else 4,)}
    )
    zeros, pack = bytes(1_000_000), zlib.compressobj(wbits=-15)
    first = pack.compress(head.getvalue()) + pack.flush(zlib.Z_FULL_FLUSH)
    same = pack.compress(zeros) + pack.flush(
        zlib.Z_FULL_FLUSH
    )  # a megabyte that depends on nothing before it
    digest = zlib.crc32(head.getvalue())
    for _ in range(megabytes):
        digest = zlib.crc32(zeros, digest)
    box = io.BytesIO()
    with zipfile.ZipFile(box, "w") as archive:
        entry = zipfile.ZipInfo(f"{name}.npy")
        archive.writestr(entry, first + megabytes * same + pack.flush())
        entry.compress_type, entry.CRC = zipfile.ZIP_DEFLATED, digest
        entry.file_size = len(head.getvalue()) + megabytes * len(zeros)
        box.seek(entry.header_offset)
        box.write(entry.FileHeader())
        box.seek(archive.start_dir)
    return box.getvalue()


def wide_png(side: int = 50_000) -> bytes:
    """A picture of one grey, and as many pixels as its side squared."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(4_000_000), 9)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def entities(levels: int = 10) -> bytes:
    """A URDF whose name is a billion letters by entities of entities."""
    message = '<!ENTITY a0 "lol">' + "".join(
        f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, levels)
    )
    return (
        f'<?xml version="1.0"?><!DOCTYPE robot [{message}]><robot name="&a{levels - 1};"/>'.encode()
    )


def deep_xml(levels: int = 100_000) -> bytes:
    """XML of so many elements in one another."""
    return b"<robot name='r'>" + b"<link>" * levels + b"</link>" * levels + b"</robot>"


def vast_ply() -> bytes:
    """A mesh that declares more corners than there are bytes in the world."""
    return (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\n"
        b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + bytes(64)
    )


def many_corners(problem: dict[str, Any], corners: int = 256) -> dict[str, Any]:
    """The problem with a patch of so many corners, a little off its plane, under the first toe."""
    contact = problem["contacts"][0]
    square = np.array(contact["vertices_m"])
    centre, normal = square.mean(axis=0), np.array(contact["normal"])
    first = square[0] - centre
    second = np.cross(normal, first)
    angle = 2.0 * np.pi * np.arange(corners) / corners
    off = 1e-6 * np.sin(7.0 * angle)[:, None] * normal
    ring = centre + np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second + off
    found: dict[str, Any] = json.loads(json.dumps(problem))
    found["contacts"][0]["vertices_m"] = ring.tolist()
    return found
