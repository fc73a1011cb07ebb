"""Which of a robot's links are inside each other or inside the terrain, and how deep (coal, extra ``kin``).

Links are the shapes that their file says they collide with, meshes by their convex hulls. Pairs whose boxes some axis
of either keeps apart are clear (the separating-axis theorem); coal measures the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..terrain.obstacles import Ground, Obstacles
from .contacts import feet_of
from .kinematics import Kinematics
from .links_in_ground import LinksInGround
from .overlaps import Near, Overlap, WholeBody
from .robot_model import RobotModel
from .shapes import Shape
from .solids import shape_points, solid_shapes
from .urdf_reader import coal, pinocchio

TOUCH_M, LINKS_M = 1e-3, 1e-4
"""A link this deep in the terrain only touches it, as terrain is known to a millimetre; and links this deep inside each
other: joint angles, corners and coal's depths are ten times as exact. More presses them apart wherever it is run."""
FINE, ARCS = 0.5, 1.01
"""Two links that go so much of the tolerance between two postures are not looked at in between; points go so much
farther on the arcs of joints than straight."""
SIDES = np.array(list(product((-1.0, 1.0), repeat=3)))
"""Corners of a box in units of half its sides."""
POSTURES = 256
"""In so many postures two links touch before they are taken for drawn so."""
LONG_M = 0.05
"""A part of a leg that is longer than this has a shape, or is said to have none [m]."""
ALIGNED, ON_M = 1.0 - 1e-6, 1e-4
"""Cosine between normals of one surface, and how far from it what stands on it may be [m]."""

_DRAWN_SO: WeakKeyDictionary[RobotModel, tuple[tuple[str, str], ...]] = WeakKeyDictionary()
"""``Bodies.drawn_so`` of models that there are, each tried once: names, which follow from the model alone, so that two
threads that try one at a time write down the same."""


class Bodies:
    """A robot's links and a terrain. Not for use by several threads at once.

    drawn_so: pairs of links that are inside each other in the standing posture and in every other one that was tried,
    256 all over the joints' limits: their file has them so, and they are left out, as neighbours and pairs that an SRDF
    disables are. missing: what has no shape, and links that may be elsewhere, a
    line each. Raises InvalidInput where coal is not installed.
    """

    def __init__(self, kinematics: Kinematics, terrain: Obstacles = Obstacles(convex=(), closed=())) -> None:
        self._coal, self._pin, self._of = coal(), pinocchio(), kinematics
        self.model = kinematics.model
        known = kinematics.known
        self._data, self._terrain = known.createData(), terrain
        shapes, missing = link_shapes(kinematics.model)
        self.missing = (*missing, *self.model.gaps)
        self.links = [shape.link for shape, _ in shapes]
        frames = [known.getFrameId(link, self._pin.FrameType.BODY) for link in self.links]
        self._frames, joints = frames, [known.frames[frame].parentJoint for frame in frames]
        self._turns = np.array([shape.rotation for shape, _ in shapes]).reshape(-1, 3, 3)
        self._origins = np.array([shape.origin_m for shape, _ in shapes]).reshape(-1, 3)
        self._geometry = [self._made(shape, points) for shape, points in shapes]
        points = [each for _, each in shapes]
        boxes = np.array([_box(geometry) for geometry in self._geometry]).reshape(-1, 2, 3)
        self._middles, self._halves = boxes[:, 0], boxes[:, 1]
        self._solids = [self._hull(each.solid.corners) for each in terrain.convex]
        spans = [(each.solid.corners.min(axis=0), each.solid.corners.max(axis=0)) for each in terrain.convex]
        self._spans = np.array(spans).reshape(-1, 2, 3)
        self._request, self._here = self._coal.DistanceRequest(), self._coal.Transform3s()
        self._request.enable_signed_distance, self._result = True, self._coal.DistanceResult()
        self._foot = feet_of([shape for shape, _ in shapes], self.model.legs, self.model.mounts)
        self._in_ground = (
            None if terrain.ground is None else LinksInGround(terrain.ground, points, self._foot, kinematics.radii_m)
        )
        disabled = self.model.disabled_pairs
        self._pairs = np.array(
            [
                (i, j) for i, j in combinations(range(len(joints)), 2)
                if not _neighbours(known, joints[i], joints[j])
                and frozenset((self.links[i], self.links[j])) not in disabled
            ], dtype=int,
        ).reshape(-1, 2)  # fmt: skip
        if self.model not in _DRAWN_SO:
            _DRAWN_SO[self.model] = self._always_inside()
        self.drawn_so = _DRAWN_SO[self.model]
        left_out = {frozenset(pair) for pair in self.drawn_so}
        kept = [(i, j) for i, j in self._pairs.tolist() if frozenset((self.links[i], self.links[j])) not in left_out]
        self._pairs = np.array(kept, dtype=int).reshape(-1, 2)

    def overlaps(self, body: WholeBody, *, terrain_m: float = TOUCH_M, links_m: float = LINKS_M) -> tuple[Overlap, ...]:
        """What is deeper than ``terrain_m`` in the terrain, and than ``links_m`` in another link, below 0 what is as
        near to it; the deepest first. A foot may be in the surface that it stands on."""
        turns, origins = self._in_world(body)
        meeting = [
            Overlap(link=self.links[i], other=self.links[j], depth_m=-self._distance(turns, origins, i, j))
            for i, j in self._meeting(turns, origins, self._pairs, max(-links_m, 0.0))
        ]
        found = [
            Overlap(
                link=self.links[i], other=self._terrain.convex[part].name,
                depth_m=-self._distance(turns, origins, i, part, terrain=True),
            )
            for i, part in self._in_terrain(turns, origins, 0.0)
        ]  # fmt: skip
        middles = origins + np.einsum("sij,sj->si", turns, self._middles)
        if self._in_ground is not None:
            reach = np.einsum("sij,sj->si", np.abs(turns), self._halves)
            below = self._in_ground.depths(turns, origins, middles - reach, middles + reach, body)
            found += [Overlap(link=self.links[i], other=Ground.name, depth_m=depth) for i, depth in below]
        for surface in self._terrain.closed:
            for i in np.flatnonzero(surface.holds(middles)):
                found.append(Overlap(link=self.links[i], other=surface.name, depth_m=surface.depth(middles[i])))
        both = ((found, terrain_m), (meeting, links_m))
        deep = [each for some, beyond_m in both for each in some if each.depth_m > beyond_m]
        return tuple(sorted(deep, key=lambda each: -each.depth_m))

    def between(self, first: WholeBody, last: WholeBody, links_m: float = LINKS_M) -> Iterator[tuple[float, Overlap]]:
        """Links that are deeper than ``links_m`` in each other on the way between two postures, on which joints turn
        evenly, and in neither of them, each with its share of the way.

        Two links d₁ and d₂ apart in the two postures, whose points go m in the body between them, are (d₁ + d₂ − m) / 2
        apart at least. Where that is not enough both halves of the way are looked at, too, as long as m is more than
        ``FINE`` of the tolerance.
        """
        placed = {0.0: self._placed(first.angles), 1.0: self._placed(last.angles)}
        parts = [(0.0, 1.0, self._pairs)]
        while parts:
            begin, end, pairs = parts.pop()
            near = list(self._crossing(placed[begin], placed[end], pairs, links_m))
            for *pair, depths, _ in near:
                at = begin if depths[0] > depths[1] else end
                if max(depths) > links_m and 0.0 < at < 1.0:
                    yield at, Overlap(link=self.links[pair[0]], other=self.links[pair[1]], depth_m=max(depths))
            left = [(i, j) for i, j, depths, way in near if max(depths) <= links_m and way > FINE * links_m]
            if left:
                middle = 0.5 * (begin + end)
                placed[middle] = self._placed(first.angles + middle * (last.angles - first.angles))
                parts += [(begin, middle, np.array(left)), (middle, end, np.array(left))]

    def _crossing(
        self, first: tuple[Array, Array], last: tuple[Array, Array], pairs: NDArray[np.int_], links_m: float
    ) -> Iterator[tuple[int, int, tuple[float, float], float]]:
        """Pairs of shapes, placed twice in the body, that may be deeper in each other in between; how deep they are in
        both, and how far their points go [m]."""
        corners = self._middles[:, None] + SIDES * self._halves[:, None]
        ends = [origins[:, None] + corners @ np.swapaxes(turns, 1, 2) for turns, origins in (first, last)]
        way = ARCS * np.linalg.norm(ends[1] - ends[0], axis=2).max(axis=1)[pairs].sum(axis=1)
        for row in np.flatnonzero(self._gaps(*first, pairs) < way - links_m).tolist():
            i, j = pairs[row].tolist()
            depths = -self._distance(*first, i, j), -self._distance(*last, i, j)
            if sum(depths) > 2.0 * links_m - way[row]:
                yield i, j, depths, float(way[row])

    def near(self, body: WholeBody, within_m: float) -> Iterator[Near]:
        """What is nearer to each other than this, of the pairs that ``overlaps`` looks at; of the terrain's convex
        parts alone, and of feet but those that they do not stand on."""
        turns, origins = self._in_world(body)
        parts = self._in_terrain(turns, origins, within_m)
        for terrain, pairs in (
            (False, self._meeting(turns, origins, self._pairs, within_m)),
            (True, ((i, part) for i, part in parts if not self._stands_on(i, part, body))),
        ):
            for i, j in pairs:
                distance = self._distance(turns, origins, i, j, terrain=terrain)
                if distance < within_m:
                    found = self._result
                    yield Near(
                        shape=i, other=-1 if terrain else j,
                        name=self._terrain.convex[j].name if terrain else self.links[j], distance_m=distance,
                        points_m=np.array([found.getNearestPoint1(), found.getNearestPoint2()]),
                        normal=-np.array(found.normal),
                    )  # fmt: skip

    def depth(self, overlap: Overlap, body: WholeBody) -> float:
        """How deep the link of an overlap is inside the same other thing in another posture, negative outside [m]; of
        the terrain the ground alone."""
        turns, origins = self._in_world(body)
        own, others = ([k for k, link in enumerate(self.links) if link == n] for n in (overlap.link, overlap.other))
        if self._in_ground is not None and overlap.other == Ground.name:
            return max(self._in_ground.depth(turns, origins, i) for i in own)
        return max(-self._distance(turns, origins, i, j) for i in own for j in others)

    def _in_world(self, body: WholeBody) -> tuple[Array, Array]:
        """R_WS and p_WS of every shape."""
        turns, origins = self._placed(body.angles)
        return body.rotation @ turns, body.origin_m + origins @ body.rotation.T

    def _meeting(
        self, turns: Array, origins: Array, pairs: NDArray[np.int_], within_m: float
    ) -> Iterator[tuple[int, int]]:
        """Pairs of shapes that no axis of either's box keeps farther apart than this."""
        yield from pairs[self._gaps(turns, origins, pairs) < within_m].tolist()

    def _gaps(self, turns: Array, origins: Array, pairs: NDArray[np.int_]) -> Array:
        """How far apart an axis of either's box keeps pairs of shapes at least, shape (P,) [m]."""
        first, second = pairs.T
        middles = origins + np.einsum("sij,sj->si", turns, self._middles)
        between = (middles[second] - middles[first])[:, None]
        a, b = turns[first], turns[second]
        across = np.abs(np.swapaxes(a, 1, 2) @ b)
        ha, hb = self._halves[first], self._halves[second]
        along_a = np.abs(between @ a)[:, 0] - ha - np.einsum("pij,pj->pi", across, hb)
        along_b = np.abs(between @ b)[:, 0] - hb - np.einsum("pij,pi->pj", across, ha)
        return np.asarray(np.maximum(along_a.max(axis=1), along_b.max(axis=1)))

    def _in_terrain(self, turns: Array, origins: Array, within_m: float) -> Iterator[tuple[int, int]]:
        """Shapes and parts of the terrain that no axis of the shape's box, and no face of the part, keeps farther
        apart than this."""
        middles = origins + np.einsum("sij,sj->si", turns, self._middles)
        reach = np.einsum("sij,sj->si", np.abs(turns), self._halves) + within_m
        low, high = middles - reach, middles + reach
        near = np.all((low[:, None] < self._spans[:, 1]) & (high[:, None] > self._spans[:, 0]), axis=2)
        for part in np.flatnonzero(near.any(axis=0)).tolist():
            solid, its = self._terrain.convex[part].solid, np.flatnonzero(near[:, part])
            support = np.vecdot(np.abs(solid.normals @ turns[its]), self._halves[its][:, None])
            gap = (middles[its] @ solid.normals.T - solid.offsets_m - support).max(axis=1)
            for i in its[gap < within_m].tolist():
                yield i, part

    def _stands_on(self, shape: int, part: int, body: WholeBody) -> bool:
        """Whether a shape is the foot of a limb that stands on a face of a part of the terrain."""
        limb, solid = self._foot[shape], self._terrain.convex[part].solid
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

    def _always_inside(self) -> tuple[tuple[str, str], ...]:
        """Links of which two shapes touch in every posture."""
        lower, upper = self._of.lower_rad, self._of.upper_rad
        spread = lower + (upper - lower) * _spread(POSTURES, len(lower))
        always = self._pairs
        for angles in [np.concatenate([leg.stance_rad for leg in self.model.legs]), *spread]:
            placed = self._placed(angles)
            touching = [pair for pair in self._meeting(*placed, always, 0.0) if self._distance(*placed, *pair) < 0.0]
            always = np.array(touching, dtype=int).reshape(-1, 2)
            if not touching:
                return ()
        named = (sorted((self.links[i], self.links[j]), key=self.links.index) for i, j in sorted(always.tolist()))
        return tuple(dict.fromkeys((one, other) for one, other in named))

    def _distance(self, turns: Array, origins: Array, shape: int, other: int, *, terrain: bool = False) -> float:
        """Between a shape and another one, or a part of the terrain, negative where one is inside the other [m]."""
        one = self._geometry[shape], self._coal.Transform3s(turns[shape], origins[shape])
        two = (
            (self._solids[other], self._here) if terrain
            else (self._geometry[other], self._coal.Transform3s(turns[other], origins[other]))
        )  # fmt: skip
        self._result.clear()
        return float(self._coal.distance(*one, *two, self._request, self._result))

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


def link_shapes(model: RobotModel) -> tuple[list[tuple[Shape, Array]], tuple[str, ...]]:
    """The shapes of a robot's links with points whose hulls they are, and what has no shape, one line each.

    Meshes that cannot be had have none, and long parts of legs that their file gives no shape.
    """
    found, missing = list[tuple[Shape, Array]](), dict[str, list[str]]()
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
