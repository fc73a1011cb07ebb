"""NumPy's files, read in bounds: .npz archives and .npy arrays whose headers are believed only as
far as the bytes go.

A header is read before memory is asked for what it declares: its shape times its type has to be
what the file, or the archive's entry, holds to the byte. Nothing is ever unpickled.
"""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..errors import InvalidInput
from .documents import MOST_BYTES, read_bytes

MOST_ARRAYS = 1000
"""In one archive."""
MOST_UNPACKED = 256_000_000
"""Bytes that an archive may unfold to."""
DEFLATED_MOST = 1032
"""Deflate packs no more bytes into one."""
KINDS = "biufU"
"""Truth values, integers, real numbers and texts."""
LONGEST_HEADER = 10_000
SAID = "expected arrays without pickle"


def read_archive(path: str | Path) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file by name.

    Raises InvalidInput.
    """
    return unpacked(read_bytes(path, MOST_BYTES), str(path))


def unpacked(content: bytes, where: str) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz archive by name, read-only.

    Raises InvalidInput for what is damaged, holds anything but arrays of numbers and texts, or
    declares more than its bytes can hold.
    """
    if content.count(b"PK\x01\x02") > MOST_ARRAYS:
        raise InvalidInput(f"{where}: expected {MOST_ARRAYS} arrays or fewer, got more")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            _check_entries(entries, where)
            return {
                entry.filename.removesuffix(".npy"): _entry(archive, entry) for entry in entries
            }
    except InvalidInput:
        raise
    except Exception as error:  # zip, zlib and numpy's headers raise whatever struck them
        raise InvalidInput(f"{where}: {SAID}: {_told(error)}") from None


def array_of(content: bytes, where: str) -> NDArray[Any]:
    """The array of an .npy file, read-only.

    Raises InvalidInput as ``unpacked`` does.
    """
    try:
        return _array(io.BytesIO(content), len(content))
    except Exception as error:  # as above
        raise InvalidInput(f"{where}: {SAID}: {_told(error)}") from None


def _check_entries(entries: list[zipfile.ZipInfo], where: str) -> None:
    """Raise InvalidInput for names that are no arrays' or come twice, and for sizes that cannot
    be.
    """
    names = [entry.filename for entry in entries]
    if len(set(names)) < len(names) or not all(name.endswith(".npy") for name in names):
        raise InvalidInput(f"{where}: {SAID}: its entries are not NAME.npy, each once")
    if sum(entry.file_size for entry in entries) > MOST_UNPACKED:
        raise InvalidInput(f"{where}: expected {MOST_UNPACKED} bytes of arrays or fewer, got more")
    for entry in entries:
        if entry.file_size > entry.compress_size * (DEFLATED_MOST if entry.compress_type else 1):
            raise InvalidInput(
                f"{where}: {SAID}: {entry.filename!r:.40} cannot hold the bytes that it declares"
            )


def _entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(entry) as stream:
        return _array(stream, entry.file_size)


def _array(stream: IO[bytes], size: int) -> NDArray[Any]:
    """The array of a stream of so many bytes, header included.

    Raises ValueError, and what its parsers raise.
    """
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"expected version 1.0 or 2.0 of .npy, got {version[0]}.{version[1]}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Python's parser, on what is no header
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, by_column, dtype = read_header(stream, max_header_size=LONGEST_HEADER)
    if dtype.kind not in KINDS or dtype.itemsize == 0:
        raise ValueError(f"expected numbers or texts, got {dtype!s:.40}")
    if len(shape) > 8 or any(isinstance(n, bool) or n < 0 for n in shape):
        raise ValueError(f"expected up to 8 lengths, got {shape!s:.40}")
    wanted = math.prod(shape) * dtype.itemsize
    data = stream.read(size - stream.tell())
    if len(data) != wanted or stream.read(1):
        raise ValueError(f"expected {wanted:.4g} bytes of shape {shape!s:.40}, got {len(data)}")
    if dtype.kind == "b" and np.frombuffer(data, dtype=np.uint8).max(initial=0) > 1:
        raise ValueError("expected truth values of 0 and 1")
    return np.frombuffer(data, dtype=dtype).reshape(shape, order="F" if by_column else "C")


def _told(error: Exception) -> str:
    return f"{' '.join(str(error).split()) or type(error).__name__:.120}"
