"""Plans within torque limits: what the largest torque of a plan is before and after the whole body is planned with.

    python benchmarks/torques.py [--courses FOLDER] [--torque-nm 10] [--torque-share .9] [--only walls,icy] [--json]
    python benchmarks/torques.py --robots FOLDER [--weaker .5]     # quadrupeds over a step, within their own limits

The hexapod on the built-in courses and on those of a folder. torque: in the joint with the largest share of its limit,
of the plan as the planner has it and of the one with joints; steps: of the whole plan, 0 where other forces do or
nothing has to. plan: the planner; joints: inverse kinematics; stage: all that comes after it, checks included, in
seconds of this process's CPU. verdict: the verifier's, on contacts, joints and torque, under this limit. --weaker: of
robots with files, this share of the largest torque that each needs as it comes is what it is given.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _bench import Options, Row, launch, spread
from robot_step import step_course
from robots import robots

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course import Course
from stancekit.planners.problem.course_file import read_course, spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.projection.torque_limits import TorqueLimits
from stancekit.planners.projection.whole_body import whole_body
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.plan_joints import plan_angles
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.methods import make_course_planner
from stancekit.planners.verify import check_plan

BUILT_IN = ("stairs", "walls", "icy-walls", "tube", "ground-to-wall")


@dataclass(frozen=True, kw_only=True)
class Torques(Options):
    """See above."""

    courses: Path | None = None
    """A folder of courses."""
    robots: Path | None = None
    """A folder of robots: their quadrupeds climb a step, in place of the hexapod's courses."""
    torque_nm: float = 10.0
    """Of the hexapod's servos."""
    torque_share: float = 0.9
    weaker: float | None = None
    only: str = ""
    """Parts of names, with commas between them."""


def main(options: Torques) -> None:
    """Plan, bend, verify."""
    wanted, rows = [part for part in options.only.split(",") if part], list[Row]()
    for name, course in courses(options):
        if wanted and not any(part in name for part in wanted):
            continue
        found = {"name": name, "refused": course} if isinstance(course, str) else measured(name, course, options)
        options.say(found, line)
        rows.append(found)
    bent = [row for row in rows if row.get("share_before", 0.0) > 1.0]
    within = [row for row in bent if row["accepted"] and row["share"] <= 1.0]
    if not options.json and within:
        steps = spread([row["steps"] for row in within])
        print(f"{len(within)} of {len(bent)} that are above the limit come to it, in {steps} steps")
        print(f"stage, s of CPU: {spread([r['stage_s'] for r in within])}")


def courses(options: Torques) -> Iterator[tuple[str, Course | str]]:
    """Names and courses, or what is wrong with one."""
    folder = options.courses
    files = [] if folder is None else [str(path) for path in sorted(folder.glob("*.yaml"))]
    if options.robots is not None:
        for name, file in robots(options.robots):
            try:
                model = named_robot(file)
                if len(model.legs) == 4:
                    yield name, build_course(spec_from(step_course(model, file)))
            except InvalidInput as error:
                yield name, str(error)
        return
    for file in (*BUILT_IN, *files):
        try:
            yield Path(file).stem, read_course(file)
        except InvalidInput as error:
            yield Path(file).stem, str(error)


def measured(name: str, course: Course, options: Torques) -> Row:
    """One row."""
    begin = time.process_time()
    outcome = plan_with_reserve(make_course_planner("two-stage"), course)
    planned = time.process_time()
    row: dict[str, Any] = {"name": name, "frames": course.frames, "plan_s": planned - begin}
    if outcome.plan is None:
        return row | {"status": outcome.status.value}
    limits = TorqueLimits(torque_nm=limit(outcome.plan, options), share=options.torque_share)
    begin = time.process_time()
    bent = whole_body(outcome.plan, limits)
    bent_s, begin = time.process_time() - begin, time.process_time()
    plan_angles(outcome.plan, Kinematics(course.robot))
    joints_s = time.process_time() - begin
    report = check_plan(bent.plan, joints=True)
    return row | {
        "status": outcome.status.value, "joints_s": joints_s, "stage_s": bent_s - joints_s, "steps": bent.steps,
        "before_nm": bent.before[1], "after_nm": bent.after[1], "share_before": bent.before[0], "share": bent.after[0],
        "accepted": report.accepted, "message": report.message,
        "goal_mm": [1e3 * check_plan(plan).goal_m for plan in (outcome.plan, bent.plan)],
        "friction_share": bent.plan.provenance.get("friction_share"),
    }  # fmt: skip


def limit(plan: Plan, options: Torques) -> float | None:
    """For any joint [Nm]; None: its own."""
    if options.robots is None:
        return options.torque_nm
    return None if options.weaker is None else options.weaker * whole_body(plan, TorqueLimits(steps=0)).before[1]


def line(row: Row) -> str:
    """A row for people."""
    if "refused" in row:
        return f"{row['name']:20} refused: {row['refused']:.100}"
    head = f"{row['name']:20} {row['frames']:3} frames, plan {row['plan_s']:.2f} s"
    if "after_nm" not in row:
        return f"{head}: {row['status']}"
    goals = " → ".join(f"{goal:.0f}" for goal in row["goal_mm"])
    return (
        f"{head}, joints {row['joints_s']:.2f}, stage {row['stage_s']:.2f} | {row['before_nm']:.1f} → "
        f"{row['after_nm']:.1f} Nm ({row['share']:.0%}) in {row['steps']} | goal {goals} mm, friction "
        f"{row['friction_share']:.0%} | {'accepted' if row['accepted'] else row['message']:.60}"
    )


if __name__ == "__main__":
    launch(main, Torques, __doc__)
