"""Comparison of two JSON-ready values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .validation import shown

SAME = 1e-9
"""Numbers so near to each other, absolutely or as a share, are the same: another machine rounds
otherwise."""


def first_difference(said: Any, expected: Any, where: str = "") -> str:
    """The first place where ``said`` is not ``expected``, as "key[3].name: expected this, got
    that"; empty where there is none. Numbers may differ by ``SAME``.
    """
    if isinstance(said, Mapping) and isinstance(expected, Mapping):
        for name in dict.fromkeys((*expected, *said)):
            place = f"{where}.{name}" if where else str(name)
            if name not in said:
                return f"{place}: expected this key, got nothing"
            if name not in expected:
                return f"{place}: expected nothing, got {shown(said[name])}"
            if difference := first_difference(said[name], expected[name], place):
                return difference
        return ""
    if isinstance(said, list | tuple) and isinstance(expected, list | tuple):
        if len(said) != len(expected):
            return f"{where}: expected {len(expected)}, got {len(said)}"
        each = (
            first_difference(*pair, f"{where}[{i}]")
            for i, pair in enumerate(zip(said, expected, strict=True))
        )
        return next(filter(None, each), "")
    same = (
        abs(said - expected) <= SAME * max(1.0, abs(expected))
        if _number(said) and _number(expected)
        else said == expected
    )
    return "" if same else f"{where}: expected {shown(expected)}, got {shown(said)}"


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
