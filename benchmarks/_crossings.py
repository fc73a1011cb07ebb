"""Robots by their names, and files that are none, over four grounds: ``benchmarks/robots.py
--crossings FOLDER``; or over grounds that are drawn, each of a family, a level and a seed; or, in
place of robots with a name, quadrupeds that are drawn: their legs have 20 to 85 % of the mass, and
their trunk's own is ahead of its middle, behind it, below or above.

Each is asked for a plan over 1 m of flat ground, a step of 10 cm, a slope of 12° and a gap of 12
cm, and what is planned is executed in MuJoCo. Rows are kept in the folder, one a line, and an
interrupted run goes on there. A negative, of which nothing may be accepted, is an arm, a car, a
robot in a plane, or one whose legs have two joints.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from itertools import pairwise
from math import radians, tan
from pathlib import Path

import numpy as np
from _bench import Lines, Row, tally

import stancekit
from stancekit.planners.robot.model import BUILT_IN
from stancekit.planners.robot.robot_file import as_they_come, catalogue, provider_folder

HALF_M = 1.5
RISE = tan(radians(12.0))
PROFILES: dict[str, tuple[tuple[tuple[float, float], ...], ...]] = {
    "flat": (((-2.0, 0.0), (3.0, 0.0)),),
    "step": (((-2.0, 0.0), (0.5, 0.0), (0.5, 0.1), (3.0, 0.1)),),
    "slope": (((-2.0, -2.0 * RISE), (3.0, 3.0 * RISE)),),
    "gap": (((-2.0, 0.0), (0.44, 0.0)), ((0.56, 0.0), (3.0, 0.0))),
}
"""Grounds by their profiles (x, z), which go on across the way [m]."""
SCENES = ("stairs", "stones", "gaps", "beams", "rubble", "slopes", "walls")
"""The families of polygons."""
LEVELS = 0.05, 0.3
"""Of drawn grounds, of 1: what robots of half a metre can cross."""
START, GOAL = (0.0, 0.0), (1.0, 0.0)
NEAR = (0.06, 0.0)
"""Goal of quadrupeds that are drawn [m]."""
NEGATIVES = {
    "example-robot-data": (
        "panda_description/urdf/panda.urdf",
        "ur_description/urdf/ur5_robot.urdf",
        "z1_description/urdf/z1.urdf",
        "finger_edu_description/robots/finger_edu.urdf",
        "solo_description/robots/solo.urdf",
        "pr2_description/urdf/pr2.urdf",
    ),
    "pybullet": (
        "racecar/racecar.urdf",
        "quadruped/minitaur.urdf",
        "biped/biped2d_pybullet.urdf",
        "kuka_iiwa/model.urdf",
    ),
    "mjlab": ("i2rt_yam/xmls/yam.xml",),
    "gymnasium": (
        "ant.xml",
        "walker2d_v5.xml",
        "half_cheetah.xml",
        "hopper.xml",
        "pusher_v5.xml",
        "inverted_pendulum.xml",
    ),
    "dm-control": ("cheetah.xml", "manipulator.xml", "fish.xml"),
}
"""Files by package that are no robots with legs to walk on."""


def heavy(seed: int) -> str:
    """A quadruped as a URDF: 6 to 20 kg, thigh and shank of 18 to 26 cm."""
    rng = np.random.default_rng(seed)
    share, mass, long, ahead, up = rng.uniform(
        [0.2, 6.0, 0.18, -0.18, -0.03], [0.85, 20.0, 0.26, 0.1, 0.3]
    )
    whole = 0.25 * share * mass
    turns = f'velocity="14" effort="{22.0 * mass * long:.4g}"/></joint>'
    text = _link("trunk", (1.0 - share) * mass, (ahead, 0.0, up), (0.54, 0.2, 0.1))
    for leg, x, side in (("fl", 0.22, 1), ("fr", 0.22, -1), ("hl", -0.22, 1), ("hr", -0.22, -1)):
        parent = "trunk"
        for part, place, axis, limits, weighs in (
            ("hip", (x, 0.1 * side, 0.0), "1 0 0", (-0.8, 0.8), 0.15),
            ("thigh", (0.0, 0.06 * side, 0.0), "0 1 0", (-1.2, 2.4), 0.25),
            ("shank", (0.0, 0.0, -long), "0 1 0", (-2.6, -0.3), 0.45),
            ("foot", (0.0, 0.0, -long), "", (), 0.15),
        ):
            name, bone = f"{leg}_{part}", part in ("thigh", "shank")
            size = (0.03, 0.03, 0.7 * long) if bone else (0.04, 0.04, 0.04)
            text += _link(
                name, weighs * whole, (0.0, 0.0, -0.5 * long * bone), size, ball=part == "foot"
            )
            text += (
                f'<joint name="{name}_joint" type="{"revolute" if axis else "fixed"}">'
                f'<parent link="{parent}"/><child link="{name}"/>'
                f'<origin xyz="{" ".join(map(str, place))}"/>'
            )
            text += (
                f'<axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" {turns}'
                if axis
                else "</joint>"
            )
            parent = name
    return f'<?xml version="1.0"?><robot name="heavy{seed}">{text}</robot>'


def _link(
    name: str,
    mass: float,
    at: tuple[float, ...],
    size: tuple[float, ...],
    *,
    ball: bool = False,
) -> str:
    """A box, of even density about its own centre, wherever that is; or a ball of 2 cm."""
    ixx, iyy, izz = (mass / 12.0 * (np.dot(size, size) - side**2) for side in size)
    shape = '<sphere radius="0.02"/>' if ball else f'<box size="{" ".join(map(str, size))}"/>'
    middle = at if name != "trunk" else (0.0, 0.0, 0.0)
    origin = '<origin xyz="{:.5g} {:.5g} {:.5g}"/>'
    return (
        f'<link name="{name}"><inertial>{origin.format(*at)}<mass value="{mass:.5g}"/><inertia '
        f'ixx="{ixx:.5g}" ixy="0" ixz="0" iyy="{iyy:.5g}" iyz="0" izz="{izz:.5g}"/></inertial>'
        f"<collision>{origin.format(*middle)}<geometry>{shape}</geometry></collision></link>"
    )


def robots(folder: Path, quadrupeds: int) -> Iterator[tuple[str, str, bool]]:
    """What is asked for, its name, and whether it is a negative: so many that are drawn, or those
    of packages that are installed.
    """
    for seed in range(quadrupeds):
        path = folder / f"heavy{seed}.urdf"
        path.write_text(heavy(seed), encoding="utf-8")
        yield str(path), path.stem, False
    if quadrupeds:
        return
    for name in (*BUILT_IN, *catalogue()):
        yield name, name, False
    for name, provider, _ in as_they_come():
        if provider_folder(provider) is not None:
            yield name, name, False
    for provider, paths in NEGATIVES.items():
        folder = provider_folder(provider)
        for path in paths if folder is not None else ():
            yield str(folder / path), f"{provider}: {path.rpartition('/')[2]}", True


def ground(name: str, folder: Path) -> Path:
    """The mesh of a ground."""
    corners, faces = list[str](), list[str]()
    for piece in PROFILES[name]:
        for (x0, z0), (x1, z1) in pairwise(piece):
            first = len(corners) + 1
            ends = ((x0, -1, z0), (x1, -1, z1), (x1, 1, z1), (x0, 1, z0))
            corners += [f"v {x} {HALF_M * side} {z}" for x, side, z in ends]
            faces.append(f"f {first} {first + 1} {first + 2} {first + 3}")
    path = folder / f"{name}.obj"
    path.write_text("\n".join([*corners, *faces, ""]))
    return path


def grounds(folder: Path, drawn: int) -> dict[str, str | Path]:
    """Grounds by name: the four, or so many that are drawn of families of polygons."""
    if not drawn:
        return {name: ground(name, folder) for name in PROFILES}
    rng = np.random.default_rng(0)
    levels = rng.uniform(*LEVELS, size=drawn)
    names = [f"{SCENES[k % len(SCENES)]}:{level:.2f}:{k}" for k, level in enumerate(levels)]
    return {name: name for name in names}


def crossed(robot: str, terrain: str | Path, limit_s: float, goal: tuple[float, float]) -> Row:
    """What is answered, and what comes of it in MuJoCo."""
    begun, row = time.process_time(), {"status": "refused", "run": ""}
    try:
        answer = stancekit.plan(
            terrain,
            robot=robot,
            start=START,
            goal=goal,
            time_limit_s=limit_s,
        )
        row |= {"status": answer.status.value, "says": answer.message}
        if answer.status.value == "feasible":
            report = stancekit.simulate(answer.solution)
            row["run"] = "as planned" if report.succeeded else report.message
    except Exception as error:  # a death is a row, too
        where = "run" if row["status"] != "refused" else "says"
        died = (
            "" if isinstance(error, stancekit.InvalidInput) else f"died of {type(error).__name__}: "
        )
        row[where] = f"{died}{error}"
    return row | {"cpu_s": time.process_time() - begun}


def rows(
    folder: Path, wanted: list[str], limit_s: float, drawn: int, quadrupeds: int
) -> Iterator[Row]:
    """A row a robot and ground, asked or kept; over grounds that are drawn robots alone."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = Lines(folder / "crossings.jsonl")
    for name, terrain in grounds(folder, drawn).items():
        for robot, called, negative in robots(folder, quadrupeds):
            left_out = wanted and not any(part in called for part in wanted)
            if left_out or (negative and drawn):
                continue
            if (key := f"{called} {name}") not in kept.rows:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    row = crossed(robot, terrain, limit_s, NEAR if quadrupeds else GOAL)
                    kept.add(key, {"negative": negative, **row})
            yield kept.rows[key]


def line(row: Row) -> str:
    """A row for people."""
    ran = f"; run: {row['run']:.80}" if row["run"] else ""
    return (
        f"{row['key']:48} {row['status']:10} {row['cpu_s']:6.1f} s {row.get('says', ''):.150}{ran}"
    )


def counts(found: list[Row]) -> Row:
    """How many crossed each ground and were executed as planned; negatives that were accepted."""
    told: Row = {
        name: tally(
            "executed" if row["run"] == "as planned" else row["status"]
            for row in found
            if row["key"].endswith(f" {name}") and not row["negative"]
        )
        for name in dict.fromkeys(row["key"].split()[-1] for row in found)
    }
    accepted = [row["key"] for row in found if row["negative"] and row["status"] == "feasible"]
    return told | {"negatives": sum(row["negative"] for row in found), "accepted of them": accepted}
