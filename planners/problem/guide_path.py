"""The guide path: where a robot's body can go over a terrain, from one place to another, and what
is in the way.

Places of the centre of mass are the nodes of a lattice. At a node every toe, as the robot stands,
needs a foothold close by, all at about one height, and no surface may be where the standing robot
is: its footprint, the hull of its joints, feet and base seen from above, is kept clear of
everything between its belly and its top (the Minkowski sum of a surface and the mirrored footprint,
Lozano-Pérez, 1983). Heights at a node are measured from the slope of the ground there: a plane is
as free as level ground, however steep. Ways are longer where footholds are rare and where solids
are near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput, NoPlace, PlanningFailed, check_time
from ..files.arrays import Array
from ..robot.model import Robot
from ..terrain.patch import Patch
from ..terrain.polygon import half_planes
from .standing_map import INFEASIBLE, UNLIKELY

if TYPE_CHECKING:
    from ..terrain.families import Terrain
    from ..terrain.heightfield import HeightField
    from .standing_map import StandingMap

LATTICE_M = 0.04
"""Between nodes [m]; more on terrains that have too many."""
_MOST_NODES = 150_000
_ASIDE = 0.35
"""Distance that a toe's foothold may have from where it likes to be, in reaches."""
_APART = (0.3, 0.5)
"""Height by which a foothold may be above or below the mean of all, in reaches: the second where
the first leaves no way."""
_STRIDES = (0.3, 0.5, 0.75)
"""The same where legs step over what is in their way."""
_STRAIGHT_M = 0.03
"""Points of the way this close to a straight line are left out [m]."""
_RARE = 3.0
"""A way costs so many times its length where every toe is as far aside as it may be."""
_ROOMS = ((0.0, np.inf), (0.06, 4.0), (0.12, 2.0), (0.18, 1.3))
"""How much room there is between footprint and solids [m], and what a way with less costs by its
length."""
_AVOIDED_M, _AVOIDED = 0.5, 6.0
"""About a place where a plan failed before a way costs so many times its length, so far around
[m]."""
_DOUBTED = 4.0
"""A way costs so many times its length where a map says that the robot is not likely to stand."""
_UPRIGHT = 0.3
"""Surfaces whose normals are steeper than this have one height at a place."""
_LEANS = 0.85
"""Surfaces whose normals are steeper than this, and not upright, are slopes to people (32°)."""
_BELLY, _TOP = 0.4, 0.5
"""Solids are in the way from so far below the centre of mass on, in heights of the body over its
toes, and up to so far above it, where nobody knows the robot's links."""
_OVER, _FARTHER = 0.08, 0.6
"""So far the trunk stays above what legs step over, in heights of the body over its toes, and what
``_ASIDE`` is then."""
_LIFTS = 0.8
"""So much of what legs are longer than the body is high it rises over what the trunk would meet."""
_NEXT_TO_M = 0.06
"""The ground that a solid stands on begins so near to it [m]."""
_ALIKE_M = 5e-3
"""Heights of a border that differ by less are one to people [m]."""
_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))
_TIE_DIGITS, _TIE = 6, 1e-6
"""Decimals of the costs of ways between nodes, in their spacing, and share of a cost: what only
rounding tells apart is alike."""
_TRIES = 32
"""So many straight parts are tried from a node of a way on."""
_NEAR, TURN_RAD = 6, np.pi / 4.0
"""The direction of a way at a node is that between nodes so far before and after it, to an eighth
of a turn."""
_MEASURED_M = 1e-3
"""Widths of gaps are measured to that [m]."""
_MOST_MEASURED = 20_000
"""So many places at most to each side of where there is no ground."""
_SHIFTS, _TURNED = 13, 8
"""So many lattices, each moved by other parts of its spacing along x and along y, measure a gap."""


class Overhead(str):
    """Words of a refusal for what is over a way and leaves room below, for a robot that is lower."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprint:
    """A standing robot from above.

    Arguments:
        toes_m: vectors from the centre of mass to the toes, shape (N, 3) [m].
        hull_m: convex hull of the whole robot, about the centre of mass, shape (K, 2) [m].
        low_m, high_m: lowest and highest height over the centre of mass at which solids are in its
            way [m].
        names: names of the limbs.
        reach_m: mean reach of the limbs [m].
        size: that of the robot, which the lengths of this page follow.
        belly_m: height of the trunk's lowest point over the centre of mass, where it is known [m].
        trunk_m: convex hull of the trunk, as ``hull_m``, where it is known.
        aside: distance that a toe's foothold may have from where it likes to be, in reaches.
        lift_m: height by which the body may rise over what its trunk would meet [m].
    """

    toes_m: Array
    hull_m: Array
    low_m: float
    high_m: float
    names: tuple[str, ...]
    reach_m: float
    belly_m: float = -np.inf
    size: float = 1.0
    trunk_m: Array | None = None
    aside: float = _ASIDE
    lift_m: float = 0.0

    @classmethod
    def of(cls, robot: Robot, toes_m: Array) -> Footprint:
        """The footprint of a robot that stands on these toes; of its toes alone where its legs are
        not known.
        """
        reach = float(np.mean([limb.reach_m for limb in robot.limbs]))
        down = float(np.abs(toes_m[:, 2]).mean())
        points, belly, high, under = [toes_m], -np.inf, _TOP * down, None
        try:
            from ..robot.kinematics import Kinematics

            known = Kinematics(robot)
            angles, _, _ = known.solve(np.zeros(3), np.zeros(3), toes_m)
            chains, trunk = known.chains(angles).reshape(-1, 3), np.zeros((0, 3))
            for shape, corners in known.model.link_shapes[0]:
                if known.model.mounts[shape.link].leg is None:
                    mount = known.model.mounts[shape.link]
                    at = corners @ shape.rotation.T + shape.origin_m
                    trunk = np.vstack([trunk, at @ mount.rotation.T + mount.origin_m])
            points.append(np.vstack([chains, trunk]) - robot.origin_m)
            high = float(points[1][:, 2].max())
            if len(trunk):
                own = points[1][len(chains) :]
                belly, under = float(own[:, 2].min()), _hull(own[:, :2])
        except InvalidInput:  # nobody knows its legs, or pinocchio is not there
            pass
        flat = np.concatenate(points)[:, :2]
        return cls(
            toes_m=toes_m,
            hull_m=_hull(flat),
            low_m=-_BELLY * down,
            high_m=high,
            names=tuple(limb.name for limb in robot.limbs),
            reach_m=reach,
            belly_m=belly,
            size=robot.size,
            trunk_m=under,
        )

    @classmethod
    def of_walker(cls, robot: Robot, yaw_rad: float) -> Footprint:
        """The footprint of a torso and its feet that faces so from x towards y [rad]."""
        toes = np.array([foot.nominal_m for foot in robot.feet])
        half = robot.trunk_half_m
        trunk = np.array([[x, y, 0.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
        turn = np.array(
            [
                [np.cos(yaw_rad), np.sin(yaw_rad), 0.0],
                [-np.sin(yaw_rad), np.cos(yaw_rad), 0.0],
                [0, 0, 1],
            ]
        )
        high = robot.stand_height_m
        return cls(
            toes_m=toes @ turn,
            hull_m=_hull((np.vstack([toes, trunk]) @ turn)[:, :2]),
            low_m=-_BELLY * high,
            high_m=_TOP * high,
            names=tuple(foot.name for foot in robot.feet),
            reach_m=high,
        )

    @property
    def down_m(self) -> float:
        """Height of the centre of mass over the toes in the mean [m]."""
        return float(np.abs(self.toes_m[:, 2]).mean())

    @property
    def free_m(self) -> float:
        """Height over the ground below which nothing is in its way [m]."""
        return self.down_m + self.low_m

    def stepping(self, step_m: float) -> Footprint:
        """The footprint of a robot whose legs step so high: what is no higher is in the way of its
        trunk alone.
        """
        return replace(self, low_m=max(self.low_m, min(self.belly_m, step_m - self.down_m)))

    def striding(self) -> Footprint:
        """The footprint of a robot whose legs step over whatever its trunk gets over, to footholds
        that are farther away; as it is where the trunk is unknown.
        """
        hull, low = self.trunk_m, self.belly_m - _OVER * self.down_m
        lift = _LIFTS * max(self.reach_m - self.down_m, 0.0)
        if hull is None:
            return self
        return replace(self, hull_m=hull, low_m=low, aside=_FARTHER, lift_m=lift)

    def level(self, z: Array, slope: Array) -> Array:
        """Height of the body over the plane of the ground through the middle of all toes, moved
        along this plane to below the body, shape (…) [m].

        Arguments:
            slope: gradient of the plane, shape (…, 2).
        """
        return np.asarray(z - slope @ self.toes_m[:, :2].mean(axis=0))

    @property
    def radius_m(self) -> float:
        """The farthest that it goes from the centre of mass [m]."""
        return float(np.linalg.norm(self.hull_m, axis=1).max())

    def width_m(self, ahead_rad: float) -> float:
        """Width across a way in this direction, from x towards y [m]."""
        return float(np.ptp(self.hull_m @ np.array([-np.sin(ahead_rad), np.cos(ahead_rad)])))

    def grown(self, room_m: float, scale: float = 1.0) -> Array:
        """The hull by a scale and with room around it, shape (K', 2) [m]."""
        if room_m <= 0.0:
            return scale * self.hull_m
        turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
        rim = room_m / np.cos(np.pi / 12) * np.column_stack([np.cos(turn), np.sin(turn)])
        return _hull((scale * self.hull_m[:, None] + rim).reshape(-1, 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class GuidePath:
    """A way of the body.

    Arguments:
        points_m: straight between them, shape (L, 3) [m].
        room_m: the least room between solids and footprint that it was asked for along it [m].
    """

    points_m: Array
    room_m: float

    @property
    def length_m(self) -> float:
        """Along it [m]."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


def guide_path(
    terrain: Terrain,
    footprint: Footprint,
    ends_m: Array,
    avoid_m: Sequence[Array] = (),
    standing: StandingMap | None = None,
    *,
    mirrored: bool = False,
    striding: bool = False,
) -> GuidePath:
    """The best way between two places, shape (2, 2) [m].

    Arguments:
        striding: legs step over what is in their way: surfaces are in that of the trunk alone.
        mirrored: whether the lattice begins at the terrain's left border, not at its right one.
        avoid_m: places (x, y) where a plan along another way failed.
        standing: map of where the robot can stand when it faces along x: a way costs more where it is
            not likely to, and most where standing there so is proved impossible, which another
            heading or height may lift.

    Raises:
        NoPlace: for a start or goal in a solid, or without footholds for all toes.
        InvalidInput: for one off the terrain.
        PlanningFailed: where no way is found; it names what is in the way and proves nothing.
    """
    start, goal = ends_m
    surfaces = [patch for _, patch in terrain.standing]
    first: InvalidInput | PlanningFailed | None = None
    footprint = footprint.striding() if striding else footprint
    for apart in _STRIDES if striding else _APART:
        for lowest in (False, True):
            lattice = _Lattice.over(
                terrain.patches, surfaces, footprint, apart, lowest=lowest, mirrored=mirrored
            )
            try:
                return lattice.way(start, goal, avoid_m, standing)
            except (NoPlace, PlanningFailed) as error:
                known = first is None or (
                    isinstance(first, NoPlace) and isinstance(error, PlanningFailed)
                )
                first = error if known else first
            if not lattice.layered:
                break
    assert first is not None
    raise first


def guide_over(
    heights: HeightField,
    footprint: Footprint,
    ends_m: Array,
    friction: float,
    avoid_m: Sequence[Array] = (),
) -> tuple[GuidePath, bool]:
    """Guide path over heights, and whether the straight way is as good.

    Ground that is steeper than friction holds is no foothold; what is higher than the robot's belly
    is a wall, as bars overhead are.
    """
    first: InvalidInput | PlanningFailed | None = None
    for apart in _APART:
        lattice = _Lattice.on(heights, footprint, apart, friction)
        try:
            return lattice.way(ends_m[0], ends_m[1], avoid_m), lattice.clear(ends_m)
        except (NoPlace, PlanningFailed) as error:
            first = first or error
    assert first is not None
    raise first


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lattice:
    """Nodes on an even grid from a corner, shape (2,) [m].

    Arguments:
        z_m: height of the body there, NaN where it cannot stand, shape (n, m).
        slope: gradient of the ground there, from which heights are measured, shape (n, m, 2).
        worth: cost of a way there by its length.
        missing: index of a toe that lacks a foothold, −1 for none.
        apart: truth values, True if footholds are too far above or below each other.
        apart_m: height by which they are too far apart, and so that of a step [m].
        room: number of the first of ``_ROOMS`` that there is not, by which surface, −1 for none.
        layered: whether footholds are above each other.
        heights_m: heights of the ground at the nodes, for a terrain of heights.
    """

    corner_m: Array
    spacing_m: float
    z_m: Array
    slope: Array
    worth: Array
    missing: NDArray[np.int_]
    apart: NDArray[np.bool_]
    apart_m: float
    room: NDArray[np.int_]
    by: NDArray[np.int_]
    layered: bool
    footprint: Footprint
    surfaces: Sequence[Patch]
    heights_m: Array | None = None

    @classmethod
    def over(
        cls,
        surfaces: Sequence[Patch],
        standing: Sequence[Patch],
        footprint: Footprint,
        apart: float,
        *,
        lowest: bool,
        mirrored: bool,
    ) -> _Lattice:
        """The lattice over footholds.

        Arguments:
            apart: how far one may be above or below the mean of all toes', in reaches.
            lowest: take the lowest of footholds above each other, not the highest.
        """
        reach, toes = footprint.reach_m, footprint.toes_m
        footprint = footprint.stepping(apart * reach)
        corners = np.concatenate([patch.vertices_m for patch in standing])[:, :2]
        room = float(np.abs(toes[:, :2]).max()) + footprint.aside * reach
        low, high = corners.min(axis=0) - room, corners.max(axis=0) + room
        spacing = max(LATTICE_M * footprint.size, float(np.sqrt(np.prod(high - low) / _MOST_NODES)))
        shape = np.ceil((high - low) / spacing).astype(int) + 1
        if mirrored:
            low[1] = high[1] - spacing * (shape[1] - 1)
        heights, slopes = _rastered(standing, low, spacing, shape)
        layered = bool(np.nanmax(heights[0] - heights[1], initial=0.0) > apart * reach)
        k = int(lowest)
        heights[k][_pits(heights[k], int(footprint.aside * reach / spacing), apart * reach)] = (
            np.nan
        )
        stood = cls._stood(heights[k], slopes[k], low, spacing, footprint, apart)
        rooms = [footprint.size * room for room, _ in _ROOMS]

        def room_at(z: Array) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
            return _room(surfaces, footprint, z, stood["slope"], low, spacing, rooms)

        blocked, by = room_at(stood["z_m"])
        if footprint.lift_m > 0.0 and (blocked == 0).any():
            over = (blocked == 0) & (room_at(stood["z_m"] + footprint.lift_m)[0] != 0)
            if over.any():
                stood["z_m"] = _lifted(stood["z_m"], over, footprint.lift_m, spacing)
                blocked, by = room_at(stood["z_m"])
        return cls(
            **stood | _worth(stood["worth"], blocked), by=by, layered=layered, surfaces=surfaces
        )

    @classmethod
    def on(
        cls, heights: HeightField, footprint: Footprint, apart: float, friction: float
    ) -> _Lattice:
        """The lattice over heights."""
        low, high = np.array(heights.domain_m).T
        spacing = max(LATTICE_M, float(np.sqrt(np.prod(high - low) / _MOST_NODES)))
        lines = [
            low[k] + spacing * np.arange(int((high[k] - low[k]) / spacing) + 1) for k in range(2)
        ]
        xy = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
        ground, slope = heights.height_and_gradient(xy.reshape(-1, 2))
        ground, slope = ground.reshape(xy.shape[:2]), slope.reshape(xy.shape)
        held = np.where(np.linalg.norm(slope, axis=-1) > friction, np.nan, ground)
        stood = cls._stood(held, slope, low, spacing, footprint, apart)
        body = footprint.level(stood["z_m"], stood["slope"])
        blocked = np.full(ground.shape, -1)
        for number in reversed(range(len(_ROOMS))):
            hull = footprint.grown(_ROOMS[number][0])
            highest = _highest(ground, hull, spacing, stood["slope"])
            blocked[highest > body + footprint.low_m] = number
        none = np.full(ground.shape, -1)
        return cls(
            **stood | _worth(stood["worth"], blocked),
            by=none,
            layered=False,
            surfaces=(),
            heights_m=ground,
        )

    @staticmethod
    def _stood(
        heights: Array,
        gradients: Array,
        low: Array,
        spacing: float,
        footprint: Footprint,
        apart: float,
    ) -> dict[str, Any]:
        """Places where the robot can stand, of footholds' heights and gradients at the nodes.

        The slope of the ground at a node is that of the plane nearest to all toes' footholds. They
        are too far apart as measured from as much of it as they rise themselves: on both sides of
        a step they are level.
        """
        from scipy.ndimage import distance_transform_edt  # slow to import

        reach, toes = footprint.reach_m, footprint.toes_m
        away, nearest = distance_transform_edt(np.isnan(heights), return_indices=True)
        aside = spacing * away / (footprint.aside * reach)
        close = np.where(aside <= 1.0, heights[tuple(nearest)], np.nan)
        shifts = np.round(toes[:, :2] / spacing).astype(int)
        each, costs = [], []
        for toe, shift in zip(toes, shifts, strict=True):
            each.append(_moved(close, shift, np.nan) - toe[2])
            costs.append(_moved(aside, shift, 1.0))
        levels = np.array(each)
        lacking = np.where(np.isnan(levels).any(axis=0), np.isnan(levels).argmax(axis=0), -1)
        z = levels.mean(axis=0)
        arms = spacing * (shifts - shifts.mean(axis=0))
        own = [_moved(gradients[(*nearest, k)], shift, 0.0) for shift in shifts for k in range(2)]
        own = np.array(own).reshape(len(toes), 2, *z.shape).mean(axis=0)
        slope, share = _slope(own, arms, levels - z)
        rise = np.einsum("nmk,tk->tnm", slope * share[..., None], arms)
        uneven = np.abs(levels - z - rise).max(axis=0) > apart * reach
        z[uneven], slope[uneven] = np.nan, 0.0
        worth = 1.0 + (_RARE - 1.0) * np.clip(np.mean(costs, axis=0), 0.0, 1.0)
        return {
            "corner_m": low,
            "spacing_m": spacing,
            "z_m": z,
            "slope": slope,
            "worth": worth,
            "missing": lacking,
            "apart": uneven,
            "apart_m": apart * reach,
            "footprint": footprint,
        }

    def clear(self, ends_m: Array) -> bool:
        """Tell whether the robot can stand, clear of solids, all along a straight way."""
        count = int(np.ceil(np.linalg.norm(ends_m[1] - ends_m[0]) / self.spacing_m)) + 1
        points = ends_m[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends_m[1] - ends_m[0])
        i, j = np.round((points - self.corner_m) / self.spacing_m).astype(int).T
        return bool(self.free[i, j].all())

    @property
    def free(self) -> NDArray[np.bool_]:
        """Nodes where the robot can stand, clear of solids."""
        return np.asarray(np.isfinite(self.z_m) & (self.room != 0))

    def way(
        self,
        start: Array,
        goal: Array,
        avoid_m: Sequence[Array],
        standing: StandingMap | None = None,
    ) -> GuidePath:
        """The cheapest way."""
        ends = [self._node(place, name) for place, name in ((start, "start"), (goal, "goal"))]
        if ends[0] == ends[1]:  # it stands still, or nearly so
            points = np.array([[*place, self._point(ends[0])[2]] for place in (start, goal)])
            number = int(self.room.ravel()[ends[0]])
            return GuidePath(points_m=points, room_m=_ROOMS[number - 1 if number > 0 else -1][0])
        worth = self.worth
        for place in avoid_m:
            off = np.linalg.norm(self._places() - place[:2], axis=-1)
            worth = np.where(off < _AVOIDED_M * self.footprint.size, _AVOIDED * worth, worth)
        free = self.free
        if standing is not None:
            verdict = standing.at(self._places(), 0.0)
            worth = np.where(verdict == UNLIKELY, _DOUBTED * worth, worth)
            worth = np.where(verdict == INFEASIBLE, _DOUBTED**2 * worth, worth)
        path = self._cheapest(ends, free, worth)
        if path is None:
            raise PlanningFailed(partial(self._refusal, start, goal, ends))
        points, rooms = self._shortened(path, worth, free)
        points[0, :2], points[-1, :2] = start, goal
        least = min(
            (_ROOMS[number - 1][0] for number in rooms if number > 0), default=_ROOMS[-1][0]
        )
        return GuidePath(
            points_m=_straightened(points, _STRAIGHT_M * self.footprint.size), room_m=least
        )

    @property
    def _border(self) -> tuple[Array, Array]:
        """Corners of a rectangle about the terrain, shape (2,) [m] each."""
        if self.heights_m is not None:
            return self.corner_m, self.corner_m + self.spacing_m * (np.array(self.z_m.shape) - 1)
        corners = np.concatenate([patch.vertices_m for patch in self.surfaces])[:, :2]
        return corners.min(axis=0), corners.max(axis=0)

    def _cheapest(self, ends: list[int], free: NDArray[np.bool_], worth: Array) -> list[int] | None:
        """Nodes of the cheapest way over free ones, None where there is none."""
        from scipy.sparse.csgraph import dijkstra  # slow to import

        shortest: Any = dijkstra
        graph = self._graph(np.where(free, self.z_m, np.nan), worth)
        cost, before = shortest(graph, indices=ends[0], return_predecessors=True, directed=False)
        if not np.isfinite(cost[ends[1]]):
            return None
        nodes = [ends[1]]
        while nodes[-1] != ends[0]:
            nodes.append(int(before[nodes[-1]]))
        return nodes[::-1]

    def _shortened(
        self, nodes: list[int], worth: Array, free: NDArray[np.bool_]
    ) -> tuple[Array, NDArray[np.int_]]:
        """Points of the way, shape (L, 3) [m], straight wherever that costs no more, and their
        ``room``.
        """
        places = np.array(np.unravel_index(nodes, self.z_m.shape)).T
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        costs = worth.ravel()[nodes]
        spent = np.concatenate([[0.0], np.cumsum(0.5 * steps * (costs[1:] + costs[:-1]))])
        parts, rooms, at, last = (
            [self._point(nodes[0])[None]],
            [self.room.ravel()[nodes[:1]]],
            0,
            len(nodes) - 1,
        )
        while at < last:
            for end in np.unique(np.geomspace(last, at + 1, _TRIES).astype(int))[::-1]:
                count = 2 if end == at + 1 else int(np.abs(places[end] - places[at]).max()) + 1
                line = np.linspace(places[at], places[end], count)
                rows = tuple(np.round(line).astype(int).T)
                rises = np.abs(np.diff(self.z_m[rows]))
                length = float(np.linalg.norm(places[end] - places[at]))
                cost = length * float(np.mean(0.5 * (worth[rows][1:] + worth[rows][:-1])))
                good = free[rows].all() and bool((rises <= self._rise(self.spacing_m)).all())
                if end == at + 1 or (good and cost <= (1.0 + _TIE) * (spent[end] - spent[at])):
                    break
            points = np.column_stack([self.corner_m + self.spacing_m * line, self.z_m[rows]])
            parts.append(points[1:])
            rooms.append(self.room[rows][1:])
            at = int(end)
        return np.concatenate(parts), np.concatenate(rooms)

    def _places(self) -> Array:
        """Places of the nodes, shape (n, m, 2) [m]."""
        i, j = np.meshgrid(*map(np.arange, self.z_m.shape), indexing="ij")
        return np.asarray(self.corner_m + self.spacing_m * np.stack([i, j], axis=-1))

    def _point(self, node: int) -> Array:
        i, j = np.unravel_index(node, self.z_m.shape)
        return np.array([*(self.corner_m + self.spacing_m * np.array([i, j])), self.z_m[i, j]])

    def _node(self, place: Array, name: str) -> int:
        """The node at a place.

        Raises NoPlace where the robot cannot stand, and InvalidInput for a place off the terrain.
        """
        at = np.round((place - self.corner_m) / self.spacing_m).astype(int)
        where = f"{name}: expected footholds for every toe about ({place[0]:g}, {place[1]:g})"
        if not np.isfinite(self.z_m).any():
            why = ": some are too far above or below the others" if self.apart.any() else ""
            raise NoPlace(f"{where}, got a terrain on which the robot can stand nowhere{why}")
        inside = bool(np.all((at >= 0) & (at < self.z_m.shape)))
        low, high = self._border
        beyond = float(np.linalg.norm(np.maximum(low - place, 0.0) + np.maximum(place - high, 0.0)))
        if beyond > 0.0:
            raise InvalidInput(  # whatever the stance
                f"{name}: expected a place on the terrain, got ({place[0]:g}, {place[1]:g}), "
                f"{beyond:.3g} m "
                "beyond its border"
            )
        if inside and self.free[tuple(at)]:
            return int(np.ravel_multi_index(tuple(at), self.z_m.shape))
        gaps = self.corner_m + self.spacing_m * np.argwhere(self.free) - place
        gap = float(np.linalg.norm(gaps, axis=1).min(initial=np.inf))
        nearest = f"the nearest place to stand is {gap:.3g} m away"
        if (solid_m := self._solid_at(place)) is not None:
            raise NoPlace(
                f"{name}: expected a place outside of solids, got ({place[0]:g}, {place[1]:g}) in "
                "the "
                f"solid that is {solid_m:.3g} m high; {nearest}"
            )
        if inside and np.isfinite(self.z_m[tuple(at)]):
            what = self._named(int(self.by[tuple(at)]), place)
            wanted = f"{name}: expected room for the robot about ({place[0]:g}, {place[1]:g})"
            raise NoPlace(type(what)(f"{wanted}, got a {what}; {nearest}"))
        lacking = int(self.missing[tuple(at)]) if inside else 0
        names = self.footprint.names
        reason = (
            f"none near that of {names[lacking]}"
            if lacking >= 0
            else "some too far above or below the others"
        )
        raise NoPlace(f"{where}, got {reason}; {nearest}")

    def _solid_at(self, place: Array) -> float | None:
        """Height of the solid that stands on the ground over a place [m]."""
        ground = self._ground(place, place)
        over = list[tuple[float, int]]()
        for number, patch in enumerate(self.surfaces):
            flat = patch.vertices_m[:, :2]
            if (
                patch.normal[2] < _UPRIGHT
                or np.any(place < flat.min(axis=0))
                or np.any(place > flat.max(axis=0))
            ):
                continue
            normals, offsets = half_planes(flat)
            top = float(patch.heights_at(place))
            if np.all(normals @ place < offsets) and top > ground + self.footprint.free_m:
                over.append((top, number))
        if not over:
            return None
        top, number = max(over)
        bar = any(  # a bar's underside: one may stand below it
            other.normal[2] <= -_UPRIGHT
            and np.all((place >= flat.min(axis=0)) & (place <= flat.max(axis=0)))
            and ground + 1e-3 < float(other.vertices_m[:, 2].min()) < top
            for other in self.surfaces
            for flat in [other.vertices_m[:, :2]]
        )
        return None if bar else top - ground

    def _ground(self, place: Array, at: Array) -> float:
        """Height of the ground at a place, as its slope goes on from the node that is nearest to
        another and can be stood at [m].
        """
        away = at - self._places()
        gaps = np.linalg.norm(place - self._places(), axis=-1)
        gaps[~np.isfinite(self.z_m)] = np.inf
        node = np.unravel_index(int(gaps.argmin()), gaps.shape)
        level = self.footprint.level(self.z_m[node], self.slope[node])
        about = float(level - self.footprint.down_m + self.slope[node] @ away[node])
        below = [
            float(patch.heights_at(at))
            for patch in self.surfaces
            if patch.normal[2] > _LEANS
            and np.linalg.norm(_nearest_in(patch.vertices_m[:, :2], at) - at) < _NEXT_TO_M
        ]
        near = [height for height in below if abs(height - about) < _ASIDE * self.footprint.reach_m]
        return min(near, key=lambda height: abs(height - about), default=about)

    def _named(self, number: int, place: Array) -> str:
        """Words for a surface: wall or bar, where near a place, and how high over the ground
        there.
        """
        if self.heights_m is not None:
            off = np.linalg.norm(self._places() - place, axis=-1)
            i, j = np.unravel_index(
                np.where(off < self.footprint.radius_m, self.heights_m, -np.inf).argmax(), off.shape
            )
            near = self.corner_m + self.spacing_m * np.array([i, j])
            return f"wall at {_at(near)}, {_m(self.heights_m[i, j] - self._ground(place, near))} m high"
        patch = self.surfaces[number]
        if _UPRIGHT < patch.normal[2] < _LEANS:
            at = _at(_nearest_on(patch.vertices_m[:, :2], place))
            return f"slope of {np.degrees(np.arccos(patch.normal[2])):.0f} degrees at {at}"
        tops = [_top_near(patch, place, self.footprint.radius_m)]
        for other in self.surfaces:  # of the sides of a solid the nearest
            if abs(other.vertices_m[:, 2].max() - patch.vertices_m[:, 2].max()) < _ALIKE_M:
                tops.append(_top_near(other, place, self.footprint.radius_m))
        tops = [each for each in tops if each[2] > tops[0][2] - _ALIKE_M]
        near, low, high = min(
            tops, key=lambda each: (round(float(np.linalg.norm(each[0] - place)), 3), each[1])
        )
        ground = self._ground(place, near)
        if low > ground + 0.02:
            heights = f"{_m(low - ground)} to {_m(high - ground)} m above the ground"
            return Overhead(f"bar at {_at(near)}, {heights}")
        return f"wall at {_at(near)}, {_m(high - ground)} m high"

    def _refusal(self, start: Array, goal: Array, ends: list[int]) -> str:
        """Refusal that says what is in the way, where every way is barred."""
        from scipy.ndimage import label  # slow to import

        known, free = np.where(np.isfinite(self.z_m), self.z_m, np.nanmean(self.z_m)), self.free
        barred = replace(self, z_m=np.full_like(known, float(np.nanmean(self.z_m))))
        through = barred._cheapest(ends, np.ones_like(free), np.where(free, 1.0, 30.0))
        head = f"no way from ({start[0]:g}, {start[1]:g}) to ({goal[0]:g}, {goal[1]:g})"
        reached = np.asarray(label(free, structure=np.ones((3, 3)))[0])
        region = reached == reached.ravel()[ends[0]]
        if through is None:
            return head
        node = next((each for each in through if not free.ravel()[each]), None)
        if node is None:  # heights alone: a slope or a step between places that can be stood at
            node = through[int(np.abs(np.diff(known.ravel()[through])).argmax())]
            place = self._point(node)[:2]
            return f"{head}: a step or slope of more than 45 degrees at {_at(place)}"
        i, j = np.unravel_index(node, free.shape)
        place = self.corner_m + self.spacing_m * np.array([i, j])
        at = through.index(node)
        near = [
            self._point(through[k])[:2]
            for k in (max(at - _NEAR, 0), min(at + _NEAR, len(through) - 1))
        ]
        width = self.footprint.width_m(
            round(float(np.arctan2(*(near[1] - near[0])[::-1])) / TURN_RAD) * TURN_RAD
        )
        around = float(np.linalg.norm(self._places()[region] - place, axis=-1).max(initial=0.0))
        beyond = f"no way round within {around:.2g} m"
        if np.isfinite(self.z_m[i, j]):
            what = self._named(int(self.by[i, j]), place)
            return type(what)(f"{head}: {what}: {beyond}{self._widest(ends, width)}")
        if self.missing[i, j] >= 0:
            toe = place + self.footprint.toes_m[int(self.missing[i, j]), :2]
            wall = self._wall_near(toe)
            if not wall:
                return f"{head}: {self._gap_at(toe, near[1] - near[0])}: {beyond}"
            return f"{head}: {wall}: {beyond}{self._widest(ends, width)}"
        wall = self._wall_near(place)
        gap = self._widest(ends, width) if wall else ""
        return f"{head}: {wall or self._step_near(place)}: {beyond}{gap}"

    def _gap_at(self, toe: Array, along: Array) -> str:
        """Words for where there is no ground below a toe: from where and how wide along the way, or
        that it goes on to the border.
        """
        ahead = along / max(float(np.linalg.norm(along)), 1e-9)
        low, high = self._border
        ground, aside = self._ground(toe, toe), _ASIDE * self.footprint.reach_m
        most = (aside, np.inf)  # the far side may be higher
        count = min(int(float(np.linalg.norm(high - low)) / _MEASURED_M), _MOST_MEASURED)
        ends = list[Array]()
        for way, above in zip((-ahead, ahead), most, strict=True):
            line = toe + way * _MEASURED_M * np.arange(count)[:, None]
            over = np.zeros(count, dtype=bool)
            for patch in self.surfaces:
                if patch.normal[2] > _LEANS:
                    normals, offsets = half_planes(patch.vertices_m[:, :2])
                    rise = (patch.centre_m[:2] - line) @ patch.normal[:2] / patch.normal[2]
                    inside = np.all(normals @ line.T <= offsets[:, None] + _MEASURED_M, axis=0)
                    height = patch.centre_m[2] + rise - ground
                    over |= inside & (height > -aside) & (height < above)
            if not over.any():
                return f"no ground beyond {_at(ends[0] if ends else toe)}"
            ends.append(line[int(over.argmax())])
        return f"gap at {_at(ends[0])}, {_m(float(np.linalg.norm(ends[1] - ends[0])))} m wide"

    def _step_near(self, place: Array) -> str:
        """Words for the step where the ground below the highest toe of the body at a place ends on
        the way to the lowest.
        """
        below = list[tuple[float, int, Array]]()
        for toe in place + self.footprint.toes_m[:, :2]:
            over = [
                (float(patch.centre_m[2] - (toe - patch.centre_m[:2]) @ slope), number, toe)
                for number, patch in enumerate(self.surfaces)
                if patch.normal[2] > _LEANS
                and np.linalg.norm(_nearest_in(patch.vertices_m[:, :2], toe) - toe) < _ALIKE_M
                for slope in [patch.normal[:2] / patch.normal[2]]
            ]
            below += [max(over, key=lambda each: each[0])] if over else []
        said = "higher than the legs can take"
        high, low = (
            pick(below, key=lambda each: each[0], default=(0.0, -1, place)) for pick in (max, min)
        )
        if high[1] == low[1]:
            return f"step at {_at(place)}, {said}"
        edge = _nearest_on(self.surfaces[high[1]].vertices_m[:, :2], low[2])
        return f"step at {_at(edge)}, {_m(high[0] - low[0])} m high, {said}"

    def _wall_near(self, place: Array) -> str:
        """The highest solid over the ground that is near to a place, for people; empty for none."""
        free, radius = self.footprint.free_m, self.footprint.radius_m
        if self.heights_m is not None:
            off = np.linalg.norm(self._places() - place, axis=-1)
            highest = self.heights_m[off < radius].max(initial=-np.inf)
            return self._named(-1, place) if highest > self._ground(place, place) + free else ""
        result = list[tuple[float, int]]()
        for number, patch in enumerate(self.surfaces):
            near = _nearest_on(patch.vertices_m[:, :2], place)
            if np.linalg.norm(near - place) >= radius:
                continue
            near, low, high = _top_near(patch, place, radius)
            ground = self._ground(place, near)
            below = low < ground + self.footprint.down_m + self.footprint.high_m
            if high > ground + free and below:
                result.append((float(np.ptp(patch.vertices_m[:, 2])), number))
        return self._named(max(result)[1], place) if result else ""

    def _widest(self, ends: list[int], width: float) -> str:
        """Width of the widest gap, where a narrower robot would have a way; empty where none would.

        Arguments:
            width: width of this robot across its way [m].
        """
        from scipy.ndimage import distance_transform_edt, label  # slow to import

        near = tuple(distance_transform_edt(np.isnan(self.z_m), return_indices=True)[1])
        corners, places = self._border, self._places()
        slope = self.slope[near]
        heights = self.z_m[near] + np.vecdot(slope, places - places[near])

        def passes(scale: float, shift: Array | float = 0.0) -> bool:
            hull, at = scale * self.footprint.hull_m, places + shift
            inside = np.all(
                (at + hull.min(axis=0) > corners[0]) & (at + hull.max(axis=0) < corners[1]),
                axis=-1,
            )
            if self.heights_m is None:
                blocked, _ = _room(
                    self.surfaces,
                    self.footprint,
                    heights,
                    slope,
                    self.corner_m + shift,
                    self.spacing_m,
                    rooms=(0.0,),
                    scale=scale,
                )
            else:
                hull = self.footprint.grown(0.0, scale)
                high_m = _highest(self.heights_m, hull, self.spacing_m, slope)
                body = self.footprint.level(heights, slope)
                blocked = np.where(high_m > body + self.footprint.low_m, 0, -1)
            parts = np.asarray(label(inside & (blocked != 0))[0]).ravel()
            return bool(parts[ends[0]] == parts[ends[1]] > 0)

        if not passes(1e-3) or passes(1.0):
            return ""
        widest = 0.0
        for k in range(_SHIFTS if self.heights_m is None else 1):  # nodes miss the middles of gaps
            shift = self.spacing_m * (np.array([1, _TURNED]) * k % _SHIFTS) / _SHIFTS
            low, high = widest, min(1.0, widest + 2.0 * self.spacing_m / width) if k else 1.0
            if k and not passes(min(low + _MEASURED_M / width, 1.0), shift):
                continue
            while (high - low) * width > _MEASURED_M:
                middle = 0.5 * (low + high)
                low, high = (middle, high) if passes(middle, shift) else (low, middle)
            widest = low
        if widest * width < self.spacing_m:
            return ""
        return f"; the robot is {_m(width)} m wide across it, and the widest gap about {_m(widest * width)} m"

    def _rise(self, ahead_m: float) -> float:
        """Rise of the body over so far ahead that is no wall: that of 45 degrees, or of a step [m]."""
        return max(ahead_m, self.apart_m)

    def _graph(self, z: Array, worth: Array) -> Any:
        """Ways between neighbouring nodes, by what they cost."""
        from scipy.sparse import coo_array  # slow to import

        index = np.arange(z.size).reshape(z.shape)
        ones, others, costs = [], [], []
        for step in _STEPS:
            here, there = _pair(z.shape, step)
            rise = np.abs(z[there] - z[here])
            flat = self.spacing_m * float(np.hypot(*step))
            good = rise <= self._rise(flat)
            ones.append(index[here][good])
            others.append(index[there][good])
            cost = np.hypot(flat, rise) * 0.5 * (worth[here] + worth[there])
            costs.append(np.round(cost[good] / self.spacing_m, _TIE_DIGITS))
        pairs = np.concatenate(ones), np.concatenate(others)
        return coo_array((np.concatenate(costs), pairs), shape=(z.size, z.size)).tocsr()


def _lifted(z: Array, met: NDArray[np.bool_], lift_m: float, spacing: float) -> Array:
    """Heights of a body that rises so far where its trunk would meet something, and on the way
    there and from there by no more than goes ahead, shape (n, m) [m].
    """
    from scipy.ndimage import distance_transform_edt  # slow to import

    return np.asarray(z + np.maximum(lift_m - spacing * distance_transform_edt(~met), 0.0))


def _worth(worth: Array, blocked: NDArray[np.int_]) -> dict[str, Any]:
    """Cost of a way by its length where there is so much room."""
    for number, (_, factor) in enumerate(_ROOMS):
        if np.isfinite(factor):
            worth = np.where(blocked == number, factor * worth, worth)
    return {"worth": worth, "room": blocked}


def _pits(heights: Array, size: int, deep_m: float) -> NDArray[np.bool_]:
    """Tell which footholds are deep in a trench or a pit that toes step over, to a foothold that is
    no farther than so many nodes away.
    """
    from scipy.ndimage import maximum_filter, minimum_filter  # slow to import

    known = np.pad(np.where(np.isnan(heights), -np.inf, heights), size, constant_values=-np.inf)
    closed = minimum_filter(maximum_filter(known, 2 * size + 1), 2 * size + 1)
    inner = slice(size, -size or None)
    return np.asarray(closed[inner, inner] > heights + deep_m)


def _slope(own: Array, arms: Array, levels: Array) -> tuple[Array, Array]:
    """Gradient of the plane nearest to all toes' footholds, shape (n, m, 2), and the share of it that
    the ground itself has, shape (n, m).

    Arguments:
        own: gradient of the ground below the toes in the mean, shape (2, n, m).
        arms: places of the toes about their middle, shape (N, 2) [m].
        levels: heights of the footholds about their mean, shape (N, n, m) [m].
    """
    own = np.moveaxis(own, 0, -1)
    fit = np.linalg.pinv(arms, rcond=0.1)
    along = np.einsum("kt,tnm->nmk", fit, levels)
    along += own @ (np.eye(2) - fit @ arms).T  # across toes in one line
    squares = np.vecdot(along, along)
    share = np.clip(np.vecdot(own, along) / np.where(squares > 0.0, squares, 1.0), 0.0, 1.0)
    return np.nan_to_num(along), np.nan_to_num(share)


def _room(
    surfaces: Sequence[Patch],
    footprint: Footprint,
    z: Array,
    slope: Array,
    low: Array,
    spacing: float,
    rooms: Sequence[float],
    scale: float = 1.0,
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """At every node the number of the first of ``rooms`` [m] that is not there, and which surface
    takes it, of several the highest; −1 for none.

    Arguments:
        z: height of the body, shape (n, m).
        slope: gradient of the ground below it, shape (n, m, 2).
        scale: factor on the footprint.
    """
    blocked, by = np.full(z.shape, -1), np.full(z.shape, -1)
    if not np.isfinite(z).any():
        return blocked, by
    z = footprint.level(z, slope)
    lowest, highest = float(np.nanmin(z)) + footprint.low_m, float(np.nanmax(z)) + footprint.high_m
    spans = [(patch.vertices_m[:, 2].min(), patch.vertices_m[:, 2].max()) for patch in surfaces]
    order = sorted(range(len(surfaces)), key=lambda i: spans[i][1] - spans[i][0])
    hulls = [-footprint.grown(room, scale) for room in rooms]
    radii = [float(np.linalg.norm(hull, axis=1).max()) for hull in hulls]
    most = max(radii) * float(np.linalg.norm(slope, axis=-1).max())
    near = [i for i in order if spans[i][1] > lowest - most and spans[i][0] < highest + most]
    for number in reversed(range(len(rooms))):
        for i in near:
            check_time(doing="while a way of the body was looked for")
            window = _window(surfaces[i], hulls[number], low, spacing, z.shape)
            body, ground = z[window], slope[window]
            bottom, top = _span(surfaces[i], ground, window, low, spacing)
            normal = surfaces[i].normal
            if abs(normal[2]) > _UPRIGHT:
                steep = radii[number] * np.linalg.norm(ground + normal[:2] / normal[2], axis=-1)
                plane = surfaces[i].heights_at(_xy(window, low, spacing))
                bottom, top = np.maximum(plane - steep, bottom), np.minimum(plane + steep, top)
            hit = (top > body + footprint.low_m) & (bottom < body + footprint.high_m)
            if hit.any():
                hit &= _covered(surfaces[i], hulls[number], window, low, spacing)
                blocked[window][hit], by[window][hit] = number, i
    return blocked, by


def _span(
    patch: Patch, slope: Array, window: tuple[slice, slice], low: Array, spacing: float
) -> tuple[Array, Array]:
    """The lowest and the highest of a surface's corners, moved along the slope of the ground at
    each node of a window to that node [m].
    """
    corners = patch.vertices_m
    if not slope.any():
        return corners[:, 2].min(), corners[:, 2].max()
    bottom, top = np.full(slope.shape[:2], np.inf), np.full(slope.shape[:2], -np.inf)
    for corner in corners:
        over = corner[2] - slope @ corner[:2]
        np.minimum(bottom, over, out=bottom)
        np.maximum(top, over, out=top)
    fallen = np.vecdot(slope, _xy(window, low, spacing))
    return bottom + fallen, top + fallen


def _highest(heights: Array, hull: Array, spacing: float, slope: Array) -> Array:
    """The highest of the heights below a hull about every node, moved along the slope of the ground
    there to that node, shape (n, m) [m].
    """
    from scipy.ndimage import maximum_filter  # slow to import

    size = int(np.ceil(np.linalg.norm(hull, axis=1).max() / spacing))
    line = spacing * np.arange(-size, size + 1)
    normals, offsets = half_planes(hull)
    mask = np.all(
        np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1) @ normals.T <= offsets, axis=-1
    )
    if not slope.any():
        return np.asarray(maximum_filter(heights, footprint=mask, mode="nearest"))
    padded, highest = np.pad(heights, size, mode="edge"), np.full(heights.shape, -np.inf)
    for k, m in np.argwhere(mask):
        fallen = slope[..., 0] * line[k] + slope[..., 1] * line[m]
        there = padded[k : k + len(heights), m : m + heights.shape[1]]
        np.maximum(highest, there - fallen, out=highest)
    return highest


def _window(
    patch: Patch, hull: Array, low: Array, spacing: float, shape: tuple[int, ...]
) -> tuple[slice, slice]:
    """Nodes about the sum of a surface, from above, and a hull."""
    flat = patch.vertices_m[:, :2]
    corners = flat.min(axis=0) + hull.min(axis=0), flat.max(axis=0) + hull.max(axis=0)
    first = np.clip(np.ceil((corners[0] - low) / spacing).astype(int), 0, shape)
    last = np.clip(np.floor((corners[1] - low) / spacing).astype(int) + 1, first, shape)
    return slice(first[0], last[0]), slice(first[1], last[1])


def _covered(
    patch: Patch, hull: Array, window: tuple[slice, slice], low: Array, spacing: float
) -> NDArray[np.bool_]:
    """Tell which nodes of a window are in the sum of a surface, from above, and a hull."""
    area = _hull((patch.vertices_m[:, None, :2] + hull).reshape(-1, 2))
    normals, offsets = half_planes(area)
    return np.asarray(np.all(_xy(window, low, spacing) @ normals.T <= offsets, axis=-1))


def _xy(window: tuple[slice, slice], low: Array, spacing: float) -> Array:
    """Places of a window's nodes, shape (n, m, 2) [m]."""
    axes = [np.arange(part.start, part.stop) for part in window]
    return np.asarray(low + spacing * np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))


def _hull(points: Array) -> Array:
    """Corners of the convex hull, shape (K, 2), counter-clockwise."""
    from scipy.spatial import ConvexHull  # slow to import

    return np.asarray(points[ConvexHull(points).vertices])


def _nearest_on(polygon: Array, place: Array) -> Array:
    """The point of a polygon's border that is nearest to a place, shape (2,)."""
    ahead = np.roll(polygon, -1, axis=0) - polygon
    share = np.clip(
        np.vecdot(place - polygon, ahead) / np.maximum(np.vecdot(ahead, ahead), 1e-12), 0.0, 1.0
    )
    points = polygon + share[:, None] * ahead
    return np.asarray(points[int(np.linalg.norm(points - place, axis=1).argmin())])


def _nearest_in(polygon: Array, place: Array) -> Array:
    """The point of a convex polygon that is nearest to a place, shape (2,)."""
    normals, offsets = half_planes(polygon)
    return place if np.all(normals @ place <= offsets) else _nearest_on(polygon, place)


def _top_near(patch: Patch, place: Array, radius_m: float) -> tuple[Array, float, float]:
    """The highest point of a surface's border near a place, from above, shape (2,), of several the
    nearest, and the lowest and the highest height of the border there [m].

    Arguments:
        radius_m: points this much farther away than the nearest are near, too.
    """
    starts, ends = patch.vertices_m, np.roll(patch.vertices_m, -1, axis=0)
    count = int(np.ceil(np.linalg.norm(ends - starts, axis=1).max() / 0.01)) + 1
    points = (starts + np.linspace(0.0, 1.0, count)[:, None, None] * (ends - starts)).reshape(-1, 3)
    away = np.linalg.norm(points[:, :2] - place, axis=1)
    points = points[away <= away.min() + radius_m]
    points = points[points[:, 2] >= points[:, 2].max() - _ALIKE_M]
    top = points[np.linalg.norm(points[:, :2] - place, axis=1).argmin()]
    run = ends - starts
    share = np.vecdot(top[:2] - starts[:, :2], run[:, :2]) / np.maximum(
        np.vecdot(run[:, :2], run[:, :2]), 1e-12
    )
    levels = starts + np.clip(share, 0.0, 1.0)[:, None] * run
    there = np.linalg.norm(levels[:, :2] - top[:2], axis=1) < _ALIKE_M
    return top[:2], float(levels[there, 2].min()), float(top[2])


def _at(place: Array) -> str:
    """A place in words, to 1 cm."""
    return f"({_m(place[0])}, {_m(place[1])})"


def _m(value: float) -> str:
    """A length in words, to 1 cm."""
    return f"{round(float(value), 2) + 0.0:g}"


def _rastered(
    patches: Sequence[Patch], low: Array, spacing: float, shape: Array
) -> tuple[Array, Array]:
    """The height of the highest and of the lowest of patches at every node, NaN where there is
    none, shape (2, n, m) [m], and their gradients, shape (2, n, m, 2).
    """
    heights, slopes = np.full((2, *shape), np.nan), np.zeros((2, *shape, 2))
    for patch in patches:
        if patch.normal[2] < 1e-3:
            continue
        flat = patch.vertices_m[:, :2]
        (i0, j0), (i1, j1) = (
            np.floor((flat.min(axis=0) - low) / spacing),
            np.ceil((flat.max(axis=0) - low) / spacing) + 1.0,
        )
        window = (slice(int(i0), int(i1)), slice(int(j0), int(j1)))
        normals, offsets = half_planes(flat)
        inside = np.all(_xy(window, low, spacing) @ normals.T <= offsets + 1e-9, axis=-1)
        z = patch.heights_at(_xy(window, low, spacing))
        slope = -patch.normal[:2] / patch.normal[2] + 0.0
        for k, sign in enumerate((1.0, -1.0)):
            known = heights[k][window]
            new = inside & ~(sign * z <= sign * known)
            known[new], slopes[k][window][new] = z[new], slope
    return heights, slopes


def _moved(values: Array, shift: NDArray[np.int_], beyond: float) -> Array:
    """values at (i, j) + shift, and ``beyond`` where that is none."""
    values_moved = np.full(values.shape, beyond)
    here, there = _pair(values.shape, (int(shift[0]), int(shift[1])))
    values_moved[here] = values[there]
    return values_moved


def _pair(
    shape: tuple[int, ...], step: tuple[int, int]
) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of nodes, and of those a step away."""
    here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, shape, strict=True))
    there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, shape, strict=True))
    return here, there


def _straightened(points: Array, off_m: float) -> Array:
    """The way without points that are close to straight lines between the others (Douglas and
    Peucker).
    """
    if len(points) < 3:
        return points
    line = points[-1] - points[0]
    about = points - points[0]
    share = np.clip(about @ line / max(float(line @ line), 1e-12), 0.0, 1.0)
    off = np.linalg.norm(about - share[:, None] * line, axis=1)
    farthest = int(np.round(off / off_m, _TIE_DIGITS).argmax())
    if off[farthest] <= off_m:
        return points[[0, -1]]
    return np.concatenate(
        [_straightened(points[: farthest + 1], off_m)[:-1], _straightened(points[farthest:], off_m)]
    )
