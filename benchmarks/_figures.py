"""Two answers set side by side: the figures to a tolerance, the words letter by letter.

An answer is what JSON holds: numbers, text, lists and objects of them. A list of numbers, nested or
not, is one array.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

Answers = Mapping[str, Any]
"""Answers by name, as JSON holds them."""
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")
"""A number in a text, alone."""


@dataclass(frozen=True, kw_only=True)
class Difference:
    """The place at which two answers are furthest apart.

    Arguments:
        where: name of the part of the answer, with the index in its array.
        apart: difference over the magnitude of the array, and over 1 where that is less; inf where
            words, shapes or parts differ.
        before, now: what stands there.
    """

    where: str
    apart: float
    before: str
    now: str

    def __str__(self) -> str:
        far = f"{self.apart:.2g} of the magnitude: " if np.isfinite(self.apart) else ""
        return f"{self.where}: {far}{self.before} before, {self.now} now"


def parts(answer: Any, name: str = "") -> Iterator[tuple[str, str | NDArray[np.float64]]]:
    """The arrays and texts of an answer, by their names; the numbers of a text are an array."""
    if isinstance(answer, dict):
        for key, value in answer.items():
            yield from parts(value, f"{name}.{key}" if name else key)
    elif isinstance(answer, int | float):
        yield name, np.array(float(answer))
    elif isinstance(answer, list) and (array := _array(answer)) is not None:
        yield name, array
    elif isinstance(answer, list):
        yield f"{name}, length", np.array(float(len(answer)))
        for index, value in enumerate(answer):
            yield from parts(value, f"{name}[{index}]")
    else:
        text = str(answer)
        yield name, NUMBER.sub("#", text)
        yield f"{name}, numbers", np.array([float(each) for each in NUMBER.findall(text)])


def furthest(before: Any, now: Any) -> Difference | None:
    """The largest difference of two answers; None where they are equal."""
    old, new = dict(parts(before)), dict(parts(now))
    for name in [*old, *new]:
        if name not in old or name not in new:
            one, other = ("there" if name in each else "not there" for each in (old, new))
            return Difference(where=name, apart=np.inf, before=one, now=other)
    found = [each for name in old if (each := _difference(name, old[name], new[name]))]
    return max(found, key=lambda each: each.apart, default=None)


def digest(answer: Any) -> str:
    """The first half of a hash of all bits of an answer."""
    return hashlib.sha256(json.dumps(answer).encode()).hexdigest()[:16]


def report(
    before: Answers, now: Answers, within: float, of: str, file: TextIO | None = None
) -> int:
    """Print which answers of two tables differ, and which only one of them has; the exit code is 1
    where some differ, or where the tables have none in common.

    Arguments:
        within: difference that a figure may have, as ``Difference`` measures it.
        of: what an answer is one of, in the plural.
        file: where to; standard output where there is none.
    """
    file = file or sys.stdout
    both = [name for name in now if name in before]
    found = {name: each for name in both if (each := furthest(before[name], now[name]))}
    differ = {name: each for name, each in found.items() if each.apart > within}
    alone = {
        "before": [name for name in before if name not in now],
        "now": [name for name in now if name not in before],
    }
    for name, each in differ.items():
        print(f"differs: {name}: {each}", file=file)
    for side, names in alone.items():
        for name in names:
            print(f"only {side}: {name}", file=file)
    same = sum(digest(before[name]) == digest(now[name]) for name in both)
    counts = ", ".join(f"{len(names)} only {side}" for side, names in alone.items())
    print(
        f"{len(both)} {of}, {len(differ)} differ; {same} are equal to the last bit; {counts}",
        file=file,
    )
    near = {name: each for name, each in found.items() if name not in differ}
    if near:
        name = max(near, key=lambda each: near[each].apart)
        print(f"largest difference within {within:g}: {name}: {near[name]}", file=file)
    return int(bool(differ) or not both)


def _array(values: list[Any]) -> NDArray[np.float64] | None:
    """The array of nested lists of numbers; None where they are none, or uneven."""
    try:
        array = np.array(values)
    except ValueError:  # uneven
        return None
    return array.astype(float) if array.dtype.kind in "bif" else None


def _difference(name: str, before: Any, now: Any) -> Difference | None:
    if isinstance(before, str) or isinstance(now, str):
        if isinstance(before, str) and isinstance(now, str) and before == now:
            return None
        return Difference(where=name, apart=np.inf, before=repr(before), now=repr(now))
    if before.shape != now.shape:
        shapes = (f"shape {each.shape}" for each in (before, now))
        return Difference(where=name, apart=np.inf, before=next(shapes), now=next(shapes))
    same = (before == now) | (np.isnan(before) & np.isnan(now))
    if same.all():
        return None
    both = np.abs(np.stack([before, now]))
    magnitude = max(1.0, both[np.isfinite(both)].max(initial=0.0))
    with np.errstate(invalid="ignore"):
        far = np.where(same, 0.0, np.abs(before - now) / magnitude)
    far[np.isnan(far)] = np.inf  # one of the two is not finite
    place = np.unravel_index(np.argmax(far), far.shape)
    index = f"[{', '.join(map(str, place))}]" if place else ""
    return Difference(
        where=name + index,
        apart=float(far[place]),
        before=repr(float(before[place])),
        now=repr(float(now[place])),
    )
