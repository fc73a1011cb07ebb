"""Links that are inside each other or inside the terrain, and their depth (coal, extra ``robots``).

Links are the shapes that their file says they collide with, meshes by their convex hulls, and where
a hull is much larger than its mesh and near to something, by convex parts. Pairs whose boxes some
axis of either keeps apart are clear (the separating-axis theorem); coal measures the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..terrain.obstacles import Ground, Obstacles
from ..terrain.patch import Solid, with_as_many_faces
from .contacts import Bounds, Index, LinksInGround, balls_apart, boxes_apart, feet_of, off_solids
from .inverse_kinematics import Near, Overlap, WholeBody
from .kinematics import Kinematics
from .leg import between_rotations
from .meshes import Shape
from .robot_model import RobotModel
from .urdf_reader import coal, pinocchio

ROOM_M = 1e-3
"""Links that come nearer to each other than this are too near: joints that follow to milliradians
make them touch."""
TOUCH_M, LINKS_M = 1e-3, 1e-4
"""A link this deep in the terrain only touches it, as terrain is known to a millimetre, and one this
near to it may touch: plans are bent for as much room; and links this deep inside each other: joint
angles, corners and coal's depths are ten times as exact. More presses them apart wherever it is
run."""
_FINE, _ARCS = 0.5, 1.01
"""Two links that go so much of the tolerance between two postures are not looked at in between;
points go so much farther on the arcs of joints than straight."""
_SIDES = np.array(list(product((-1.0, 1.0), repeat=3)))
"""Corners of a box in units of half its sides."""
_PARTS_M = 0.02
"""Where hulls are nearer than this, or inside each other, it is their parts that are measured
[m]."""
_POSTURES = 256
"""In so many postures two links touch before they are taken for drawn so."""
_FIRST = 8
"""In one of so many of them most links that are not drawn so are apart."""
_ALIGNED, _ON_M = 1.0 - 1e-6, 1e-4
"""Cosine between normals of one surface, and how far from it what stands on it may be [m]."""

BLOCK = 128
"""So many moments are looked at together."""

_DRAWN_SO: WeakKeyDictionary[RobotModel, tuple[tuple[str, str], ...]] = WeakKeyDictionary()
"""``Bodies.drawn_so`` of models that there are, each tried once: names, which follow from the model
alone, so that two threads that try one at a time write down the same."""


class Bodies:
    """A robot's links and a terrain.

    Not for use by several threads at once.

    drawn_so: pairs of links that are inside each other in the standing posture and in every other
    one that was tried, 256 all over the joints' limits: their file has them so, and they are left
    out, as neighbours and pairs that an SRDF disables are. missing: what has no shape, and links
    that may be elsewhere, a line each. Raises InvalidInput where coal is not installed.
    """

    def __init__(
        self, kinematics: Kinematics, terrain: Obstacles = Obstacles(convex=(), closed=())
    ) -> None:
        self._coal, self._of = coal(), kinematics
        self.model = kinematics.model
        known = kinematics.known
        self._terrain = terrain
        shapes, missing = self.model.link_shapes
        self.missing = (*missing, *self.model.gaps)
        self.links = [shape.link for shape, _ in shapes]
        body = pinocchio().FrameType.BODY
        joints = [known.frames[known.getFrameId(link, body)].parentJoint for link in self.links]
        mounts = [kinematics.model.mounts[link] for link in self.links]
        self._carriers = np.array([kinematics.carrier(mount) for mount in mounts], dtype=int)
        on = [(mount, shape) for mount, (shape, _) in zip(mounts, shapes, strict=True)]
        turns = [mount.rotation @ shape.rotation for mount, shape in on]
        self._turns = np.array(turns).reshape(-1, 3, 3)
        self._origins = np.array([mount.placed(shape.origin_m) for mount, shape in on]).reshape(
            -1, 3
        )
        self._geometry = [self._made(shape, points) for shape, points in shapes]
        self._parts = {
            k: _parts_of([(self._hull(part), part) for part in shape.parts_m])
            for k, (shape, _) in enumerate(shapes)
            if shape.parts_m
        }
        boxes = np.array([_box(geometry) for geometry in self._geometry]).reshape(-1, 2, 3)
        self._middles, self._halves = boxes[:, 0], boxes[:, 1]
        self._balls = np.array([shape.kind == "sphere" for shape, _ in shapes], dtype=bool)
        self._radii = np.where(
            self._balls, self._halves[:, 0], np.linalg.norm(self._halves, axis=1)
        )
        self._corners = (
            self._middles[:, None]
            + np.where(self._balls, 0.0, 1.0)[:, None, None] * _SIDES * self._halves[:, None]
        )
        solids = [solid for _, solid in terrain.convex]
        # bodies by number: the shapes of links, then the parts of the terrain
        self._geometry += [self._hull(solid.corners) for solid in solids]
        self._names = [*self.links, *(name for name, _ in terrain.convex)]
        spans = [(solid.corners.min(axis=0), solid.corners.max(axis=0)) for solid in solids]
        self._spans = np.array(spans).reshape(-1, 2, 3)
        self._faces = _faces(solids)
        self._request, self._here = self._coal.DistanceRequest(), self._coal.Transform3s()
        self._request.enable_signed_distance, self._result = True, self._coal.DistanceResult()
        self._foot = feet_of([shape for shape, _ in shapes], self.model.legs, self.model.mounts)
        self._in_ground = (
            None
            if terrain.ground is None
            else LinksInGround(
                terrain.ground, [each for _, each in shapes], self._foot, kinematics.radii_m
            )
        )
        disabled = self.model.disabled_pairs
        self._pairs = np.array(
            [
                (i, j)
                for i, j in combinations(range(len(joints)), 2)
                if joints[i] not in (joints[j], known.parents[joints[j]])
                and joints[j] != known.parents[joints[i]]  # bodies that a joint joins touch
                and frozenset((self.links[i], self.links[j])) not in disabled
            ],
            dtype=int,
        ).reshape(-1, 2)
        if self.model not in _DRAWN_SO:
            _DRAWN_SO[self.model] = self._always_inside()
        self.drawn_so = _DRAWN_SO[self.model]
        left_out = {frozenset(pair) for pair in self.drawn_so}
        kept = [frozenset(self.links[k] for k in pair) not in left_out for pair in self._pairs]
        self._pairs = self._pairs[np.array(kept, dtype=bool)]

    def overlaps(
        self, body: WholeBody, *, terrain_m: float = TOUCH_M, links_m: float = LINKS_M
    ) -> tuple[Overlap, ...]:
        """Find overlaps deeper than ``terrain_m`` in the terrain, and than ``links_m`` in another
        link, below 0 whatever is as near to it; the deepest first. A foot may touch what it stands
        on.
        """
        result = [each for _, each in self._swept(body.moments, terrain_m, links_m, between=False)]
        return tuple(sorted(result, key=lambda each: -each[0]))

    def sweep(
        self,
        bodies: WholeBody,
        *,
        terrain_m: float = TOUCH_M,
        links_m: float = LINKS_M,
        between: bool = True,
    ) -> Iterator[tuple[int, list[tuple[float, Overlap]]]]:
        """Find the overlaps of T postures, block by block.

        Arguments:
            bodies: a motion, on which joints turn evenly and the base goes straight from one moment
                to the next.
            between: whether what is deep nowhere but on the way from one moment to the next is
                found, too: in other links, and in convex parts of the terrain, by the usual
                tolerances where ``terrain_m`` and ``links_m`` are smaller.

        Yields:
            After how many moments, and the overlaps of the block, each with its moment, a fraction
            of the way for what is between.
        """
        begin, count = 0, len(bodies)
        while begin < count:
            first = max(begin - 1, 0) if between else begin
            end = min(begin + BLOCK, count)
            overlaps = self._swept(
                bodies.at(slice(first, end)), terrain_m, links_m, between=between
            )
            yield end, [(first + at, each) for at, each in overlaps if first + at > begin - 1]
            begin = end

    def near(self, bodies: WholeBody, within_m: float) -> list[tuple[int, Near]]:
        """Find the bodies that are nearer to each other than this, of the pairs that ``overlaps``
        looks at, with the number of its moment; of the terrain's convex parts alone, and of feet
        but those that they do not stand on.
        """
        result = list[tuple[int, Near]]()
        for begin in range(0, len(bodies), BLOCK):
            block = bodies.at(slice(begin, begin + BLOCK))
            world = self._in_world(block, self._placed(block.angles))
            links, parts = (
                self._links_apart(self._pairs, world, within_m),
                self._off_terrain(world, within_m),
            )
            parts[1].least[self._stand_on(block, parts[0])] = np.inf
            measurements = [
                (t, on, k, near)
                for on, pairs in enumerate((links, parts))
                for t, k, near in self._measured_near(world, *pairs, within_m)
            ]
            result += [
                (begin + t, near)
                for t, _, _, near in sorted(measurements, key=lambda each: each[:3])
            ]
        return result

    def depth(self, overlap: Overlap, body: WholeBody) -> float:
        """Depth of the link of an overlap inside the same other thing in another posture, negative
        outside [m]; of the terrain the ground alone.
        """
        one, (_, link, other) = body.moments, overlap
        world = self._in_world(one, self._placed(one.angles))
        shapes, others = (
            [k for k, link in enumerate(self.links) if link == n] for n in (link, other)
        )
        if self._in_ground is not None and other == Ground.name:
            return max(self._in_ground.depth(world[0][0], world[1][0], i) for i in shapes)
        apart = self._distances(world)
        return max(-apart(0, i, j) for i in shapes for j in others)

    def _placed(self, angles: Array) -> tuple[Array, Array]:
        """R_BS and p_BS of every shape at T postures, shapes (T, S, 3, 3) and (T, S, 3) [m]."""
        turns, places = self._of.carriers(angles)
        turns, places = turns[:, self._carriers], places[:, self._carriers]
        return turns @ self._turns, places + (turns @ self._origins[:, :, None])[..., 0]

    def _in_world(self, bodies: WholeBody, placed: tuple[Array, Array]) -> tuple[Array, Array]:
        """R_WS and p_WS of shapes that are placed in the base."""
        turns, origins = placed
        back = np.swapaxes(bodies.rotation, -1, -2)
        return bodies.rotation[..., None, :, :] @ turns, bodies.origin_m[
            ..., None, :
        ] + origins @ back

    def _middle(self, placed: tuple[Array, Array]) -> Array:
        """Middles of the boxes of shapes, shape (T, S, 3) [m]."""
        turns, origins = placed
        return np.asarray(origins + (turns @ self._middles[:, :, None])[..., 0])

    def _ways(self, placed: tuple[Array, Array]) -> Array:
        """Longest way of points of shapes from one moment to the next, shape (T − 1, S) [m]; of
        balls it is their centres that count.
        """
        turns, origins = placed
        ends = origins[:, :, None] + self._corners @ np.swapaxes(turns, -1, -2)
        moved = np.diff(ends, axis=0)
        return _ARCS * np.asarray(
            np.sqrt(np.einsum("tsci,tsci->tsc", moved, moved).max(axis=2, initial=0.0))
        )

    def _swept(
        self, bodies: WholeBody, terrain_m: float, links_m: float, *, between: bool
    ) -> Iterator[tuple[float, Overlap]]:
        """Overlaps that are too deep at some moment, or between two."""
        placed = self._placed(bodies.angles)
        world = self._in_world(bodies, placed)

        def in_base(t: Index, share: Array) -> tuple[Array, Array]:
            before, after = bodies.angles[t], bodies.angles[t + 1]
            return self._placed(before + share[:, None] * (after - before))

        def in_world(t: Index, share: Array) -> tuple[Array, Array]:
            turned = between_rotations(bodies.rotation[t], bodies.rotation[t + 1], share)
            moved = bodies.origin_m[t] + share[:, None] * (
                bodies.origin_m[t + 1] - bodies.origin_m[t]
            )
            return self._in_world(
                replace(bodies.at(t), rotation=turned, origin_m=moved), in_base(t, share)
            )

        kinds = (
            (
                placed,
                self._links_apart(self._pairs, placed, -links_m, between=between),
                (links_m, LINKS_M),
                in_base,
            ),
            (
                world,
                self._off_terrain(world, -terrain_m, between=between),
                (terrain_m, TOUCH_M),
                in_world,
            ),
        )
        for where, (pairs, bounds), limits_m, way in kinds:
            for t, k, depth_m in self._deep(
                where, pairs, bounds, limits_m, way if between else None
            ):
                yield t, (depth_m, self._names[pairs[k, 0]], self._names[pairs[k, 1]])
        yield from self._below(bodies, world, terrain_m)

    def _links_apart(
        self,
        pairs: NDArray[np.int_],
        placed: tuple[Array, Array],
        limit_m: float,
        *,
        between: bool = False,
    ) -> tuple[NDArray[np.int_], Bounds]:
        """Pairs of links, shape (K, 2), and what boxes and balls around them say of their
        distances.
        """
        middles, (first, second) = self._middle(placed), pairs.T
        exact = self._balls[first] & self._balls[second]
        least = balls_apart(middles, self._radii, pairs)
        bounds = Bounds(
            least=least,
            way=self._ways(placed)[:, pairs].sum(axis=2),
            exact=np.tile(exact, (len(least), 1)),
        )
        t, k = np.nonzero(bounds.nearer(limit_m, between=between) & ~exact)
        turns, i, j = placed[0], first[k], second[k]
        apart = boxes_apart(
            middles[t, j] - middles[t, i],
            (turns[t, i], self._halves[i]),
            (turns[t, j], self._halves[j]),
        )
        least[t, k] = np.maximum(least[t, k], apart)
        return pairs, bounds

    def _off_terrain(
        self, world: tuple[Array, Array], limit_m: float, *, between: bool = False
    ) -> tuple[NDArray[np.int_], Bounds]:
        """Pairs of shapes and parts of the terrain of which some may be nearer than that, shape (K,
        2), by part; and what boxes and balls say of their distances.
        """
        middles, ways = self._middle(world), self._ways(world)
        reach = (np.abs(world[0]) @ self._halves[:, :, None])[..., 0]
        reach[:, self._balls] = self._radii[self._balls, None]
        low, high = middles - reach, middles + reach
        room = max(limit_m, 0.0) + (float(ways.max(initial=0.0)) if between else 0.0)
        bottom, top = np.swapaxes(self._spans, 0, 1)
        close = np.all(
            (low.min(axis=0) - room < top[:, None]) & (high.max(axis=0) + room > bottom[:, None]),
            axis=2,
        )
        shape, part = np.argwhere(close)[:, ::-1].T
        least = np.maximum(low[:, shape] - top[part], bottom[part] - high[:, shape]).max(axis=2)
        exact = np.zeros(least.shape, dtype=bool)
        bounds = Bounds(least=least, way=ways[:, shape], exact=exact)
        open_ = bounds.nearer(limit_m, between=between)
        for parts, faces, offsets_m in self._faces:
            t, k = np.nonzero(open_ & np.isin(part, parts))
            if not len(t):
                continue
            s, of = shape[k], np.searchsorted(parts, part[k])
            normals, ball = faces[of], self._balls[s]
            supports = (np.abs(normals @ world[0][t, s]) @ self._halves[s][:, :, None])[..., 0]
            supports = np.where(ball[:, None], self._radii[s][:, None], supports)
            off, over = off_solids(middles[t, s], supports, normals, offsets_m[of])
            least[t, k], exact[t, k] = (
                np.where(ball & over, off, np.maximum(least[t, k], off)),
                ball & over,
            )
        return np.column_stack([shape, len(self.links) + part]), bounds

    def _deep(
        self,
        placed: tuple[Array, Array],
        pairs: NDArray[np.int_],
        bounds: Bounds,
        limits_m: tuple[float, float],
        between: Callable[[Index, Array], tuple[Array, Array]] | None,
    ) -> Iterator[tuple[float, int, float]]:
        """Find the pairs that are deeper than that, at which moments and, where that is known,
        where between two; and how deep.

        Arguments:
            limits_m: how deep; on ways as deep as the second of them at least.
            between: where shapes are between a moment and the next.
        """
        deep_m, on_way_m = limits_m[0], max(limits_m)

        numbers, apart_m = pairs.tolist(), self._distances(placed)

        def measure(t: int, k: int) -> float:
            return apart_m(t, *numbers[k])

        bounds = bounds.measured(measure, -deep_m, between=False)
        if between is not None:
            bounds = bounds.measured(measure, -on_way_m, between=True)
        least = bounds.least
        for moment, pair in np.argwhere(bounds.exact & (least < -deep_m)).tolist():
            yield moment, pair, -float(least[moment, pair])
        if between is None:
            return
        t, k = np.nonzero(least[:-1] + least[1:] < bounds.way - 2.0 * on_way_m)
        share, apart = (
            np.tile([0.0, 1.0], (len(t), 1)),
            np.stack([least[t, k], least[t + 1, k]], axis=1),
        )
        moving = pairs if np.all(pairs < len(self.links)) else pairs[:, :1]
        ends = [self._corners_of(between(t, share[:, end]), moving[k]) for end in range(2)]
        while len(t):  # every round halves the ways that the distances at their ends leave open
            gone = np.sqrt(np.square(ends[1] - ends[0]).sum(axis=3).max(axis=2)).sum(axis=1) * _ARCS
            open_ = (
                (apart.min(axis=1) >= -on_way_m)
                & (apart.sum(axis=1) < gone - 2.0 * on_way_m)
                & (gone > _FINE * on_way_m)
            )
            t, k, share, apart, ends = (
                t[open_],
                k[open_],
                share[open_],
                apart[open_],
                [end[open_] for end in ends],
            )
            middle, left = share.mean(axis=1), np.arange(len(t))
            halfway = between(t, middle)
            apart_m = self._distances(halfway)
            distances = np.array([apart_m(n, *numbers[k[n]]) for n in left.tolist()])
            deep = np.flatnonzero(distances < -on_way_m)
            yield from zip(
                (t[deep] + middle[deep]).tolist(),
                k[deep].tolist(),
                (-distances[deep]).tolist(),
                strict=True,
            )
            corners = self._corners_of(halfway, moving[k])
            share = np.concatenate(
                [np.stack([share[:, 0], middle], axis=1), np.stack([middle, share[:, 1]], axis=1)]
            )
            apart = np.concatenate(
                [
                    np.stack([apart[:, 0], distances], axis=1),
                    np.stack([distances, apart[:, 1]], axis=1),
                ]
            )
            ends = [np.concatenate([ends[0], corners]), np.concatenate([corners, ends[1]])]
            t, k = np.tile(t, 2), np.tile(k, 2)

    def _corners_of(self, placed: tuple[Array, Array], shapes: NDArray[np.int_]) -> Array:
        """Corners of the boxes of some shapes, shape (L, n), that are placed L times, shape (L, n,
        8, 3).
        """
        turns, origins = (part[np.arange(len(shapes))[:, None], shapes] for part in placed)
        return np.asarray(origins[:, :, None] + self._corners[shapes] @ np.swapaxes(turns, -1, -2))

    def _below(
        self, bodies: WholeBody, world: tuple[Array, Array], terrain_m: float
    ) -> Iterator[tuple[int, Overlap]]:
        """Links that are deeper than that in ground of heights, and links whose middle is inside of
        a closed surface.
        """
        middles = self._middle(world)
        if self._in_ground is not None:
            reach = (np.abs(world[0]) @ self._halves[:, :, None])[..., 0]
            for t, i, depth_m in self._in_ground.depths(
                *world, middles - reach, middles + reach, bodies
            ):
                if depth_m > terrain_m:
                    yield t, (depth_m, self.links[i], Ground.name)
        for surface in self._terrain.closed:
            for t, i in np.argwhere(
                surface.holds(middles.reshape(-1, 3)).reshape(middles.shape[:2])
            ).tolist():
                depth_m = surface.depth(middles[t, i])
                if depth_m > terrain_m:
                    yield t, (depth_m, self.links[i], surface.name)

    def _measured_near(
        self,
        world: tuple[Array, Array],
        pairs: NDArray[np.int_],
        bounds: Bounds,
        within_m: float,
    ) -> list[tuple[int, int, Near]]:
        """Pairs that are nearer, as moment, pair and distance."""
        result = list[tuple[int, int, Near]]()
        numbers, apart_m = pairs.tolist(), self._distances(world)

        def measure(t: int, k: int) -> float:
            i, j = numbers[k]
            distance = apart_m(t, i, j)
            if distance < within_m:
                points = np.array(
                    [self._result.getNearestPoint1(), self._result.getNearestPoint2()]
                )
                near = Near(
                    shape=i,
                    other=j if j < len(self.links) else -1,
                    name=self._names[j],
                    distance_m=distance,
                    points_m=points,
                    normal=-np.array(self._result.normal),
                )
                result.append((t, k, near))
            return distance

        unknown = replace(
            bounds, exact=np.zeros_like(bounds.exact)
        )  # where they are nearest is not said of balls
        unknown.measured(measure, within_m, between=False)
        return result

    def _stand_on(self, bodies: WholeBody, pairs: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Tell which shapes are feet of limbs that stand on a face of a part of the terrain, shape
        (T, K).
        """
        standing = np.zeros((len(bodies), len(pairs)), dtype=bool)
        for k, (shape, part) in enumerate(pairs.tolist()):
            limb, solid = self._foot[shape], self._terrain.convex[part - len(self.links)][1]
            if limb >= 0:
                along = bodies.normals[:, limb] @ solid.normals.T > _ALIGNED
                heights = bodies.toes_m[:, limb] @ solid.normals.T - solid.offsets_m
                on = np.any(along & (np.abs(heights) < _ON_M), axis=1) & (
                    heights.max(axis=1) < _ON_M
                )
                standing[:, k] = bodies.stands[:, limb] & on
        return standing

    def _always_inside(self) -> tuple[tuple[str, str], ...]:
        """Links of which two shapes touch in every posture."""
        lower, upper = self._of.lower_rad, self._of.upper_rad
        standing = np.concatenate([leg.stance_rad for leg in self.model.legs])
        turns, origins = self._placed(
            np.vstack([standing, lower + (upper - lower) * _spread(_POSTURES, len(lower))])
        )
        pairs = self._pairs
        for some in (slice(_FIRST), slice(_FIRST, None)):
            _, bounds = self._links_apart(pairs, (turns[some], origins[some]), 0.0)
            pairs = pairs[(bounds.least < 0.0).all(axis=0)]
        apart = self._distances((turns, origins))
        named = [
            sorted((self.links[i], self.links[j]), key=self.links.index)
            for i, j in pairs.tolist()
            if all(apart(t, i, j) < 0.0 for t in range(len(turns)))
        ]
        return tuple(dict.fromkeys((one, other) for one, other in named))

    def _distances(self, placed: tuple[Array, Array]) -> Callable[[int, int, int], float]:
        """The function of a moment and two bodies that measures how far they are apart, negative
        where one is inside the other [m].

        Arguments:
            placed: R and p of the S shapes at T moments, shapes (T, S, 3, 3) and (T, S, 3) [m].
        """
        (turns, origins), transform = placed, self._coal.Transform3s
        made = dict[tuple[int, int], Any]()

        def at(t: int, shape: int) -> Any:
            if shape >= len(self.links):
                return self._here
            if (result := made.get((t, shape))) is None:
                result = made[t, shape] = transform(turns[t, shape], origins[t, shape])
            return result

        def apart(t: int, shape: int, other: int) -> float:
            pose = turns[t], origins[t]
            return self._distance(pose, (at(t, shape), at(t, other)), shape, other)

        return apart

    def _distance(
        self,
        placed: tuple[Array, Array],
        transforms: tuple[Any, Any],
        shape: int,
        other: int,
    ) -> float:
        """Between two bodies.

        Arguments:
            placed: R and p of the S shapes at one moment.
        """
        (turns, origins), (here, there) = placed, transforms

        def between(one: Any, two: Any) -> float:
            self._result.clear()
            return float(self._coal.distance(one, here, two, there, self._request, self._result))

        apart_m = between(self._geometry[shape], self._geometry[other])
        if apart_m >= _PARTS_M or not {shape, other} & self._parts.keys():
            return apart_m

        def in_parts(of: int) -> tuple[tuple[Any, ...], Array, Array]:
            if of not in self._parts:  # one that has none may be anywhere
                return (self._geometry[of],), np.zeros((1, 3)), np.array([np.inf])
            geometry, middles, radii = self._parts[of]
            return geometry, middles @ turns[of].T + origins[of], radii

        parts, middles, radii = in_parts(shape)
        others, their_middles, their_radii = in_parts(other)
        apart = np.linalg.norm(middles[:, None] - their_middles, axis=2)
        far_m = apart - radii[:, None] - their_radii
        least, best, last = np.inf, (0, 0), (0, 0)
        for at in np.argsort(far_m, axis=None).tolist():
            i, j = divmod(at, len(others))
            if far_m[i, j] >= least:
                break
            last, apart_m = (i, j), between(parts[i], others[j])
            if apart_m < least:
                least, best = apart_m, last
        if last != best:  # the nearest points are those of the last that was measured
            between(parts[best[0]], others[best[1]])
        return least

    def _made(self, shape: Shape, points: Array) -> Any:
        """A shape as coal has it."""
        size = [float(x) for x in shape.size_m]
        if shape.kind == "mesh":
            return self._hull(points)
        return {
            "box": self._coal.Box,
            "sphere": self._coal.Sphere,
            "cylinder": self._coal.Cylinder,
            "capsule": self._coal.Capsule,
        }[shape.kind](*size)

    def _hull(self, points: Array) -> Any:
        corners = self._coal.StdVec_Vec3s()
        corners.extend(list(points))
        return self._coal.Convex.convexHull(corners, True, "Qt")


def _parts_of(parts: Sequence[tuple[Any, Array]]) -> tuple[tuple[Any, ...], Array, Array]:
    """Geometry of convex parts, and balls about them: middles, shape (P, 3), radii, (P,) [m]."""
    middles = np.array([corners.mean(axis=0) for _, corners in parts])
    radii = [
        np.linalg.norm(corners - middle, axis=1).max()
        for (_, corners), middle in zip(parts, middles, strict=True)
    ]
    return tuple(geometry for geometry, _ in parts), middles, np.array(radii)


def _faces(solids: Sequence[Solid]) -> list[tuple[NDArray[np.int_], Array, Array]]:
    """Faces n·x = d of parts of a terrain that have as many of them, F: parts by number, shape (K,),
    normals, shape (K, F, 3), and offsets, shape (K, F) [m].
    """
    return [
        (
            parts,
            np.array([solids[k].normals for k in parts.tolist()]),
            np.array([solids[k].offsets_m for k in parts.tolist()]),
        )
        for parts in with_as_many_faces(solids)
    ]


def _spread(count: int, dimension: int) -> Array:
    """Points all over the unit cube, shape (count, dimension): Kronecker's sequence of the roots of
    primes.
    """
    numbers = np.arange(2, 16 * (dimension + 4))
    primes = numbers[
        np.all((numbers % numbers[:, None] > 0) | (numbers <= numbers[:, None]), axis=0)
    ]
    return np.outer(np.arange(1, count + 1), np.sqrt(primes[:dimension])) % 1.0


def _box(geometry: Any) -> tuple[Array, Array]:
    """Middle and half sides of a shape's box in its own frame, shape (3,) each [m]."""
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    low, high = np.array(box.min_).ravel(), np.array(box.max_).ravel()
    return 0.5 * (low + high), 0.5 * (high - low)
