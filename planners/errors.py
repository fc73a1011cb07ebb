"""The errors that Stancekit raises on purpose; their messages carry the evidence."""

from __future__ import annotations


class StancekitError(Exception):
    """Root of the errors that Stancekit raises on purpose."""


class InvalidInput(StancekitError, ValueError):
    """Input that cannot be used. The message says where, what was expected and what came."""


class PlanningFailed(StancekitError):
    """A plan was asked for and none was found; the message says why."""


class HardwareFault(StancekitError):
    """A device did not do what it was told, or fell silent; the message says which part and what was seen."""
