"""A passage: can a robot get from one place over a terrain to another, however it goes?

A course lays out key frames, a gait and candidates; a passage leaves all of that open, and is what a
person asks who gives a terrain, a start and a goal.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array, checked, checked_members, read_only
from ..files.codec import LATER, fields_to_json, from_json
from ..robot.model import Robot
from ..terrain.patch import Frame, Patch

FACING_UP = 0.3
"""Surfaces whose normals are steeper than this are no ground."""
_CRACK_M = 2e-3
"""Cracks as wide as this let nothing through [m]."""
_SAMPLE_M = 5e-3
"""Distance of the points of a border that are looked at [m]."""
_SMALL_M2 = 1e-6
"""Surfaces that overlap less are beside each other [m²]."""
_MOST_TOPS = 300
"""Of more surfaces above others none is known to be a top."""


def tops_of_solids(terrain: Sequence[Patch], footholds: Sequence[Patch]) -> frozenset[int]:
    """The tops of solids, by number in the terrain."""
    import shapely  # slow to import

    ground = {k: patch for k, patch in enumerate(terrain) if patch.normal[2] >= FACING_UP}
    upper = _above(ground, ground) - _above(ground, dict(enumerate(footholds)))
    if not 0 < len(upper) <= _MOST_TOPS:
        return frozenset()
    corners = np.concatenate([each.vertices_m[:, :2] for each in (*terrain, *footholds)])
    map_ = shapely.box(*corners.min(axis=0), *corners.max(axis=0))
    walls = [patch for patch in terrain if _upright(patch)]
    borders = {k: _Border(ground[k], ground, walls, map_) for k in upper}
    tops = set(upper)
    while leaky := {k for k in tops if not borders[k].closed(ground, tops)}:
        tops -= leaky
    return frozenset(tops)


def _height_of(patch: Patch, places: Array) -> Array:
    """Heights of a patch's plane at places, shape (…, 2) [m]."""
    away = places - patch.vertices_m[0, :2]
    return np.asarray(patch.vertices_m[0, 2] - away @ (patch.normal[:2] / patch.normal[2]))


def _above(surfaces: dict[int, Patch], others: dict[int, Patch]) -> set[int]:
    """Surfaces that have one of some others below them."""
    import shapely  # slow to import

    if not others:
        return set()
    numbers, below = list(surfaces), list(others.values())
    plans, plans_below, found = _plans(surfaces.values()), _plans(below), set()
    for i, j in shapely.STRtree(plans_below).query(plans).T:
        common = shapely.intersection(plans[i], plans_below[j])
        if common.area > _SMALL_M2:
            place = np.array(common.centroid.coords[0])
            if _height_of(surfaces[numbers[i]], place) > _height_of(below[j], place) + _CRACK_M:
                found.add(numbers[i])
    return found


def _plans(patches: Iterable[Patch]) -> NDArray[Any]:
    """The area covered by patches, seen from above."""
    import shapely  # slow to import

    return np.array([shapely.Polygon(each.vertices_m[:, :2]) for each in patches])


def _upright(patch: Patch) -> bool:
    """Tell whether a patch is seen as a line from above."""
    flat = patch.vertices_m[:, :2] - patch.vertices_m[:, :2].mean(axis=0)
    return bool(np.linalg.svd(flat)[1][1] <= 0.5 * _CRACK_M)


def _close(patch: Patch, flat: Array) -> bool:
    """Tell whether a patch may be near a polygon from above."""
    corners = patch.vertices_m[:, :2]
    apart = np.maximum(
        corners.min(axis=0) - flat.max(axis=0), flat.min(axis=0) - corners.max(axis=0)
    )
    return bool(np.all(apart <= 2.0 * _CRACK_M))


class _Border:
    """Points on the border of a surface, and how far up walls go there.

    Arguments:
        patch: the surface.
        ground: all that face up.
        walls: upright ones.
        map_: all of the terrain from above.
    """

    def __init__(
        self, patch: Patch, ground: dict[int, Patch], walls: Sequence[Patch], map_: Any
    ) -> None:
        import shapely  # slow to import

        flat = patch.vertices_m[:, :2]
        edges = np.roll(flat, -1, axis=0) - flat
        lengths = np.linalg.norm(edges, axis=1)
        counts = np.ceil(lengths / _SAMPLE_M).astype(int)
        shares = np.concatenate([(np.arange(n) + 0.5) / n for n in counts])
        points = np.repeat(flat, counts, axis=0) + shares[:, None] * np.repeat(
            edges, counts, axis=0
        )
        turn = 1.0 if shapely.Polygon(flat).exterior.is_ccw else -1.0
        outward = turn * np.column_stack([edges[:, 1], -edges[:, 0]])[lengths > 0.0]
        outward = np.repeat(outward / lengths[lengths > 0.0, None], counts[lengths > 0.0], axis=0)
        beside = points + 1.5 * _CRACK_M * outward
        on_map = shapely.contains_xy(map_, beside)
        self.points, self.beside, inside = (
            each[on_map] for each in (points, beside, points - 1.5 * _CRACK_M * outward)
        )
        self.top = _height_of(patch, self.points)
        near = [each for each in ground.values() if _close(each, flat)]
        self.lowest = np.maximum(_lowest(near, self.beside), _lowest(near, inside))
        self.walls = [_spans(wall, self.points) for wall in walls if _close(wall, flat)]

    def closed(self, ground: dict[int, Patch], tops: set[int]) -> bool:
        """Tell whether nothing gets below the surface, where it does not get below these tops."""
        import shapely  # slow to import

        up, before = self.lowest.copy(), np.full(len(self.top), np.nan)
        for k in tops:
            inside = shapely.contains_xy(_plans([ground[k]])[0], self.beside)
            up[inside] = np.maximum(up[inside], _height_of(ground[k], self.beside[inside]))
        while not np.array_equal(up, before):
            before = up
            for low, high in self.walls:
                up = np.where(low <= up + _CRACK_M, np.maximum(up, high), up)
        return bool(np.all(up >= self.top - _CRACK_M))


def _lowest(ground: Iterable[Patch], places: Array) -> Array:
    """Height of the lowest ground at places, −inf where there is none, shape (K,) [m]."""
    import shapely  # slow to import

    result = np.full(len(places), np.inf)
    for patch in ground:
        near = shapely.distance(_plans([patch])[0], shapely.points(places)) <= 0.5 * _CRACK_M
        result[near] = np.minimum(result[near], _height_of(patch, places[near]))
    return np.where(np.isinf(result), -np.inf, result)


def _spans(wall: Patch, points: Array) -> tuple[Array, Array]:
    """Heights from which and up to which a wall goes at points, inf and −inf where it is not, shape
    (K,) each [m].
    """
    flat, up = wall.vertices_m[:, :2], wall.vertices_m[:, 2]
    start = flat[np.argmax(np.linalg.norm(flat - flat[0], axis=1))]
    end = flat[np.argmax(np.linalg.norm(flat - start, axis=1))]
    along = (end - start) / np.linalg.norm(end - start)
    corners, where = (flat - start) @ along, (points - start) @ along
    at = np.clip(where, corners.min(), corners.max())
    near = np.linalg.norm(points - start - at[:, None] * along, axis=1) <= _CRACK_M
    low, high = np.full(len(points), np.inf), np.full(len(points), -np.inf)
    for t0, t1, z0, z1 in zip(corners, np.roll(corners, -1), up, np.roll(up, -1), strict=True):
        if t0 == t1:  # its ends are those of the edges beside it
            continue
        on = near & (min(t0, t1) <= at) & (at <= max(t0, t1))
        height = z0 + (at - t0) / (t1 - t0) * (z1 - z0)
        low[on], high[on] = np.minimum(low, height)[on], np.maximum(high, height)[on]
    return low, high


_NEAR = 0.2
_NEAREST_M = 0.06
"""Distance from start and goal at which a robot is there, in reaches of its feet from its centre of
mass, and the least one of a robot of size 1 [m]: a plan's last key frame may be so far from the
goal."""


def near_of(robot: Robot) -> float:
    """Horizontal distance from a place within which a robot's centre of mass is there [m]."""
    far = max(float(np.linalg.norm(limb.shoulder_m)) + limb.reach_m for limb in robot.limbs)
    return max(_NEAR * far, _NEAREST_M * robot.size)


@dataclass(frozen=True, kw_only=True, eq=False)
class Passage:
    """A robot, a terrain, and two places.

    Arguments:
        name: name of the terrain.
        robot: who goes.
        terrain: every surface there is.
        footholds: surfaces on which feet may stand.
        start_m, goal_m: places of the centre of mass, shape (2,) [m].
        near_m: horizontal distance within which it is there [m].
        frame: frame in which all of it is; None for the world.
        doubts: what the reader of the ground's file mended or left out, one line each.

    Raises:
        InvalidInput: for a wrong shape, and numbers out of range.
    """

    FORMAT: ClassVar = "stancekit/passage/1"

    name: str
    robot: Robot
    terrain: tuple[Patch, ...]
    footholds: tuple[Patch, ...]
    start_m: Array
    goal_m: Array
    near_m: float
    frame: Frame | None = None
    doubts: tuple[str, ...] = field(default=(), metadata=LATER)

    def __post_init__(self) -> None:
        for name, kind in (("terrain", Patch), ("footholds", Patch), ("doubts", str)):
            object.__setattr__(self, name, checked_members(getattr(self, name), kind, name))
        for name in ("start_m", "goal_m"):
            object.__setattr__(self, name, read_only(getattr(self, name), (2,), name))
        object.__setattr__(self, "near_m", checked(self.near_m, "near_m", least=0.0))

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return fields_to_json(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Passage:
        """Read what ``to_json`` wrote.

        Raises InvalidInput.
        """
        return from_json(cls, data)
