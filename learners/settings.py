"""Settings from mappings: typed by the dataclass that owns them, wrong keys told by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import neighbour, validated

Settings = TypeVar("Settings")


def typed(kind: type[Settings], given: Mapping[str, Any], where: str) -> Settings:
    """The settings of this dataclass from a mapping. Raises InvalidInput with every key that is wrong."""
    prefix = f"{where}." if where else ""
    known = [f.name for f in fields(kind)]  # type: ignore[arg-type]
    for name in given:
        if name not in known:
            raise InvalidInput(
                f"{prefix}{name}: expected one of {', '.join(known)}, got an unknown key{neighbour(name, known)}"
            )
    return validated(kind, dict(given), key=prefix)
