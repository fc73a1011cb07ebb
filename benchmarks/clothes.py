"""One question in all its clothes: the same robot, ground and places, written another way, have to
get the same answer.

    python benchmarks/clothes.py --quick
    python benchmarks/clothes.py --folder out/clothes
    python benchmarks/clothes.py --quick --against ../before
    python benchmarks/clothes.py --sample 200 --seed 1
    python benchmarks/clothes.py --slopes

A row a pair: a ground, a robot and a cloth beside the plain question, which is the ground's mesh as
an OBJ file and the robot's own file, asked of ``stancekit.plan``. Rows are kept in the folder, one
a line, and an interrupted run goes on there. At the end there is a table of what differs by cloth.
Equal is: the same status, and for cloths that lose nothing the same objective to six digits, or to
the width that the cloth says: the robot is moved and turned with its world, or as many times as
large. Where both refuse, the pair counts only if a refusal is right. A drawn robot is asked over
grounds of its size. --sample: so many drawn rows of the whole table. --slopes: CPU time of planes of
5 to 33 degrees, up, down and across, over that of flat
ground. --against: another checkout, in which `python setup.py links` was run; the same pairs
are asked there first.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from math import cos, pi, radians, sin, tan
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from _bench import ROOT, Lines, Options, Row, launch, spread, tally
from _checkouts import of_checkout

import stancekit
from stancekit.envs.traverse import TraverseEnv
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.projection.held import PRESSES
from stancekit.planners.robot.robot_file import as_they_come, provider_folder, robot_of
from stancekit.planners.search.answer import objective_of
from stancekit.planners.search.friction_margin import SHARES
from stancekit.planners.search.plan_course import replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.patch import Frame
from stancekit.views.playground.answers import patient_answer
from stancekit.views.playground.scenario import Scenario

HALF_M = 1.2
"""Half of a ground's width across the way [m]."""
PIECE_M, DIGITS = 0.05, 3
"""Side of the triangles that a mesh is cut into, and decimals of a metre of what is rounded."""
SPACING_M = 0.02
"""Of a grid [m]."""
FRICTION = 0.9
LIMIT_S = 120.0
"""Of a plan [s]: twice the usual, so that a loaded machine changes little."""
SHIPPED = ("hexapod", "configs/demo/ant.yaml", "a1", "aliengo", "laikago", "spirit40", "vision60")
TWINS = {"go2": "go2_mjcf", "g1": "g1_mjcf"}
"""Robots whose packages have them as URDF and as MJCF, in packages that need not be installed."""
TWIN_M = 0.01
"""Two files of a robot may have its feet, and its stand height, so far apart [m]."""
DRAWN, SIZE_M = 12, 0.6
"""Drawn robots, and the size from foot to foot that grounds are made for [m]."""
QUICK = {
    "grounds": "flat,slope20,slope30,ramp25,steps,stairs,wall,door",
    "robots": "hexapod,ant",
}
NONE = "no course"
"""The status of a door that takes courses alone, where none has a plan."""
FIGURES, VERDICT = "figures", "verdict"
"""What has to be the same: status and objective; status."""


# ------------------------------------------------------------------------------------------------------------
# grounds


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Triangles, shape (T, 3, 3) [m], two places, whether a robot that is large enough gets from
    one to the other, and the scale of all lengths.
    """

    name: str
    triangles: Array
    start: tuple[float, float] = (0.0, 0.0)
    goal: tuple[float, float] = (0.6, 0.0)
    passable: bool = True
    friction: float = FRICTION
    scale: float = 1.0

    def of_size(self, scale: float, *, passable: bool) -> Ground:
        """The ground by a scale, and whether a robot is one that plans are made for."""
        start, goal = ((scale * x, scale * y) for x, y in (self.start, self.goal))
        return replace(
            self,
            triangles=scale * self.triangles,
            start=start,
            goal=goal,
            scale=scale,
            passable=self.passable and passable,
        )


def quad(*corners: tuple[float, float, float]) -> Array:
    """Two triangles."""
    a, b, c, d = map(np.array, corners)
    return np.array([[a, b, c], [a, c, d]], dtype=float)


def extruded(*pieces: list[tuple[float, float]]) -> Array:
    """Profiles (x, z) that go on across the way."""
    return np.concatenate(
        [
            quad((a, -HALF_M, h), (b, -HALF_M, g), (b, HALF_M, g), (a, HALF_M, h))
            for piece in pieces
            for (a, h), (b, g) in pairwise(piece)
        ]
    )


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Array:
    """A closed box."""
    made = trimesh.creation.box(bounds=[[x0, y0, z0], [x1, y1, z1]])
    return np.asarray(made.triangles, dtype=float)


def grounds() -> Iterator[Ground]:
    """Grounds, the plainest first."""
    floor = [(-1.0, 0.0), (1.6, 0.0)]
    yield Ground(name="flat", triangles=extruded(floor))
    for degrees in (5, 10, 15, 20, 25, 30, 33):
        k = tan(radians(degrees))
        yield Ground(name=f"slope{degrees}", triangles=extruded([(-1.0, -k), (1.6, 1.6 * k)]))
    for degrees in (20, 30):
        k = tan(radians(degrees))
        up = extruded([(-1.2, -1.2 * k), (1.2, 1.2 * k)])
        yield Ground(name=f"down{degrees}", triangles=up, goal=(-0.6, 0.0))
        yield Ground(name=f"across{degrees}", triangles=up, goal=(0.0, 0.5))
    k = tan(radians(25))
    ramp = [(-1.0, 0.0), (0.4, 0.0), (0.8, 0.4 * k), (2.4, 0.4 * k)]
    yield Ground(name="ramp25", triangles=extruded(ramp), goal=(1.3, 0.0))
    ridge = [(-1.0, 0.0), (0.3, 0.0), (0.8, 0.15), (1.3, 0.0), (2.4, 0.0)]
    yield Ground(name="ridge", triangles=extruded(ridge), goal=(1.5, 0.0))
    steps = [(-1.0, 0.0), (0.3, 0.0), (0.3, 0.06), (1.0, 0.06), (1.0, 0.0), (2.2, 0.0)]
    yield Ground(name="steps", triangles=extruded(steps), goal=(0.8, 0.0))
    stairs = [(-1.0, 0.0), (0.25, 0.0)]
    for k in range(1, 5):
        stairs += [(0.3 * k - 0.05, 0.06 * k), (0.3 * k + 0.25, 0.06 * k)]
    stairs += [(2.6, 0.24)]
    yield Ground(name="stairs", triangles=extruded(stairs), goal=(0.9, 0.0))
    stones = [
        box(x, x + 0.26, y, y + 0.26, -0.3, 0.02 * ((i + 2 * j) % 3))
        for i, x in enumerate(np.arange(-1.0, 1.6, 0.3).tolist())
        for j, y in enumerate(np.arange(-1.2, 1.1, 0.3).tolist())
    ]
    yield Ground(name="stones", triangles=np.concatenate(stones))
    gap = extruded([(-1.0, 0.0), (0.4, 0.0)], [(0.46, 0.0), (1.8, 0.0)])
    yield Ground(name="gap", triangles=gap, goal=(0.8, 0.0))
    trench = [(-1.0, 0.0), (0.4, 0.0), (0.4, -0.3), (0.48, -0.3), (0.48, 0.0), (1.8, 0.0)]
    yield Ground(name="trench", triangles=extruded(trench), goal=(0.8, 0.0))
    lines = np.linspace(-1.2, 1.2, 13)
    cells = [
        quad(*((x, y, 0.15 * (x * x + y * y)) for x, y in ((a, c), (b, c), (b, d), (a, d))))
        for a, b in pairwise(lines.tolist())
        for c, d in pairwise(lines.tolist())
    ]
    yield Ground(name="bowl", triangles=np.concatenate(cells), goal=(0.5, 0.0))
    plain = extruded([(-1.0, 0.0), (2.6, 0.0)])
    barred = box(0.9, 1.0, -HALF_M, HALF_M, 0.0, 0.8)
    yield Ground(
        name="wall",
        triangles=np.concatenate([plain, barred]),
        goal=(1.8, 0.0),
        passable=False,
    )
    door = [box(0.9, 1.0, *sides, 0.0, 0.8) for sides in ((0.7, HALF_M), (-HALF_M, -0.7))]
    yield Ground(name="door", triangles=np.concatenate([plain, *door]), goal=(1.8, 0.0))
    beams = [
        box(-1.0, 1.6, y - 0.08, y + 0.08, -0.3, 0.0) for y in (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)
    ]
    yield Ground(name="beams", triangles=np.concatenate(beams))
    for degrees in (12, 25):
        k = tan(radians(degrees))
        yield Ground(
            name=f"ice{degrees}",
            triangles=extruded([(-1.0, -k), (1.6, 1.6 * k)]),
            passable=False,
            friction=0.6 * k,
        )


# ------------------------------------------------------------------------------------------------------------
# robots


def size_m(seed: int) -> float:
    """Size of a drawn robot, 0.1 to 2 m from foot to foot [m]."""
    return float(0.1 * 20.0 ** np.random.default_rng(seed).uniform())


def joints_of(seed: int) -> int:
    """Joints of each leg of a drawn robot; legs of two have no workspace with an inside, and are
    refused.
    """
    return 2 + seed % 5


def drawn(seed: int) -> str:
    """A robot as a URDF: 3 to 8 legs of 2 to 6 joints about a ring."""
    legs, joints, size = 3 + seed % 6, joints_of(seed), size_m(seed)
    mass = 12.0 * size**3 / 0.5**3
    text = _link("base", mass, f'<cylinder radius="{0.2 * size:.6g}" length="{0.1 * size:.6g}"/>')
    kinds = {2: "pp", 3: "ypp", 4: "yppp", 5: "yrppp", 6: "yrpppp"}[joints]
    pitches = kinds.count("p")
    bend = {2: (-0.5, 1.7), 3: (-0.5, 1.0, 0.7), 4: (-0.5, 0.6, 0.6, 0.5)}[pitches]
    for leg in range(legs):
        ahead = 2.0 * pi * (leg + 0.5) / legs
        parent, at, turn = "base", (0.22 * size * cos(ahead), 0.22 * size * sin(ahead)), ahead
        place = f"{at[0]:.6g} {at[1]:.6g} 0"
        for number, kind in enumerate(kinds):
            bends = kinds[:number].count("p")
            length = (0.35 if kind == "p" else 0.04) * size * (2.0 / pitches if kind == "p" else 1)
            name, axis = f"leg{leg}_{number}", {"y": "0 0 1", "r": "1 0 0", "p": "0 1 0"}[kind]
            rest = bend[bends] if kind == "p" else 0.0
            text += (
                f'<joint name="{name}" type="revolute"><parent link="{parent}"/>'
                f'<child link="{name}_link"/><origin xyz="{place}" rpy="0 {rest:g} {turn:.6g}"/>'
                f'<axis xyz="{axis}"/><limit lower="-0.9" upper="0.9" '
                f'effort="{90.0 * mass * size:.6g}" velocity="10"/></joint>'
            )
            shape = f'<box size="{0.8 * length:.6g} {0.03 * size:.6g} {0.03 * size:.6g}"/>'
            text += _link(f"{name}_link", 0.02 * mass, shape, 0.5 * length)
            parent, place, turn = f"{name}_link", f"{length:.6g} 0 0", 0.0
        text += (
            f'<joint name="foot{leg}" type="fixed"><parent link="{parent}"/>'
            f'<child link="foot{leg}_link"/><origin xyz="{place}"/></joint>'
        )
        text += _link(f"foot{leg}_link", 0.005 * mass, f'<sphere radius="{0.03 * size:.6g}"/>')
    return f'<?xml version="1.0"?><robot name="drawn{seed}">{text}</robot>'


def _link(name: str, mass: float, shape: str, along: float = 0.0) -> str:
    inertia = 0.4 * mass * max(along, 0.02) ** 2
    at = f'<origin xyz="{along:.6g} 0 0"/>'
    return (
        f'<link name="{name}"><inertial>{at}<mass value="{mass:.6g}"/><inertia ixx="{inertia:.6g}" '
        f'ixy="0" ixz="0" iyy="{inertia:.6g}" iyz="0" izz="{inertia:.6g}"/></inertial>'
        f"<collision>{at}<geometry>{shape}</geometry></collision></link>"
    )


def robots(folder: Path) -> dict[str, str | None]:
    """What ``stancekit.plan`` takes for a robot, by name."""
    found: dict[str, str | None] = {}
    for name in SHIPPED:
        path = ROOT / name
        found[path.stem] = None if name == "hexapod" else str(path) if path.suffix else name
    found |= {name: name for name in TWINS}
    for seed in range(DRAWN):
        path = folder / f"drawn{seed}.urdf"
        path.write_text(drawn(seed), encoding="utf-8")
        found[path.stem] = str(path)
    return found


# ------------------------------------------------------------------------------------------------------------
# clothes


@dataclass(frozen=True, kw_only=True)
class Cloth:
    """One way of writing a question down.

    Arguments:
        same: what has to be the same of its answer.
        width: share by which objectives may differ where a solver ends elsewhere within its tolerance.
        ask: the answer for a ground, a robot and a folder.
    """

    name: str
    same: str
    ask: Callable[[Ground, str | None, Path], Row]
    width: float = 1e-6


Change = Callable[[trimesh.Trimesh], trimesh.Trimesh]


def mesh_of(ground: Ground) -> trimesh.Trimesh:
    """The ground with welded corners."""
    corners, number = np.unique(
        ground.triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True
    )
    return trimesh.Trimesh(corners, number.reshape(-1, 3), process=False)


def plan(ground: Ground, path: Any, robot: stancekit.Robot | str | None) -> Row:
    """The answer of the library."""
    asked: dict[str, Any] = {
        "start": ground.start,
        "goal": ground.goal,
        "robot": robot,
        "time_limit_s": LIMIT_S,
    }
    return row_of(lambda: stancekit.plan(path, **asked))


def row_of(answered: Callable[[], Any]) -> Row:
    """What an answer of the library says, and its CPU time."""
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            answer = answered()
            row = {"status": answer.status.value, "message": answer.message}
            if answer.status.value == "feasible":
                row["objective"] = float(answer.objective)
        except stancekit.StancekitError as error:
            row = refused(error)
    return {**row, "cpu_s": round(time.process_time() - begin, 2)}


def refused(error: stancekit.StancekitError) -> Row:
    """The row of a question that is refused."""
    return {"status": "refused", "message": f"{type(error).__name__}: {error}", "cpu_s": 0.0}


def footholds_of(
    ground: Ground, path: Path, robot: stancekit.Robot | str | None, **options: Any
) -> Any:
    """What ``stancekit.terrain`` returns of a file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return stancekit.terrain(path, friction=ground.friction, robot=robot, **options)


def as_file(
    suffix: str,
    ground: Ground,
    robot: str | None,
    folder: Path,
    *,
    change: Change | None = None,
    **options: Any,
) -> Row:
    """A mesh of this kind, changed, and the options of ``stancekit.terrain`` that undo it."""
    footholds = written(ground, robot, folder, suffix, change=change, **options)
    if isinstance(footholds, dict):
        return footholds
    return plan(ground, footholds, robot)


def written(
    ground: Ground,
    robot: stancekit.Robot | str | None,
    folder: Path,
    suffix: str = ".obj",
    *,
    change: Change | None = None,
    **options: Any,
) -> Any:
    """Footholds of the ground's mesh, or the row of their refusal."""
    mesh, path = mesh_of(ground), folder / f"{ground.name}{suffix}"
    mesh = mesh if change is None else change(mesh)
    mesh.export(path, **({"digits": 12} if suffix == ".obj" else {}))
    try:
        return footholds_of(ground, path, robot, **options)
    except stancekit.StancekitError as error:
        return refused(error)


def as_grid(ground: Ground, robot: str | None, folder: Path) -> Row:
    """The heights of the upper side on a grid, NaN where there is none or a bottom far below."""
    low, high = (getattr(ground.triangles, name)(axis=(0, 1)) for name in ("min", "max"))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    spacing = SPACING_M * ground.scale
    count = (2.0 * half[:2] / spacing + 1e-6).astype(int)
    lines = [middle[k] + spacing * (np.arange(n) - 0.5 * (n - 1)) for k, n in enumerate(count)]
    heights = np.full(tuple(count), np.nan)
    for a, b, c in ground.triangles:
        u, v = b - a, c - a
        double = u[0] * v[1] - u[1] * v[0]
        if abs(double) < 1e-12:
            continue
        x, y = lines[0][:, None] - a[0], lines[1][None] - a[1]
        s, t = (x * v[1] - y * v[0]) / double, (u[0] * y - u[1] * x) / double
        inside = (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1.0 + 1e-9)
        heights = np.where(inside, np.fmax(heights, a[2] + s * u[2] + t * v[2]), heights)
    path = folder / f"{ground.name}.npy"
    np.save(path, heights)
    try:
        footholds = footholds_of(
            ground, path, robot, kind="grid", spacing_m=spacing, offset_m=(*middle[:2], 0.0)
        )
    except stancekit.StancekitError as error:
        return refused(error)
    return plan(ground, footholds, robot)


def other_file(ground: Ground, robot: str | None, folder: Path) -> Row:
    """The robot as another package's file has it, in the posture that the first one stands in."""
    assert robot is not None
    _, provider, inside = next(each for each in as_they_come() if each[0] == TWINS[robot])
    if provider_folder(provider) is None:
        return {"status": NONE, "message": f"{provider} is not installed", "cpu_s": 0.0}
    mine, path = robot_of(robot).own_model(), folder / f"{TWINS[robot]}.yaml"
    names = (zip(leg.joint_names, leg.stance_rad.tolist(), strict=True) for leg in mine.legs)
    posture = {joint: angle for leg in names for joint, angle in leg}
    known = {"name": robot, "provider": provider, "urdf": inside, "posture_rad": posture}
    path.write_text(json.dumps(known), encoding="utf-8")
    twin = robot_of(path).own_model()
    feet = [
        {leg.name: leg.chain.feet(leg.stance_rad[None])[0] for leg in each.legs}
        for each in (mine, twin)
    ]
    if set(feet[0]) != set(feet[1]):
        return {"status": f"legs {', '.join(feet[1])}", "message": "", "cpu_s": 0.0}
    apart = max(float(np.linalg.norm(feet[0][name] - feet[1][name])) for name in feet[0])
    if max(apart, abs(mine.stand_height_m - twin.stand_height_m)) > TWIN_M:
        return {"status": f"feet {apart:.3f} m apart", "message": "", "cpu_s": 0.0}
    return as_file(".obj", ground, str(path), folder)


def by_playground(ground: Ground, robot: str | None, folder: Path) -> Row:
    """The playground, once nothing is changed."""
    footholds = written(ground, robot, folder)
    if isinstance(footholds, dict):
        return footholds
    question = laid_between(footholds, ground.start, ground.goal, robot=robot or "hexapod")
    begin = time.process_time()
    answer = patient_answer(Scenario.about(question))
    status = "refused" if answer.status is None else answer.status.value
    row = {"status": status, "message": answer.message}
    if answer.accepted:
        row["objective"] = float(objective_of(answer.plan))
    return {**row, "cpu_s": round(time.process_time() - begin, 2)}


def laid(ground: Ground, robot: str | None, folder: Path) -> Problem | Row:
    """The course that the plain answer has a plan over, or a row where there is none: one that is
    handed over states its layout, and so is another question where it has no plan.
    """
    footholds = written(ground, robot, folder)
    if isinstance(footholds, dict):
        return footholds
    asked = {"start": ground.start, "goal": ground.goal, "robot": robot}
    try:
        answer = stancekit.plan(footholds, **asked, time_limit_s=LIMIT_S)
    except stancekit.StancekitError as error:
        return {**refused(error), "status": NONE}
    if answer.status.value == "feasible":
        return answer.solution.problem
    return {"status": NONE, "message": answer.message, "cpu_s": 0.0}


def by_value(ground: Ground, robot: str | None, folder: Path) -> Row:
    """The course that was laid out, as a value."""
    course = laid(ground, robot, folder)
    if isinstance(course, dict):
        return course
    return row_of(lambda: stancekit.plan(course, time_limit_s=LIMIT_S))


def by_loop(ground: Ground, robot: str | None, folder: Path) -> Row:
    """The function of the closed loop, asked for all of the course."""
    course = laid(ground, robot, folder)
    if isinstance(course, dict):
        return course
    planner = TwoStage(time_limit_s=LIMIT_S)
    given = {"shares": SHARES, "presses": PRESSES, "limits": stancekit.WholeBodyLimits()}
    deadline = time.perf_counter() + LIMIT_S
    return row_of(lambda: replan(None, course, planner=planner, deadline=deadline, **given))


def by_environment(ground: Ground, robot: str | None, folder: Path) -> Row:
    """Traverse-v0 over the course, in one window from where its robot stands."""
    course = laid(ground, robot, folder)
    if isinstance(course, dict):
        return course
    begin = time.process_time()
    regions = max(len(each.candidates) for each in course.footholds)
    env = TraverseEnv(
        lambda _: course,
        limbs=len(course.robot.limbs),
        regions=regions,
        horizon=course.frames - 1,
    )
    env.reset(seed=0)
    over, info = False, dict[str, Any]()
    while not over:
        _, _, terminated, truncated, info = env.step(np.int64(0))
        over = terminated or truncated
    status = (
        "feasible" if info["is_success"] else "infeasible" if info["infeasible"] else "undecided"
    )
    row = {"status": status, "message": f"key frame {info['frame']} of {course.frames - 1}"}
    return {**row, "cpu_s": round(time.process_time() - begin, 2)}


def by_command(ground: Ground, robot: str | None, folder: Path) -> Row:
    """The command on the mesh, in a process of its own."""
    path = folder / f"{ground.name}.obj"
    mesh_of(ground).export(path, digits=12)
    start, goal = (",".join(map(str, place)) for place in (ground.start, ground.goal))
    words = [str(path), f"--start={start}", f"--goal={goal}", f"--friction={ground.friction}"]
    words += ["--time-limit-s", str(LIMIT_S), *(["--robot", robot] if robot else [])]
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "stancekit.cli.main", "plan", *words, "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    spent = round(time.perf_counter() - begin, 2)
    try:
        record = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        return {"status": "refused", "message": done.stderr.strip()[-300:], "wall_s": spent}
    row = {"status": record["status"], "message": record.get("message", ""), "wall_s": spent}
    if record["status"] == "feasible":
        row["objective"] = record["objective"]
    return row


def moved(by: Array, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh elsewhere."""
    return trimesh.Trimesh(mesh.vertices + by, mesh.faces, process=False)


def scaled(factor: float, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh in another unit."""
    return trimesh.Trimesh(factor * mesh.vertices, mesh.faces, process=False)


def lying(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with y up: its x, y and z are the world's y, z and x."""
    return trimesh.Trimesh(mesh.vertices[:, [1, 2, 0]], mesh.faces, process=False)


def twice(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Every face from both sides."""
    faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def cut(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Faces cut in small ones."""
    side = max(PIECE_M, 0.04 * float(np.ptp(mesh.vertices, axis=0).max()))
    corners, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, side)
    return trimesh.Trimesh(*_welded(corners, faces), process=False)


def rounded(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Small faces whose corners are rounded to a millimetre."""
    small = cut(mesh)
    return trimesh.Trimesh(small.vertices.round(DIGITS), small.faces, process=False)


def _welded(corners: Array, faces: Array) -> tuple[Array, Array]:
    corners, number = np.unique(corners.round(9), axis=0, return_inverse=True)
    return corners, number.reshape(-1)[faces]


def mirrored(ground: Ground, robot: str | None, folder: Path) -> Row:
    """Left is right."""
    flipped = ground.triangles[:, ::-1] * np.array([1.0, -1.0, 1.0])
    return as_file(".obj", replace(ground, triangles=flipped), robot, folder)


def in_world(world: Frame, ground: Ground, robot: str | None, folder: Path) -> Row:
    """Ground, places and robot moved and turned together."""
    start, goal = (
        world.places(np.array([*place, 0.0]))[:2] for place in (ground.start, ground.goal)
    )
    there = replace(
        ground,
        triangles=world.places(ground.triangles),
        start=tuple(start.tolist()),
        goal=tuple(goal.tolist()),
    )
    who = stancekit.robot(robot or "hexapod").turned(world)
    footholds = written(there, who, folder)
    return footholds if isinstance(footholds, dict) else plan(there, footholds, who)


def sized(size: float, ground: Ground, robot: str | None, folder: Path) -> Row:
    """Robot and ground larger or smaller, by similarity."""
    who = stancekit.robot(robot or "hexapod")
    if who.own and not str(robot).endswith(".urdf"):
        return {"status": NONE, "message": "a file of meshes", "cpu_s": 0.0}
    if who.own:
        path = folder / f"sized-{Path(str(robot)).name}"
        path.write_text(larger(Path(str(robot)).read_text(encoding="utf-8"), size))
        who = stancekit.robot(path)
    else:
        limbs = (
            replace(limb, shoulder_m=size * limb.shoulder_m, reach_m=size * limb.reach_m)
            for limb in who.limbs
        )
        powers = {"torque_nm": 4, "velocity_rad_s": -0.5, "rotor_kg_m2": 5}
        powers |= {"stiffness_nm_rad": 4, "damping_nms_rad": 4.5}
        drive = {name: size**power * getattr(who.servo, name) for name, power in powers.items()}
        who = stancekit.Robot(
            name="six",
            mass_kg=size**3 * who.mass_kg,
            limbs=tuple(limbs),
            drawn=replace(who.servo, **drive),
        )
    there = replace(ground.of_size(size, passable=True), passable=ground.passable)
    footholds = written(there, who, folder)
    row = footholds if isinstance(footholds, dict) else plan(there, footholds, who)
    return row | ({"objective": row["objective"] / size**2} if "objective" in row else {})


POWERS = {"xyz": 1, "radius": 1, "length": 1, "size": 1, "mass": 3, "effort": 4, "velocity": -0.5}


def larger(text: str, size: float) -> str:
    """A URDF of the robot this many times as large; its inertias by the fifth power."""

    def number(found: re.Match[str]) -> str:
        name, numbers = found[1], found[2].split()
        power = POWERS.get(name.removesuffix(" value"), 5)
        return f'{name}="{" ".join(repr(float(each) * size**power) for each in numbers)}"'

    names = "xyz|radius|length|size|mass value|effort|velocity|i[xyz]{2}"
    return re.sub(rf'(?<!axis )\b({names})="(.*?)"', number, text)


def renamed(ground: Ground, robot: str | None, folder: Path) -> Row:
    """Legs of other names, in the opposite order."""
    if robot is not None and "drawn" not in robot:
        return {"status": NONE, "message": "a file of meshes", "cpu_s": 0.0}
    if robot is None:
        plain = stancekit.robot("hexapod")
        limbs = [replace(limb, name=f"limb_{limb.name}") for limb in reversed(plain.limbs)]
        who = replace(plain, name="other", limbs=tuple(limbs), drawn=plain.drawn)
    else:
        text = Path(robot).read_text(encoding="utf-8")
        head, *legs = re.split(r'(?=<joint name="leg\d_0")', text.removesuffix("</robot>"))
        path = folder / f"renamed-{Path(robot).name}"
        whole = f"{head}{''.join(reversed(legs))}</robot>"
        path.write_text(re.sub(r"(leg|foot)(\d)", r"z\1\2", whole), encoding="utf-8")
        who = stancekit.robot(path)
    footholds = written(ground, who, folder)
    return footholds if isinstance(footholds, dict) else plan(ground, footholds, who)


PLAIN = Cloth(name="plain", same=FIGURES, ask=partial(as_file, ".obj"))
AWAY_M = np.array([3.0, -2.0, 0.5])
OTHER_FILE = Cloth(name="other file", same=VERDICT, ask=other_file)
CLOTHES = (
    *(
        Cloth(
            name=suffix[1:],
            same=FIGURES if suffix == ".off" else VERDICT,
            ask=partial(as_file, suffix),
        )
        for suffix in (".stl", ".ply", ".off", ".glb", ".dae")
    ),
    Cloth(
        name="millimetres",
        same=FIGURES,
        ask=partial(as_file, ".obj", change=partial(scaled, 1000.0), unit_m=0.001),
    ),
    Cloth(name="y up", same=FIGURES, ask=partial(as_file, ".obj", change=lying, up="y")),
    Cloth(
        name="offset",
        same=VERDICT,
        ask=partial(as_file, ".obj", change=partial(moved, AWAY_M), offset_m=tuple(-AWAY_M)),
    ),
    Cloth(name="twice", same=VERDICT, ask=partial(as_file, ".obj", change=twice)),
    Cloth(name="cut", same=VERDICT, ask=partial(as_file, ".obj", change=cut)),
    Cloth(name="rounded", same=VERDICT, ask=partial(as_file, ".obj", change=rounded)),
    Cloth(name="grid", same=VERDICT, ask=as_grid),
    Cloth(name="command", same=FIGURES, ask=by_command),
    Cloth(name="playground", same=FIGURES, ask=by_playground),
    Cloth(name="value", same=FIGURES, ask=by_value),
    Cloth(name="loop", same=FIGURES, ask=by_loop),
    Cloth(name="environment", same=VERDICT, ask=by_environment),
    Cloth(name="mirrored", same=VERDICT, ask=mirrored),
    OTHER_FILE,
    Cloth(name="renamed", same=VERDICT, ask=renamed),
    *(
        Cloth(
            name=f"{far / 1e3:g} km away",
            same=FIGURES,
            width=1e-4,
            ask=partial(in_world, Frame(origin_m=np.array([far, -0.7 * far, 0.0]))),
        )
        for far in (1.0, 1e3, 1e5, 4e5)
    ),
    *(
        Cloth(
            name=f"turned {degrees}",
            same=FIGURES,
            width=1e-3,
            ask=partial(in_world, Frame(origin_m=np.zeros(3), heading_rad=radians(degrees))),
        )
        for degrees in (30, 90, 137, 180, -100, -45, -10)
    ),
    *(
        Cloth(name=f"times {size:g}", same=FIGURES, width=0.05, ask=partial(sized, size))
        for size in (0.25, 0.5, 2.0, 4.0)
    ),
)


# ------------------------------------------------------------------------------------------------------------
# pairs


@dataclass(frozen=True, kw_only=True)
class ClothesOptions(Options):
    """What is asked."""

    folder: Path = Path("out/clothes")
    """Rows are kept here."""
    quick: bool = False
    """Eight grounds and two robots."""
    grounds: str = ""
    """Names with commas between them; all where it is empty."""
    robots: str = ""
    """Names with commas between them; all where it is empty."""
    clothes: str = ""
    """Names with commas between them; all where it is empty."""
    sample: int | None = None
    """So many pairs of a ground, a robot and a cloth, drawn by the seed."""
    slopes: bool = False
    """CPU time of slopes over that of flat ground."""
    against: Path | None = None
    """Another checkout, asked first."""


def chosen(names: str, every: Mapping[str, Any]) -> dict[str, Any]:
    """What is named, or all."""
    if wrong := set(filter(None, names.split(","))) - set(every):
        sys.exit(f"expected some of {', '.join(every)}, got {', '.join(sorted(wrong))}")
    return {name: each for name, each in every.items() if not names or name in names.split(",")}


def alike(cloth: Cloth, plain: Row, row: Row) -> bool:
    """Tell whether two answers are the same, as far as they have to be."""
    if plain["status"] != row["status"]:
        return False
    if cloth.same != FIGURES or "objective" not in plain:
        return True
    return bool(np.isclose(plain["objective"], row["objective"], rtol=cloth.width, atol=1e-9))


def judged(ground: Ground, cloth: Cloth, plain: Row, row: Row) -> str:
    """A word for a pair."""
    if row["status"] == NONE:
        return NONE
    if not alike(cloth, plain, row):
        return "differs"
    if ground.passable and plain["status"] in ("refused", "infeasible"):
        return "both refuse"
    return "equal"


def pairs(asked: ClothesOptions) -> Iterator[Row]:
    """Every pair, asked or kept."""
    asked.folder.mkdir(parents=True, exist_ok=True)
    kept = Lines(asked.folder / "answers.jsonl")
    names = {key: getattr(asked, key) or (QUICK[key] if asked.quick else "") for key in QUICK}
    over = chosen(names["grounds"], {ground.name: ground for ground in grounds()})
    who = chosen(names["robots"], robots(asked.folder))
    clothes = chosen(asked.clothes, {cloth.name: cloth for cloth in CLOTHES})
    scales = {f"drawn{seed}": (size_m(seed) / SIZE_M, joints_of(seed) > 2) for seed in range(DRAWN)}

    def answer(cloth: Cloth, ground: Ground, name: str) -> Row:
        key = f"{ground.name} {name} {cloth.name}"
        if key in kept.rows:
            return kept.rows[key]
        try:
            row = cloth.ask(ground, who[name], asked.folder)
        except stancekit.StancekitError as error:  # a robot that is no walker
            row = refused(error)
        return kept.add(key, row)

    every = list(product(over.values(), who, clothes.values()))
    every = [each for each in every if (each[1] in TWINS) == (each[2] is OTHER_FILE)]
    if asked.sample is not None:
        rng = np.random.default_rng(asked.seed)
        every = [every[k] for k in rng.permutation(len(every))[: asked.sample]]
    for plain, name, cloth in every:
        scale, planned = scales.get(name, (1.0, True))
        ground = plain.of_size(scale, passable=planned)
        first, row = answer(PLAIN, ground, name), answer(cloth, ground, name)
        yield {
            "ground": ground.name,
            "robot": name,
            "cloth": cloth.name,
            "is": judged(ground, cloth, first, row),
            "plain": first["status"],
            "dressed": row["status"],
            "cpu_s": [first.get("cpu_s"), row.get("cpu_s")],
            "says": row["message"],
        }


def slopes(asked: ClothesOptions) -> Iterator[Row]:
    """CPU time of slopes, and how often it is that of flat ground: by mesh, by grid, by family."""
    asked.folder.mkdir(parents=True, exist_ok=True)
    over = {ground.name: ground for ground in grounds()}
    who = robots(asked.folder)
    grid = next(cloth for cloth in CLOTHES if cloth.name == "grid")
    up = [f"slope{degrees}" for degrees in (5, 10, 15, 20, 25, 30, 33)]
    aside = ["down20", "down30", "across20", "across30"]
    sets = [("hexapod", PLAIN, up + aside), ("ant", PLAIN, up[1::2] + aside[1::2])]
    sets += [("a1", PLAIN, up[1::2] + aside), ("hexapod", grid, up[1::2] + aside[1::2])]
    for name, cloth, names in sets:
        flat = [cloth.ask(over["flat"], who[name], asked.folder) for _ in range(3)][1:]
        least = min(row["cpu_s"] for row in flat)
        for each in names:
            row = cloth.ask(over[each], who[name], asked.folder)
            yield _times(each, name, cloth.name, row, least)
    asks = {"start": (0.0, 0.0), "goal": (0.6, 0.0), "time_limit_s": LIMIT_S}
    ways = [partial(stancekit.plan, f"slopes:{level:g}:4", **asks) for level in (0.0, 0.3, 0.6)]
    first, *others = [row_of(way) for way in (ways[0], *ways)][1:]
    for level, row in zip((0.3, 0.6), others, strict=True):
        yield _times(f"slopes:{level:g}:4", "hexapod", "family", row, first["cpu_s"])


def _times(ground: str, robot: str, cloth: str, row: Row, flat_s: float) -> Row:
    spent = {"cpu_s": row["cpu_s"], "flat_s": flat_s, "times": round(row["cpu_s"] / flat_s, 2)}
    return {"ground": ground, "robot": robot, "cloth": cloth, "status": row["status"], **spent}


def line(row: Row) -> str:
    """A row for people."""
    head = f"{row['ground']:10} {row['robot']:10} {row['cloth']:12} {row['is']:12}"
    said = f" {row['says'][:110]}" if row["is"] == "differs" else ""
    return f"{head} {row['plain']} / {row['dressed']}{said}"


def main(asked: ClothesOptions) -> int:
    """Ask, print, and count; 1 where a pair that counts differs."""
    if asked.against is not None:
        words = [word for word in sys.argv[1:] if not word.startswith("--against")]
        words = [word for word in words if word != str(asked.against)]
        folder = asked.folder / "before"
        subprocess.run(
            [sys.executable, __file__, *words, "--folder", str(folder)],
            env=of_checkout(asked.against.resolve()),
            check=False,
        )
    rows = list[Row]()
    if asked.slopes:
        for row in slopes(asked):
            asked.say(row)
            rows.append(row)
        print(f"times of flat: {spread([row['times'] for row in rows])}", file=sys.stderr)
        return 0
    for row in pairs(asked):
        asked.say(row, line)
        rows.append(row)
    for cloth in dict.fromkeys(row["cloth"] for row in rows):
        mine = [row["is"] for row in rows if row["cloth"] == cloth]
        print(f"{cloth:12} {tally(mine)}", file=sys.stderr)
    counts = Counter(row["is"] for row in rows)
    total = counts["equal"] + counts["differs"] + counts["both refuse"]
    print(f"{counts['equal']} of {total} pairs are equal: {dict(counts)}", file=sys.stderr)
    return int(counts["differs"] > 0)


if __name__ == "__main__":
    launch(main, ClothesOptions, __doc__)
