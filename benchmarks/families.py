"""Difficulty curves: at every level of a family, the share of scenes with a plan, and with a proof
that there is none.

    python benchmarks/families.py --out out/families --picture families.png

A scene is the course FAMILY:LEVEL:SEED of the default hexapod, in which toes are offered all that
they could reach, so that a proof holds for the scene, the gait and the body's way. Planned: the
verifier accepts the plan's contacts; bodies and joints are not asked. Infeasible: it accepts the
certificate, or some limb has nothing within reach wherever the body may be. All else is undecided.
A level gets ``count`` scenes, and more, in batches, until the half-width of its Wilson interval of
95 % is ``width`` or ``most`` are done. The seeds of all levels are the same, so a fall of the share
is one of the same scenes. Rows are kept in the folder; another run goes on from them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from _bench import Options, Row, kept, launch

from stancekit.learners.data.scene_set import judged
from stancekit.learners.evaluation.evaluate import Share
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.terrain.families import SCENES
from stancekit.views.difficulty import difficulty_curves
from stancekit.views.sheet import save

BATCH = 50


@dataclass(frozen=True, kw_only=True)
class FamilyOptions(Options):
    """Which scenes, and for how long."""

    families: tuple[str, ...] = SCENES
    levels: tuple[float, ...] = tuple(round(0.1 * k, 1) for k in range(11))
    count: int = 200
    most: int = 600
    width: float = 0.04
    time_limit_s: float = 6.0
    """Of one scene."""
    out: Path = Path("out/families")
    picture: Path | None = None
    """Of the curves: .png, .pdf or .svg."""


def main(options: FamilyOptions) -> None:
    """A row a level, and whether the shares fall."""
    planner = TwoStagePlanner(programs=Programs(), time_limit_s=options.time_limit_s)
    rows = []
    for family in options.families:
        for level in options.levels:
            rows.append(of_level(planner, options, family, level))
            options.say(rows[-1], _line)
    for family in options.families:
        shares = [row["planned"] for row in rows if row["family"] == family]
        rises = [max(after - before, 0.0) for before, after in pairwise(shares)]
        options.say(
            {"family": family, "largest rise of the share": round(max(rises, default=0.0), 4)}
        )
    if options.picture is not None:
        save(difficulty_curves(rows), options.picture)


def of_level(planner: TwoStagePlanner, options: FamilyOptions, family: str, level: float) -> Row:
    """The shares of a level."""
    counts, seconds, done = (
        dict.fromkeys(("feasible", "infeasible", "no footing", "undecided"), 0),
        0.0,
        0,
    )
    row: Row = {"half_width": 1.0}
    while done < options.count or (row["half_width"] > options.width and done < options.most):
        path = (
            options.out / f"{family}-{level:g}-{options.seed}-{options.time_limit_s:g}-{done}.json"
        )
        seeds = range(options.seed + done, options.seed + done + BATCH)
        batch = kept(path, lambda seeds=seeds: measured(planner, family, level, seeds))
        done, seconds = done + BATCH, seconds + batch["cpu_s"]
        for answer in batch["answers"]:
            counts[answer] += 1
        none = counts["infeasible"] + counts["no footing"]
        intervals = [Share(hits=some, of=done).interval for some in (counts["feasible"], none)]
        row = {
            "family": family,
            "level": level,
            "scenes": done,
            "planned": counts["feasible"] / done,
            "proved_none": none / done,
            "undecided": counts["undecided"] / done,
            "half_width": max(0.5 * (high - low) for low, high in intervals),
            "no_footing": counts["no footing"] / done,
            "cpu_s_per_scene": seconds / done,
        }
    return row


def measured(planner: TwoStagePlanner, family: str, level: float, seeds: range) -> Row:
    """What came of each of these scenes, and CPU seconds of all."""
    begun = time.process_time()
    verdicts = [judged(planner, f"{family}:{level:g}:{seed}") for seed in seeds]
    answers = [
        "no footing" if each.proof == "no footing" else each.status.value for each in verdicts
    ]
    return {"answers": answers, "cpu_s": time.process_time() - begun}


def _line(row: Row) -> str:
    return (
        f"{row['family']:7} {row['level']:4g}  {row['scenes']:4} scenes  planned {100 * row['planned']:5.1f} %  "
        f"none {100 * row['proved_none']:5.1f} % ({100 * row['no_footing']:.1f} % no footing)  "
        f"undecided {100 * row['undecided']:4.1f} %  ±{100 * row['half_width']:.1f}  "
        f"{row['cpu_s_per_scene']:.3f} CPU-s"
    )


if __name__ == "__main__":
    launch(main, FamilyOptions, __doc__)
