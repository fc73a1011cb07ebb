"""Robots as they come: what loads without a word of configuration, what their feet reach, and
inverse kinematics.

    python benchmarks/robots.py [--robots FOLDER] [--legs 1] [--only go1,solo]
        [--correct FILE.yaml ...] [--json] [--markdown]
    # quadrupeds over a step, and what their postures are decided by
    python benchmarks/robots.py --step
    # all of them, and what is no robot with legs, over four grounds
    python benchmarks/robots.py --crossings FOLDER [--limit 40] [--drawn 60] [--quadrupeds 22]

The robots that have a name and whose package is installed, and other files of these packages;
--robots: those of a folder. --correct: robots as YAML files correct them, in addition.

load: the file read and its legs found. ws: one leg's workspace measured. cover: of what the foot
reaches usefully below its hip, the share in the inner polytope; unr.: share of the polytope out of
reach; outer: of 100,000 random postures, feet outside the outer set. IK: feet drawn from the inner
polytopes of all measured legs, the share that joint angles are found for, and the time of a stance
of all legs in a batch of 1000. Times are of this process's CPU. --step, --natural: see
_robot_step.py; --crossings, --limit, --drawn, --quadrupeds: see _crossings.py.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, launch, share
from _crossings import counts, line as crossing_line, robots as named, rows as crossings
from _robot_step import REACHED_M, step_line, step_row

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.inverse_kinematics import InverseKinematics
from stancekit.planners.robot.outer_sets import directions_of, foot_cloud
from stancekit.planners.robot.reach_sets import Workspace, workspace_of
from stancekit.planners.robot.robot_file import named_robot, provider_folder
from stancekit.planners.robot.robot_model import RobotModel

OTHERS = {
    "pybullet": (
        "laikago/laikago_toes.urdf",
        "laikago/laikago_toes_limits.urdf",
        "mini_cheetah/mini_cheetah.urdf",
        "quadruped/spirit40.urdf",
        "quadruped/quadruped.urdf",
        "humanoid/humanoid.urdf",
    ),
    "example-robot-data": (
        "b1_description/urdf/b1-z1.urdf",
        "laikago_description/urdf/laikago.urdf",
        "talos_data/robots/talos_full_v2.urdf",
        "romeo_description/urdf/romeo_small.urdf",
        "icub_description/robots/icub_reduced.urdf",
        "quadruped_description/urdf/quadruped.urdf",
        "centauro_description/urdf/centauro.urdf",
        "alex_description/urdf/alex_nub_hands.urdf",
        "cassie_description/robots/cassie_v2.urdf",
    ),
}
"""Files with legs that have no name."""
STANCES, RANDOM = 1000, 100_000


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Robots to look at.

    Arguments:
        robots: a folder of robots, all of its URDFs.
        legs: legs of each robot that are measured; 0: all of them.
        only: parts of names, with commas between them.
        correct: robots as YAML files correct them, in addition.
        step: quadrupeds alone: a plan over a step, natural postures.
        natural: postures to decide a robot, with ``--step``.
        crossings: folder of rows, of plans over four grounds.
        limit: of each of these plans [s].
        drawn: so many drawn grounds in place of the four.
        quadrupeds: so many drawn ones, with heavy legs among them, in place of the named robots.
    """

    robots: Path | None = None
    legs: int = 1
    only: str = ""
    correct: tuple[Path, ...] = ()
    step: bool = False
    natural: int = 40
    crossings: Path | None = None
    limit: float = 40.0
    drawn: int = 0
    quadrupeds: int = 0


def main(arguments: Asked) -> None:
    """Measure and print."""
    wanted = [part for part in arguments.only.split(",") if part]
    if arguments.crossings is not None:
        answers = []
        for each in crossings(
            arguments.crossings,
            wanted,
            arguments.limit,
            arguments.drawn,
            arguments.quadrupeds,
        ):
            arguments.say(each, crossing_line)
            answers.append(each)
        arguments.say(counts(answers))
        return
    rows = []
    for name, file in (
        *robots(arguments.robots),
        *((path.stem, str(path)) for path in arguments.correct),
    ):
        if wanted and not any(part in name for part in wanted):
            continue
        found = (
            step_row(name, file, arguments.natural)
            if arguments.step
            else row(name, file, arguments.legs)
        )
        rows.append(found)
        arguments.say(found, step_line if arguments.step else line)
    if arguments.step:
        asked = [each for each in rows if "refused" not in each]
        climbed = sum(bool(each.get("accepted")) and each["worst_m"] <= REACHED_M for each in asked)
        within = f"planned, verified, feet within {1e3 * REACHED_M:g} mm; others are refused"
        arguments.say({within: share(climbed, len(asked))})
        return
    loaded = [each for each in rows if "refused" not in each]
    quick = sum(each["load_s"] <= 1.5 for each in loaded)
    arguments.say({"load": share(len(loaded), len(rows)), "of them in 1.5 s or less": quick})


def robots(folder: Path | None) -> Iterator[tuple[str, str]]:
    """Names and files."""
    if folder is not None:
        yield from ((path.stem, str(path)) for path in sorted(folder.rglob("*.urdf")))
        return
    for file, name, negative in named(Path(), 0):
        if not negative:
            yield name, file
    for package, paths in OTHERS.items():
        root = provider_folder(package)
        for path in paths if root is not None else ():
            yield f"{package}: {path.rpartition('/')[2]}", str(root / path)


def row(name: str, file: str, legs: int) -> dict[str, Any]:
    """What is measured of one robot."""
    started = time.process_time()
    try:
        model = named_robot(file)
    except InvalidInput as error:
        return {"name": name, "refused": re.sub(r"^\S+: ", "", str(error))}
    found: dict[str, Any] = {
        "name": name,
        "load_s": time.process_time() - started,
        "legs": len(model.legs),
        "joints": len(model.legs[0].joints),
        "mass_kg": model.mass_kg,
        "doubts": len(model.doubts),
    }
    measured = model.legs[: legs or None]
    started = time.process_time()
    try:
        workspaces = [workspace_of(leg) for leg in measured]
    except InvalidInput as error:
        return found | {"no_workspace": str(error)}
    found["workspace_s"] = (time.process_time() - started) / len(measured)
    rng = np.random.default_rng(1)
    normals, clouds = directions_of(), [foot_cloud(leg) for leg in measured]
    outside = 0
    for leg, cloud in zip(measured, clouds, strict=True):
        feet = leg.chain.feet(leg.random_angles(RANDOM, rng))
        outside += int(np.any(feet @ normals.T > cloud.supports(normals), axis=1).sum())
    return found | {
        "reach_m": workspaces[0].reach_m,
        "faces": len(workspaces[0].inner.normals),
        "cover": min(each.cover for each in workspaces),
        "unreachable": max(each.unreachable for each in workspaces),
        "outside": outside,
        "slack_m": max(cloud.slack_m for cloud in clouds),
        **kinematics(model, workspaces, rng),
    }


def kinematics(
    model: RobotModel, workspaces: Sequence[Workspace], rng: np.random.Generator
) -> dict[str, float]:
    """Share of feet that are reached, and milliseconds of a stance of all legs."""
    legs = model.legs[: len(workspaces)]
    solver = InverseKinematics(legs, [leg.random_angles(8000, rng) for leg in legs])
    feet = np.stack([each.inner.sample(STANCES, rng) for each in workspaces], axis=1)
    started = time.process_time()
    found, error_m = solver.solve(feet)
    seconds = (time.process_time() - started) * len(model.legs) / len(legs)
    lower, upper = (
        np.concatenate([getattr(leg, end) for leg in legs]) for end in ("lower_rad", "upper_rad")
    )
    if np.any(found < lower) or np.any(found > upper):
        raise RuntimeError(f"{model.name}: limits are not kept")
    return {"reached": float((error_m <= REACHED_M).mean()), "stance_ms": 1e3 * seconds / STANCES}


def line(row: dict[str, Any]) -> str:
    """One row of the table."""
    if "refused" in row:
        return f"{row['name']:44} refused: {row['refused']:.120}"
    head = f"{row['name']:44} {row['legs']} × {row['joints']} joints {row['mass_kg']:6.1f} kg, load {row['load_s']:.2f} s"
    if "no_workspace" in row:
        return f"{head} | {row['no_workspace']}"
    return (
        f"{head} | reach {row['reach_m']:.2f} m, cover {row['cover']:.0%}, unr. {row['unreachable']:.2%},"
        f" {row['faces']} faces, outer {row['outside']} outside, slack {1e3 * row['slack_m']:.1f} mm,"
        f" ws {row['workspace_s']:.2f} s | IK {row['reached']:.2%} {row['stance_ms']:.3f} ms"
    )


if __name__ == "__main__":
    launch(main, Asked, __doc__)
