"""Contents and cost of a data set."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from .ledger import Counts, Ledger


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Contents and cost of a data set.

    Arguments:
        rows: kept.
        drawn: kept or not.
        cpu_s_per_1000: processor seconds for 1000 samples drawn.
        solve_ms_median, solve_ms_p99: of deciding each of them, of a block its share, wall clock
            [ms]. NaN without timing files.
    """

    rows: Counts
    drawn: Counts
    cpu_s_per_1000: float
    solve_ms_median: float
    solve_ms_p99: float

    @classmethod
    def of(cls, ledger: Ledger) -> Summary:
        """Count what the shards hold."""
        tallies, timings = ledger.tallies.values(), ledger.timings()
        solve_ms = np.concatenate([np.zeros(0), *(timing.solve_ms for timing in timings)])
        timed = len(solve_ms) > 0
        return cls(
            rows=reduce(add, (tally.rows for tally in tallies), Counts()),
            drawn=reduce(add, (tally.drawn for tally in tallies), Counts()),
            cpu_s_per_1000=1e3 * sum(timing.cpu_s for timing in timings) / len(solve_ms)
            if timed
            else math.nan,
            solve_ms_median=float(np.median(solve_ms)) if timed else math.nan,
            solve_ms_p99=float(np.quantile(solve_ms, 0.99)) if timed else math.nan,
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; NaN becomes null."""
        return finite(asdict(self))


def finite(values: dict[str, Any]) -> dict[str, Any]:
    """Replace numbers that JSON lacks by None."""
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()
    }
