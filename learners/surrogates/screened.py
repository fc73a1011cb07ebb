"""Answers of a surrogate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """Answers of a surrogate.

    Arguments:
        answers: "feasible", "infeasible" or "ask" per problem, shape (B,).
        margins: the surrogate's own estimate of how far each problem is from the border, above 0
            feasible, within ±0.1, non-dimensional: no bound holds it; shape (B,).
        scores: by which it answers, the larger, the more feasible, shape (B,).
        error: of truly feasible problems of the class at most this share is called infeasible, and
            of truly infeasible ones at most this share feasible; of trivially infeasible ones only
            where the rows of the calibration had any.
        confidence: with which that holds, by the rows that it was calibrated on.
        shifted: why everything is asked, where a batch of 64 problems or more is not drawn as the
            class is, so that nothing is promised of it; empty otherwise.

    Raises:
        Nothing.
    Source:
        Wilks (1941), one-sided tolerance intervals.

    Example:
        >>> import numpy as np
        >>> from stancekit import Screened
        >>> Screened(answers=np.array(["feasible", "ask"]), margins=np.zeros(2),
        ...          scores=np.zeros(2), error=0.005, confidence=0.95).decided
        0.5
    """

    answers: NDArray[np.str_]
    margins: Array
    scores: Array
    error: float
    confidence: float
    shifted: str = ""

    def __len__(self) -> int:
        return len(self.answers)

    @property
    def decided(self) -> float:
        """Share of the problems that are not asked of an exact planner; NaN for no problems."""
        return float(np.mean(self.answers != "ask")) if len(self.answers) else math.nan
