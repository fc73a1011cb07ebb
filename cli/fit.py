"""``stancekit fit``: learn envelopes from a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import emit, out, progress


@dataclass
class Fit:
    """Learn envelopes from a labelled data set and write them to a file.

    heuristic: the expert's bounds of paper E. quantile: the box that leaves a share of the solutions out on each side.
    gmm-printed: paper E's Algorithm 2 line by line. gmm: Algorithm 2 with its boundary fitted by P1's own margins.
    """

    dataset: Annotated[Path, tyro.conf.Positional]
    """Data set folder of `stancekit label`."""
    out: Path
    """Envelope file to write."""
    method: Literal["heuristic", "quantile", "gmm-printed", "gmm"] = "gmm"
    """How to learn."""
    share: float = 0.05
    """Share of the solutions outside a quantile box, on each side of each dimension."""
    clusters: int = 1
    """Envelopes to learn (n of Algorithm 2)."""
    threshold: float = 0.05
    """Least membership probability of a kept solution (p_th of Algorithm 2)."""
    steps: int = 80
    """Steps of the margin descent: more is better and slower."""
    time_limit_s: float = 12.0
    """Limit of the printed boundary program, a cluster [s]."""
    seed: int = 0
    """Seed of mixture and descent."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Fit and write."""
        from stancekit.learners.dataset import Dataset
        from stancekit.learners.fitting import FitSettings, fit
        from stancekit.planners.files import write_envelopes

        settings = FitSettings(
            share=self.share,
            clusters=self.clusters,
            threshold=self.threshold,
            steps=self.steps,
            time_limit_s=self.time_limit_s,
            seed=self.seed,
        )
        with progress(f"fit {self.method}") as bar:
            envelopes = fit(self.method, Dataset.open(self.dataset), settings, bar)
        write_envelopes(self.out, envelopes)
        widths = [float((envelope.high - envelope.low).mean()) for envelope in envelopes.envelopes]
        if self.json:
            emit(
                {
                    "out": str(self.out),
                    "method": self.method,
                    "problem_class": envelopes.problem_class,
                    "envelopes": len(widths),
                    "mean_width": widths,
                    "provenance": dict(envelopes.provenance),
                }
            )
        else:
            out.print(f"[bold]{self.out}[/bold]: {len(widths)} envelope(s) for {envelopes.problem_class}, "
                      f"mean width {', '.join(f'{width:.3f}' for width in widths)}")  # fmt: skip
        return 0
