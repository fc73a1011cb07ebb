"""``stancekit sample``: draw posture problems."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from stancekit.planners.errors import InvalidInput

from .console import emit, out
from .names import DISTRIBUTION, ROBOT, TERRAIN
from .options import OptionalPath, OptionalText


@dataclass
class Sample:
    """Draw posture problems from a distribution, one JSON object a line.

    The output is what `stancekit solve` reads. Equal seeds give equal problems.
    """

    problem: Annotated[str, tyro.conf.Positional, DISTRIBUTION]
    """Distribution: ground-k, wall-k or terrain-k with k legs, as wall-3; one that another package brings, a YAML file,
    or FILE.py:NAME."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand: a .urdf file, or a .yaml file that names one (extra kin); else the default hexapod."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that the scenes of terrain-k are cut from."""
    count: int = 1
    """How many problems."""
    seed: int = 0
    """Seed of the random stream."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File to write; standard output where there is none."""
    json: bool = False
    """Say what was written to a file as one JSON object."""

    def run(self) -> int:
        """Draw and print."""
        import numpy as np

        from stancekit.envs.distributions.postures import distribution
        from stancekit.planners.files.writing import check_writable, write_text

        if self.count < 1:
            raise InvalidInput(f"--count: expected 1 or more, got {self.count}")
        if self.seed < 0:
            raise InvalidInput(f"--seed: expected 0 or more, got {self.seed}")
        source = distribution(self.problem, robot=self.robot, terrain=self.terrain)
        rng = np.random.default_rng(self.seed)
        records = (source.sample(rng).to_json() for _ in range(self.count))
        if self.out is None:
            for record in records:
                emit(record)
            return 0
        check_writable(self.out)
        write_text(self.out, "".join(json.dumps(record) + "\n" for record in records))
        if self.json:
            emit({"out": str(self.out), "problem_class": source.name, "problems": self.count})
        else:
            out.print(f"{self.out}: {self.count} problem(s) of {source.name}")
        return 0
