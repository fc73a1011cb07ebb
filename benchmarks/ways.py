"""The way round: thirty terrains of 4 to 20 m, planned, judged by points of every link, and
compared.

    nice -n 15 python benchmarks/ways.py plan FOLDER [--scenes block-4 ...] [--limit-s 60]
        [--walks] [--anew]
    python benchmarks/ways.py judge FOLDER
    python benchmarks/ways.py run FOLDER --scenes block-20 ...
    python benchmarks/ways.py table FOLDER [--against FOLDER]

The terrains are in ways/scenes.yaml: 24 have a way for a disc as wide as the hexapod and its feet,
which is known since it was drawn first, and 6 have none. They were drawn before anything was
planned over them.

plan: every scene by the package's own command, ``plan`` or with --walks ``gait``, one process at a
time; a line of plans.jsonl with what was said, CPU time, memory, and the length of the body's way.
Scenes that have a line are not planned again without --anew.

judge: points of every link of the file's URDF, at moments of the motion half as far apart as the
verifier's, against the boxes of the scene: angles are those of the motion that is run, kinematics
and geometry are written here. A link that is more than 3 mm inside of a solid goes through it.

run: plans in the package's MuJoCo.

table: by length: scenes planned, CPU-s per metre of the body's way, memory, and the ways against
the known ones.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import numpy as np
import tyro
import yaml
from _bench import ROOT, Options, launch
from numpy.typing import NDArray

SCENES = ROOT / "benchmarks" / "ways" / "scenes.yaml"
THICK_M = 0.2
THROUGH_M = 0.003
"""A point this deep in a solid is through its surface: feet touch, and terrain is known to a
millimetre."""
PATIENCE = 6.0
APART_M = 0.015
"""Between the points of a link [m]."""
FINER = 2.0
"""Moments of the motion are so many times nearer to each other than those that the verifier
judges."""
LONGER = 1.3
WALK_S_M = 4.0
"""Walks have so long for a metre of the known way."""
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One terrain. boxes_m: its solids, each x, y and z from and to, the floor's parts first, shape
    (B, 6); floors: how many of them are floor; way_m: of a disc, shape (K, 2), None where there is
    none.
    """

    name: str
    kind: str
    boxes_m: Array
    floors: int
    start: tuple[float, float]
    goal: tuple[float, float]
    way_m: Array | None

    @classmethod
    def of(cls, keys: Mapping[str, Any]) -> Scene:
        """The scene of an entry of the list."""
        floor = [[*part, -THICK_M, 0.0] for part in _around(keys["floor"], keys.get("holes", []))]
        return cls(
            name=keys["name"],
            kind=keys["kind"],
            boxes_m=np.array([*floor, *keys.get("solids", [])], dtype=float),
            floors=len(floor),
            start=tuple(keys["start"]),
            goal=tuple(keys["goal"]),
            way_m=np.array(keys["way"], dtype=float) if "way" in keys else None,
        )

    @property
    def known_m(self) -> float:
        """Length of the known way [m]."""
        return np.nan if self.way_m is None else length_of(self.way_m)

    @property
    def apart_m(self) -> float:
        """Between start and goal along x, after which scenes are grouped [m]."""
        return float(self.goal[0] - self.start[0])

    def write(self, path: Path) -> None:
        """The terrain as a mesh of closed boxes; parts of a floor share their borders."""
        path.parent.mkdir(parents=True, exist_ok=True)
        lines, first = list[str](), 1
        for x0, x1, y0, y1, z0, z1 in self.boxes_m.tolist():
            corners = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
            lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
            faces = (
                (0, 1, 3, 2),
                (4, 6, 7, 5),
                (0, 4, 5, 1),
                (2, 3, 7, 6),
                (0, 2, 6, 4),
                (1, 5, 7, 3),
            )
            for a, b, c, d in faces:
                lines += [
                    f"f {first + a} {first + b} {first + c}",
                    f"f {first + a} {first + c} {first + d}",
                ]
            first += 8
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def scenes(names: Sequence[str] = ()) -> list[Scene]:
    """The list, or some of it in its order."""
    every = [
        Scene.of(keys) for keys in yaml.safe_load(SCENES.read_text(encoding="utf-8"))["scenes"]
    ]
    unknown = set(names) - {each.name for each in every}
    if unknown:
        raise SystemExit(
            f"--scenes: expected some of {', '.join(each.name for each in every)}, got {unknown}"
        )
    return [each for each in every if not names or each.name in names]


def length_of(points: Array) -> float:
    """Of a line through points, in the plane [m]."""
    return float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum())


def _around(floor: Sequence[float], holes: Sequence[Sequence[float]]) -> list[list[float]]:
    """A rectangle as rectangles that leave holes out: strips along x between the holes' borders."""
    cuts = sorted({floor[0], floor[1], *(x for hole in holes for x in hole[:2])})
    parts = []
    for left, right in pairwise(cuts):
        over = sorted(hole[2:] for hole in holes if hole[0] < right and left < hole[1])
        low = floor[2]
        for bottom, top in over:
            if bottom > low:
                parts.append([left, right, low, bottom])
            low = max(low, top)
        if low < floor[3]:
            parts.append([left, right, low, floor[3]])
    return parts


# ------------------------------------------------------------------------------------------------------
# planning


def command(
    arguments: Sequence[str], patience_s: float, environment: Mapping[str, str]
) -> dict[str, Any]:
    """Run ``stancekit`` with ``--json``: exit code, the object printed, the last line of errors,
    time and memory.
    """
    began = time.monotonic()
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "stancekit.cli.main", *arguments, "--json"],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=errors,
            start_new_session=True,
            env={**os.environ, **environment},
        )
        while True:
            pid, status, used = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() - began > patience_s:
                os.killpg(process.pid, signal.SIGKILL)
            time.sleep(0.05)
        code = os.waitstatus_to_exitcode(status)
        process.returncode = code
        out.seek(0)
        errors.seek(0)
        lines, said = out.read().strip().splitlines(), errors.read().strip().splitlines()
    return {
        "code": code,
        "said": json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {},
        "error": (said or [""])[-1][:300],
        "cpu_s": round(used.ru_utime + used.ru_stime, 2),
        "wall_s": round(time.monotonic() - began, 1),
        "memory_mb": round(used.ru_maxrss / 1024),
    }


def planned(
    scene: Scene, folder: Path, limit_s: float, *, walk: bool, package: Path | None
) -> dict[str, Any]:
    """Plan one scene; the file stays in the folder."""
    mesh, out = folder / "terrains" / f"{scene.name}.obj", folder / "plans" / f"{scene.name}.json"
    scene.write(mesh)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.unlink(missing_ok=True)
    places = [
        f"--start={scene.start[0]:g},{scene.start[1]:g}",
        f"--goal={scene.goal[0]:g},{scene.goal[1]:g}",
    ]
    seconds = f"{round(WALK_S_M * (20.0 if scene.way_m is None else scene.known_m)):d}"
    urdf = str(ROOT / "configs" / "robots" / "hexapod.urdf")
    verb = [
        "gait",
        str(mesh),
        *places,
        "--robot",
        urdf,
        "--smooth-m",
        "0.12",
        "--duration-s",
        seconds,
    ]
    verb += ["--total-s", str(limit_s)]
    if not walk:
        verb = ["plan", str(mesh), *places, "--time-limit-s", str(limit_s)]
    environment = {} if package is None else {"PYTHONPATH": str(package / ".editable")}
    done = command([*verb, "--out", str(out)], PATIENCE * limit_s, environment)
    said = done.pop("said")
    verdict = said.get("verdict") or {}
    accepted = done["code"] == 0 and out.exists()
    message = verdict.get("message") or said.get("message") or done["error"]
    row = {
        "scene": scene.name,
        "accepted": accepted,
        "status": said.get("status", ""),
        "message": str(message)[:300],
        "known_m": round(scene.known_m, 2),
        **done,
    }
    if accepted:
        path = np.asarray(_read(out).torso_m if walk else _read(out).com_m)
        row |= {"frames": len(path), "way_m": round(length_of(path), 3)}
    return row


def _read(path: Path) -> Any:
    import stancekit

    return stancekit.load(path)


class Lines:
    """Lines of a file of results, the last one of a scene counting."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def all(self) -> dict[str, dict[str, Any]]:
        """By scene."""
        if not self.path.exists():
            return {}
        rows = [
            json.loads(line)
            for line in self.path.read_text(encoding="utf-8").splitlines()
            if line.endswith("}")
        ]
        return {row["scene"]: row for row in rows}

    def add(self, row: Mapping[str, Any]) -> None:
        """One more."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


# -------------------------------------------------------------------------------------------------------
# judging


@dataclass(frozen=True, kw_only=True)
class Link:
    """Points of a link in its own frame, shape (P, 3), each the middle of a ball of this radius
    [m].
    """

    name: str
    points_m: Array
    radius_m: float

    @property
    def middle_m(self) -> Array:
        """Of its points, shape (3,) [m]."""
        return np.asarray(0.5 * (self.points_m.min(axis=0) + self.points_m.max(axis=0)))

    @property
    def reach_m(self) -> float:
        """How far it goes from its middle [m]."""
        return float(np.linalg.norm(self.points_m - self.middle_m, axis=1).max()) + self.radius_m


class Robot:
    """A URDF: its joints from parent to child, and points of what its links collide with."""

    def __init__(self, urdf: str) -> None:
        root = ElementTree.fromstring(urdf)
        self.joints = []
        for joint in root.findall("joint"):
            origin = _placed(joint.find("origin"))
            axis = np.array((_get(joint.find("axis"), "xyz") or "1 0 0").split(), dtype=float)
            names = [_get(joint.find(end), "link") for end in ("parent", "child")]
            self.joints.append((joint.get("name"), joint.get("type"), *names, origin, axis))
        children = {child for _, _, _, child, _, _ in self.joints}
        self.base = next(
            link.get("name") for link in root.findall("link") if link.get("name") not in children
        )
        self.links = [each for link in root.findall("link") for each in _points(link)]
        self.middles_m = [link.middle_m for link in self.links]
        self.reaches_m = np.array([link.reach_m for link in self.links])

    def placed(self, base: Array, angles: Mapping[str, float]) -> dict[str, Array]:
        """Frames of all links in the world, shape (4, 4) each; base: that of the first."""
        frames, left = {self.base: base}, list(self.joints)
        while left:
            name, kind, parent, child, origin, axis = left.pop(0)
            if parent not in frames:
                left.append((name, kind, parent, child, origin, axis))
                continue
            turn = np.eye(4)
            if kind in ("revolute", "continuous"):
                turn[:3, :3] = _turned(axis / np.linalg.norm(axis) * angles.get(name, 0.0))
            frames[child] = frames[parent] @ origin @ turn
        return frames


def _get(element: Any, name: str) -> Any:
    return None if element is None else element.get(name)


def _placed(origin: Any) -> Array:
    frame = np.eye(4)
    if origin is not None:
        frame[:3, 3] = np.array((origin.get("xyz") or "0 0 0").split(), dtype=float)
        roll, pitch, yaw = np.array((origin.get("rpy") or "0 0 0").split(), dtype=float)
        turns = [_turned(np.array(v)) for v in ((0, 0, yaw), (0, pitch, 0), (roll, 0, 0))]
        frame[:3, :3] = turns[0] @ turns[1] @ turns[2]
    return frame


def _turned(vector: Array) -> Array:
    """The rotation about a vector by its length (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def _points(link: Any) -> Iterator[Link]:
    for collision in link.findall("collision"):
        frame, shape = _placed(collision.find("origin")), collision.find("geometry")[0]
        radius = float(shape.get("radius", 0.0))
        if shape.tag == "box":
            half = 0.5 * np.array(shape.get("size").split(), dtype=float)
            axes = [np.linspace(-h, h, max(2, int(np.ceil(2 * h / APART_M)) + 1)) for h in half]
            points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        elif shape.tag == "cylinder":
            half_m, radius_m, radius = 0.5 * float(shape.get("length")), radius, 0.0
            along = np.linspace(-half_m, half_m, max(2, int(np.ceil(2 * half_m / APART_M)) + 1))
            turn = np.linspace(
                0.0, 2 * np.pi, max(8, int(np.ceil(2 * np.pi * radius_m / APART_M))), endpoint=False
            )
            around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
            out = np.linspace(0.0, radius_m, max(2, int(np.ceil(radius_m / APART_M)) + 1))
            mantle = [np.column_stack([radius_m * around, np.full(len(turn), z)]) for z in along]
            ends = [
                np.column_stack([r * around, np.full(len(turn), z)])
                for r in out
                for z in (-half_m, half_m)
            ]
            points = np.vstack(mantle + ends)
        elif shape.tag == "capsule":
            half_m = 0.5 * float(shape.get("length"))
            along = np.linspace(-half_m, half_m, max(2, int(np.ceil(2 * half_m / APART_M)) + 1))
            points = np.column_stack([0 * along, 0 * along, along])
        else:
            points = np.zeros((1, 3))
        yield Link(
            name=link.get("name"), points_m=points @ frame[:3, :3].T + frame[:3, 3], radius_m=radius
        )


def depth_in(points: Array, boxes: Array) -> Array:
    """How deep each point is inside of the box it is deepest in, shape (P,); negative: how far from
    all of them [m].
    """
    low, high = boxes[:, None, ::2], boxes[:, None, 1::2]
    inside = np.minimum(points - low, high - points)  # (B, P, 3)
    outside = np.linalg.norm(np.maximum(-inside, 0.0), axis=2)
    return np.asarray(np.where(outside > 0.0, -outside, inside.min(axis=2)).max(axis=0))


def judged(scene: Scene, path: Path) -> dict[str, Any]:
    """The deepest that any link is in a solid, along the motion of a plan [m]."""
    from stancekit.planners.motion.joints import JointPath
    from stancekit.planners.motion.path import APART_M as STEP_M, PlanPath
    from stancekit.planners.robot.kinematics import Kinematics

    plan = _read(path)
    robot, boxes = Robot(plan.problem.robot.legs.urdf), scene.boxes_m
    known = Kinematics(plan.problem.robot)
    moments, postures = JointPath(PlanPath(plan), known, STEP_M / FINER).judged()
    worst: tuple[float, str, float] = (-np.inf, "", 0.0)
    for number, angles in enumerate(postures.angles):
        base = np.eye(4)
        base[:3, :3], base[:3, 3] = postures.rotation[number], postures.origin_m[number]
        frames = robot.placed(base, dict(zip(known.joints, angles, strict=True)))
        about = boxes[
            np.all(
                (boxes[:, ::2] < base[:3, 3] + 1.5) & (boxes[:, 1::2] > base[:3, 3] - 1.5), axis=1
            )
        ]
        placed = [frames[link.name] for link in robot.links]
        middles = np.array(
            [
                frame[:3, :3] @ middle + frame[:3, 3]
                for frame, middle in zip(placed, robot.middles_m, strict=True)
            ]
        )
        most = depth_in(middles, about) + robot.reaches_m
        for k in np.flatnonzero(most > worst[0]):  # depths change no faster than places
            link, frame = robot.links[k], placed[k]
            depth = (
                float(depth_in(link.points_m @ frame[:3, :3].T + frame[:3, 3], about).max())
                + link.radius_m
            )
            if depth > worst[0]:
                before, after = moments.before[number], moments.after[number]
                worst = depth, link.name, float(before + moments.share[number] * (after - before))
    return {
        "scene": scene.name,
        "depth_mm": round(1e3 * worst[0], 2),
        "link": worst[1],
        "frame": round(worst[2], 2),
        "moments": len(postures.angles),
        "through": bool(worst[0] > THROUGH_M),
    }


# -------------------------------------------------------------------------------------------------------
# options


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """What is done with which scenes."""

    what: Annotated[str, tyro.conf.Positional]
    """plan, judge, run or table."""
    folder: Annotated[Path, tyro.conf.Positional]
    """Plans and lines."""
    scenes: tuple[str, ...] = ()
    """Names; all of the list where none is given."""
    limit_s: float = 60.0
    """Of every command [s]."""
    walks: bool = False
    """Walks by ``gait`` in place of plans."""
    anew: bool = False
    """Plan scenes again that have a line."""
    package: Path | None = None
    """Another checkout, whose commands plan."""
    against: Path | None = None
    """The folder to compare with."""


def main(asked: Asked) -> None:
    """Do it."""
    some = scenes(asked.scenes)
    lines = Lines(asked.folder / "plans.jsonl")
    if asked.what == "plan":
        for scene in some:
            if asked.anew or scene.name not in lines.all():
                row = planned(
                    scene, asked.folder, asked.limit_s, walk=asked.walks, package=asked.package
                )
                lines.add(row)
                asked.say(row)
    elif asked.what in ("judge", "run"):
        results = Lines(asked.folder / f"{asked.what}.jsonl")
        for scene in some:
            path = asked.folder / "plans" / f"{scene.name}.json"
            if lines.all().get(scene.name, {}).get("accepted") and (
                asked.anew or scene.name not in results.all()
            ):
                row = judged(scene, path) if asked.what == "judge" else _ran(scene, path)
                results.add(row)
                asked.say(row)
    elif asked.what == "table":
        _table(asked, some)
    else:
        raise SystemExit(f"expected plan, judge, run or table, got {asked.what}")


def _ran(scene: Scene, path: Path) -> dict[str, Any]:
    done = command(["run", str(path), "--world", "mujoco"], 3600.0, {})
    said = done.pop("said")
    return {"scene": scene.name, "message": said.get("message", ""), **done}


def _table(asked: Asked, some: Sequence[Scene]) -> None:
    rows = Lines(asked.folder / "plans.jsonl").all()
    depths = Lines(asked.folder / "judge.jsonl").all()
    before = {} if asked.against is None else Lines(asked.against / "plans.jsonl").all()
    for scene in some:
        row, old = rows.get(scene.name), before.get(scene.name)
        if row is None:
            continue
        asked.say(row, lambda row, old=old: _line(row, old, depths.get(row["scene"])))
    done = [(scene, rows[scene.name]) for scene in some if scene.name in rows]
    for apart_m in (4.0, 10.0, 20.0):
        its = [row for scene, row in done if scene.way_m is not None and scene.apart_m == apart_m]
        good = [row for row in its if _good(row)]
        if good:
            metre = [row["cpu_s"] / row["way_m"] for row in good]
            asked.say(
                {
                    "start to goal": f"{apart_m:g} m",
                    "planned": f"{len(good)} of {len(its)}",
                    "CPU-s per metre": f"{np.median(metre):.2f} ({min(metre):.2f} to {max(metre):.2f})",
                    "memory": f"{max(row['memory_mb'] for row in good)} MB",
                }
            )
    without = [row for scene, row in done if scene.way_m is None]
    asked.say(
        {
            "planned": sum(_good(row) for scene, row in done if scene.way_m is not None),
            "without a way, and planned": sum(row["accepted"] for row in without),
            "through solids": sum(row["through"] for row in depths.values()),
            "judged": len(depths),
        }
    )


def _good(row: Mapping[str, Any]) -> bool:
    """Whether a scene with a way counts as planned: accepted, in 60 CPU-s, by a way 1.3 times the
    known one at most.
    """
    return row["accepted"] and row["cpu_s"] <= 60.0 and row["way_m"] <= LONGER * row["known_m"]


def _line(
    row: Mapping[str, Any], old: Mapping[str, Any] | None, depth: Mapping[str, Any] | None
) -> str:
    took = f"{row['cpu_s']:6.1f} CPU-s {row['memory_mb']:4} MB"
    was = (
        ""
        if old is None
        else f"  before: {'plan' if old['accepted'] else 'none'} {old['cpu_s']:.1f} CPU-s"
    )
    deep = "" if depth is None else f"  deepest {depth['depth_mm']:.1f} mm"
    said = (
        f"{row['way_m']:.2f} m of {row['known_m']:g} m" if row["accepted"] else row["message"][:90]
    )
    return f"{row['scene']:14} {'plan' if row['accepted'] else 'none'} {took}  {said}{deep}{was}"


if __name__ == "__main__":
    launch(main, Asked, __doc__)
