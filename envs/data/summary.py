"""Contents and cost of a data set."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from .ledger import Counts, Ledger

ALWAYS = ("rows", "drawn", "cpu_s_per_1000", "solve_ms_median", "solve_ms_p99")
"""Figures that the summary of every data set has."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Contents and cost of a data set.

    Arguments:
        rows: rows kept, by label.
        drawn: samples drawn, kept or not, by label.
        cpu_s_per_1000: processor seconds for 1000 samples drawn.
        solve_ms_median, solve_ms_p99: median and 99th percentile of the wall-clock time to decide a
            sample, or of its share of a block [ms]; NaN without timing files.
        screened: draws that a surrogate skipped undecided, by predicted label, which ``drawn``
            leaves out; None without one.
        screen_error: largest share of the rows of the other label that may be among them, and so be
            missing here; None without a surrogate.
        draw_cpu_s_per_1000, screen_cpu_s_per_1000: the parts of cpu_s_per_1000 in which problems
            were drawn and the surrogate was asked; None without one.
    """

    rows: Counts
    drawn: Counts
    cpu_s_per_1000: float
    solve_ms_median: float
    solve_ms_p99: float
    screened: Counts | None = None
    screen_error: float | None = None
    draw_cpu_s_per_1000: float | None = None
    screen_cpu_s_per_1000: float | None = None

    @classmethod
    def of(cls, ledger: Ledger) -> Summary:
        """Count what the shards hold."""
        tallies, timings = ledger.tallies.values(), ledger.timings()
        solve_ms = np.concatenate([np.zeros(0), *(timing.solve_ms for timing in timings)])
        timed = len(solve_ms) > 0
        plan = ledger.header.plan
        error = getattr(plan, "screen_error", None)
        screened = reduce(add, (tally.screened or Counts() for tally in tallies), Counts())
        parts = {
            f"{name}_per_1000": 1e3
            * sum(getattr(timing, name) or 0.0 for timing in timings)
            / len(solve_ms)
            for name in ("draw_cpu_s", "screen_cpu_s")
            if error is not None and timed
        }
        return cls(
            rows=reduce(add, (tally.rows for tally in tallies), Counts()),
            drawn=reduce(add, (tally.drawn for tally in tallies), Counts()),
            cpu_s_per_1000=1e3 * sum(timing.cpu_s for timing in timings) / len(solve_ms)
            if timed
            else math.nan,
            solve_ms_median=float(np.median(solve_ms)) if timed else math.nan,
            solve_ms_p99=float(np.quantile(solve_ms, 0.99)) if timed else math.nan,
            screened=None if error is None else screened,
            screen_error=error,
            **parts,
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; NaN becomes null, and what only a surrogate has is left out
        without one.
        """
        return finite(
            {
                name: value
                for name, value in asdict(self).items()
                if value is not None or name in ALWAYS
            }
        )


def finite(values: dict[str, Any]) -> dict[str, Any]:
    """Replace numbers that JSON lacks by None."""
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()
    }
