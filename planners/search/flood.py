"""Search for a proof that no balanced motion leads through a passage: a flood.

A state is a place of the centre of mass, a cell of a raster, and a set of surfaces that feet touch.
From a state the robot gets to a neighbouring cell on the same surfaces, or to the same cell with one
surface more or fewer. A state is left out where one of these cannot be, each a relaxation of what a
robot can do, tilted and turned in any way:

* reach: a contact is farther from every centre of mass over the cell than any foot gets;
* two feet: two surfaces are farther apart than two feet get;
* balance: forces in friction cones on these surfaces do not hold the weight there. In a horizontal
  direction d, forces f_k at p_k with Σ f_k = W e_z and Σ p_k × f_k = c × W e_z give, for any z₀,
  W d·c = Σ f_kz d·p_k − (p_kz − z₀) d·f_k ≤ W max_k (d·p_k + κ_k |p_kz − z₀|), κ_k the tangent of
  slope and friction together;
* trunk: a ball about the centre of mass that is inside of the trunk is above the ground; a centre
  that may be outside is assumed to be no deeper in it than twice as far, where there is no proof
  without that. That is what bars walls.

Where the states that are reached from the start do not hold the goal, they are a certificate, which
``verify.flood`` replays with code of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Certificate
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem.passage import FACING_UP, Passage, tops_of_solids
from ..robot.outer_sets import Extent
from ..terrain.patch import Patch
from ..terrain.polygon import half_planes
from ..verify.flood import KINDS, MOST_SPACING_M, STEEPEST_RAD, check_flood

_FINEST_M, _MOST_CELLS = 0.005, 300_000
"""Spacing of the raster [m], and how many cells it has at most."""
_MOST_NODES, _MOST_PIECES = 7, 600
"""Surfaces are put together until there are so few; more footholds than this are not looked at."""
_DIRECTIONS = 32
_TOGETHER_M, _SAME_M, _SAME_COS = 0.06, 0.01, 0.9994
"""Pieces of one plane, to 1 cm and 2 degrees, are one surface where they are no farther apart than
this [m]."""
_SLACK_M = 1e-6
"""Room for rounding [m]."""
_COVERED_M = 1e-3
"""Cracks between surfaces twice as wide are closed [m]."""
_LEVELS = 12
"""Heights about which moments are taken."""
_Cells = NDArray[np.bool_]


def flood(passage: Passage) -> Certificate | None:
    """A certificate that no balanced motion leads through the passage; None where none is found.

    It takes as long as it takes, some CPU-seconds at most, whatever the time limit of a plan.
    """
    corners = np.concatenate([each.vertices_m for each in (*passage.terrain, *passage.footholds)])
    low, high = corners.min(axis=0)[:2], corners.max(axis=0)[:2]
    spacing = max(_FINEST_M, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
    if spacing > MOST_SPACING_M or not 0 < len(passage.footholds) <= _MOST_PIECES:
        return None
    try:
        extent = Extent.of(passage.robot)
        found = _Flood(passage, extent, low, high, spacing).certificate()
        if found is not None and extent.assumes:
            bare = replace(extent, outward_m=np.inf)
            found = _Flood(passage, bare, low, high, spacing).certificate() or found
    except InvalidInput:  # a robot of which nobody knows where its feet may be
        return None
    return found if found is not None and check_flood(found).accepted else None


class _Flood:
    """States of one passage.

    Arguments:
        low, high: corners of the map, shape (2,) [m].
        spacing: of its raster [m].
    """

    def __init__(
        self, passage: Passage, extent: Extent, low: Array, high: Array, spacing: float
    ) -> None:
        self.passage, self.extent = passage, extent
        self.tops = tops_of_solids(passage.terrain, passage.footholds)
        self.corner, self.end, self.spacing = low, high, spacing
        self.shape = tuple(np.maximum(np.ceil((high - low) / spacing), 1).astype(int).tolist())
        self.half = spacing / np.sqrt(2.0)
        self.x, self.y = (low[k] + spacing * (np.arange(self.shape[k]) + 0.5) for k in range(2))
        self.grow = extent.sole_m + _SLACK_M
        turn = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
        self.directions = np.column_stack([np.cos(turn), np.sin(turn)])

    def certificate(self) -> Certificate | None:
        """The states that are reached from the start, where they do not hold the goal."""
        pieces, low_m = self.passage.footholds, self._lowest()
        nodes = _nodes(pieces)
        near = self._apart(pieces, nodes)
        sets = [
            chosen
            for size in range(1, len(nodes) + 1)
            for chosen in combinations(range(len(nodes)), size)
            if all(near[i, j] for i, j in combinations(chosen, 2))
        ]
        reached = [self._reached([pieces[p] for p in node], low_m) for node in nodes]
        bounds = self._bounds([[pieces[p] for p in node] for node in nodes])
        allowed = {}
        for chosen in sets:
            free = np.logical_and.reduce([reached[i] for i in chosen])
            allowed[chosen] = self._balanced(free, bounds[list(chosen)]) if free.any() else free
        seen = self._flooded(allowed)
        goal = self._near(self.passage.goal_m)
        there = any((cells & goal).any() for cells in seen.values())
        return None if there else self._written(nodes, seen)

    def _written(
        self, nodes: Sequence[Sequence[int]], seen: dict[tuple[int, ...], _Cells]
    ) -> Certificate:
        """The certificate of these states (``KINDS``)."""
        rows = [
            (KINDS["raster"], *self.shape, *self.corner),
            (KINDS["spacing"], 0, 0, self.spacing, 0),
        ]
        rows += [(KINDS["piece"], i, p, 0, 0) for i, node in enumerate(nodes) for p in node]
        for number, (chosen, cells) in enumerate(seen.items()):
            rows += [(KINDS["set"], number, i, 0, 0) for i in chosen]
            steps = np.diff(np.concatenate([[0], cells.ravel().astype(np.int8), [0]]))
            ends = zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True)
            rows += [(KINDS["run"], number, 0, first, last) for first, last in ends]
        tree = np.array(rows, dtype=np.float64)
        return Certificate(tree=tree, multipliers=self.directions, problem=self.passage)

    def _near(self, place: Array) -> _Cells:
        """Cells that hold a place of the centre of mass within reach of one that is asked for."""
        most = self.passage.near_m + self.half + _SLACK_M
        return np.asarray(np.hypot(self.x[:, None] - place[0], self.y - place[1]) <= most)

    def _window(self, polygon: Array, room_m: float) -> tuple[slice, slice]:
        """Cells about a polygon, shape (U, 2), with so much room."""
        first = (polygon.min(axis=0) - room_m - self.corner) / self.spacing - 1.0
        last = (polygon.max(axis=0) + room_m - self.corner) / self.spacing + 1.0
        first, last = (np.clip(each, 0, self.shape).astype(int) for each in (first, last))
        return slice(first[0], last[0]), slice(first[1], last[1])

    def _lowest(self) -> Array:
        """The lowest that the centre of mass may be over every cell, −inf where nothing is known
        [m].
        """
        out = self.extent.outward_m
        if not np.isfinite(out):
            return np.full(self.shape, -np.inf)
        if out <= -2.0 * self.half:
            return self._raised(self._ground(self.x, self.y), -out)
        corners = [
            np.minimum(self.corner[k] + self.spacing * np.arange(self.shape[k] + 1), self.end[k])
            for k in range(2)
        ]
        ground = self._ground(*corners)
        ground = np.minimum(ground[:-1], ground[1:])
        return np.minimum(ground[:, :-1], ground[:, 1:]) - self.extent.depth_m

    def _ground(self, x: Array, y: Array) -> Array:
        """Heights of the lowest ground at grid lines, of tops of solids above it where there are any,
        shape (n, m), −inf where there is none [m].
        """
        ground, above = np.full((2, len(x), len(y)), np.inf)
        above = -above
        for number, patch in enumerate(self.passage.terrain):
            if patch.normal[2] < FACING_UP:
                continue
            flat = patch.vertices_m[:, :2]
            (i, j), (k, m) = (
                [int(np.searchsorted(line, end)) for line, end in zip((x, y), ends, strict=True)]
                for ends in (flat.min(axis=0) - _COVERED_M, flat.max(axis=0) + _COVERED_M)
            )
            along, aside = x[i:k, None], y[j:m]
            out = np.full((k - i, m - j), -np.inf)
            for normal, offset in zip(*half_planes(flat), strict=True):
                out = np.maximum(out, normal[0] * along + normal[1] * aside - offset)
            rise = patch.normal[:2] / patch.normal[2]
            height = patch.centre_m[2] - (along - patch.centre_m[0]) * rise[0]
            height = height - (aside - patch.centre_m[1]) * rise[1]
            sunk = height - _COVERED_M / patch.normal[2]
            lower = np.where(out <= _COVERED_M, sunk, np.inf)
            ground[i:k, j:m] = np.minimum(ground[i:k, j:m], lower)
            if number in self.tops:
                above[i:k, j:m] = np.maximum(above[i:k, j:m], np.where(out <= 0.0, sunk, -np.inf))
        heights: Array = np.maximum(np.where(np.isfinite(ground), ground, -np.inf), above)
        return heights

    def _raised(self, ground: Array, inside_m: float) -> Array:
        """The lowest centre of mass over every cell about which a ball is above the ground [m]."""
        from scipy.ndimage import maximum_filter  # slow to import

        count = int((inside_m - self.half) / self.spacing)
        steps = self.spacing * np.arange(-count, count + 1)
        away = np.hypot(steps[:, None], steps) + self.half + _COVERED_M
        result = np.full(self.shape, -np.inf)
        for ring in np.unique(away[away <= inside_m]):
            highest = maximum_filter(ground, footprint=away == ring, mode="constant", cval=-np.inf)
            result = np.maximum(result, highest + np.sqrt(inside_m**2 - ring**2))
        return result

    def _reached(self, pieces: Sequence[Patch], low_m: Array) -> _Cells:
        """Cells over which some centre of mass has a foot on one of these pieces."""
        reach, result = self.extent.reach_m + _SLACK_M, np.zeros(self.shape, dtype=bool)
        for piece in pieces:
            window = self._window(piece.vertices_m[:, :2], reach + self.grow + self.half)
            places = self.x[window[0], None] + 1j * self.y[window[1]]
            corners = piece.vertices_m[:, :2] @ [1.0, 1j]
            corners = corners[corners != np.roll(corners, -1)]
            edges = (np.roll(corners, -1) - corners)[:, None, None]
            off = (places - corners[:, None, None]) / edges  # 1 is along an edge, i beside it
            away = np.abs((off - np.clip(off.real, 0.0, 1.0)) * edges).min(axis=0)
            away[np.all(off.imag >= 0.0, axis=0) != np.all(off.imag <= 0.0, axis=0)] = 0.0
            across = np.maximum(away - self.half - self.grow, 0.0)
            top_m = float(piece.vertices_m[:, 2].max()) + self.grow * _sine(piece)
            up = np.maximum(low_m[window] - top_m, 0.0)
            result[window] |= np.hypot(across, up) <= reach
        return result

    def _apart(self, pieces: Sequence[Patch], nodes: Sequence[Sequence[int]]) -> _Cells:
        """Tell of which two surfaces two feet may be on one each, shape (n, n)."""
        away = _distances(pieces) <= self.extent.apart_m + 2.0 * self.grow + _SLACK_M
        return np.array([[away[np.ix_(one, two)].any() for two in nodes] for one in nodes])

    def _bounds(self, nodes: Sequence[Sequence[Patch]]) -> Array:
        """Largest d·p + κ |p_z − z₀| of every surface, shape (n, levels, directions) [m]."""
        tops = np.unique(
            np.concatenate([p.vertices_m[:, 2] for node in nodes for p in node]).round(3)
        )
        levels = np.unique(np.quantile(tops, np.linspace(0.0, 1.0, _LEVELS), method="nearest"))
        result = np.full((len(nodes), len(levels), _DIRECTIONS), -np.inf)
        for i, piece in ((i, piece) for i, node in enumerate(nodes) for piece in node):
            steep = float(np.arccos(min(piece.normal[2], 1.0)) + np.arctan(piece.friction))
            if steep >= STEEPEST_RAD:
                result[i] = np.inf
                continue
            lever = np.abs(piece.vertices_m[:, 2] - levels[:, None]) + self.grow * _sine(piece)
            along = self.directions @ piece.vertices_m[:, :2].T + self.grow + _SLACK_M
            each = along[None] + np.tan(steep) * lever[:, None]
            result[i] = np.maximum(result[i], each.max(axis=2))
        return result

    def _balanced(self, cells: _Cells, bounds: Array) -> _Cells:
        """Those of some cells where the weight may be held on surfaces with these bounds."""
        most, result = bounds.max(axis=0).min(axis=0), cells.copy()
        for direction, bound in zip(self.directions, most, strict=True):
            if np.isfinite(bound):
                along = direction[0] * self.x[:, None] + direction[1] * self.y
                result &= along <= bound + self.half
        return result

    def _flooded(self, allowed: dict[tuple[int, ...], _Cells]) -> dict[tuple[int, ...], _Cells]:
        """States that are reached from the start, by the surfaces that are touched."""
        from scipy.ndimage import label  # slow to import

        start = self._near(self.passage.start_m)
        parts = {s: np.asarray(label(cells, np.ones((3, 3)))[0]) for s, cells in allowed.items()}
        count = {s: int(part.max()) + 1 for s, part in parts.items()}
        seen = {s: np.bincount(part[start], minlength=count[s]) > 0 for s, part in parts.items()}
        for reached in seen.values():
            reached[0] = False
        sets = {frozenset(s): s for s in allowed}
        left = [(s, int(p)) for s, reached in seen.items() for p in np.flatnonzero(reached)]
        nodes = {i for s in allowed for i in s}
        while left:
            chosen, part = left.pop()
            here = parts[chosen] == part
            for i in nodes:
                other = sets.get(frozenset(chosen) ^ {i})
                if other is None or seen[other][1:].all():
                    continue
                there = np.bincount(parts[other][here], minlength=count[other]) > 0
                there[0] = False
                left += [(other, int(p)) for p in np.flatnonzero(there & ~seen[other])]
                seen[other] |= there
        return {s: seen[s][part] for s, part in parts.items() if seen[s].any()}


def _sine(piece: Patch) -> float:
    """Rise of a piece per metre along it."""
    return float(np.hypot(piece.normal[0], piece.normal[1]))


def _distances(pieces: Sequence[Patch]) -> Array:
    """Distances of pieces from each other, or less: across and up taken apart, shape (K, K) [m]."""
    import shapely  # slow to import

    shapes = np.array([shapely.Polygon(each.vertices_m[:, :2]) for each in pieces])
    spans = np.array([[f(each.vertices_m[:, 2]) for f in (np.min, np.max)] for each in pieces])
    up = np.maximum(spans[:, None, 0] - spans[:, 1], 0.0)
    return np.asarray(np.hypot(shapely.distance(shapes[:, None], shapes), np.maximum(up, up.T)))


def _nodes(pieces: Sequence[Patch]) -> list[list[int]]:
    """Pieces put together to surfaces: those of one plane that are beside each other, and then the
    nearest ones until there are few. Any way to do so is sound.
    """
    away = _distances(pieces)
    normals = np.array([each.normal for each in pieces])
    middles = np.array([each.centre_m for each in pieces])
    off = np.abs(np.einsum("ik,ijk->ij", normals, middles - middles[:, None]))
    level = (np.maximum(off, off.T) < _SAME_M) & (normals @ normals.T > _SAME_COS)
    from scipy.sparse.csgraph import connected_components  # slow to import

    count, of = connected_components(level & (away < _TOGETHER_M), directed=False)
    groups = [np.flatnonzero(of == k).tolist() for k in range(count)]
    gaps = np.array([[away[np.ix_(one, two)].min() for two in groups] for one in groups])
    np.fill_diagonal(gaps, np.inf)
    while len(groups) > _MOST_NODES:
        i, j = sorted(int(k) for k in np.unravel_index(int(gaps.argmin()), gaps.shape))
        groups[i] += groups.pop(j)
        gaps[i] = gaps[:, i] = np.minimum(gaps[i], gaps[j])
        gaps[i, i] = np.inf
        gaps = np.delete(np.delete(gaps, j, axis=0), j, axis=1)
    return groups
