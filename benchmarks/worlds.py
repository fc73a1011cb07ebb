"""The same plan in both simulators, of robots whose files are written in several ways.

    python benchmarks/worlds.py --out out/worlds [--robots drawn1 drawn2 ...] [--ways plain axes ...]

Robots of 3 to 8 legs with 3 to 6 joints each (those of clothes.py; legs of two have no workspace with an
inside) climb over level ground, walk there or stand in one posture; in each way their file, what turns their joints, or
the place of the ground is another. A row says how far apart the two bodies are at the end, how far
each is from its plan, or the line by which a world or the planner refused. Rows that are there are
not made again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from _bench import Lines, Options, Row, launch, markdown
from clothes import drawn, size_m

import stancekit
from stancekit.planners.files.writing import write_text
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.robot.leg import ActuatorModel, Actuators
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import make_world

WORLDS = ("mujoco", "bullet")
WAYS = (
    "plain",
    "axes",
    "half effort",
    "damping 1, friction 2",
    "twice the actuators",
    "5 km",
    "500 km",
)
FILES = ("axes", "half effort", "damping 1, friction 2")
"""Ways that are written into a robot's file."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Robots, ways and motions."""

    out: Path = Path("out/worlds")
    """Folder of the rows and of the robots' files."""
    robots: tuple[str, ...] = tuple(f"drawn{seed}" for seed in (1, 2, 3, 4, 7, 8, 9, 13, 14, 19))
    """Seeds of clothes.py's robots, or names of robots, whose files stay as they are."""
    ways: tuple[str, ...] = WAYS
    motions: tuple[str, ...] = ("climb", "walk", "posture")
    pace: float = 2.0
    """Pace of climbs."""


def main(arguments: Arguments) -> None:
    """Plan and run whatever has no row."""
    lines = Lines(arguments.out / "rows.jsonl")
    arguments.out.mkdir(parents=True, exist_ok=True)
    for way in arguments.ways:
        for robot in arguments.robots:
            for motion in arguments.motions:
                key = f"{robot}, {motion}, {way}"
                if robot.startswith("drawn") or way not in FILES:
                    arguments.say(
                        lines.rows.get(key) or lines.add(key, ran(robot, motion, way, arguments))
                    )


def ran(robot: str, motion: str, way: str, arguments: Arguments) -> Row:
    """One motion of one robot in both worlds."""
    row = {"robot": robot, "motion": motion, "way": way}
    far_m = 1e3 * float(way.removesuffix(" km")) if way.endswith("km") else 0.0
    try:
        asks = {"climb": climb, "walk": walk, "posture": posture}[motion]
        answer = asks(*asked(robot, way, arguments.out), far_m, arguments.out)
        if answer.solution is None:
            return {**row, "said": f"planner: {answer.message}"}
        accepted = Accepted.verified(answer.solution, robot)
        strong = doubled(accepted.robot) if way == "twice the actuators" else None
        ends = [ended(accepted, world, strong, arguments.pace) for world in WORLDS]
    except stancekit.StancekitError as error:
        return {**row, "said": str(error)}
    apart = float(np.linalg.norm(ends[0].pop("at") - ends[1].pop("at")))
    both = {
        f"{k} {world}": v for world, end in zip(WORLDS, ends, strict=True) for k, v in end.items()
    }
    return {**row, "apart_m": apart, **both}


def asked(robot: str, way: str, folder: Path) -> tuple[str, float]:
    """The robot as a way has it, and its size [m]."""
    if not robot.startswith("drawn"):
        return robot, 0.5
    seed = int(robot.removeprefix("drawn"))
    root = ElementTree.fromstring(drawn(seed))
    for joint in root.findall("joint[@type='revolute']"):
        axis, limit = (joint.find(tag).attrib for tag in ("axis", "limit"))  # type: ignore[union-attr]
        if way == "axes":
            axis["xyz"] = " ".join(str(2.0 * float(x)) for x in axis["xyz"].split())
        if way == "half effort":
            limit["effort"] = repr(0.5 * float(limit["effort"]))
        if way == "damping 1, friction 2":
            ElementTree.SubElement(joint, "dynamics", damping="1", friction="2")
    path = folder / f"{robot}-{way.replace(' ', '-').replace(',', '')}.urdf"
    write_text(path, ElementTree.tostring(root, encoding="unicode"))
    return str(path), size_m(seed)


def posture(robot: str, size: float, far_m: float, folder: Path) -> Any:
    """A stand on level ground, of one key frame."""
    return climb(robot, size, far_m, folder, ahead=0.0, frames=1)


def climb(
    robot: str,
    size: float,
    far_m: float,
    folder: Path,
    ahead: float = 0.35,
    frames: int | None = None,
) -> Any:
    """A climb over level ground, by a third of the robot's size."""
    start, half = (far_m, -0.4 * far_m), 4.0 * size
    corners = [(start[0] + half * x, start[1] + half * y) for x in (-1, 1) for y in (-x, x)]
    write_text(
        folder / "level.obj", "".join(f"v {x!r} {y!r} 0\n" for x, y in corners) + "f 1 2 3 4\n"
    )
    return stancekit.plan(
        folder / "level.obj",
        start=start,
        goal=(far_m + ahead * size, start[1]),
        frames=frames,
        robot=robot,
        time_limit_s=60.0,
    )


def walk(robot: str, size: float, far_m: float, folder: Path) -> Any:
    """A walk over level ground."""
    start, x = (far_m, -0.4 * far_m), np.linspace(-6.0 * size, 6.0 * size, 61)
    level = stancekit.HeightField(
        x_m=x + start[0], y_m=x + start[1], heights_m=np.zeros((len(x), len(x)))
    )
    return stancekit.walk(
        level,
        (far_m + 0.35 * size, start[1]),
        start=start,
        robot=robot,
        duration_s=2.0,
    )


def ended(accepted: Accepted[Any], world: str, strong: Actuators | None, pace: float) -> Row:
    """The end of a run in one world."""
    made = make_world(world, accepted.robot, gravity_m_s2=accepted.gravity_m_s2, actuators=strong)
    report = Runner(made, settings=RunSettings(timing=Timing().at_pace(pace))).run(accepted)
    if report.execution is None:
        return {"at": np.full(3, np.nan), "said": report.message}
    return {
        "at": report.execution.trace.origin_m[-1],
        "off_m": report.execution.com_final_m,
        "said": report.message,
    }


def doubled(robot: stancekit.Robot) -> Actuators:
    """Actuators of twice the efforts of the robot's file."""
    kinds = {
        joint.name: ActuatorModel(
            stall_nm=2.0 * joint.torque_nm, no_load_rad_s=joint.velocity_rad_s, curve="flat"
        )
        for leg in robot.legs.legs
        for joint in leg.joints
    }
    return Actuators(joints={name: name for name in kinds}, actuators=kinds)


def table(rows: list[Row]) -> Iterable[str]:
    """A line per way and motion."""
    lines = []
    for way, motion in dict.fromkeys((row["way"], row["motion"]) for row in rows):
        some = [row for row in rows if (row["way"], row["motion"]) == (way, motion)]
        apart = np.array([1e3 * row["apart_m"] for row in some if "apart_m" in row])
        lines.append(
            (
                way,
                motion,
                f"{np.count_nonzero(apart <= 5.0)} of {len(apart)}",
                f"{apart.max(initial=0.0):.1f}",
                len(some) - len(apart),
            )
        )
    return markdown(("way", "motion", "end within 5 mm", "farthest apart [mm]", "refused"), lines)


if __name__ == "__main__":
    launch(main, Arguments, __doc__, worlds=table)
