"""``stancekit sample``: draw posture problems."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from stancekit.planners.outcome import InvalidInput

from .console import emit


@dataclass
class Sample:
    """Draw posture problems from a distribution, one JSON object a line.

    The output is what `stancekit solve` reads. Equal seeds give equal problems.
    """

    problem: Annotated[str, tyro.conf.Positional]
    """Distribution: ground-3, wall-3 or wall-5."""
    count: int = 1
    """How many problems."""
    seed: int = 0
    """Seed of the random stream."""
    out: Path | None = None
    """File to write; standard output where there is none."""

    def run(self) -> int:
        """Draw and print."""
        import numpy as np
        from stancekit.envs.terrains import distribution
        from stancekit.planners.files import write_text

        if self.count < 1:
            raise InvalidInput(f"--count: expected 1 or more, got {self.count}")
        if self.seed < 0:
            raise InvalidInput(f"--seed: expected 0 or more, got {self.seed}")
        source, rng = distribution(self.problem), np.random.default_rng(self.seed)
        records = (source.sample(rng).to_json() for _ in range(self.count))
        if self.out is None:
            for record in records:
                emit(record)
        else:
            write_text(self.out, "".join(json.dumps(record) + "\n" for record in records))
        return 0
