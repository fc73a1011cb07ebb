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
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from _bench import Options, Row, kept, launch
from _crossings import SCENES
from matplotlib.figure import Figure

from stancekit.learners.evaluation.evaluate import Share
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.problem.contact import NoFooting
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.views.sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    QUIET,
    SIZE_PX,
    headline,
    quiet_axes,
    save,
    sheet,
)

BATCH = 50
COLUMNS = 4
PLANNED, NONE = "#2c8173", ACCENT


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
    planner = TwoStage(programs=Programs(), time_limit_s=options.time_limit_s)
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


def of_level(planner: TwoStage, options: FamilyOptions, family: str, level: float) -> Row:
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


def answered(planner: TwoStage, name: str) -> str:
    """What came of a scene; what is infeasible is proved."""
    try:
        answer = planner.solve(read_course(name))
    except NoFooting:
        return "no footing"
    return answer.status.value if answer.solution or answer.certificate else "undecided"


def measured(planner: TwoStage, family: str, level: float, seeds: range) -> Row:
    """What came of each of these scenes, and CPU seconds of all."""
    begun = time.process_time()
    answers = [answered(planner, f"{family}:{level:g}:{seed}") for seed in seeds]
    return {"answers": answers, "cpu_s": time.process_time() - begun}


def _line(row: Row) -> str:
    return (
        f"{row['family']:7} {row['level']:4g}  {row['scenes']:4} scenes  planned {100 * row['planned']:5.1f} %  "
        f"none {100 * row['proved_none']:5.1f} % ({100 * row['no_footing']:.1f} % no footing)  "
        f"undecided {100 * row['undecided']:4.1f} %  ±{100 * row['half_width']:.1f}  "
        f"{row['cpu_s_per_scene']:.3f} CPU-s"
    )


@DEFAULT_STYLE
def difficulty_curves(rows: Sequence[Row]) -> Figure:
    """A panel a family.

    Arguments:
        rows: each with family, level, scenes, planned, proved_none, undecided and half_width,
            shares of 1; the band is the half-width.
    """
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    figure = sheet(SIZE_PX)
    scenes = [row["scenes"] for row in rows]
    worst = max(row["undecided"] for row in rows)
    headline(
        figure,
        "How hard is a level?",
        f"{min(scenes)} to {max(scenes)} scenes a level; at most {100.0 * worst:.1f} % of a "
        "level's undecided",
    )
    grid = figure.add_gridspec(
        -(-len(families) // COLUMNS),
        COLUMNS,
        left=0.06,
        right=0.98,
        bottom=0.07,
        top=0.84,
        hspace=0.35,
        wspace=0.25,
    )
    for k, family in enumerate(families):
        axes = figure.add_subplot(grid[divmod(k, COLUMNS)])
        quiet_axes(axes)
        mine = sorted(
            (row for row in rows if row["family"] == family), key=lambda row: float(row["level"])
        )
        level = np.array([row["level"] for row in mine])
        half = np.array([row["half_width"] for row in mine])
        for name, colour in (("planned", PLANNED), ("proved_none", NONE)):
            share = np.array([row[name] for row in mine])
            low, high = np.clip(share - half, 0.0, 1.0), np.clip(share + half, 0.0, 1.0)
            axes.fill_between(level, 100.0 * low, 100.0 * high, color=colour, alpha=0.2, lw=0)
            axes.plot(level, 100.0 * share, color=colour, lw=2.0, marker="o", ms=3.5, label=name)
        axes.set(xlim=(-0.02, 1.02), ylim=(-2.0, 102.0))
        axes.set_title(family, loc="left", size=12, color=INK, weight="bold")
        axes.set_xlabel("level", color=QUIET)
        if k % COLUMNS == 0:
            axes.set_ylabel("% of scenes", color=QUIET)
    height = figure.get_figheight()
    figure.text(
        0.72, 1.0 - 0.36 / height, "● a verified plan", color=PLANNED, va="center", weight="bold"
    )
    figure.text(0.72, 1.0 - 0.66 / height, "● proved: none", color=NONE, va="center", weight="bold")
    return figure


if __name__ == "__main__":
    launch(main, FamilyOptions, __doc__)
