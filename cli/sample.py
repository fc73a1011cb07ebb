"""``stancekit sample``: draw posture problems, or scenes of a terrain family."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from stancekit.planners.errors import InvalidInput

from .console import as_options, emit, progress, tell
from .options import DISTRIBUTION, ROBOT, TERRAIN, OptionalPath, OptionalText, check_out

_MOST = 100_000_000
"""Problems, or scenes, of one call."""


@dataclass
class Sample:
    """Draw posture problems from a distribution, one JSON object a line.

    The output is what `stancekit solve` reads. Equal seeds give equal problems.

    Of a terrain family at a level, as stairs:0.6, scenes are written into a folder (--export):
    heights, surfaces, and whether the hexapod has a plan there.
    """

    problem: Annotated[str, tyro.conf.Positional, DISTRIBUTION]
    """Distribution: ground-k, wall-k or terrain-k with k legs, as wall-3; one that another package
    brings, a YAML file, FILE.py:NAME; or FAMILY:LEVEL with --export."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand: a .urdf file, or a .yaml file that names one (extra robots); else the
    default hexapod."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that the scenes of terrain-k are cut from, or a ground by its name, as
    stairs:0.5:7."""
    count: int = 1
    """How many problems."""
    seed: int = 0
    """Seed of the random stream."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File to write; standard output where there is none."""
    export: Annotated[OptionalPath, tyro.conf.arg(metavar="FOLDER")] = None
    """New or empty folder for the scenes of a family."""
    json: bool = False
    """Say what was written to a file as one JSON object."""

    def run(self) -> int:
        """Draw and print."""
        from stancekit.planners.files.arrays import checked_int
        from stancekit.planners.files.writing import write_text
        from stancekit.samples import distribution, drawn

        checked_int(self.count, "--count", least=1, most=_MOST)
        checked_int(self.seed, "--seed", least=0)
        if self.export is not None:
            return self._export(self.export)
        source = distribution(self.problem, robot=self.robot, terrain=self.terrain)
        records = (problem.to_json() for problem in drawn(source, self.count, self.seed))
        if self.out is None:
            for record in records:
                emit(record)
            return 0
        check_out(self.out)
        write_text(self.out, "".join(json.dumps(record) + "\n" for record in records))
        tell(
            self.json,
            {"out": str(self.out), "problem_class": source.name, "problems": self.count},
            f"{self.out}: {self.count} problem(s) of {source.name}",
        )
        return 0

    def _export(self, folder: Path) -> int:
        """Write the scenes of a family."""
        from stancekit.datasets import export_scenes

        for name in ("robot", "terrain", "out"):
            if getattr(self, name) is not None:
                raise InvalidInput(
                    f"--{name}: expected none with --export, got {getattr(self, name)}"
                )
        with as_options("export"), progress("scenes") as bar:
            statuses = export_scenes(self.problem, folder, self.count, seed=self.seed, progress=bar)
        counts = {
            status: statuses.count(status) for status in ("feasible", "infeasible", "undecided")
        }
        text = ", ".join(f"{number} {status}" for status, number in counts.items())
        tell(
            self.json,
            {"out": str(folder), "scenes": self.count, **counts},
            f"{folder}: {self.count} scene(s) of {self.problem}: {text}",
        )
        return 0
