"""Problems of one key frame or several, their files, and the features that a policy sees of
them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .contact import Contact
from .posture_batch import PostureBatch
from .problem import Problem

__all__ = ["Contact", "PostureBatch", "Problem"]


if not TYPE_CHECKING:  # or a checker would take any name for one that there is

    def __getattr__(name: str) -> Any:
        """The names of before, for one release."""
        if name == "PostureProblem":
            from .old import renamed

            return renamed(name, __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
