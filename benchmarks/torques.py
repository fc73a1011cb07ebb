"""Plans of the whole body: the largest torque and the deepest collision of a plan, before and after
they are mended.

    python benchmarks/torques.py [--courses FOLDER] [--torque-nm 10] [--torque-share .9]
        [--only walls,icy] [--json]
    # quadrupeds over a step, within their own limits
    python benchmarks/torques.py --robots FOLDER [--weaker .5]

The hexapod on the built-in courses and on those of a folder. torque: in the joint with the largest
share of its limit, of the plan as the planner has it and of the one with joints; steps: of the
whole plan, 0 where other forces do or nothing has to. plan: the planner; joints: inverse
kinematics; stage: all that comes after it, checks included, in seconds of this process's CPU; a
limit of 0 is none but the joints' own: what bodies alone take. depth: of the deepest collision all
along the motion [mm]. judged: contacts, joints, torque, bodies and motion by the verifier, in
seconds, and its verdict under this limit. --weaker: of robots with files, this share of the largest
torque that each needs as it comes is what it is given.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _bench import Options, Row, launch, spread
from _robot_step import scene_course
from robots import robots

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.motion.joints import plan_angles
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course, spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.projection.whole_body import WholeBodyLimits, whole_body
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.methods import make_planner
from stancekit.planners.verify import check_plan

BUILT_IN = ("stairs", "walls", "icy-walls", "tube", "ground-to-wall")


@dataclass(frozen=True, kw_only=True)
class Torques(Options):
    """See above."""

    courses: Path | None = None
    """A folder of courses."""
    robots: Path | None = None
    """A folder of robots: their quadrupeds on ``scenes``, in place of the hexapod's courses."""
    scenes: str = "step"
    """Of quadrupeds, with commas between them: step, stairs, slope, gap."""
    torque_nm: float = 10.0
    """Of the hexapod's servos; 0: what they have."""
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
        found = (
            {"name": name, "refused": course}
            if isinstance(course, str)
            else measured(name, course, options)
        )
        options.say(found, line)
        rows.append(found)
    bent = [row for row in rows if row.get("share_before", 0.0) > 1.0]
    within = [row for row in bent if row["accepted"] and row["share"] <= 1.0]
    deep = [row for row in rows if row.get("depth_mm", [0.0])[0] > 1.0]
    clear = [row for row in deep if row["accepted"]]
    planned = [row for row in rows if "stage_s" in row]
    if not options.json and planned:
        print(
            f"{sum(row['accepted'] for row in planned)} of {len(planned)} plans are accepted, motion included"
        )
        print(f"{len(within)} of {len(bent)} that are above the limit come to it")
        print(
            f"{len(clear)} of {len(deep)} that collide are planned clear: {', '.join(row['name'] for row in clear)}"
        )
        for title, chosen in (("all", planned), ("above the limit", within), ("colliding", clear)):
            if chosen:
                print(f"stage, s of CPU, {title}: {spread([row['stage_s'] for row in chosen])}")
        print(f"judging, s of CPU: {spread([row['judged_s'] for row in planned])}")


def courses(options: Torques) -> Iterator[tuple[str, Problem | str]]:
    """Names and courses, or what is wrong with one."""
    folder = options.courses
    files = [] if folder is None else [str(path) for path in sorted(folder.glob("*.yaml"))]
    if options.robots is not None:
        for name, file in robots(options.robots):
            try:
                model = named_robot(file)
            except InvalidInput as error:
                yield name, str(error)
                continue
            for scene in options.scenes.split(",") if len(model.legs) == 4 else ():
                try:
                    yield (
                        f"{name} {scene}",
                        build_course(spec_from(scene_course(model, file, scene))),
                    )
                except InvalidInput as error:
                    yield f"{name} {scene}", str(error)
        return
    for file in (*BUILT_IN, *files):
        try:
            yield Path(file).stem, read_course(file)
        except InvalidInput as error:
            yield Path(file).stem, str(error)


def measured(name: str, course: Problem, options: Torques) -> Row:
    """One row."""
    begin = time.process_time()
    outcome = plan_with_reserve(make_planner("two-stage", of="courses"), course)
    planned = time.process_time()
    row: dict[str, Any] = {"name": name, "frames": course.frames, "plan_s": planned - begin}
    if outcome.solution is None:
        return row | {"status": outcome.status.value}
    limits = WholeBodyLimits(torque_nm=limit(outcome.solution, options), share=options.torque_share)
    begin = time.process_time()
    bent = whole_body(outcome.solution, limits)
    bent_s, begin = time.process_time() - begin, time.process_time()
    plan_angles(outcome.solution, Kinematics(course.robot))
    joints_s = time.process_time() - begin
    begin = time.process_time()
    report = check_plan(bent.plan, joints=True)
    judged_s = time.process_time() - begin
    return row | {
        "judged_s": judged_s,
        "depth_mm": [1e3 * bent.before.depth_m, 1e3 * bent.after.depth_m],
        "status": outcome.status.value,
        "joints_s": joints_s,
        "stage_s": bent_s - joints_s,
        "steps": bent.steps,
        "before_nm": bent.before.torque_nm,
        "after_nm": bent.after.torque_nm,
        "share_before": bent.before.share,
        "share": bent.after.share,
        "accepted": report.accepted,
        "message": report.failures or report.message,
        "goal_mm": [
            1e3 * check_plan(plan).figures["goal_m"] for plan in (outcome.solution, bent.plan)
        ],
        "friction_share": bent.plan.provenance.get("friction_share"),
    }


def limit(plan: Plan, options: Torques) -> float | None:
    """For any joint [Nm]; None: its own."""
    if options.robots is None:
        return options.torque_nm or None
    if options.weaker is None:
        return None
    return options.weaker * whole_body(plan, WholeBodyLimits(steps=0)).before.torque_nm


def line(row: Row) -> str:
    """A row for people."""
    if "refused" in row:
        return f"{row['name']:20} refused: {row['refused']:.100}"
    head = f"{row['name']:20} {row['frames']:3} frames, plan {row['plan_s']:.2f} s"
    if "after_nm" not in row:
        return f"{head}: {row['status']}"
    goals, depths = (
        " → ".join(f"{value:.0f}" for value in row[name]) for name in ("goal_mm", "depth_mm")
    )
    seconds = (
        f"joints {row['joints_s']:.2f}, stage {row['stage_s']:.2f}, judged {row['judged_s']:.2f}"
    )
    torque = (
        f"{row['before_nm']:.1f} → {row['after_nm']:.1f} Nm ({row['share']:.0%}) in {row['steps']}"
    )
    verdict = "accepted" if row["accepted"] else f"{row['message']:.60}"
    friction = f"friction {row['friction_share']:.0%}"
    return (
        f"{head}, {seconds} | {torque}, {depths} mm deep | goal {goals} mm, {friction} | {verdict}"
    )


if __name__ == "__main__":
    launch(main, Torques, __doc__)
