"""Columns of ``gait_bench`` rows that tables and pictures need, checked where a cell's file is
read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, NonNegativeFloat, NonNegativeInt

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown, validated


class _Model(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)


class _Before(_Model):
    """A portfolio's first feasible point."""

    peak_acceleration_g: float | None


class _Failed(_Model):
    """Nothing was solved, e.g. for want of a map."""

    success: bool
    verified: bool
    refused: list[str] = []


class _Solved(_Failed):
    """A solve, or the solves of a portfolio, and the verifier's figures."""

    iterations: NonNegativeInt
    cpu_s: NonNegativeFloat
    linear_s: NonNegativeFloat
    phase_iterations: dict[str, int] = {}
    violations: list[float | None] = Field(default=[], min_length=1)
    before: _Before | None = None
    peak_acceleration_g: float | None = None
    force_rms: float | None = None
    force_peak: float | None = None
    reach: float | None = None
    penetration: float | None = None
    outside_cone: float | None = None
    friction_needed: float | None = None


def checked_row(row: Any, cell: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The row as it is.

    Raises InvalidInput.

    Arguments:
        cell: terrain, task, seed and method that it is of.
    """
    if not isinstance(row, dict):
        raise InvalidInput(f"{where}: row: expected an object, got {type(row).__name__}")
    for name, value in cell.items():
        if row.get(name) != value:
            raise InvalidInput(
                f"{where}: row: {name}: expected {value!r} by the file's name, got "
                f"{shown(row.get(name))}"
            )
    solved = row.get("success") is not False or "violations" in row
    validated(_Solved if solved else _Failed, row, f"{where}: row")
    return row
