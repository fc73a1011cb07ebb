"""Kinds of learned scores of leaps' candidates, by name."""

from __future__ import annotations

from typing import Literal

Kind = Literal["additive", "set"]
KINDS: tuple[Kind, ...] = ("additive", "set")
FORMAT = "stancekit/leap-scorer/1"
