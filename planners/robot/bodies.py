"""Which of a robot's links are inside each other or inside the terrain, and how deep (coal, extra ``kin``).

Links are the shapes that their file says they collide with, meshes by their convex hulls. Pairs whose boxes some axis
of either keeps apart are clear (the separating-axis theorem); coal measures the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from ..terrain.obstacles import Obstacles
from .kinematics import Kinematics
from .shapes import Shape
from .solids import shape_points, solid_shapes
from .urdf_reader import pinocchio

TOUCH_M = 1e-3
"""Bodies this deep inside each other only touch: shapes are drawn to a millimetre, and joint angles, corners and coal's
depths are ten times as exact."""
LONG_M = 0.05
"""A part of a leg that is longer than this has a shape, or is said to have none."""
POSTURES = 256
"""In so many postures two links touch before they are taken for drawn so."""
ALIGNED, ON_M = 1.0 - 1e-6, 1e-4
"""Cosine between normals of one surface, and how far from it what stands on it may be [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeBody:
    """A robot in the world, J joints, N limbs.

    rotation, origin_m: R_WB and p_WB of the base's frame, shapes (3, 3), (3,) [m]. angles: shape (J,) [rad]. toes_m,
    normals: where limbs touch and of what surface, shape (N, 3); stands: which of them do, shape (N,).
    """

    rotation: Array
    origin_m: Array
    angles: Array
    toes_m: Array
    normals: Array
    stands: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """A link is depth_m deep inside something: another link, or a part of the terrain."""

    link: str
    other: str
    depth_m: float


class Bodies:
    """A robot's links and a terrain. Not for use by several threads at once.

    drawn_so: pairs of links that are inside each other in the standing posture and in every other one that was tried,
    256 all over the joints' limits: their file has them so, and they are left out, as neighbours and pairs that an SRDF
    disables are. missing: what has no shape, a line each. Raises InvalidInput where coal is not installed.
    """

    def __init__(self, kinematics: Kinematics, terrain: Obstacles = Obstacles(convex=(), closed=())) -> None:
        self._coal, self._pin, self._of = _coal(), pinocchio(), kinematics
        self.model = kinematics.model
        known = kinematics.known
        self._data, self._terrain = known.createData(), terrain
        shapes, self.missing = _found(kinematics)
        self.links = [shape.link for shape, _ in shapes]
        frames = [known.getFrameId(link, self._pin.FrameType.BODY) for link in self.links]
        self._frames, joints = frames, [known.frames[frame].parentJoint for frame in frames]
        self._turns = np.array([shape.rotation for shape, _ in shapes]).reshape(-1, 3, 3)
        self._origins = np.array([shape.origin_m for shape, _ in shapes]).reshape(-1, 3)
        self._geometry = [self._made(shape, points) for shape, points in shapes]
        boxes = np.array([_box(geometry) for geometry in self._geometry]).reshape(-1, 2, 3)
        self._middles, self._halves = boxes[:, 0], boxes[:, 1]
        self._solids = [self._hull(each.solid.corners) for each in terrain.convex]
        spans = [(each.solid.corners.min(axis=0), each.solid.corners.max(axis=0)) for each in terrain.convex]
        self._spans = np.array(spans).reshape(-1, 2, 3)
        self._request, self._here = self._coal.DistanceRequest(), self._coal.Transform3s()
        self._request.enable_signed_distance = True
        feet = {leg.foot: i for i, leg in enumerate(self.model.legs)}
        self._foot = [feet.get(link, -1) for link in self.links]
        disabled = self.model.disabled_pairs
        self._pairs = np.array(
            [
                (i, j) for i, j in combinations(range(len(joints)), 2)
                if not _neighbours(known, joints[i], joints[j])
                and frozenset((self.links[i], self.links[j])) not in disabled
            ], dtype=int,
        ).reshape(-1, 2)  # fmt: skip
        self.drawn_so = self._leave_out()

    def overlaps(self, body: WholeBody, *, beyond_m: float = TOUCH_M) -> tuple[Overlap, ...]:
        """What is deeper than ``beyond_m`` inside something else, the deepest first; a foot may be in the surface that
        it stands on."""
        turns, origins = self._placed(body.angles)
        turns, origins = body.rotation @ turns, body.origin_m + origins @ body.rotation.T
        found = [
            Overlap(link=self.links[i], other=self.links[j], depth_m=depth)
            for i, j, depth in self._among_links(turns, origins, self._pairs)
        ]
        found += self._in_terrain(turns, origins, body)
        return tuple(sorted((each for each in found if each.depth_m > beyond_m), key=lambda each: -each.depth_m))

    def _among_links(self, turns: Array, origins: Array, pairs: NDArray[np.int_]) -> Iterator[tuple[int, int, float]]:
        """Pairs of shapes whose boxes meet, and how deep one is inside the other, negative outside."""
        first, second = pairs.T
        middles = origins + np.einsum("sij,sj->si", turns, self._middles)
        between = (middles[second] - middles[first])[:, None]
        a, b = turns[first], turns[second]
        across = np.abs(np.swapaxes(a, 1, 2) @ b)
        ha, hb = self._halves[first], self._halves[second]
        along_a = np.abs(between @ a)[:, 0] - ha - np.einsum("pij,pj->pi", across, hb)
        along_b = np.abs(between @ b)[:, 0] - hb - np.einsum("pij,pi->pj", across, ha)
        for k in np.flatnonzero(np.maximum(along_a.max(axis=1), along_b.max(axis=1)) < 0.0):
            i, j = pairs[k].tolist()
            yield i, j, -self._distance(self._at(turns, origins, i), self._at(turns, origins, j))

    def _in_terrain(self, turns: Array, origins: Array, body: WholeBody) -> Iterator[Overlap]:
        """Shapes whose boxes meet a part of the terrain, or whose middles are inside a closed surface."""
        middles = origins + np.einsum("sij,sj->si", turns, self._middles)
        reach = np.einsum("sij,sj->si", np.abs(turns), self._halves)
        low, high = middles - reach, middles + reach
        near = np.all((low[:, None] < self._spans[:, 1]) & (high[:, None] > self._spans[:, 0]), axis=2)
        for part in np.flatnonzero(near.any(axis=0)):
            obstacle, its = self._terrain.convex[part], np.flatnonzero(near[:, part])
            solid = obstacle.solid
            support = np.vecdot(np.abs(solid.normals @ turns[its]), self._halves[its][:, None])
            gap = (middles[its] @ solid.normals.T - solid.offsets_m - support).max(axis=1)
            for i in its[gap < 0.0]:
                if not self._stands_on(self._foot[i], obstacle.solid, body):
                    depth = -self._distance(self._at(turns, origins, i), (self._solids[part], self._here))
                    yield Overlap(link=self.links[i], other=obstacle.name, depth_m=depth)
        for surface in self._terrain.closed:
            for i in np.flatnonzero(surface.holds(middles)):
                yield Overlap(link=self.links[i], other=surface.name, depth_m=surface.depth(middles[i]))

    def _stands_on(self, limb: int, solid: Any, body: WholeBody) -> bool:
        """Whether the limb's foot stands on a face of the solid."""
        if limb < 0 or not body.stands[limb]:
            return False
        toe, along = body.toes_m[limb], solid.normals @ body.normals[limb] > ALIGNED
        heights = solid.normals @ toe - solid.offsets_m
        return bool(np.any(along & (np.abs(heights) < ON_M)) and heights.max() < ON_M)

    def _placed(self, angles: Array) -> tuple[Array, Array]:
        """R_BS and p_BS of every shape, shapes (S, 3, 3) and (S, 3) [m]."""
        self._pin.framesForwardKinematics(self._of.known, self._data, self._of.configuration(angles))
        places = [self._data.oMf[frame] for frame in self._frames]
        turns = np.array([place.rotation for place in places]).reshape(-1, 3, 3)
        origins = np.array([place.translation for place in places]).reshape(-1, 3)
        return turns @ self._turns, origins + np.einsum("sij,sj->si", turns, self._origins)

    def _leave_out(self) -> tuple[tuple[str, str], ...]:
        """Leave out the pairs that touch in every posture, and say which links they are of."""
        lower, upper = self._of.lower_rad, self._of.upper_rad
        spread = lower + (upper - lower) * _spread(POSTURES, len(lower))
        always = self._pairs
        for angles in [np.concatenate([leg.stance_rad for leg in self.model.legs]), *spread]:
            touching = [(i, j) for i, j, depth in self._among_links(*self._placed(angles), always) if depth > 0.0]
            always = np.array(touching, dtype=int).reshape(-1, 2)
            if not touching:
                return ()
        drawn = {tuple(pair) for pair in always.tolist()}
        kept = [pair for pair in self._pairs.tolist() if tuple(pair) not in drawn]
        self._pairs = np.array(kept, dtype=int).reshape(-1, 2)
        return tuple((self.links[i], self.links[j]) for i, j in sorted(drawn))

    def _at(self, turns: Array, origins: Array, shape: int) -> tuple[Any, Any]:
        """A shape and where it is, as coal has them."""
        return self._geometry[shape], self._coal.Transform3s(turns[shape], origins[shape])

    def _distance(self, one: tuple[Any, Any], other: tuple[Any, Any]) -> float:
        """Between two bodies, negative where one is inside the other [m]."""
        found = self._coal.distance(*one, *other, self._request, self._coal.DistanceResult())
        return float(found)

    def _made(self, shape: Shape, points: Array) -> Any:
        """A shape as coal has it."""
        size = [float(x) for x in shape.size_m]
        if shape.kind == "mesh":
            return self._hull(points)
        return {
            "box": self._coal.Box, "sphere": self._coal.Sphere, "cylinder": self._coal.Cylinder,
            "capsule": self._coal.Capsule,
        }[shape.kind](*size)  # fmt: skip

    def _hull(self, points: Array) -> Any:
        corners = self._coal.StdVec_Vec3s()
        for point in points:
            corners.append(point)
        return self._coal.Convex.convexHull(corners, True, "Qt")


def _coal() -> Any:
    """The coal module. Raises InvalidInput where it is not installed."""
    try:
        import coal
    except ImportError:
        message = "bodies: expected coal for collisions, it is not installed: pip install 'stancekit[kin]'"
        raise InvalidInput(message) from None
    return coal


def _found(kinematics: Kinematics) -> tuple[list[tuple[Shape, Array]], tuple[str, ...]]:
    """Shapes of links and points whose hulls they are; and what has none: meshes that cannot be had, long parts of
    legs."""
    model, found, missing = kinematics.model, list[tuple[Shape, Array]](), dict[str, list[str]]()
    for shape in solid_shapes(model.shapes):
        points = shape_points(shape)
        if points is not None:
            found.append((shape, points))
        elif shape.link not in missing.setdefault("link|: no mesh", []):
            missing["link|: no mesh"].append(shape.link)
    feet = {leg.foot for leg in model.legs if np.linalg.norm(model.mounts[leg.foot].origin_m) > LONG_M}
    mounts = [model.mounts[shape.link] for shape, _ in found if shape.link not in feet]
    shaped = {(mount.leg, mount.joint) for mount in mounts}
    for i, leg in enumerate(model.legs):
        ends = [*leg.chain.origins[1:], leg.chain.tip_m]
        bare = [k for k, end in enumerate(ends) if np.linalg.norm(end) > LONG_M and (i, k) not in shaped]
        missing.setdefault("joint|: no shape of what they carry", []).extend(leg.joint_names[k] for k in bare)
    lines = [(*key.split("|"), names) for key, names in missing.items() if names]
    return found, tuple(f"{kind}{'s' if len(names) > 1 else ''} {', '.join(names)}{why}" for kind, why, names in lines)


def _spread(count: int, dimension: int) -> Array:
    """Points all over the unit cube, shape (count, dimension): Kronecker's sequence of the roots of primes."""
    numbers = np.arange(2, 16 * (dimension + 4))
    primes = numbers[np.all((numbers % numbers[:, None] > 0) | (numbers <= numbers[:, None]), axis=0)]
    return np.outer(np.arange(1, count + 1), np.sqrt(primes[:dimension])) % 1.0


def _box(geometry: Any) -> tuple[Array, Array]:
    """Middle and half sides of a shape's box in its own frame, shape (3,) each [m]."""
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    low, high = np.array(box.min_).ravel(), np.array(box.max_).ravel()
    return 0.5 * (low + high), 0.5 * (high - low)


def _neighbours(known: Any, one: int, other: int) -> bool:
    """Whether two joints of pinocchio's carry the same body, or bodies that one of them joins."""
    return one == other or known.parents[one] == other or known.parents[other] == one
