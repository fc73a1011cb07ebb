"""Readers of mesh files, one module per format: each takes a file's bytes and believes no count and
no index in them.

A reader returns corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners'
numbers. Polygons are cut in their planes, whatever their shape. Memory is asked for only as far as
the bytes go, and work grows with the file's size alone.
"""

from __future__ import annotations

from .collada import read_collada
from .glb import read_glb
from .numbers import Reader
from .ply import read_obj, read_off, read_ply, read_stl

READERS: dict[str, Reader] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": read_ply,
    ".dae": read_collada,
    ".off": read_off,
    ".glb": read_glb,
}
"""The reader of each format, by the ending of a file's name."""
