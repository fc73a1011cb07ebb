"""Walks of robots from files, planned, verified and then run in simulation: do they stand, how
well, how do feet hold?

    python benchmarks/walks.py --robots FOLDER [--only go1 solo12] [--terrains ripple rough:0.5:7]
    [--count 20]
        [--first 0] [--planned-friction .75] [--world bullet] [--offset-deg .5 --delay-ms 15 --mass
        1.15] [--stiffness .7 --friction .8] [--no-fits] [--keep FOLDER] [--folder FOLDER] [--json]

FOLDER: example-robot-data's ``robots``; robots that are not there are left out, and said. A walk of
ten seconds over 3.6 times the robot's height, at μ = .6 or --planned-friction, is planned once and
kept in --keep; with --count others follow, each with a heading and a length of its own, up to that,
drawn from --seed; --first: the number of the first, 1 for drawn ones alone. It is run as it is,
whatever the joints' limits; why the runner would have refused it else is said at the end of its
row, unless --no-fits. Rows that are in --folder are not measured again. Terrains: any name or file
that ``stancekit gait`` takes, so also a map of one's own; ``_grounds.py`` writes some. On the cone,
whose slope is .6, μ = .6 leaves feedback nothing, and ANYmal B falls: Pan et al. have .75 there.

body: distance of the body's origin from where it should be, root mean square, worst, and at the end
[mm]. slip: of the worst stance since its foot touched, and stances with more than 10 mm. late: how
long after it should have the last foot touched [ms]. torque: the largest of any joint in units of
its own limit. The options make the robot, or its terrain, other than planned.
"""

from __future__ import annotations

import json
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, kept, launch
from _wrong import Wrong

import stancekit
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.walker import walker_of
from stancekit.runner.acceptance import Accepted
from stancekit.runner.report import Execution
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings, Tolerance
from stancekit.runner.worlds.world import make_world

HEADING_RAD, HEIGHTS, FRICTION, SLIP_M = 0.64, 3.6, 0.6, 0.01
SHORTEST = 0.6
"""Of that way, where others are drawn."""
TERRAINS = ("ripple", "rough:0.3:7", "rough:0.5:7", "rough:0.8:3")


@dataclass(frozen=True)
class Example:
    """A robot of example-robot-data: its files, hip and knee as it stands (turned round behind
    where ``mirrored``), and what its file says wrongly of its joints.
    """

    urdf: str
    srdf: str
    hip_rad: float
    knee_rad: float
    mirrored: bool
    joint: dict[str, float] | None = None


B, C = (f"anymal_{kind}_simple_description" for kind in "bc")
ROBOTS = {
    "anymal_b": Example(f"{B}/robots/anymal.urdf", f"{B}/srdf/anymal.srdf", 0.75, -1.3, True),
    "anymal_c": Example(f"{C}/urdf/anymal.urdf", f"{C}/srdf/anymal.srdf", 0.75, -1.3, True),
    "go1": Example(
        "go1_description/urdf/go1.urdf", "go1_description/srdf/go1.srdf", 0.8, -1.6, False
    ),
    "a1": Example("a1_description/urdf/a1.urdf", "a1_description/srdf/a1.srdf", 0.8, -1.6, False),
    "solo12": Example(
        "solo_description/robots/solo12.urdf",
        "solo_description/srdf/solo.srdf",
        0.8,
        -1.5,
        True,
        {"torque_nm": 2.7, "velocity_rad_s": 40.0},
    ),
}


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which robots, over what, in which world, and what is wrong with them."""

    robots: Path
    only: tuple[str, ...] = tuple(ROBOTS)
    terrains: tuple[str, ...] = TERRAINS
    count: int = 1
    first: int = 0
    planned_friction: float = FRICTION
    fits: bool = True
    world: str = "mujoco"
    keep: Path = Path(tempfile.gettempdir()) / "stancekit-walks"
    folder: Path | None = None
    offset_deg: float = 0.0
    delay_ms: float = 0.0
    mass: float = 1.0
    stiffness: float = 1.0
    friction: float = 1.0


def main(arguments: Arguments) -> None:
    """Plan, run and print."""
    wrong = Wrong.of(arguments)
    arguments.keep.mkdir(parents=True, exist_ok=True)
    for name in arguments.only:
        if not (arguments.robots / ROBOTS[name].urdf).exists():
            print(f"{name}: no file {ROBOTS[name].urdf}, left out")
            continue
        rows = [
            measured(name, terrain, index, arguments, wrong)
            for terrain in arguments.terrains
            for index in range(arguments.first, arguments.first + arguments.count)
        ]
        ran = [row for row in rows if "rms_mm" in row]
        if not arguments.json and ran:
            stood = sum(row["outcome"] == "stood" for row in ran)
            rms, slip = ([row[key] for row in ran] for key in ("rms_mm", "slip_mm"))
            print(
                f"{name:<9} {arguments.world}: {stood} of {len(ran)} stood, {len(ran)} of {len(rows)} planned, body "
                f"{np.median(rms):.1f} ≤ {max(rms):.1f} mm, slip {np.median(slip):.1f} ≤ {max(slip):.1f} mm",
                flush=True,
            )


def measured(
    name: str, terrain: str, index: int, arguments: Arguments, wrong: Wrong
) -> dict[str, Any]:
    """One walk's row, printed; measured where it is not kept."""
    rng = np.random.default_rng([arguments.seed, index])
    heading, share = (
        (HEADING_RAD, 1.0)
        if index == 0
        else (rng.uniform(-np.pi, np.pi), rng.uniform(SHORTEST, 1.0))
    )

    def measure() -> dict[str, Any]:
        path = planned(
            name,
            arguments.robots,
            terrain,
            arguments.keep,
            (float(heading), float(share)),
            arguments.planned_friction,
        )
        found = row(path, arguments.world, wrong, fits=arguments.fits)
        return {"robot": name, "terrain": terrain, "walk": index} | found

    said = (
        arguments.offset_deg,
        arguments.delay_ms,
        arguments.mass,
        arguments.stiffness,
        arguments.friction,
    )
    said += (f"mu-{arguments.planned_friction:g}",) * (arguments.planned_friction != FRICTION)
    stem = "-".join(
        [name, terrain, str(arguments.seed), str(index), arguments.world, *map(str, said)]
    )
    file = None if arguments.folder is None else arguments.folder / f"{as_file_name(stem)}.json"
    found = measure() if file is None else kept(file, measure)
    arguments.say(found, line)
    return found


def as_file_name(text: str) -> str:
    """The text, a file's name: of another terrain, as rough:0.3:7 and rough:0.8:3, another."""
    return re.sub(r"[^\w.-]+", "-", text)


def robot_file(example: Example, folder: Path, path: Path) -> Path:
    """A file, written to this path, of the robot in the posture that it walks from."""
    urdf, srdf = folder / example.urdf, folder / example.srdf
    behind = {
        leg.name: -1.0 if example.mirrored and leg.hip_m[0] < 0.0 else 1.0
        for leg in named_robot(urdf).legs
    }
    posture = {
        joint: angle
        for leg in named_robot(urdf).legs
        for joint, angle in zip(
            leg.joint_names,
            (0.0, behind[leg.name] * example.hip_rad, behind[leg.name] * example.knee_rad),
            strict=True,
        )
    }
    keys = {"urdf": str(urdf.resolve()), "posture_rad": posture}
    keys |= {"srdf": str(srdf.resolve())} if srdf.exists() else {}
    keys |= {} if example.joint is None else {"joints": dict.fromkeys(posture, example.joint)}
    path.write_text(json.dumps(keys), encoding="utf-8")  # which is YAML, too
    return path


def planned(
    name: str,
    folder: Path,
    terrain: str,
    keep: Path,
    way: tuple[float, float] = (HEADING_RAD, 1.0),
    friction: float = FRICTION,
) -> Path | str:
    """The file of a walk, planned where it is not there; or why there is none. way: its heading
    [rad], and its length as a share of the longest. friction: μ.
    """
    end = "" if way == (HEADING_RAD, 1.0) else f"-{way[0]:.3f}-{way[1]:.3f}"
    end += "" if friction == FRICTION else f"-mu-{friction:g}"
    path = keep / f"{as_file_name(f'{name}-{terrain}')}{end}.json"
    if path.exists():
        return path
    robot = walker_of(named_robot(robot_file(ROBOTS[name], folder, keep / f"{name}.yaml")))
    far = way[1] * HEIGHTS * robot.stand_height_m
    goal = far * np.cos(way[0]), far * np.sin(way[0])
    try:
        found = stancekit.walk(terrain, goal, robot=robot, friction=friction, time_limit_s=120.0)
    except InvalidInput as error:  # ground that it cannot stand on, for one
        return str(error)
    if found.solution is None:
        return str(found.message)
    write_motion(path, found.solution, stancekit.verify(found.solution))
    return path


def row(path: Path | str, world: str, wrong: Wrong, *, fits: bool = True) -> dict[str, object]:
    """One walk, run. fits: say why the runner would have refused it."""
    if isinstance(path, str):
        return {"outcome": f"not planned: {path}"}
    accepted = Accepted.from_file(path)
    settings = RunSettings(
        check_limits=False, tolerance=Tolerance(body_m=0.3, body_rad=0.8, slip_m=SLIP_M)
    )
    with make_world(world, accepted.robot, imperfections=wrong.imperfections) as made:
        refused = ""
        try:
            if fits:
                Runner(made).prepare(accepted)
        except InvalidInput as error:
            refused = str(error)
        report = Runner(made, settings=settings).run(accepted, wrong.ground(accepted))
    run = report.execution
    if run is None:
        return {"outcome": report.message}
    return {
        "outcome": "stood" if run.fallen_s is None else f"fell at {run.fallen_s:.1f} s"
    } | figures(run, refused)


def figures(run: Execution, fits: str) -> dict[str, object]:
    """Of a run."""
    return {
        "rms_mm": 1e3 * run.body_rms_m,
        "worst_mm": 1e3 * run.body_worst_m,
        "end_mm": 1e3 * run.body_final_m,
        "slip_mm": 1e3 * float(run.slip_m.max()),
        "slipped": int(np.count_nonzero(run.slip_m > SLIP_M)),
        "stances": len(run.slip_m),
        "late_ms": 1e3 * float(run.late_s.max()),
        "torque": float(run.torque_share.max()),
        "bump_s": run.bump_s,
        "fits": fits,
    }


def line(found: dict[str, Any]) -> str:
    """For people."""
    start = f"{found['robot']:<9} {found['terrain']:<12} {found['walk']:2} {found['outcome']:<14}"
    if "rms_mm" not in found:
        return start
    return (
        f"{start} body {found['rms_mm']:5.1f} {found['worst_mm']:5.1f} {found['end_mm']:5.1f} mm  slip "
        f"{found['slip_mm']:5.1f} mm, {found['slipped']} of {found['stances']}  late {found['late_ms']:3.0f} ms  "
        f"torque {found['torque']:.2f}  bumped {found['bump_s']:.2f} s  {found['fits']}"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
