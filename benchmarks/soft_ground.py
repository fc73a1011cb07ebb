"""Do braced climbs stand where the ground yields? With feet that feel, and open loop beside it.

    python benchmarks/soft_ground.py --out FOLDER [--world bullet] [--stiffness 2e4 1e5] [--courses
    walls tube]
        [--modes feel open] [--hard] [--first 12] [--json]

The hexapod between walls, over ice, in a tube and from the ground to a wall: soft/list.yaml has the
names, the seed and how stiff the ground is; damping is what ``SoftContact`` takes by itself. Plans
are made once, for hard ground, with the reserve of friction that ``stancekit plan`` keeps, and kept
in the folder with a line per run; what is there is not made again.

feel: as ``stancekit run`` does it. open: as ``stancekit run --blind``, joints alone are followed.
--hard: on hard ground, too. stood: it did not fall, and was not stopped; ended: within the
tolerance of ``RunSettings``, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from _bench import Options, launch
from _stand_list import Lines

from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.search.witness import with_whole_body
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import SoftContact, make_world

LIST = Path(__file__).with_name("soft") / "list.yaml"
MOST_DRAWS = 12
"""Draws of a course that are tried at most."""
MODES = {"feel": RunSettings(), "open": RunSettings(blind=True)}
Mode = Literal["feel", "open"]


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which climbs, on what, and where the files go."""

    out: Path
    """Folder of plans and lines."""
    world: str = "mujoco"
    stiffness: tuple[float, ...] = ()
    """N/m, the list's unless said."""
    courses: tuple[str, ...] = ()
    """All of the list's unless said."""
    modes: tuple[Mode, ...] = ("feel", "open")
    hard: bool = False
    first: int | None = None
    """So many climbs, in the list's order."""


def main(arguments: Arguments) -> None:
    """Plan what is not there, run what is not there, print."""
    listed = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    lines, made = Lines(arguments.out / "runs.jsonl"), []
    for name, count in listed["courses"].items():
        if not arguments.courses or name in arguments.courses:
            made += climbs(name, count, arguments.out, listed)
    grounds = [*(arguments.stiffness or listed["stiffnesses_n_m"]), *([None] * arguments.hard)]
    for ground in grounds:
        for mode in arguments.modes:
            rows = []
            for file in made[: arguments.first]:
                key = f"{file.stem}:{arguments.world}:{ground}:{mode}"
                if key not in lines.rows:
                    arguments.say(lines.add(key, ran(file, arguments.world, ground, mode)), line)
                rows.append(lines.rows[key])
            arguments.say(summary(rows, arguments.world, ground, mode), total)


def climbs(name: str, count: int, folder: Path, listed: dict[str, Any]) -> Iterator[Path]:
    """Plan files of so many draws of a course."""
    for draw in range(MOST_DRAWS):
        file = folder / "plans" / f"{name}-{draw}.json"
        refused = file.with_suffix(".refused")
        if not file.exists() and not refused.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            rng = np.random.default_rng([listed["seed"], draw])
            course = perturbed(name, rng, amount=listed["amount"]) if draw else read_course(name)
            if said := planned(course, file):
                refused.write_text(f"{said}\n", encoding="utf-8")
                print(f"{file.stem}: {said}", flush=True)
        if file.exists():
            yield file
            count -= 1
        if count == 0:
            return


def planned(course: Problem, file: Path) -> str:
    """Write an accepted plan that can be run on hard ground; why there is none, empty where there
    is.
    """
    outcome = with_whole_body(plan_with_reserve(TwoStage(), course))
    report = outcome.report
    if outcome.solution is None or report is None or not report.accepted:
        return outcome.message or outcome.status.value
    try:
        with make_world("mujoco", course.robot, gravity_m_s2=course.gravity_m_s2) as world:
            Runner(world).prepare(Accepted.verified(outcome.solution, course.name))
    except InvalidInput as error:
        return f"not begun: {error}"
    write_motion(file, outcome.solution, report)
    return ""


def ran(file: Path, world: str, stiffness_n_m: float | None, mode: str) -> dict[str, Any]:
    """One run of a plan: what came of it."""
    accepted = Accepted.from_file(file)
    course, contact = accepted.plan.problem, SoftContact.of(stiffness_n_m, None)
    made = make_world(world, course.robot, gravity_m_s2=course.gravity_m_s2, contact=contact)
    report = Runner(made, settings=MODES[mode]).run(accepted)
    run, begun = report.execution, {"file": file.stem, "world": world, "mode": mode}
    row: dict[str, Any] = {**begun, "stiffness_n_m": stiffness_n_m, "ended": report.succeeded}
    row |= {"message": report.message, "stood": report.stopped_s is None}
    if run is not None:
        row |= {
            "stood": report.stopped_s is None and run.fallen_s is None,
            "fell_s": run.fallen_s
            if run.fallen_s is not None or report.stopped_s is None
            else run.seconds,
            "of_s": round(run.seconds, 2),
            "body_rms_mm": round(1e3 * run.body_rms_m, 2),
            "body_worst_mm": round(1e3 * run.body_worst_m, 2),
            "slip_mm": round(1e3 * float(run.slip_m.max()), 2),
            "force_rms_n": round(run.force_rms_n, 2),
            "loop_share": round(report.loop_share, 3),
        }
    return row


def summary(
    rows: Sequence[dict[str, Any]], world: str, ground: float | None, mode: str
) -> dict[str, Any]:
    """Counts and extremes of one ground and one way to run."""
    fell = [row["fell_s"] for row in rows if not row["stood"] and row.get("fell_s") is not None]
    stood = [row for row in rows if row["stood"]]
    return {
        "world": world,
        "stiffness_n_m": ground,
        "mode": mode,
        "runs": len(rows),
        "stood": len(stood),
        "ended": sum(row["ended"] for row in rows),
        "fell_s": [round(min(fell), 1), round(max(fell), 1)] if fell else [],
        "body_worst_mm": max((row["body_worst_mm"] for row in stood), default=None),
        "slip_mm": max((row["slip_mm"] for row in stood), default=None),
    }


def line(row: dict[str, Any]) -> str:
    """A run for people."""
    what = "stood" if row["stood"] else f"fell at {row.get('fell_s')} s"
    figures = f"body {row.get('body_rms_mm')} mm off (RMS), {row.get('body_worst_mm')} at most"
    said = f", {row['message']}" if row["message"] else ""
    return f"    {row['file']:18} {what}, {figures}, slip {row.get('slip_mm')} mm{said}"


def total(row: dict[str, Any]) -> str:
    """A summary for people."""
    ground = "hard" if row["stiffness_n_m"] is None else f"{row['stiffness_n_m']:g} N/m"
    fell = f"; fell at {row['fell_s'][0]} to {row['fell_s'][1]} s" if row["fell_s"] else ""
    return (
        f"{row['world']:7} {ground:12} {row['mode']:5} {row['stood']} of {row['runs']} stood, {row['ended']} ended as "
        f"planned{fell}; of those that stood body at most {row['body_worst_mm']} mm off, slip {row['slip_mm']} mm"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
