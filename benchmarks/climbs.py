"""Quadrupeds of files climb steps and stairs: planned, verified, and run in simulation; how many of the plans stand?

    python benchmarks/climbs.py --robots FOLDER [--only go1 solo12] [--terrains step stairs] [--count 20]
        [--world bullet] [--offset-deg .5 --delay-ms 15 --mass 1.15 --stiffness .7 --friction .8]
        [--workers 2] [--json]

FOLDER: example-robot-data's ``robots``; robots that are not there are left out, and said. The courses begin on level
ground; a step, or stairs of two, each between 5 and 8 cm high, more by nothing and less in proportion where a
leg is shorter than .3 m. Heights, treads, where the first step is, and friction are drawn anew for every course.

planned: courses with a plan that the verifier accepts, joints and torques, too; stood: those of them that a run carries
to their end, within the tolerance of ``RunSettings``. body: root mean square distance of its origin from where it
should be, median and worst [mm]. slip: the longest of any stance [mm], median and worst. torque: the largest of any
joint in units of its own limit. bumped: longest time that anything but a foot touched [s].
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, launch
from _wrong import Wrong
from joblib import Parallel, delayed
from walks import ROBOTS, robot_file

from stancekit.planners.answer.plan import Plan
from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.robot.contact_robot import standing_toes
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.methods import make_course_planner
from stancekit.planners.search.whole_body_outcome import with_whole_body
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world

RISES_M, SHORT_M = (0.05, 0.08), 0.3
"""Heights of a step, and the length of a leg below which they are less in proportion."""
STEPS = {"step": 1, "stairs": 2}
STRIDE = 0.09
"""How far the body goes between two key frames, in units of a leg's length."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which robots, over what, in which world, and what is wrong with them."""

    robots: Path
    only: tuple[str, ...] = tuple(ROBOTS)
    terrains: tuple[str, ...] = tuple(STEPS)
    count: int = 20
    world: str = "mujoco"
    workers: int = 1
    offset_deg: float = 0.0
    delay_ms: float = 0.0
    mass: float = 1.0
    stiffness: float = 1.0
    friction: float = 1.0


def main(arguments: Arguments) -> None:
    """Plan, run and print."""
    wrong = Wrong.of(arguments)
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.only:
            if not (arguments.robots / ROBOTS[name].urdf).exists():
                print(f"{name}: no file {ROBOTS[name].urdf}, left out", flush=True)
                continue
            file = robot_file(ROBOTS[name], arguments.robots, Path(folder) / f"{name}.yaml")
            for terrain in arguments.terrains:
                seeds = np.random.SeedSequence(arguments.seed).spawn(arguments.count)
                jobs = (delayed(climbed)(str(file), terrain, seed, arguments.world, wrong) for seed in seeds)
                found = list(Parallel(n_jobs=arguments.workers)(jobs))
                arguments.say({"robot": name, "terrain": terrain, "world": arguments.world} | summary(found), line)
                if not arguments.json:
                    for index, said in failures(found):
                        print(f"    course {index}: {said}", flush=True)


def climbed(file: str, terrain: str, seed: np.random.SeedSequence, world: str, wrong: Wrong) -> RunReport | str:
    """One course, planned and run; what was said where there is no accepted plan."""
    plan = planned(named_robot(file), file, terrain, np.random.default_rng(seed))
    if isinstance(plan, str):
        return plan
    course = plan.course
    made = make_world(world, course.robot, gravity_m_s2=course.gravity_m_s2, imperfections=wrong.imperfections)
    settings = RunSettings(check_limits=False)
    return Runner(made, settings=settings).run(Accepted.verified(plan, terrain), wrong.patches(plan))


def planned(model: RobotModel, file: str, terrain: str, rng: np.random.Generator) -> Plan | str:
    """An accepted plan over a drawn course, or why there is none."""
    course = build_course(spec_from(course_of(model, file, STEPS[terrain], rng)))
    outcome = with_whole_body(plan_with_reserve(make_course_planner("two-stage"), course))
    if outcome.plan is None:
        return outcome.message or outcome.status.value
    report = check_plan(outcome.plan, joints=True)
    return outcome.plan if report.accepted else f"{report.message}; {report.joints_message}"


def course_of(model: RobotModel, file: str, steps: int, rng: np.random.Generator) -> dict[str, Any]:
    """Level ground and steps up, which all feet have climbed at the end."""
    length, height = model.legs[0].chain.length_m, model.stand_height_m
    toes = standing_toes(model)[:, 0]
    rises = min(1.0, length / SHORT_M) * rng.uniform(*RISES_M, steps)
    tread = rng.uniform(1.4, 1.7) * length
    edge = float(toes.max()) + rng.uniform(0.1, 0.25) * length
    ends = edge + tread * np.arange(steps)
    via = [[float(edge_m - toe), 0.0, float(height + (k + share) * rises[: k + 1].mean())]
           for k, edge_m in enumerate(ends) for toe, share in ((toes.max(), 0.0), (toes.min(), 0.5))]  # fmt: skip
    goal = [float(ends[-1] - toes.min()) + 0.3 * length, 0.0, float(height + rises.sum())]
    frames = int(np.ceil(goal[0] / (STRIDE * length))) + 1
    return {
        "name": "climb", "robot": file, "frames": frames, "gait": "wave", "start_m": [0.0, 0.0, height],
        "via_m": sorted(via), "goal_m": goal, "body": {"com_radius_m": 0.15 * length, "first_radius_m": 0.05 * length},
        "steps": {"com_m": 0.3 * length, "toe_m": 1.2 * length, "rotation_rad": 0.15},
        "candidates": {"window_m": 0.4 * length},
        "terrain": {"kind": "stairs", "friction": float(rng.uniform(0.56, 0.7)), "first_m": edge, "run_m": tread,
                    "rises_m": [*map(float, rises), *([0.0] * 3)]},
    }  # fmt: skip


def summary(found: list[RunReport | str]) -> dict[str, Any]:
    """How many, medians and extremes."""
    reports = [each for each in found if isinstance(each, RunReport)]
    runs = [report.execution for report in reports if report.execution is not None]
    row: dict[str, Any] = {
        "courses": len(found), "planned": len(reports), "stood": sum(report.succeeded for report in reports),
    }  # fmt: skip
    if not runs:
        return row
    figures = {
        "body_mm": [1e3 * run.body_rms_m for run in runs], "slip_mm": [1e3 * float(run.slip_m.max()) for run in runs],
        "torque": [float(run.torque_share.max()) for run in runs], "bumped_s": [run.bump_s for run in runs],
    }  # fmt: skip
    return row | {name: [float(np.median(values)), max(values)] for name, values in figures.items()}


def failures(found: list[RunReport | str]) -> Iterator[tuple[int, str]]:
    """Which courses have no plan, or none that stood, and why."""
    for index, each in enumerate(found):
        if isinstance(each, str):
            yield index, f"not planned: {each:.140}"
        elif not each.succeeded:
            yield index, each.message


def line(row: dict[str, Any]) -> str:
    """For people."""
    head = f"{row['robot']:<9} {row['terrain']:<7} {row['world']:<7} {row['stood']:3} of {row['planned']} stood"
    head += f", {row['planned']} of {row['courses']} planned"
    if "body_mm" not in row:
        return head
    return head + "".join(
        f"  {name} {row[key][0]:.{digits}f} ≤ {row[key][1]:.{digits}f}"
        for name, key, digits in (("body", "body_mm", 1), ("slip", "slip_mm", 1), ("torque", "torque", 2),
                                  ("bumped", "bumped_s", 2))
    )  # fmt: skip


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
