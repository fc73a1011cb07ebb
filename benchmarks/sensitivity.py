"""What a run bears: one thing at a time that is not as planned, robot by robot, in simulation.

    python benchmarks/sensitivity.py [walls icy-walls go1:step anymal_c:ripple …] [--robots FOLDER]
    [--world bullet]
        [--only "as planned" "Kp - 30 %"] [--press-hz 0] [--folder FOLDER] [--keep FOLDER] [--json]

A case is a course of the hexapod by its name, or a file of one; ROBOT:step, the step of ``robots.py
--step`` for a robot of ``walks.py``; or ROBOT:TERRAIN, the walk of ``walks.py`` over it. --robots:
example-robot-data's ``robots``. Plans are made once and kept in --keep; rows that are in --folder
are not measured again. --press-hz: of ``ContactFeedback``.

run: to the end, or where and why not. body: distance of its origin from where it should be, root
mean square and worst [mm]. slip: of the worst foothold since it touched [mm]; slipped: footholds
that slid more than 10 mm. joints: root mean square of what they are off the plan [rad]. Surfaces
that are farther away are so but for where feet stand at first.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, kept, launch
from _robot_step import scene_course
from _wrong import Wrong
from walks import ROBOTS, planned as walk_file, robot_file

from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course, spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.methods import make_planner
from stancekit.planners.search.witness import with_whole_body
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.foot_placement import ContactFeedback
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings, Tolerance
from stancekit.runner.worlds.world import Imperfections, make_world

WRONG = {
    "as planned": Wrong(),
    "Kp - 30 %": Wrong(imperfections=Imperfections(stiffness_share=0.7)),
    "forces felt 20 ms late": Wrong(imperfections=Imperfections(felt_delay_s=0.02)),
    "feet feel 30 % too little": Wrong(imperfections=Imperfections(felt_share=0.7)),
    "feet feel 30 % too much": Wrong(imperfections=Imperfections(felt_share=1.3)),
    "feet feel +- 5 N": Wrong(imperfections=Imperfections(felt_noise_n=5.0)),
    "a foot feels nothing": Wrong(imperfections=Imperfections(deaf=(0,))),
    "no foot feels anything": Wrong(imperfections=Imperfections(felt_share=0.0)),
    "joints off by up to .5 deg": Wrong(
        imperfections=Imperfections(offset_rad=float(np.deg2rad(0.5)))
    ),
    "mass + 15 %": Wrong(imperfections=Imperfections(mass_share=1.15)),
    "friction x .8": Wrong(friction=0.8),
    "surfaces 10 mm farther": Wrong(farther_m=0.01),
    "commands 15 ms late": Wrong(imperfections=Imperfections(delay_s=0.015)),
}
ENDED, SLIP_M = "to the end", 0.01


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which robots over what, and what of them is wrong."""

    cases: Annotated[tuple[str, ...], tyro.conf.Positional] = (
        "walls",
        "go1:step",
        "anymal_c:ripple",
    )
    robots: Path | None = None
    world: str = "mujoco"
    only: tuple[str, ...] = tuple(WRONG)
    press_hz: float = ContactFeedback().press_hz
    folder: Path | None = None
    keep: Path = Path(tempfile.gettempdir()) / "stancekit-walks"


def main(arguments: Arguments) -> None:
    """Plan, run and print."""
    arguments.keep.mkdir(parents=True, exist_ok=True)
    for case in arguments.cases:
        found = accepted(case, arguments.robots, arguments.keep)
        for name in arguments.only:
            row = (
                {"case": case, "run": f"not planned: {found}"}
                if isinstance(found, str)
                else cell(case, found, name, arguments)
            )
            arguments.say(row, line)
            if isinstance(found, str):
                break


def cell(case: str, content: Accepted, name: str, arguments: Arguments) -> dict[str, Any]:
    """A row of the table, measured where it is not kept."""

    def measure() -> dict[str, Any]:
        report = ran(content, WRONG[name], arguments.world, arguments.press_hz)
        return {
            "case": case,
            "wrong": name,
            "world": arguments.world,
            "press_hz": arguments.press_hz,
        } | figures(report)

    if arguments.folder is None:
        return measure()
    stem = f"{Path(case).stem}-{list(WRONG).index(name)}-{arguments.world}-{arguments.press_hz:g}".replace(
        ":", "-"
    )
    return kept(arguments.folder / f"{stem}.json", measure)


def accepted(case: str, robots: Path | None, keep: Path) -> Accepted | str:
    """The plan, or the walk, of a case, made where it is not kept; or why there is none."""
    name, _, terrain = case.partition(":")
    if not terrain:
        return climb(read_course(name), keep / f"{Path(name).stem}-plan.json")
    if robots is None or name not in ROBOTS:
        raise SystemExit(f"{case}: expected --robots, and one of {', '.join(ROBOTS)}")
    if terrain != "step":
        path = walk_file(name, robots, terrain, keep)
        return path if isinstance(path, str) else Accepted.from_file(path)
    file = robot_file(ROBOTS[name], robots, keep / f"{name}.yaml")
    return climb(
        build_course(spec_from(scene_course(named_robot(file), str(file)))),
        keep / f"{name}-step-plan.json",
    )


def climb(course: Problem, path: Path) -> Accepted | str:
    """The accepted plan of a course."""
    if not path.exists():
        outcome = with_whole_body(
            plan_with_reserve(make_planner("two-stage", of="courses"), course)
        )
        if outcome.solution is None:
            return outcome.message or outcome.status.value
        report = check_plan(outcome.solution, joints=True)
        if not report.accepted:
            return f"{report.message}; {report.body_message}"
        write_motion(path, outcome.solution, report)
    return Accepted.from_file(path)


def ran(content: Accepted, wrong: Wrong, world: str, press_hz: float) -> RunReport:
    """One run, whatever the joints' limits."""
    feedback, gait = ContactFeedback(press_hz=press_hz), content.plan.has("times_s")
    tolerance = Tolerance(body_m=0.3, body_rad=0.8) if gait else Tolerance()
    settings = RunSettings(check_limits=False, feedback=feedback, tolerance=tolerance)
    if gait:
        robot, gravity, terrain = content.robot, content.gravity_m_s2, wrong.ground(content)
        made = make_world(world, robot, gravity_m_s2=gravity, imperfections=wrong.imperfections)
        return Runner(made, settings=settings).run(content, terrain)
    course = content.plan.problem
    made = make_world(
        world, course.robot, gravity_m_s2=course.gravity_m_s2, imperfections=wrong.imperfections
    )
    return Runner(made, settings=settings).run(content, wrong.patches(content.plan))


def figures(report: RunReport) -> dict[str, Any]:
    """Of a run; it has ended where nothing stopped it, however its feet slid."""
    run = report.execution
    if run is None:
        return {"run": report.message}
    return {
        "run": ENDED if report.stopped_s is None and run.fallen_s is None else report.message,
        "body_mm": [1e3 * run.body_rms_m, 1e3 * run.body_worst_m],
        "slip_mm": 1e3 * float(run.slip_m.max()),
        "slipped": int(np.count_nonzero(run.slip_m > SLIP_M)),
        "footholds": len(run.slip_m),
        "joint_rad": report.joint_rms_rad,
        "torque": float(run.torque_share.max()),
        "bump_s": run.bump_s,
    }


def line(row: dict[str, Any]) -> str:
    """For people."""
    if "body_mm" not in row:
        return f"{row['case']:<16} {row.get('wrong', ''):<26} {row['run']:.150}"
    return (
        f"{row['case']:<16} {row['wrong']:<26} press {row['press_hz']:g}  body {row['body_mm'][0]:5.1f} "
        f"{row['body_mm'][1]:6.1f} mm  slip {row['slip_mm']:6.1f} mm, {row['slipped']} of {row['footholds']}  joints "
        f"{row['joint_rad']:.3f} rad  torque {row['torque']:.2f}  bumped {row['bump_s']:.2f} s  {row['run']:.120}"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
