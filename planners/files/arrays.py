"""Read-only arrays and numbers for value classes, shape and range checked once where a value enters
the house.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from .validation import shown

Array = NDArray[np.float64]
T = TypeVar("T")
Member = TypeVar("Member")

LONGEST_NAME = 200
LARGEST = 1e6
"""No length [m], mass [kg], force [N] or ratio of a legged robot exceeds this; a larger one is a
mistake in units."""


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
    numbers in any script, truth values, nulls, complex numbers, rows of different lengths.
    """
    raw = np.asarray(value)
    large = raw.dtype.kind == "O" and all(
        type(each) in (int, float) for each in raw.flat
    )  # integers beyond 64 bits
    if raw.dtype.kind not in "fiu" and not large:
        raise TypeError
    return np.array(raw, dtype=np.float64)


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
    """Return a name that can be written anywhere: up to ``LONGEST_NAME`` printable letters.

    Raises InvalidInput.
    """
    if not isinstance(value, str) or not 1 <= len(value) <= LONGEST_NAME or not value.isprintable():
        raise InvalidInput(
            f"{where}: expected 1 to {LONGEST_NAME} printable letters, got {shown(value)}"
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
    """Check numbers that a value has, or None in their place: those above 0, those that are 0 or
    more, finite ones.

    Raises one InvalidInput that says all that is wrong.

    Arguments:
        key: what their names begin with.
    """
    limits = [(name, {"above": 0.0}) for name in above] + [(name, {"least": 0.0}) for name in least]
    limits += [(name, {}) for name in finite]
    there = [
        (getattr(value, name), f"{key}{name}", limit)
        for name, limit in limits
        if getattr(value, name) is not None
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


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # after each axis of space


def _shape_text(shape: tuple[int | None, ...]) -> str:
    return (
        "("
        + ", ".join("any" if n is None else str(n) for n in shape)
        + ("," if len(shape) == 1 else "")
        + ")"
    )
