"""Forged overlaps: bodies that touch at one instant of a motion, mostly between the moments that
are looked at.

``python benchmarks/forged_overlaps.py --each 40``. Five kinds, each forged at depths from twice the
verifier's tolerance to ten times it: a ball of a shank grazes a thin rod of the body, or a ball of
it, fast or slowly, or the tip or the face of a small plate of the terrain. A judge that shares no
code with the sweep places the ball by pinocchio at a thousand instants from each moment to the
next, and measures in closed form. Exit code 1 if the sweep misses one that the judge calls deep.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from _bench import Options, launch
from scipy.spatial.transform import Rotation, Slerp

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.bodies import LINKS_M, TOUCH_M, Bodies
from stancekit.planners.robot.inverse_kinematics import WholeBody
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.meshes import Shape
from stancekit.planners.robot.model import robot_of
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.robot.urdf_reader import pinocchio
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.obstacles import Obstacles
from tests.planners.robot.small_urdfs import quadruped

INSTANTS, MOMENTS = 1000, 4
SHANK, AT = "LF_SHANK", np.array([0.0, 0.05, -0.15])
RADIUS_M = 4e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Forged:
    """A motion of T moments whose robot has these shapes over this terrain; depth: the judge's, at
    its deepest [m].
    """

    motion: WholeBody
    shapes: tuple[Shape, ...]
    terrain: tuple[Patch, ...]
    depth: float


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How many."""

    each: int = 40


def main(arguments: Arguments) -> int:
    """Forge, judge, sweep and print; the exit code is 1 where one is missed."""
    model, missed = model_of(quadruped()), 0
    for number, (name, forge) in enumerate(KINDS.items()):
        row = Counter[str]()
        for case, size in enumerate(np.geomspace(2.0, 10.0, arguments.each)):
            forged = forge(
                model, float(size), np.random.default_rng([arguments.seed, number, case])
            )
            tolerance_m = TOUCH_M if forged.terrain else LINKS_M
            found = swept(model, forged)
            row["forged"] += 1
            row["deep by the judge"] += forged.depth > 1.2 * tolerance_m
            row["found"] += bool(found)
            row["found between two moments"] += any(at % 1.0 for at in found)
            row["missed"] += forged.depth > 1.2 * tolerance_m and not found
        arguments.say({"kind": name, **row})
        missed += row["missed"]
    arguments.say({"forged": len(KINDS) * arguments.each, "missed": missed})
    return int(missed > 0)


def swept(model: RobotModel, forged: Forged) -> list[float]:
    """The moments at which the sweep finds something."""
    solver = Kinematics(robot_of(replace(model, shapes=forged.shapes)))
    bodies = Bodies(
        solver, Obstacles.of(forged.terrain) if forged.terrain else Obstacles(convex=(), closed=())
    )
    return [at for _, block in bodies.sweep(forged.motion) for at, _ in block]


# -------------------------------------------------------------------------------------------------------------
# forging


def motion(model: RobotModel, rng: np.random.Generator, *, fast: bool) -> WholeBody:
    """Joints that turn by up to .1 rad from one moment to the next, and a base that goes and
    turns.
    """
    start = np.concatenate([leg.stance_rad for leg in model.legs])
    turns = rng.uniform(-1.0, 1.0, (MOMENTS - 1, len(start))) * (0.1 if fast else 0.02)
    drift = rng.uniform(-1.0, 1.0, (MOMENTS, 3)) * (5e-3 if fast else 2e-3)
    tilts = Rotation.from_rotvec(rng.uniform(-0.02, 0.02, (MOMENTS, 3)))
    legs = len(model.legs)
    return WholeBody(
        rotation=tilts.as_matrix(),
        origin_m=np.array([0.0, 0.0, 1.0]) + drift,
        angles=start + np.vstack([np.zeros(len(start)), np.cumsum(turns, axis=0)]),
        toes_m=np.zeros((MOMENTS, legs, 3)),
        normals=np.tile([0.0, 0.0, 1.0], (MOMENTS, legs, 1)),
        stands=np.zeros((MOMENTS, legs), dtype=bool),
    )


def poses(model: RobotModel, of: WholeBody, *, world: bool) -> tuple[Array, Array]:
    """R and p of the shank at every instant, by pinocchio, in the base or in the world, shapes (K,
    3, 3) and (K, 3).
    """
    pin, known = pinocchio(), model.built
    data, names = known.createData(), model.joint_names
    frame, base = known.getFrameId(SHANK), known.getFrameId("base")
    rows = [known.joints[known.getJointId(name)].idx_q for name in names]
    times = np.linspace(0.0, MOMENTS - 1.0, (MOMENTS - 1) * INSTANTS + 1)
    moments = np.arange(MOMENTS)
    bases = Slerp(moments, Rotation.from_matrix(of.rotation))(times).as_matrix()
    turns, places = np.empty((len(times), 3, 3)), np.empty((len(times), 3))
    state = pin.neutral(known)
    for k, time in enumerate(times):
        state[rows] = [np.interp(time, moments, column) for column in of.angles.T]
        pin.framesForwardKinematics(known, data, state)
        at = data.oMf[base].actInv(data.oMf[frame])
        turns[k], places[k] = at.rotation, at.translation
    if world:
        origin = np.stack([np.interp(times, moments, column) for column in of.origin_m.T], axis=1)
        places = origin + np.einsum("kij,kj->ki", bases, places)
        turns = bases @ turns
    return turns, places


def ball(link: str, at: Array, radius_m: float = RADIUS_M) -> Shape:
    """A ball in a link."""
    return shape(link, "sphere", [radius_m], at)


def shape(link: str, kind: str, size: list[float], at: Array, turn: Array = np.eye(3)) -> Shape:
    """A shape of a link that collides."""
    return Shape(
        link=link, kind=kind, size_m=np.array(size), rotation=turn, origin_m=at, collides=True
    )  # type: ignore[arg-type]


def instant(count: int, rng: np.random.Generator) -> int:
    """An instant that is no moment."""
    return int(rng.integers(MOMENTS - 1)) * INSTANTS + int(
        rng.integers(INSTANTS // 10, INSTANTS - INSTANTS // 10)
    )


def aside(places: Array, k: int, rng: np.random.Generator) -> Array:
    """A unit vector across the way of a point."""
    way = np.cross(places[k + 1] - places[k - 1], rng.normal(size=3))
    return np.asarray(way / np.linalg.norm(way))


def balls(model: RobotModel, size: float, rng: np.random.Generator, *, fast: bool) -> Forged:
    """A ball of the shank that passes one of the base, in the closed form of two balls."""
    of = motion(model, rng, fast=fast)
    turns, origins = poses(model, of, world=False)
    places = origins + turns @ AT
    k = instant(len(places), rng)
    middle = places[k] + (2.0 * RADIUS_M - size * LINKS_M) * aside(places, k, rng)
    depth = 2.0 * RADIUS_M - np.linalg.norm(places - middle, axis=1).min()
    return Forged(
        motion=of, shapes=(ball("base", middle), ball(SHANK, AT)), terrain=(), depth=float(depth)
    )


def thin(model: RobotModel, size: float, rng: np.random.Generator) -> Forged:
    """A rod of the base, .2 mm thick, that a ball of the shank grazes with its side: a capsule's
    closed form.
    """
    of, half, radius = motion(model, rng, fast=True), 0.03, 1e-4
    turns, origins = poses(model, of, world=False)
    places = origins + turns @ AT
    k = instant(len(places), rng)
    out = aside(places, k, rng)
    along = np.cross(out, places[k + 1] - places[k - 1])
    along = along / np.linalg.norm(along)
    middle = places[k] + (RADIUS_M + radius - size * LINKS_M) * out
    rod = shape(
        "base",
        "capsule",
        [radius, 2.0 * half],
        middle,
        np.column_stack([np.cross(out, along), out, along]),
    )
    axial = np.clip((places - middle) @ along, -half, half)
    gap = np.linalg.norm(places - middle - axial[:, None] * along, axis=1)
    depth = RADIUS_M + radius - gap.min()
    return Forged(motion=of, shapes=(rod, ball(SHANK, AT)), terrain=(), depth=float(depth))


def spike(
    model: RobotModel, size: float, rng: np.random.Generator, *, flat: bool = False
) -> Forged:
    """A small plate of the terrain whose corner, or whose face, a ball of the shank touches in
    passing.
    """
    of, side = motion(model, rng, fast=True), 3e-3
    turns, origins = poses(model, of, world=True)
    places = origins + turns @ AT
    k = instant(len(places), rng)
    out = aside(places, k, rng)
    ahead = places[k + 1] - places[k - 1]
    ahead = ahead / np.linalg.norm(ahead)
    across = np.cross(out, ahead)
    tip = places[k] + (RADIUS_M - 0.65 * size * TOUCH_M) * out
    normal = -out if flat else across
    axes = (ahead, across) if flat else (out + 0.4 * ahead, out - 0.4 * ahead)
    corners = (
        [tip + side * (a * axes[0] + b * axes[1]) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        if flat
        else [tip, tip + side * axes[0], tip + 2.0 * side * out, tip + side * axes[1]]
    )
    patch = Patch(vertices_m=np.array(corners), normal=normal, shear_reference=ahead, friction=0.5)
    return Forged(
        motion=of,
        shapes=(ball(SHANK, AT),),
        terrain=(patch,),
        depth=float(_prism_depth(patch, places)),
    )


def _prism_depth(patch: Patch, places: Array) -> float:
    """How deep balls are in the plate behind a patch at their deepest, outside of it: by its face,
    sides and edges.
    """
    from stancekit.planners.terrain.patch import THICKNESS_M

    best = -np.inf
    border, ahead = patch.vertices_m, np.roll(patch.vertices_m, -1, axis=0)
    turn = np.sign(np.cross(border - border[0], ahead - border[0]).sum(axis=0) @ patch.normal)
    sides = turn * np.cross(ahead - border, patch.normal)
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    for place in places:
        heights = np.vecdot(place - border, sides)
        up = (place - border[0]) @ patch.normal
        inside = [*heights, up, -up - THICKNESS_M]
        if max(inside) <= 0.0:
            return float(RADIUS_M - max(inside))
        beside = place - up * patch.normal
        along = np.clip(
            np.vecdot(beside - border, ahead - border) / np.square(ahead - border).sum(axis=1),
            0.0,
            1.0,
        )
        rim = border + along[:, None] * (ahead - border)
        flat = 0.0 if heights.max() <= 0.0 else float(np.linalg.norm(rim - beside, axis=1).min())
        off = max(up, -up - THICKNESS_M, 0.0)
        best = max(best, RADIUS_M - float(np.hypot(flat, off)))
    return best


KINDS: dict[str, Callable[[RobotModel, float, np.random.Generator], Forged]] = {
    "a thin rod": thin,
    "a fast ball": lambda model, size, rng: balls(model, size, rng, fast=True),
    "a slow ball": lambda model, size, rng: balls(model, size, rng, fast=False),
    "a spike of the terrain": spike,
    "a plate of the terrain": lambda model, size, rng: spike(model, size, rng, flat=True),
}

if __name__ == "__main__":
    launch(main, Arguments, __doc__)
