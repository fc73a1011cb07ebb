"""Courses planned within a torque, run with servos that have little more: how many run to the end,
and what touches.

    python benchmarks/servos.py FILE.yaml ... [--worlds mujoco bullet] [--torque-nm 10] [--servo-nm
    10.6]
        [--actuators XM540-W270] [--folder FOLDER] [--json]

FILE: courses of the hexapod. Each is planned with a reserve of friction, bent until no joint takes
more than --torque-nm at rest, and where the verifier accepts it run with servos of --servo-nm, or
with --actuators in place of them, by ``simulate``. FOLDER: plans and rows that are there are not
made again.

run: to the end, or where and why not. body: root mean square, worst and last distance of its origin
from where it should be [mm]. slip: of the worst foothold since it touched [mm]. torque: largest
measured, and planned by the runner [Nm]. bumped: how long anything but feet was touched [s].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import tyro
from _bench import Options, kept, launch

from stancekit import Motion
from stancekit.motions import simulate
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import read_motion, write_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.robot.leg import read_actuators
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.search.witness import with_whole_body
from stancekit.planners.verify import check_plan
from stancekit.runner.report import RunReport
from stancekit.runner.worlds.world import make_world

ENDED = "to the end"


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, in which worlds, and with what torques."""

    courses: Annotated[tuple[Path, ...], tyro.conf.Positional]
    worlds: tuple[str, ...] = ("mujoco", "bullet")
    torque_nm: float = 10.0
    servo_nm: float = 10.6
    actuators: str | None = None
    folder: Path | None = None


def main(arguments: Arguments) -> None:
    """Plan, run and print."""
    rows = [row for path in arguments.courses for row in of_course(path, arguments)]
    ran = [row for row in rows if "world" in row]
    if not arguments.json:
        for world in arguments.worlds:
            runs = [row["run"] == ENDED for row in ran if row["world"] == world]
            print(
                f"{world}: {sum(runs)} of {len(runs)} planned within {arguments.torque_nm:g} Nm run to the end"
            )


def of_course(path: Path, arguments: Arguments) -> list[dict[str, Any]]:
    """Printed rows of a course: one a world, or one that says why there is no plan."""
    drawn = read_actuators(arguments.actuators) if arguments.actuators else None
    named = f"{arguments.actuators or arguments.servo_nm}-{arguments.torque_nm:g}"

    @cache
    def plan() -> Motion | str:
        return planned(path, arguments.torque_nm, arguments.folder)

    def measured(world: str) -> dict[str, Any]:
        course = plan()
        if isinstance(course, str):
            return {"course": path.stem, "refused": course}
        report = simulate(
            course,
            make_world(world, course.robot, Servo(torque_nm=arguments.servo_nm), actuators=drawn),
        )
        return {"course": path.stem, "world": world} | figures(report)

    rows = list[dict[str, Any]]()
    for world in arguments.worlds:
        cell = arguments.folder and arguments.folder / f"{path.stem}-{world}-{named}.json"
        rows.append(kept(cell, partial(measured, world)) if cell else measured(world))
        arguments.say(rows[-1], line)
        if "refused" in rows[-1]:
            break
    return rows


def planned(path: Path, torque_nm: float, folder: Path | None = None) -> Motion | str:
    """An accepted plan within the torque, or why there is none. folder: where plans are kept."""
    file = folder and folder / f"{path.stem}-{torque_nm:g}-plan.json"
    if file and file.exists():
        return read_motion(file)[0]
    try:
        course = read_course(path)
    except InvalidInput as error:
        return str(error)
    outcome = plan_with_reserve(TwoStage(), course)
    outcome = with_whole_body(outcome, WholeBodyLimits(torque_nm=torque_nm))
    if outcome.solution is None:
        return outcome.message or outcome.status.value
    report = check_plan(outcome.solution, joints=True)
    if not report.accepted:
        return f"{report.message}; {report.body_message}"
    if file:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_motion(file, outcome.solution, report)
    return outcome.solution


def figures(report: RunReport) -> dict[str, Any]:
    """Of a run."""
    run = report.execution
    if run is None:
        return {"run": report.message}
    return {
        "run": ENDED if report.succeeded else report.message,
        "body_mm": [1e3 * run.body_rms_m, 1e3 * run.body_worst_m, 1e3 * run.body_final_m],
        "slip_mm": 1e3 * float(run.slip_m.max()),
        "torque_nm": [run.torque_worst_nm, run.planned_torque_nm],
        "bump_s": run.bump_s,
    }


def line(row: dict[str, Any]) -> str:
    """For people."""
    if "refused" in row:
        return f"{row['course']:16} not planned: {row['refused']:.120}"
    head = f"{row['course']:16} {row['world']:7}"
    if "body_mm" not in row:
        return f"{head} {row['run']}"
    body = " ".join(f"{x:5.1f}" for x in row["body_mm"])
    return (
        f"{head} body {body} mm  slip {row['slip_mm']:5.1f} mm  torque {row['torque_nm'][0]:4.1f} of "
        f"{row['torque_nm'][1]:4.1f} Nm  bumped {row['bump_s']:.2f} s  {row['run']:.150}"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
