"""One measured quantity over time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array

Rows = dict[str, tuple["Series", float] | tuple["Series", float, float]]
"""What is measured, its limit, and the value that is judged where that is not the largest of the
series."""


@dataclass(frozen=True, eq=False)
class Series:
    """One quantity over time: values, shape (S, C); names of the C columns; times_s, shape (S,)
    [s].
    """

    values: Array
    names: tuple[str, ...]
    times_s: Array

    def worst(self) -> tuple[float, str, float]:
        """The largest value, at least 0, its column's name and its time; (0, "", NaN) of
        nothing.
        """
        if not self.values.size:
            return 0.0, "", math.nan
        row, column = divmod(int(self.values.argmax()), len(self.names))
        return (
            max(float(self.values[row, column]), 0.0),
            self.names[column],
            float(self.times_s[row]),
        )

    def size(self) -> Series:
        """The rows' norms, of the whole body."""
        return Series(np.linalg.norm(self.values, axis=1)[:, None], ("torso",), self.times_s)

    def rms(self) -> float:
        """Root mean square of the rows' norms."""
        return float(np.sqrt(np.mean(np.sum(self.values**2, axis=1)))) if self.values.size else 0.0
