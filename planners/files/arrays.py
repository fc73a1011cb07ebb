"""Read-only arrays and numbers for value classes, shape and range checked once where a value enters
the house.
"""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import partial, wraps
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from ..arguments import cached_property
from ..errors import InvalidInput, require
from .documents import MOST_BYTES, read_bytes, shown

_MOST_ARRAYS = 1000
"""In one archive."""
_MOST_UNPACKED = 256_000_000
"""Bytes that an archive may unfold to."""
_DEFLATED_MOST = 1032
"""Deflate packs no more bytes into one."""
_KINDS = "biufU"
"""Truth values, integers, real numbers and texts."""
_LONGEST_HEADER = 10_000
_SAID = "expected arrays without pickle"


def archive_of(arrays: Mapping[str, Any], *, compressed: bool = True) -> bytes:
    """Arrays and texts by name as an .npz archive; equal ones give equal bytes."""
    content = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(content, **arrays)
    return content.getvalue()


def read_archive(path: str | Path, most: int = MOST_BYTES) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file of so many bytes at most, by name.

    Raises InvalidInput.
    """
    return unpacked(read_bytes(path, most), str(path), max(most, _MOST_UNPACKED))


def unpacked(content: bytes, where: str, most: int = _MOST_UNPACKED) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz archive by name, read-only.

    Raises InvalidInput for what is damaged, holds anything but arrays of numbers and texts, or
    declares more than its bytes can hold.
    """
    require(
        content.count(b"PK\x01\x02") <= _MOST_ARRAYS,
        f"{where}: expected {_MOST_ARRAYS} arrays or fewer, got more",
    )
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            _check_entries(entries, where, most)
            return {
                entry.filename.removesuffix(".npy"): _entry(archive, entry) for entry in entries
            }
    except InvalidInput:
        raise
    except Exception as error:  # zip, zlib and numpy's headers raise whatever struck them
        raise InvalidInput(f"{where}: {_SAID}: {told(error)}") from None


def array_of(content: bytes, where: str) -> NDArray[Any]:
    """The array of an .npy file, read-only.

    Raises InvalidInput as ``unpacked`` does.
    """
    try:
        return _array(io.BytesIO(content), len(content))
    except Exception as error:  # as above
        raise InvalidInput(f"{where}: {_SAID}: {told(error)}") from None


def _check_entries(entries: list[zipfile.ZipInfo], where: str, most: int) -> None:
    """Raise InvalidInput for names that are no arrays' or come twice, and for sizes that cannot
    be.
    """
    names = [entry.filename for entry in entries]
    named = len(set(names)) == len(names) and all(name.endswith(".npy") for name in names)
    require(named, f"{where}: {_SAID}: its entries are not NAME.npy, each once")
    require(
        sum(entry.file_size for entry in entries) <= most,
        f"{where}: expected {most} bytes of arrays or fewer, got more",
    )
    for entry in entries:
        if entry.file_size > entry.compress_size * (_DEFLATED_MOST if entry.compress_type else 1):
            raise InvalidInput(
                f"{where}: {_SAID}: {entry.filename!r:.40} cannot hold the bytes that it declares"
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
        shape, by_column, dtype = read_header(stream, max_header_size=_LONGEST_HEADER)
    if dtype.kind not in _KINDS or dtype.itemsize == 0:
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


def told(error: Exception) -> str:
    """Words of another library's error on one line, else its name."""
    return f"{' '.join(str(error).split()) or type(error).__name__:.120}"


Array = NDArray[np.float64]
T = TypeVar("T")
Member = TypeVar("Member")

_LONGEST_NAME = 200
LARGEST = 1e6
"""No length [m], mass [kg], force [N] or ratio of a legged robot exceeds this; a larger one is a
mistake in units."""


def grain(numbers: Array) -> float:
    """The unit to which all of these numbers are rounded: of one to nine decimals, else that of the
    precision, single or double, which holds the largest of them.
    """
    largest, single = np.abs(numbers).max(initial=0.0), numbers.astype(np.float32)
    unit = float(np.spacing(np.float32(largest) if (single == numbers).all() else largest))
    for decimals in range(1, 10):
        fine = 10.0**-decimals > 4.0 * unit
        if fine and (np.abs(numbers - np.round(numbers, decimals)) <= unit).all():
            return 10.0**-decimals
    return unit


def read_only(value: ArrayLike, shape: tuple[int | None, ...], where: str) -> Array:
    """Return a read-only float copy of ``value`` after checking shape, finiteness and magnitude.

    ``shape`` has ``None`` where any length will do; ``where`` names the key in error messages.
    Raises InvalidInput.
    """
    try:
        array = plain_numbers(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(
            f"{where}: expected "
            f"{f'numbers of shape {_shape_text(shape)}' if shape else 'a number'}, "
            f"got {shown(value, 80)}"
        ) from None
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        raise InvalidInput(f"{where}: expected shape {_shape_text(shape)}, got {array.shape}")
    largest = float(abs(array).max()) if array.size else 0.0
    if not largest <= LARGEST:  # also false for NaN
        if not np.all(np.isfinite(array)):
            raise InvalidInput(f"{where}: expected finite numbers, got {shown(array.tolist(), 80)}")
        raise InvalidInput(f"{where}: expected magnitudes up to {LARGEST:g}, got {largest:g}")
    array.setflags(write=False)
    return array


def locked(values: T) -> T:
    """Make the array, or the arrays of the tuple, read-only and return it."""
    for each in values if isinstance(values, tuple) else (values,):
        if isinstance(each, np.ndarray):
            each.flags.writeable = False
    return values


def cached_arrays(make: Callable[[Any], T]) -> cached_property[T]:
    """A cached property whose arrays are shared, and so cannot be written to."""

    @wraps(make)
    def made(self: Any) -> T:
        return locked(make(self))

    return cached_property(made)


def plain_numbers(value: ArrayLike) -> Array:
    """A float copy of numbers.

    Raises TypeError, ValueError or OverflowError for anything else: texts, which NumPy reads as
    numbers in any script, truth values, also among numbers, nulls, complex numbers, rows of
    different lengths.
    """
    raw = np.asarray(value)
    if raw is not value and raw.ndim and _has_truths(value):
        raise TypeError
    large = raw.dtype.kind == "O" and all(
        type(each) in (int, float) for each in raw.flat
    )  # integers beyond 64 bits
    if raw.dtype.kind not in "fiu" and not large:
        raise TypeError
    return np.array(raw, dtype=np.float64)


def _has_truths(value: Any) -> bool:
    """Tell whether there is a truth value among numbers, which NumPy takes for 1 or 0."""
    if isinstance(value, list | tuple):
        return any(map(_has_truths, value))
    return isinstance(value, bool | np.bool_)


def checked(
    value: Any,
    where: str,
    *,
    least: float = -LARGEST,
    above: float | None = None,
    most: float = LARGEST,
) -> float:
    """Return ``value`` as a float in [least, most], or in (above, most] with ``above``.

    Raises InvalidInput.
    """
    number = float(read_only(value, (), where))
    if above is not None and not number > above:
        wanted = f"above {above:g}" if most == LARGEST else f"in ({above:g}, {most:g}]"
        raise InvalidInput(f"{where}: expected a number {wanted}, got {number:g}")
    if not least <= number <= most:
        low = f"[{least:g}" if above is None else f"({above:g}"
        raise InvalidInput(f"{where}: expected a number in {low}, {most:g}], got {number:g}")
    return number


def checked_int(value: Any, where: str, *, least: int = 0, most: int | None = None) -> int:
    """Return ``value`` as an int in [least, most], without an end where most is None.

    Raises InvalidInput.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least or (most is not None and value > most):
        wanted = f"{least} or more" if most is None else f"{least} to {most}"
        raise InvalidInput(f"{where}: expected {wanted}, got {shown(value)}")
    return int(value)


def checked_choice(value: Any, where: str, among: Iterable[str]) -> str:
    """Return ``value`` where it is one of these.

    Raises InvalidInput that lists them.
    """
    known = tuple(among)
    if value not in known:
        came = shown(value) if isinstance(value, str) else f"{value!r:.80}"
        raise InvalidInput(f"{where}: expected one of {', '.join(known)}, got {came}")
    return str(value)


def checked_name(value: Any, where: str) -> str:
    """Return a name that can be written anywhere: up to ``_LONGEST_NAME`` printable letters.

    Raises InvalidInput.
    """
    if (
        not isinstance(value, str)
        or not 1 <= len(value) <= _LONGEST_NAME
        or not value.isprintable()
    ):
        raise InvalidInput(
            f"{where}: expected 1 to {_LONGEST_NAME} printable letters, got {shown(value)}"
        )
    return value


def checked_members(value: Any, kind: type[Member], where: str) -> tuple[Member, ...]:
    """Return a list or tuple as a tuple where all that is in it is of this kind.

    Raises InvalidInput.
    """
    if not isinstance(value, list | tuple):
        raise InvalidInput(f"{where}: expected a list of {kind.__name__}, got {shown(value)}")
    for index, each in enumerate(value):
        if not isinstance(each, kind):
            raise InvalidInput(f"{where}[{index}]: expected a {kind.__name__}, got {shown(each)}")
    return tuple(value)


def check_numbers(
    value: Any,
    key: str = "",
    *,
    above: Iterable[str] = (),
    least: Iterable[str] = (),
    finite: Iterable[str] = (),
) -> None:
    """Check numbers that a dataclass has, or None where a field may be that: those above 0, those
    that are 0 or more, finite ones.

    Raises one InvalidInput that says all that is wrong.

    Arguments:
        key: what their names begin with.
    """
    limits = [(name, {"above": 0.0}) for name in above] + [(name, {"least": 0.0}) for name in least]
    limits += [(name, {}) for name in finite]
    may_be_none = {each.name for each in fields(value) if "None" in str(each.type)}
    there = [
        (getattr(value, name), f"{key}{name}", limit)
        for name, limit in limits
        if getattr(value, name) is not None or name not in may_be_none
    ]
    collect_errors(*(partial(checked, number, where, **limit) for number, where, limit in there))


def collect_errors(*checks: Callable[[], object]) -> None:
    """Run every check and raise one InvalidInput that says all that is wrong, separated by "; "."""
    wrong = []
    for check in checks:
        try:
            check()
        except InvalidInput as error:
            wrong.append(str(error))
    if wrong:
        raise InvalidInput("; ".join(wrong))


def cross(a: Array, b: Array) -> Array:
    """a × b along the last axis; on a few vectors ``np.cross`` takes ten times as long."""
    first = a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1)
    return np.asarray(first - a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1))


def lengths(v: Array) -> Array:
    """Euclidean norms along the last axis; of a few vectors ``np.linalg.norm`` takes three times as
    long.
    """
    return np.asarray(np.sqrt(np.add.reduce(v * v, axis=-1)))


def flat_cross(a: Array, b: Array) -> Array:
    """The third component of a × b, along the last axis, of which the first two count."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def skew(v: Array) -> Array:
    """The matrix of v × (.), shape (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def way_to(points: Array) -> Array:
    """Way along a line to each of its points, shapes (K, D) to (K,)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # after each axis of space


def _shape_text(shape: tuple[int | None, ...]) -> str:
    return (
        "("
        + ", ".join("any" if n is None else str(n) for n in shape)
        + ("," if len(shape) == 1 else "")
        + ")"
    )
