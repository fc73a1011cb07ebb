"""Quadrupeds of files climb steps and stairs: planned, verified, and run in simulation; how many of
the plans stand?

    python benchmarks/climbs.py --robots FOLDER [--only go1 solo12] [--terrains step stairs]
    [--count 20]
        [--world bullet] [--offset-deg .5 --delay-ms 15 --mass 1.15 --stiffness .7 --friction .8]
        [--perturbed 20] [--folder FOLDER] [--workers 2] [--json]

FOLDER: example-robot-data's ``robots``; robots that are not there are left out, and said. The
courses begin on level ground; a step, or stairs of two, each between 5 and 8 cm high, more by
nothing and less in proportion where a leg is shorter than .3 m. Heights, treads, where the first
step is, and friction are drawn anew for every course. --folder: plans and runs are kept there, and
none that is there is made again.

planned: courses with a plan that the verifier accepts, joints and torques, too; stood: those of
them that a run carries to their end, within the tolerance of ``RunSettings``. body: root mean
square distance of its origin from where it should be, median and worst [mm]. slip: the longest of
any stance [mm], median and worst. torque: the largest of any joint in units of its own limit.
bumped: longest time that anything but a foot touched [s].

What is not as planned: joints off by up to --offset-deg, commands late by --delay-ms, shares --mass
of all masses, --stiffness of the loops' Kp, and --friction. With --perturbed every plan is run as
it is, and so often again with all of these at once, each drawn evenly from --seed between nothing
and what is said; the interval is Wilson's, 95 %.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, Row, kept, launch
from _wrong import Wrong
from joblib import Parallel, delayed
from walks import ROBOTS, as_file_name, robot_file

from stancekit.learners.evaluation.evaluate import Share
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.robot.reach_sets import standing_toes
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.search.methods import make_planner
from stancekit.planners.search.plan_course import plan_course
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import make_world

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
    folder: Path | None = None
    workers: int = 1
    perturbed: int = 0
    offset_deg: float = 0.0
    delay_ms: float = 0.0
    mass: float = 1.0
    stiffness: float = 1.0
    friction: float = 1.0

    @property
    def wrong(self) -> tuple[float, ...]:
        """What is not as planned, as ``WRONG`` has it."""
        return tuple(getattr(self, name) for name in WRONG)


WRONG = {"offset_deg": 0.0, "delay_ms": 0.0, "mass": 1.0, "stiffness": 1.0, "friction": 1.0}
"""Options of what is not as planned, and where nothing is."""


def main(arguments: Arguments) -> None:
    """Plan, run and print."""
    if arguments.perturbed and arguments.wrong == tuple(WRONG.values()):
        raise SystemExit(
            "--perturbed: expected something that is not as planned, e.g. --mass 1.15, got nothing"
        )
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) if arguments.folder is None else arguments.folder
        folder.mkdir(parents=True, exist_ok=True)
        for name in arguments.only:
            if not (arguments.robots / ROBOTS[name].urdf).exists():
                print(f"{name}: no file {ROBOTS[name].urdf}, left out", flush=True)
                continue
            file = robot_file(ROBOTS[name], arguments.robots, folder / f"{name}.yaml")
            for terrain in arguments.terrains:
                each = range(arguments.count)
                jobs = (
                    delayed(climbed)(str(file), terrain, index, folder, arguments) for index in each
                )
                found = list(Parallel(n_jobs=arguments.workers)(jobs))
                arguments.say(
                    {"robot": name, "terrain": terrain, "world": arguments.world} | summary(found),
                    line,
                )
                if not arguments.json:
                    for index, said in failures(found):
                        print(f"    course {index}: {said}", flush=True)


def climbed(file: str, terrain: str, index: int, folder: Path, arguments: Arguments) -> Row:
    """One course, planned and run: why there is no accepted plan; else figures of its run, and of
    those perturbed.
    """
    seed = np.random.SeedSequence(arguments.seed, spawn_key=(index,))  # as spawned
    stem = as_file_name(f"{Path(file).stem}-{terrain}-{arguments.seed}-{index}")
    path = folder / f"{stem}-plan.json"
    said = kept(
        folder / f"{stem}.json",
        lambda: {"refused": planned(path, file, terrain, np.random.default_rng(seed))},
    )
    if said["refused"]:
        return said
    accepted = Accepted.from_file(path)

    def run(its: Arguments) -> Row:
        end = as_file_name("-".join(f"{value:.4g}" for value in its.wrong))
        return kept(folder / f"{stem}-{its.world}-{end}.json", lambda: ran(accepted, its))

    if not arguments.perturbed:
        return run(arguments)
    rng = np.random.default_rng(seed.spawn(1)[0])
    shares = rng.uniform(size=(arguments.perturbed, len(WRONG)))
    again = [run(perturbed(arguments, each)) for each in shares]
    return run(perturbed(arguments, np.zeros(len(WRONG)))) | {
        "perturbed": [each["refused"] for each in again]
    }


def perturbed(arguments: Arguments, shares: np.ndarray) -> Arguments:
    """The same with these shares of what is not as planned, in the order of ``WRONG``."""
    said = zip(WRONG.items(), arguments.wrong, shares.tolist(), strict=True)
    return replace(
        arguments, **{name: none + share * (most - none) for (name, none), most, share in said}
    )


def ran(accepted: Accepted, arguments: Arguments) -> Row:
    """A plan, run. refused: why that did not succeed, empty where it did; figures where bodies are
    measured.
    """
    course, wrong = accepted.plan.problem, Wrong.of(arguments)
    made = make_world(
        arguments.world,
        course.robot,
        gravity_m_s2=course.gravity_m_s2,
        imperfections=wrong.imperfections,
    )
    report = Runner(made, settings=RunSettings(check_limits=False)).run(
        accepted, wrong.patches(accepted.plan)
    )
    row: Row = {
        "planned": True,
        "refused": "" if report.succeeded else report.message or "did not succeed",
    }
    if (run := report.execution) is not None:
        row |= {
            "body_mm": 1e3 * run.body_rms_m,
            "slip_mm": 1e3 * float(run.slip_m.max()),
            "torque": float(run.torque_share.max()),
            "bumped_s": run.bump_s,
        }
    return row


def planned(path: Path, file: str, terrain: str, rng: np.random.Generator) -> str:
    """Write an accepted plan over a drawn course; why there is none, empty where there is."""
    course = build_course(spec_from(course_of(named_robot(file), file, STEPS[terrain], rng)))
    outcome = plan_course(course, make_planner("two-stage", of="courses"))
    report = outcome.report
    if outcome.solution is None or report is None:
        return outcome.message or outcome.status.value
    if report.failures:
        return report.failures
    write_motion(path, outcome.solution, report)
    return ""


def course_of(model: RobotModel, file: str, steps: int, rng: np.random.Generator) -> dict[str, Any]:
    """Level ground and steps up, which all feet have climbed at the end."""
    length, height = model.legs[0].chain.length_m, model.stand_height_m
    toes = standing_toes(model)[:, 0]
    rises = min(1.0, length / SHORT_M) * rng.uniform(*RISES_M, steps)
    tread = rng.uniform(1.4, 1.7) * length
    edge = float(toes.max()) + rng.uniform(0.1, 0.25) * length
    ends = edge + tread * np.arange(steps)
    via = [
        [float(edge_m - toe), 0.0, float(height + (k + share) * rises[: k + 1].mean())]
        for k, edge_m in enumerate(ends)
        for toe, share in ((toes.max(), 0.0), (toes.min(), 0.5))
    ]
    goal = [float(ends[-1] - toes.min()) + 0.3 * length, 0.0, float(height + rises.sum())]
    frames = int(np.ceil(goal[0] / (STRIDE * length))) + 1
    return {
        "name": "climb",
        "robot": file,
        "frames": frames,
        "gait": "wave",
        "start_m": [0.0, 0.0, height],
        "via_m": sorted(via),
        "goal_m": goal,
        "body": {"com_radius_m": 0.15 * length, "first_radius_m": 0.05 * length},
        "steps": {"com_m": 0.3 * length, "toe_m": 1.2 * length, "rotation_rad": 0.15},
        "candidates": {"window_m": 0.4 * length},
        "terrain": {
            "kind": "stairs",
            "friction": float(rng.uniform(0.56, 0.7)),
            "first_m": edge,
            "run_m": tread,
            "rises_m": [*map(float, rises), *([0.0] * 3)],
        },
    }


def summary(found: Sequence[Row]) -> dict[str, Any]:
    """How many, medians and extremes."""
    runs = [each for each in found if "planned" in each]
    row: dict[str, Any] = {
        "courses": len(found),
        "planned": len(runs),
        "stood": sum(not each["refused"] for each in runs),
    }
    again = [said for each in runs for said in each.get("perturbed", ())]
    if again:
        share = Share(hits=again.count(""), of=len(again))
        row |= {"perturbed": len(again), "perturbed_stood": share.hits, "interval": share.interval}
    for name in ("body_mm", "slip_mm", "torque", "bumped_s"):
        values = [each[name] for each in runs if name in each]
        row |= {name: [float(np.median(values)), max(values)]} if values else {}
    return row


def failures(found: Sequence[Row]) -> Iterator[tuple[int, str]]:
    """Which courses have no plan, or none that stood, and why."""
    for index, each in enumerate(found):
        if each["refused"]:
            yield (
                index,
                each["refused"] if "planned" in each else f"not planned: {each['refused']:.140}",
            )
        for said in filter(None, each.get("perturbed", ())):
            yield index, f"perturbed: {said}"


def line(row: dict[str, Any]) -> str:
    """For people."""
    head = f"{row['robot']:<9} {row['terrain']:<7} {row['world']:<7} {row['stood']:3} of {row['planned']} stood"
    head += f", {row['planned']} of {row['courses']} planned"
    if "perturbed" in row:
        low, high = row["interval"]
        head += (
            f", perturbed {row['perturbed_stood']} of {row['perturbed']} ({low:.3f} to {high:.3f})"
        )
    if "body_mm" not in row:
        return head
    return head + "".join(
        f"  {name} {row[key][0]:.{digits}f} ≤ {row[key][1]:.{digits}f}"
        for name, key, digits in (
            ("body", "body_mm", 1),
            ("slip", "slip_mm", 1),
            ("torque", "torque", 2),
            ("bumped", "bumped_s", 2),
        )
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
