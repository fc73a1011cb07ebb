"""``stancekit sample`` and ``label``: posture problems drawn from distributions, scenes of a terrain
family, and data sets of exactly labelled problems, or of tries of leaps.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from stancekit.planners.errors import InvalidInput

from .console import Show, as_options, emit, out, progress, say, tell
from .options import (
    DISTRIBUTION,
    ROBOT,
    SURROGATE,
    TERRAIN,
    OptionalFloat,
    OptionalInt,
    OptionalPath,
    OptionalText,
    check_out,
    check_unused,
)

if TYPE_CHECKING:
    from stancekit.learners.data.executors import Executor


_MOST = 100_000_000
"""Problems, or scenes, of one call."""


@dataclass
class Sample:
    """Draw posture problems from a distribution, one JSON object per line.

    The output is what `stancekit solve` reads. Equal seeds give equal problems.
    """

    problem: Annotated[str, tyro.conf.Positional, DISTRIBUTION]
    """Distribution: ground-k, wall-k or terrain-k with k legs, as wall-3; one that another package
    brings, a YAML file, or FILE.py:NAME."""
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
    """File to write; standard output unless given."""
    json: bool = False
    """Say what was written to a file as one JSON object."""

    def run(self) -> int:
        """Draw and print."""
        from stancekit.planners.files.arrays import checked_int
        from stancekit.planners.files.writing import write_text
        from stancekit.samples import distribution, drawn

        checked_int(self.count, "--count", least=1, most=_MOST)
        checked_int(self.seed, "--seed", least=0)
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


_SETTINGS = (
    "feasible",
    "infeasible",
    "feasible, infeasible",
    "feasible, infeasible, shard_size",
    "scenes",
    "tries",
    "scenes, tries, shard_size",
    "shard_size",
    "screen",
    "screen, screen_error",
    "screen_error",
    "seed",
    "workers",
    "executor",
    "address",
)
"""What a message may begin with that is an option here."""
_OF_POSTURES = (
    "robot",
    "terrain",
    "feasible",
    "infeasible",
    "natural",
    "screen",
    "screen_error",
)
"""Options that leaps have no use for."""
_OF_LEAPS = ("scenes", "tries")
"""Options that postures have no use for."""

_FEW = 500
"""Most rows of postures that one process labels alone: others take longer to start."""


@dataclass
class LabelPostures:
    """Sample terrains and label them exactly (Lin et al., Algorithm 1) into a data set folder.

    Half of the default rows are feasible, each with a verified posture; half are infeasible, each
    with a re-checked proof. What is infeasible even without its moment balance is counted apart. A
    run that is stopped, however hard, goes on where it was when it is started again; the rows do
    not depend on the number of workers.

    Of a class of leaps, `stancekit label leap-hard data/leaps --scenes 1000`, choices of contacts
    are tried in every scene: each try is solved, with toes and forces; refuted, with multipliers
    that prove it; or unsolved, which claims nothing.
    """

    problem: Annotated[str, tyro.conf.Positional, DISTRIBUTION]
    """Distribution: ground-k, wall-k or terrain-k with k legs, as wall-3; one that another package
    brings, a YAML file, or FILE.py:NAME; or a class of leaps, as leap-hard."""
    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Folder of the data set."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand: a .urdf file, or a .yaml file that names one (extra robots); else the
    default hexapod."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that the scenes of terrain-k are cut from, or a ground by its name, as
    stairs:0.5:7."""
    feasible: OptionalInt = None
    """Feasible rows, of postures: 500 unless given."""
    infeasible: OptionalInt = None
    """Infeasible rows, none of them trivial: 500 unless given."""
    natural: bool = False
    """Keep the first feasible + infeasible samples as they come instead, whatever their label."""
    scenes: OptionalInt = None
    """Scenes, of leaps: 100 unless given."""
    tries: OptionalText = None
    """Tries per scene of leaps by each planner of leaps: random=8,finder=4,noise=4 unless given."""
    seed: int = 0
    """Seed; use another one for training than for testing."""
    shard_size: int = 500
    """Rows per file: what an interruption can lose."""
    screen: Annotated[OptionalPath, SURROGATE] = None
    """File of `stancekit fit --method surrogate`: a draw that it calls of a kind of which there are
    enough rows is passed over undecided; what is kept has its evidence as always."""
    screen_error: OptionalFloat = None
    """Share of the other kind's rows that may be lost so: 0.04 unless given."""
    workers: OptionalInt = None
    """Number of processes. By default one per processor; up to 500 rows of postures are labelled by
    this process alone, since others take longer to start."""
    executor: Literal["processes", "ray"] = "processes"
    """Where to work: on this machine, or on a Ray cluster, which brings its own number of
    workers."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """Print the summary as one JSON object."""

    def run(self) -> int:
        """Label and sum up."""
        from stancekit.datasets import executor, is_leap_class

        leaps = is_leap_class(self.problem)
        with as_options(*_SETTINGS):
            of = f"leaps of {self.problem}" if leaps else "postures"
            check_unused(self, _OF_POSTURES if leaps else _OF_LEAPS, of)
            few = not leaps and sum(self._rows()) <= _FEW
            usual = 1 if few else max(os.cpu_count() or 1, 1)
            where = executor(
                self.executor,
                workers=usual if self.workers is None else self.workers,
                address=self.address,
            )
            with progress(f"label {self.problem}, rows written") as bar:
                record, remarks = self._leaps(where, bar) if leaps else self._postures(where, bar)
        if self.json:
            emit(record)
            return 0
        out.print(str(self.folder))
        say(remarks, "  {}")
        say(record.pop("doubts", ()), "  doubt: {}")
        for name, value in record.items():
            out.print(f"  {name:15} {_plain(value)}")
        return 0

    def _rows(self) -> tuple[int, int]:
        """Feasible and infeasible rows, of postures."""
        feasible, infeasible = (500 if n is None else n for n in (self.feasible, self.infeasible))
        return feasible, infeasible

    def _postures(self, where: Executor, bar: Show) -> tuple[dict[str, Any], list[str]]:
        """The summary of labelled postures, and what their labels speak of."""
        from stancekit import label

        dataset = label(
            self.problem,
            self.folder,
            robot=self.robot,
            terrain=self.terrain,
            rows=self._rows(),
            natural=self.natural,
            seed=self.seed,
            shard_size=self.shard_size,
            screen=self.screen,
            screen_error=self.screen_error,
            workers=where,
            progress=bar,
        )
        header = dataset.header
        remarks = (
            [] if header.speaks_of is None else [f"{header.problem_class}: {header.speaks_of}"]
        )
        summary = dataset.summary()
        if summary.screened is not None:
            remarks += [
                f"screened: {count} draws passed over that the surrogate calls {kind}; at most "
                f"{100 * (summary.screen_error or 0.0):.3g} % of the other kind's rows are among "
                "them"
                for kind, count in vars(summary.screened).items()
                if count
            ]
        return summary.to_json() | {"doubts": header.doubts or []}, remarks

    def _leaps(self, where: Executor, bar: Show) -> tuple[dict[str, Any], list[str]]:
        """The summary of labelled tries, and what their labels mean."""
        from stancekit import label

        tries = label(
            self.problem,
            self.folder,
            scenes=100 if self.scenes is None else self.scenes,
            tries=None if self.tries is None else _counts(self.tries),
            seed=self.seed,
            shard_size=self.shard_size,
            workers=where,
            progress=bar,
        )
        remarks = [f"{kind}: {meaning}" for kind, meaning in tries.header.speaks_of.items()]
        return tries.summary().to_json(), remarks


def _counts(text: str) -> dict[str, int]:
    """The numbers of "random=8,finder=4".

    Raises InvalidInput.
    """
    counts = {}
    for part in text.split(","):
        name, _, count = part.partition("=")
        if not count.isdecimal() or name in counts:
            raise InvalidInput(
                f"--tries: expected counts by planner, as random=8,finder=4, got {text!r}"
            )
        counts[name] = int(count)
    return counts


def _plain(value: dict[str, int] | float | None) -> str:
    """Counts, or a number, as people read them."""
    if isinstance(value, dict):
        return ", ".join(f"{count} {kind}" for kind, count in value.items() if count)
    if isinstance(value, int):
        return str(value)
    return "–" if value is None else f"{value:.3g}"
