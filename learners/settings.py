"""Settings from mappings: typed by the dataclass that owns them, wrong keys told by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from stancekit.planners.outcome import InvalidInput
from stancekit.planners.scene.posture import pydantic_lines

Settings = TypeVar("Settings")


def typed(kind: type[Settings], given: Mapping[str, Any], where: str) -> Settings:
    """The settings of this dataclass from a mapping. Raises InvalidInput with every key that is wrong."""
    prefix = f"{where}." if where else ""
    known = [f.name for f in fields(kind)]  # type: ignore[arg-type]
    for name in given:
        if name not in known:
            raise InvalidInput(f"{prefix}{name}: expected one of {', '.join(known)}, got an unknown key")
    try:
        return TypeAdapter(kind).validate_python(dict(given))
    except ValidationError as error:
        raise InvalidInput("; ".join(prefix + line for line in refusals(error))) from None


def refusals(error: ValidationError) -> Iterator[str]:
    """One line for everything wrong; where a dataclass refused its values, what it said with its place before it."""
    for item, line in zip(error.errors(), pydantic_lines(error), strict=True):
        cause = item.get("ctx", {}).get("error")
        if item["type"] == "unexpected_keyword_argument":
            yield f"{line.partition(':')[0]}: unknown key"
        elif isinstance(cause, InvalidInput):
            yield ".".join([*(str(part) for part in item["loc"]), str(cause)])
        else:
            yield line
