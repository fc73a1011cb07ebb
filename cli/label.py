"""``stancekit label``: make a data set of exactly labelled posture problems."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import as_options, emit, out, progress
from .names import DISTRIBUTION, PROPOSERS, ROBOT, TERRAIN
from .options import OptionalPath, OptionalText

SETTINGS = (
    "feasible",
    "infeasible",
    "feasible, infeasible",
    "feasible, infeasible, shard_size",
    "shard_size",
    "seed",
    "workers",
    "executor",
    "address",
)
"""What a message may begin with that is an option here."""


@dataclass
class LabelPostures:
    """Sample terrains and label them exactly (paper E, Algorithm 1) into a data set folder.

    Half of the default rows are feasible, each with a verified posture; half are infeasible, each with a re-checked
    proof. What is infeasible even without its moment balance is counted apart. A run that is stopped, however hard,
    goes on where it was when it is started again; the rows do not depend on the number of workers.
    """

    problem: Annotated[str, tyro.conf.Positional, DISTRIBUTION]
    """Distribution: ground-k, wall-k or terrain-k with k legs, as wall-3; one that another package brings, a YAML file,
    or FILE.py:NAME."""
    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Folder of the data set."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand: a .urdf file, or a .yaml file that names one (extra kin); else the default hexapod."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that the scenes of terrain-k are cut from, or a ground by its name, as stairs:0.5:7."""
    feasible: int = 500
    """Feasible rows."""
    infeasible: int = 500
    """Infeasible rows, none of them trivial."""
    natural: bool = False
    """Keep the first feasible + infeasible samples as they come instead, whatever their label."""
    seed: int = 0
    """Seed; use another one for training than for testing."""
    shard_size: int = 500
    """Rows a file: what an interruption can lose."""
    proposers: Annotated[OptionalPath, PROPOSERS] = None
    """File of `stancekit proposers`: networks that are asked for postures and proofs before any solver."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Processes."""
    executor: Literal["processes", "ray"] = "processes"
    """Where to work: on this machine, or on a Ray cluster, which brings its own number of workers."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """Print the summary as one JSON object."""

    def run(self) -> int:
        """Label and sum up."""
        from stancekit.datasets import executor, label

        with as_options(*SETTINGS):
            where = executor(self.executor, workers=self.workers, address=self.address)
            with progress(f"label {self.problem}") as bar:
                dataset = label(
                    self.problem,
                    self.folder,
                    robot=self.robot,
                    terrain=self.terrain,
                    rows=(self.feasible, self.infeasible),
                    natural=self.natural,
                    seed=self.seed,
                    shard_size=self.shard_size,
                    proposers=self.proposers,
                    workers=where,
                    progress=bar,
                )
        record, header = dataset.summary().to_json(), dataset.header
        if self.json:
            emit(record)
        else:
            out.print(str(self.folder))
            if header.speaks_of is not None:
                out.print(f"  {header.problem_class}: {header.speaks_of}", highlight=False)
            for name, value in record.items():
                out.print(f"  {name:15} {_plain(value)}")
        return 0


def _plain(value: dict[str, int] | float | None) -> str:
    """Counts, or a number, as people read them."""
    if isinstance(value, dict):
        return ", ".join(f"{count} {kind}" for kind, count in value.items() if count)
    return "–" if value is None else f"{value:.3g}"
