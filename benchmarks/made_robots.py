"""Sixty robots of our own making, sound and unsound: which of them are planned, and how they stand
then.

    python benchmarks/made_robots.py [--only NAME,NAME] [--frames 1] [--json]

Each is written into a folder, planned for on level ground, its plan file verified, and every key
frame posed by pinocchio from the URDF's own text (``tests/planners/robot/made_robots.py``), with
the lowest point of every link.

sound: whether it is; status: accepted, rejected, undecided or refused, with the message; off_mm:
how far the lowest point of a leg that stands is from the ground at most; deepest_mm: of all shapes
below it. wrong: 1 for a sound robot that is not accepted, or that stands more than 1 mm off, and
for one that is accepted and deeper than 1 mm.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from _bench import Options, launch

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.plan_file import check_file, write_plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.urdf import joint_names
from stancekit.planners.search.methods import make_planner
from stancekit.planners.search.plan_course import plan_course
from tests.planners.robot.made_robots import Made, lowest_m, made_robots

TOUCH_M = 1e-3
LYING = np.array([np.pi / 2.0, 0.0, 0.0])
"""How the root of the robot lies whose YAML file says so."""


@dataclass(frozen=True, kw_only=True)
class Which(Options):
    """Which robots, and over how many key frames."""

    only: str = ""
    """Names with commas between them; all where there is none."""
    frames: int = 1
    """Key frames of each plan."""


def main(options: Which) -> None:
    """Plan for all of them and print a row for each, and the sums."""
    rows = []
    for made in made_robots():
        if options.only and made.name not in options.only.split(","):
            continue
        with tempfile.TemporaryDirectory() as folder:
            rows.append(judged(made, Path(folder), options.frames))
        options.say(rows[-1])
    options.say(
        {
            "robots": len(rows),
            "sound": sum(row["sound"] for row in rows),
            "accepted": sum(row["status"] == "accepted" for row in rows),
            "wrong": sum(row["wrong"] for row in rows),
        }
    )


def judged(made: Made, folder: Path, frames: int = 1) -> dict[str, Any]:
    """What is made of one robot."""
    began, row = process_time(), {"name": made.name, "sound": made.sound}
    off_m = deepest_m = 0.0
    try:
        path = made.write(folder)
        model = named_robot(path)
        ahead = 0.0 if frames == 1 else 0.04 * frames
        (folder / "course.yaml").write_text(
            f"name: level\nrobot: {path.name}\nframes: {frames}\ngait: wave\nstart_m: [0, 0]\n"
            f"goal_m: [{ahead}, 0, {model.stand_height_m}]\nterrain: {{kind: flat, friction: 0.7}}\n"
        )
        course = read_course(folder / "course.yaml")
        outcome = plan_course(course, make_planner("two-stage", of="courses"))
        status, message = outcome.status.value, outcome.message
        if outcome.solution is not None and outcome.report is not None:
            write_plan(folder / "plan.json", outcome.solution, outcome.report)
            again = check_file(folder / "plan.json", robot=model)
            status, message = (
                "accepted" if again.accepted and outcome.report.accepted else "rejected",
                again.message,
            )
            off_m, deepest_m = stands(outcome.solution, made, folder)
    except InvalidInput as error:
        status, message = "refused", str(error)
    accepted = status == "accepted"
    wrong = (made.sound and (not accepted or off_m > TOUCH_M)) or (accepted and deepest_m > TOUCH_M)
    return row | {
        "status": status,
        "wrong": int(wrong),
        "off_mm": round(1e3 * off_m, 3),
        "deepest_mm": round(1e3 * deepest_m, 3),
        "cpu_s": round(process_time() - began, 1),
        "message": message[:160],
    }


def stands(plan: Plan, made: Made, folder: Path) -> tuple[float, float]:
    """How far the lowest point of a leg that stands is from the ground, and how deep any link is in
    it [m].
    """
    course, off_m, deepest_m = plan.problem, 0.0, 0.0
    model = course.robot.model
    assert plan.joints_rad is not None
    assert model is not None
    rpy = LYING if "root_rpy_rad" in made.keys else np.zeros(3)
    if (
        "contacts" in made.keys
    ):  # what it stands on is a ball that the YAML file says, which its own text lacks
        (folder / "robot.urdf").write_text(model.urdf)
    names = joint_names(course.robot)
    standing = dict(zip(names, np.concatenate([leg.stance_rad for leg in model.legs]), strict=True))
    for k in range(course.frames):
        posture = dict(zip(names, plan.joints_rad[k], strict=True))
        turn = rotation_of(plan.rotation_rad[k])
        low = lowest_m(folder / "robot.urdf", standing, posture, plan.com_m[k], turn, rpy)
        deepest_m = max(deepest_m, -min(low.values()))
        lifted = set(course.lifts[k - 1]) if k else set()
        for name in course.robot.limb_names:
            if name not in lifted:
                own = [z for link, z in low.items() if link.startswith(f"{name}_")]
                off_m = max(off_m, abs(min(own)))
    return off_m, deepest_m


if __name__ == "__main__":
    launch(main, Which, __doc__)
