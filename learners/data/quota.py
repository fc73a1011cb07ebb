"""Amount of data that an experiment asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pydantic import ConfigDict


@dataclass(frozen=True, kw_only=True)
class Quota:
    """Number of rows per label, and their seed."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    feasible: int
    infeasible: int
    seed: int
