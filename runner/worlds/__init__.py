"""Worlds: where a motion is run. A world is one file and one registration: its line in the table of
``world``.

What is named here is imported at its first use: the heartbeat monitor needs none of it, and starts
in a third of the time.

Read ``world`` (what one is), ``simulation``, ``mujoco``, then ``bullet``, ``hardware``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .world import (
        WORLDS,
        Imperfections,
        SoftContact,
        State,
        World,
        WorldClass,
        WorldSettings,
        make_world,
    )

__all__ = [
    "WORLDS",
    "Imperfections",
    "SoftContact",
    "State",
    "World",
    "WorldClass",
    "WorldSettings",
    "make_world",
]


if not TYPE_CHECKING:  # or a checker would take any name for one that there is

    def __getattr__(name: str) -> Any:
        """A name of ``__all__`` (PEP 562)."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from . import world

        return getattr(world, name)
