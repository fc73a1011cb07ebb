"""The numbers of a problem laid end to end, and arrays gathered from them: how a program is
loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array
from .layout import Index

D = TypeVar("D")


@dataclass(frozen=True, eq=False)
class Of:
    """Values that are numbers of the problem as they are, times a factor.

    Arguments:
        name: of an attribute of the data, dotted.
        index: into it; None: all of it.
    """

    name: str
    index: Any = None
    factor: float = 1.0

    def __neg__(self) -> Of:
        return replace(self, factor=-self.factor)

    def __rmul__(self, factor: float) -> Of:
        return replace(self, factor=factor * self.factor)


Fill: TypeAlias = Callable[[D], Array | float]
"""A function of the problem; its values are broadcast to the block's shape."""
Values: TypeAlias = float | Of | Fill[D]
"""Values of a block."""


class GatheredNumbers:
    """Places of the numbers that some values are made of, laid end to end; the first one is 1.

    Arguments:
        data: any problem, for their shapes.
    """

    def __init__(self, values: Sequence[object], data: object) -> None:
        names = list(dict.fromkeys(one.name for one in values if isinstance(one, Of)))
        several = len(names) > 1  # attrgetter then reads all in one call
        self._read = (
            attrgetter(*names)
            if several
            else lambda data: [attrgetter(name)(data) for name in names]
        )
        self._places, end = {}, 1
        for name, number in zip(names, self._read(data), strict=True):
            numbers = np.asarray(number)
            self._places[name] = end + np.arange(numbers.size).reshape(numbers.shape)
            end += numbers.size

    def of(self, data: object) -> Array:
        """The numbers of a problem."""
        return np.concatenate((1.0, *self._read(data)), axis=None)

    def places(self, values: Of) -> Index:
        """Places of these values."""
        places = self._places[values.name]
        return np.asarray(places if values.index is None else places[values.index])


class Gather(Generic[D]):
    """An array whose entries are numbers of the problem times factors, added up, and values of
    functions.
    """

    def __init__(self, size: int, numbers: GatheredNumbers) -> None:
        self._size, self._numbers = size, numbers
        self._parts: list[tuple[Index, Index, float]] = []
        self._fills: list[tuple[Index, Fill[D]]] = []

    def add(self, at: Index, values: Values[D]) -> None:
        """Add values at these entries, which are all different."""
        if isinstance(values, Of):
            source = self._numbers.places(values)
            self._parts.append(
                (at.ravel(), np.broadcast_to(source, at.shape).ravel(), values.factor)
            )
        elif isinstance(values, int | float):
            self._parts.append((at.ravel(), np.zeros(at.size, dtype=np.int_), values))
        else:
            self._fills.append((at, values))

    @cached_property
    def _once(self) -> tuple[Index, Index, Array, bool]:
        """(entry, number, factor) of all parts, and whether every entry is met once, in order."""
        nothing = np.zeros(0, dtype=np.int_)
        at = np.concatenate([nothing, *(part[0] for part in self._parts)])
        source = np.concatenate([nothing, *(part[1] for part in self._parts)])
        factor = np.concatenate(
            [nothing, *(np.full(len(at), factor) for at, _, factor in self._parts)]
        )
        order = np.argsort(at, kind="stable")
        whole = np.array_equal(at[order], np.arange(self._size))
        return at[order], source[order], factor[order].astype(np.float64), whole

    @cached_property
    def constant(self) -> Array | None:
        """The array, where it is the same for every problem."""
        at, source, factor, _ = self._once
        return (
            None
            if self._fills or source.any()
            else np.bincount(at, factor, minlength=self._size).astype(np.float64)
        )

    def load(self, numbers: Array, data: D) -> Array:
        """The array for this problem."""
        if self.constant is not None:
            return self.constant
        at, source, factor, whole = self._once
        values = numbers[source]
        values *= factor
        out = (
            values
            if whole
            else np.bincount(at, values, minlength=self._size).astype(np.float64, copy=False)
        )
        for entries, fill in self._fills:
            out[entries] += fill(data)
        return out
