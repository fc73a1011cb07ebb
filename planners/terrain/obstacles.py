"""Solids of a terrain, which links may not enter.

A patch has thickness (``Patch.solid``, as the simulators have it). Patches that close around a
convex body are that body, and patches that close around another one have an inside besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..files.arrays import Array, cross, lengths
from .patch import Patch, Solid

if TYPE_CHECKING:
    from .heightfield import HeightField


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights that are solid below.

    Arguments:
        friction: Coulomb coefficient of all of it.
        doubt: why the heights are not where the ground is; empty where they are.
    """

    heights: HeightField
    friction: float = 1.0
    doubt: str = ""
    name: ClassVar[str] = "the ground"

    @cached_property
    def _spline(self) -> tuple[Array, tuple[Array, Array]]:
        """Control points and knots of the heights."""
        (control,), knots = self.heights.spline
        return control, knots

    def tops(self, low: Array, high: Array) -> Array:
        """Height above which no part of boxes is in it, corners of shape (S, 3) [m]: a spline is
        below its control points, those about a box alone where the box is not above all; shape (S,).
        """
        control, each = self._spline
        tops = np.full(len(low), control.max())
        near = np.flatnonzero(low[:, 2] < tops)
        (x0, x1), (y0, y1) = (
            [
                np.clip(np.searchsorted(knots, at[near, k], side="right") - 4, 0, len(knots) - 8)
                for at in (low, high)
            ]
            for k, knots in enumerate(each)
        )
        tops[near] = [
            control[a : b + 4, c : d + 4].max()
            for a, b, c, d in zip(*(line.tolist() for line in (x0, x1, y0, y1)), strict=True)
        ]
        return tops

    def depth(self, points: Array) -> Array:
        """Depth of points in it, along the normal where it is even, negative above, shape (…, 3) to
        (…) [m].
        """
        height, slope = self.heights.height_and_gradient(points[..., :2])
        return np.asarray((height - points[..., 2]) / np.sqrt(1.0 + np.vecdot(slope, slope)))

    @cached_property
    def _tops(self) -> Array:
        """The highest of the control points that the spline has over each cell of its knots, shape
        (X, Y) [m].
        """
        control, _ = self._spline
        rows = np.max([control[k : len(control) - 3 + k] for k in range(4)], axis=0)
        return np.asarray(np.max([rows[:, k : rows.shape[1] - 3 + k] for k in range(4)], axis=0))

    def depth_inside(self, points: Array) -> Array:
        """``depth`` of the points that are in it, and −inf of the others, shape (…, 3) to (…) [m].

        Points above all control points around them are above the spline, and are skipped; slopes
        are computed for points below the spline alone.
        """
        flat = points.reshape(-1, 3)
        depths = np.full(len(flat), -np.inf)
        _, knots = self._spline
        cells = [
            np.clip(np.searchsorted(lines, flat[:, k], side="right") - 4, 0, len(lines) - 8)
            for k, lines in enumerate(knots)
        ]
        low = np.flatnonzero(flat[:, 2] < self._tops[cells[0], cells[1]])
        low = low[self.heights.height(flat[low, :2]) > flat[low, 2]]
        if len(low):
            depths[low] = self.depth(flat[low])
        return depths.reshape(points.shape[:-1])

    def distance(self, points: Array) -> Array:
        """Distance of points from it, along the normal where it is even, negative inside, shape (…,
        3) to (…) [m].
        """
        return -self.depth(points)

    def even(self, spacing_m: float) -> tuple[Array, Array, Array]:
        """Heights on even grid lines at most this far apart: x, y and heights, shape (n,), (m,),
        (n, m) [m].
        """
        x, y = (
            np.linspace(a, b, int(np.ceil((b - a) / spacing_m)) + 1)
            for a, b in self.heights.domain_m
        )
        return x, y, self.heights.height(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))


_WELD_M = 1e-6
"""Corners of patches that are closer are one."""
_SAME_AREA = 1e-4
"""A convex body's patches are as large as its hull, up to this share."""
BLOCK = 10_000
"""So many triangles are looked at together, seen from some points."""
_INSIDE = 0.9
"""Winding number of a point that a closed surface holds: 1, less what the facets cover that readers
leave out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _ClosedSurface:
    """A surface around a body that is not convex.

    Arguments:
        triangles_m: outward by the order of corners, shape (T, 3, 3).
    """

    name: str
    triangles_m: Array

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Tell which points, shape (K, 3), are inside: by the winding number, the sum of the
        triangles' solid angles by 4π (Van Oosterom and Strackee, 1983; Jacobson et al., 2013).
        Shape (K,).
        """
        within = np.all(
            (points > self.triangles_m.min((0, 1))) & (points < self.triangles_m.max((0, 1))),
            axis=1,
        )
        inside, size = np.zeros(len(points), dtype=bool), 1 + BLOCK // len(self.triangles_m)
        open_ = np.flatnonzero(within)
        for block in (open_[begin : begin + size] for begin in range(0, len(open_), size)):
            a, b, c = (self.triangles_m[:, i] - points[block, None] for i in range(3))
            la, lb, lc = (lengths(v) for v in (a, b, c))
            volume = np.vecdot(a, cross(b, c))
            rest = la * lb * lc + np.vecdot(a, b) * lc + np.vecdot(b, c) * la + np.vecdot(c, a) * lb
            inside[block] = np.arctan2(volume, rest).sum(axis=1) / (2.0 * np.pi) > _INSIDE
        return inside

    def depth(self, point: Array) -> float:
        """Depth of a point that is inside behind the plane of the facet nearest to it, at least
        [m].
        """
        a, b, c = np.moveaxis(self.triangles_m, 1, 0)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        behind = np.vecdot(a - point, normals)
        return float(behind[behind > 0.0].min(initial=np.inf))


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacles:
    """All of a terrain.

    Arguments:
        convex: bodies.
        closed: surfaces whose inside is solid, too.
        ground: heights that are solid below.
    """

    convex: tuple[tuple[str, Solid], ...]
    closed: tuple[_ClosedSurface, ...]
    ground: Ground | None = None

    @classmethod
    def under(cls, terrain: HeightField) -> Obstacles:
        """A terrain of heights."""
        return cls(convex=(), closed=(), ground=Ground(terrain))

    @classmethod
    def of(cls, patches: Sequence[Patch]) -> Obstacles:
        """Obstacles of a course's terrain, named by the patches' numbers in it."""
        convex, closed = list[tuple[str, Solid]](), list[_ClosedSurface]()
        for group in _joined(patches):
            members = [patches[i] for i in group]
            name = (
                f"patch {group[0]}"
                if len(group) == 1
                else f"the body of patches {group[0]} to {group[-1]}"
            )
            corners = np.concatenate([patch.vertices_m for patch in members])
            if len(members) > 3 and _is_hull(corners, members):
                convex.append((name, Solid.of_corners(corners)))
                continue
            convex += [(f"patch {i}", patches[i].solid) for i in group]
            if len(members) > 3 and _closes(members):
                fans = [fan(patch) for patch in members]
                closed.append(_ClosedSurface(name=name, triangles_m=np.concatenate(fans)))
        return cls(convex=tuple(convex), closed=tuple(closed))


def _joined(patches: Sequence[Patch]) -> list[list[int]]:
    """Numbers of patches that share corners, group by group."""
    group, owners = list(range(len(patches))), dict[tuple[float, ...], int]()

    def first(index: int) -> int:
        while group[index] != index:
            group[index] = group[group[index]]
            index = group[index]
        return index

    for index, patch in enumerate(patches):
        for corner in np.round(patch.vertices_m / _WELD_M).tolist():
            group[first(owners.setdefault(tuple(corner), index))] = first(index)
    groups = dict[int, list[int]]()
    for index in range(len(patches)):
        groups.setdefault(first(index), []).append(index)
    return list(groups.values())


def _area(patch: Patch) -> float:
    ahead = np.roll(patch.vertices_m, -1, axis=0)
    middle = patch.vertices_m.mean(axis=0)
    return 0.5 * float(
        np.linalg.norm(np.cross(patch.vertices_m - middle, ahead - middle).sum(axis=0))
    )


def _is_hull(corners: Array, patches: Sequence[Patch]) -> bool:
    """All patches face outward on the hull of all of them, and leave nothing of it open."""
    flat = np.linalg.matrix_rank(corners - corners.mean(axis=0), tol=_WELD_M) < 3
    if flat or any(
        ((corners - patch.vertices_m[0]) @ patch.normal).max() > _WELD_M for patch in patches
    ):
        return False
    from scipy.spatial import ConvexHull  # slow to import

    return abs(ConvexHull(corners).area / sum(map(_area, patches)) - 1.0) < _SAME_AREA


def _closes(patches: Sequence[Patch]) -> bool:
    """Tell whether patches may be the outside of something: area vectors add up to none, the volume
    is positive.
    """
    areas = np.array([_area(patch) * patch.normal for patch in patches])
    middles = np.array([patch.vertices_m.mean(axis=0) for patch in patches])
    volume = float(np.vecdot(areas, middles - middles[0]).sum())
    return (
        bool(np.linalg.norm(areas.sum(axis=0)) < 0.01 * np.linalg.norm(areas, axis=1).sum())
        and volume > 0.0
    )


def fan(patch: Patch) -> Array:
    """The patch as triangles whose order turns about its normal, shape (U − 2, 3, 3)."""
    border = patch.vertices_m
    around = (
        np.cross(border - border[0], np.roll(border, -1, axis=0) - border[0]).sum(axis=0)
        @ patch.normal
    )
    border = border if around > 0.0 else border[::-1]
    return np.stack(
        [np.repeat(border[:1], len(border) - 2, axis=0), border[1:-1], border[2:]], axis=1
    )
