"""Options that may be left out. tyro knows ``Optional``; for ``X | None`` it imports typeguard, which takes .1 s."""

from __future__ import annotations

from pathlib import Path
from typing import Optional, TypeAlias

OptionalPath: TypeAlias = Optional[Path]  # noqa: UP045
OptionalInt: TypeAlias = Optional[int]  # noqa: UP045
OptionalText: TypeAlias = Optional[str]  # noqa: UP045
