"""A map of where a robot can stand, judged from outside: proved poses by SCIP, likely ones by exact answers.

nice -n 15 python benchmarks/standing_maps.py --map map.npz --terrain blocks.obj

Proved poses go to the second exact solver of ``second_labels.py``, whose rows are written anew from the
numbers of each posture problem. Likely poses are solved by the exact planner. Poses that lack a
foothold are infeasible by what a pose is, and are not asked about.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import Options, Row, launch, markdown, upper_end
from second_labels import HOLDS, second

import stancekit
from stancekit.learners.maps.making import BLOCK, Maker, Poses
from stancekit.planners.problem.standing_map import (
    FEASIBLE,
    INFEASIBLE,
    LIKELY,
    UNLIKELY,
    VERDICTS,
    StandingMap,
)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which map, and how many of its poses."""

    map: Path = Path("map.npz")
    """File of `stancekit map --out`."""
    terrain: str = "blocks.obj"
    """The terrain that it is of."""
    robot: str = ""
    """The robot that it is of; empty for the default hexapod."""
    proved: int = 500
    """Proved poses that SCIP is asked about."""
    likely: int = 2000
    """Likely poses that are solved exactly."""
    limit_s: float = 20.0
    """Of SCIP, a pose."""


def main(options: Arguments) -> None:
    """Print the counts."""
    found = StandingMap.read(options.map)
    robot = options.robot or None
    poses = Poses.of(
        stancekit.terrain(options.terrain, robot=robot),
        robot,
        terrain=found.terrain,
        spacing_m=found.spacing_m,
        headings=len(found.headings_rad),
        friction=found.friction,
    )
    assert poses.shape == found.shape, "expected the terrain and robot of the map"
    assert not found.options, "expected a map with the usual footholds"
    verdict, rng = found.verdict.ravel(), np.random.default_rng(options.seed)
    likely = np.flatnonzero((verdict == LIKELY) | (verdict == UNLIKELY))
    likely, truth = np.sort(rng.permutation(likely)[: options.likely]), Maker(poses)
    for begin in range(0, len(likely), BLOCK):
        truth.prove(likely[begin : begin + BLOCK])
    for called, right in ((LIKELY, FEASIBLE), (UNLIKELY, INFEASIBLE)):
        mine = likely[verdict[likely] == called]
        wrong = int((truth.verdict[mine] != right).sum())
        row = {"called": VERDICTS[called], "solved": len(mine), "wrong": wrong}
        options.say({**row, "up to, %": round(100.0 * upper_end(wrong, len(mine)), 2)})
    proved = np.flatnonzero((verdict == FEASIBLE) | ((verdict == INFEASIBLE) & ~poses.off))
    proved = rng.permutation(proved)[: options.proved]
    batch, counts = poses.batch(proved), Counter[tuple[str, str]]()
    for k in range(len(proved)):
        said = second(batch.problem(k), options.limit_s)
        near = said.label == "feasible" and not said.worst <= HOLDS
        counts[VERDICTS[verdict[proved[k]]], "near" if near else said.label] += 1
    for (ours, theirs), count in sorted(counts.items()):
        options.say({"proved": ours, "SCIP": theirs, "problems": count})


def page(rows: list[Row]) -> Iterable[str]:
    """What was asked of whom (docs/measured/screening.md)."""
    return markdown(
        ("the map says", "another judge says", "poses", "wrong"),
        (
            (
                row["called"],
                "solved exactly",
                row["solved"],
                f"{row['wrong']}, up to {row['up to, %']} %",
            )
            if "called" in row
            else (
                f"proved {row['proved']}",
                f"{row['SCIP']} (SCIP)",
                row["problems"],
                row["problems"] if row["SCIP"] not in (row["proved"], "near", "unknown") else 0,
            )
            for row in rows
        ),
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__, page=page)
