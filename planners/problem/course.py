"""The module of before of ``Problem`` and what belongs to it, for one release."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .foothold import Foothold as Foothold
from .foothold import Stance as Stance
from .limits import StepLimits as StepLimits
from .limits import Weights as Weights

if not TYPE_CHECKING:  # or a checker would take any name for one that there is

    def __getattr__(name: str) -> Any:
        if name == "Course":
            from .old import renamed

            return renamed(name, __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
