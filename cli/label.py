"""``stancekit label``: make a data set of exactly labelled posture problems."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from stancekit.planners.errors import InvalidInput

from .console import as_options, emit, out, progress
from .names import DISTRIBUTION, PROPOSERS, ROBOT, TERRAIN
from .options import OptionalPath, OptionalText

if TYPE_CHECKING:
    from stancekit.learners.proposers.proposer import Proposers


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
    """Mesh or grid that the scenes of terrain-k are cut from."""
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
        from stancekit.envs.data.ledger import LabelPlan, read_header
        from stancekit.learners.data.executors import executor
        from stancekit.learners.data.labelling import Progress, label

        proposers = None if self.proposers is None else _proposers(self.proposers)
        with as_options():
            plan = LabelPlan(
                distribution=self.problem,
                feasible=self.feasible,
                infeasible=self.infeasible,
                natural=self.natural,
                seed=self.seed,
                shard_size=self.shard_size,
                robot=self.robot,
                terrain=None if self.terrain is None else str(self.terrain),
                proposers=None if proposers is None else proposers.digest,
            )
            where = executor(self.executor, workers=self.workers, address=self.address)
        with progress(f"label {self.problem}") as bar:

            def on_progress(state: Progress) -> None:
                bar(state.rows, plan.rows)

            summary = label(plan, self.folder, run=where, progress=on_progress, proposers=proposers)
        record, header = summary.to_json(), read_header(self.folder)
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


def _proposers(path: Path) -> Proposers:
    """Networks that propose. Raises InvalidInput for a file that is missing or wrong, and where torch is missing."""
    try:
        from stancekit.learners.proposers.proposer import Proposers
    except ModuleNotFoundError as error:
        raise InvalidInput(f"{path}: proposers need {error.name}, got none: pip install 'stancekit[rl]'") from None
    return Proposers.load(path)
