"""Names and files of leaps, told apart from those of courses without what reads leaps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InvalidInput
from ..files.documents import YAML, read_json, read_yaml

FORMAT = "stancekit/leap/1"


def is_leap_class(name: str) -> bool:
    """Tell whether a name, or a file's, speaks of a class of leaps, be there one or not."""
    return Path(name).name.startswith("leap-")


def is_drawn(path: str | Path) -> bool:
    """Tell whether a name, and no file, is CLASS or CLASS:SEED of a class of leaps."""
    name = str(path).partition(":")[0]
    if not is_leap_class(name) or Path(path).exists():
        return False
    from .leap_classes import leap_classes  # draws robots and terrain, which is slow to import

    return name in leap_classes()


def is_leap(data: Any) -> bool:
    """Tell whether parsed contents say that they are a leap."""
    if not isinstance(data, Mapping):
        return False
    is_draw = "distribution" in data and set(data) <= {"distribution", "seed"}
    return data.get("format") == FORMAT or "phases" in data or is_draw


def is_leap_file(path: str | Path) -> bool:
    """Tell whether a JSON or YAML file that is there holds a leap, or a name is that of a drawn
    one.
    """
    if is_drawn(path):
        return True
    path = Path(path)
    if path.suffix not in (*YAML, ".json") or not path.is_file():
        return False
    try:
        return is_leap(read_yaml(path) if path.suffix in YAML else read_json(path))
    except InvalidInput:
        return False
