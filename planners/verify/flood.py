"""Independent check of a certificate that no balanced motion leads through a passage.

The certificate holds states that the robot may get to from the start: cells of a raster, where its
centre of mass is, by the set of surfaces that its feet touch. Its tree has a row each for (kind, i,
j, first, second):

    raster 0   cells along x and y, and the corner's x and y
    spacing 1  of the raster, in ``first``
    piece 2    surface i holds foothold j
    set 3      the i-th set holds surface j
    run 4      states of the i-th set from cell ``first`` up to ``second``, row by row of the raster

and its multipliers are horizontal directions, a row each. Nothing of it is trusted: every state near
the start, and every state beside one that is held, is held itself, or refuted by the reach of a
foot, that of two feet, or balance along one of the directions, over the lowest centre of mass that
the ground leaves. None that is held is near the goal. Then no motion leads there that is balanced at
every moment, with feet alone touching the footholds, trunk and centre of mass over the map, the
ground one of heights as it is seen once per cell of the raster. A centre that may leave the trunk is
assumed to be no deeper in the ground than twice as far as it gets out of it; the sentence says so
where a step is not refuted without that. The robot may tilt and turn as it likes, and legs are not
judged against the ground. Its extents, which hold it in any posture (``robot.outer_sets``), and
``tops_of_solids`` are all that planners use as well.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, combinations
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Certificate
from ..answer.report import Report
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem.passage import FACING_UP, Passage, tops_of_solids
from ..robot.outer_sets import Extent
from ..terrain.patch import Patch
from .certificate import Refused, expect, proof_report
from .explanation import Explanation

KINDS = MappingProxyType({"raster": 0, "spacing": 1, "piece": 2, "set": 3, "run": 4})
_MOST_NODES, _MOST_CELLS, MOST_SPACING_M = 10, 1_000_000, 0.05
STEEPEST_RAD = 1.5
"""Slope and friction together from which a contact may pull."""
ROOM_M = 1e-9
_SEAM_M = 1e-3
"""Cracks between surfaces twice as wide are no holes in the ground [m]."""
_SECTIONS = 60
_ASSUMED = (
    "balanced at every moment, feet alone touching the footholds as imported, trunk and centre of "
    "mass over this map, its ground one of heights"
)
"""What a proof is about."""
_Cells = NDArray[np.bool_]


def check_flood(certificate: Certificate) -> Report[Certificate]:
    """Replay a certificate about a passage; never raises for a bad one."""
    try:
        states = _Replay(certificate).check()
    except (InvalidInput, Refused) as error:
        return proof_report(certificate, 0.0, 0.0, 0, -1, f"rejected: {error}")
    message = f"every step out of {states} states is refuted, and the goal is in none of them"
    return proof_report(certificate, 0.0, np.inf, states, -1, message)


def explain_flood(certificate: Certificate) -> Explanation:
    """The sentence that a certificate about a passage proves."""
    report = check_flood(certificate)
    if not report.accepted:
        return Explanation(relaxations=(), message=f"nothing to explain: {report.message}")
    passage = certificate.refuted
    assert isinstance(passage, Passage)
    start, goal = (f"({place[0]:g}, {place[1]:g})" for place in (passage.start_m, passage.goal_m))
    extent = Extent.of(passage.robot)
    said = (
        f"balanced motion is impossible: none leads from within {passage.near_m:.2g} m of {start} to as near "
        f"{goal}: {_ASSUMED}{_depth(certificate, extent)}; no foot is more than {extent.reach_m:.3g} m from the "
        f"centre of mass, and no two feet are more than {extent.apart_m:.3g} m apart"
    )
    message = said if passage.frame is None else passage.frame.in_world(said)
    return Explanation(relaxations=(), message=message)


def _depth(certificate: Certificate, extent: Extent) -> str:
    """The assumption about a centre of mass that may leave the trunk, where a step needs it."""
    if not extent.assumes:
        return ""
    with suppress(Refused):
        _Replay(certificate, replace(extent, outward_m=np.inf)).check()
        return ""
    return f", the centre of mass never more than {extent.depth_m:.2g} m below its surface"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Surface:
    """Pieces on which feet may stand, put together."""

    pieces: tuple[Patch, ...]

    @cached_property
    def spans(self) -> Array:
        """Lowest and highest height of each piece, shape (K, 2) [m]."""
        return np.array([[p.vertices_m[:, 2].min(), p.vertices_m[:, 2].max()] for p in self.pieces])


class _Replay:
    """The states of one certificate.

    Arguments:
        extent: of the robot; its own where it is not given.
    """

    def __init__(self, certificate: Certificate, extent: Extent | None = None) -> None:
        passage = certificate.refuted
        if not isinstance(passage, Passage):
            raise Refused("expected a passage")
        self.passage, self.extent = passage, extent or Extent.of(passage.robot)
        tree, self.directions = certificate.tree, certificate.multipliers
        numbers = tree.shape[1:] == (5,) and np.isfinite(tree).all()
        expect(numbers, "rows of five finite numbers")
        expect(self.directions.shape[1:] == (2,), "directions in the plane")
        sizes = np.linalg.norm(self.directions, axis=1)
        expect(np.all(np.abs(sizes - 1.0) < ROOM_M), "directions of length 1")
        rows = {name: tree[tree[:, 0] == kind] for name, kind in KINDS.items()}
        expect(sum(map(len, rows.values())) == len(tree), "rows of the kinds that there are")
        self._place(rows["raster"], rows["spacing"])
        self.grow = self.extent.sole_m
        self.surfaces = self._surfaces(rows["piece"])
        self.held = self._states(rows["set"], rows["run"])

    def _place(self, raster: Array, spacing: Array) -> None:
        """Take the raster, which has to be all over the map."""
        one = len(raster) == len(spacing) == 1 and 0.0 < spacing[0, 3] <= MOST_SPACING_M
        expect(one, f"one raster of up to {MOST_SPACING_M:g} m")
        counts = raster[0, 1:3].astype(int)
        whole = np.all(counts >= 1) and np.all(counts == raster[0, 1:3])
        expect(whole and np.prod(counts) <= _MOST_CELLS, f"up to {_MOST_CELLS} cells")
        self.size, self.corner = float(spacing[0, 3]), raster[0, 3:5]
        self.counts = (int(counts[0]), int(counts[1]))
        every = [
            each.vertices_m[:, :2] for each in (*self.passage.terrain, *self.passage.footholds)
        ]
        expect(every, "a terrain")
        corners, end = np.concatenate(every), self.corner + self.size * counts
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        over = np.all(self.low >= self.corner - ROOM_M) and np.all(self.high <= end + ROOM_M)
        expect(over, "a raster all over the map")
        self.half = self.size * float(np.sqrt(0.5))
        axes = [self.corner[k] + self.size * (np.arange(self.counts[k]) + 0.5) for k in range(2)]
        self.xy = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def _surfaces(self, rows: Array) -> list[_Surface]:
        """The surfaces, which have to hold every foothold once."""
        every, nodes = list(range(len(self.passage.footholds))), np.unique(rows[:, 1])
        once = sorted(rows[:, 2].tolist()) == every and 1 <= len(nodes) <= _MOST_NODES
        expect(once, f"every foothold in one of up to {_MOST_NODES} surfaces")
        expect(np.array_equal(nodes, np.arange(len(nodes))), "surfaces by number")
        return [
            _Surface(
                pieces=tuple(self.passage.footholds[int(p)] for p in rows[rows[:, 1] == node, 2])
            )
            for node in nodes
        ]

    def _states(self, sets: Array, runs: Array) -> dict[frozenset[int], _Cells]:
        """The states that are held, by the surfaces that are touched."""
        held: dict[frozenset[int], _Cells] = {}
        for number in np.unique(sets[:, 1]):
            chosen = frozenset(int(i) for i in sets[sets[:, 1] == number, 2])
            new = chosen not in held and chosen <= set(range(len(self.surfaces)))
            expect(new, "every set of surfaces once")
            cells = np.zeros(self.counts[0] * self.counts[1], dtype=bool)
            for first, last in runs[runs[:, 1] == number, 3:5].astype(int):
                expect(0 <= first < last <= len(cells), "runs of cells of the raster")
                cells[first:last] = True
            held[chosen] = cells.reshape(self.counts)
        return held

    def check(self) -> int:
        """Number of states that are held.

        Raises Refused where a neighbouring state is not refuted.
        """
        nowhere = np.zeros(self.counts, dtype=bool)
        start, goal = (self._about(place) for place in (self.passage.start_m, self.passage.goal_m))
        numbers = range(len(self.surfaces))
        for chosen in map(
            frozenset, chain.from_iterable(combinations(numbers, n + 1) for n in numbers)
        ):
            here = self.held.get(chosen, nowhere)
            if (here & goal).any():
                raise Refused("a state that may be reached is at the goal")
            across = _beside(here) | start
            for i in numbers:  # a foot may touch several surfaces, where they meet
                across |= self.held.get(chosen ^ {i}, nowhere)
            open_ = across & ~here
            if open_.any() and not self._refuted(chosen, open_).all():
                raise Refused(
                    f"a step on surfaces {', '.join(map(str, sorted(chosen)))} is not refuted"
                )
        return int(sum(cells.sum() for cells in self.held.values()))

    def _about(self, place: Array) -> _Cells:
        """Cells of which some point is near a place."""
        away = np.maximum(np.abs(self.xy - place) - 0.5 * self.size, 0.0)
        return np.asarray((away**2).sum(axis=-1) <= self.passage.near_m**2)

    def _refuted(self, chosen: frozenset[int], cells: _Cells) -> _Cells:
        """Tell which of some cells, in a row, no state on these surfaces is over."""
        if any(self._too_far(i, j) for i, j in combinations(sorted(chosen), 2)):
            return np.ones(int(cells.sum()), dtype=bool)
        refuted: _Cells = ~np.all([self._within[i][cells] for i in chosen], axis=0)
        if refuted.all():
            return refuted
        places = self.xy[cells]
        for direction in self.directions:
            refuted |= places @ direction - self.half > self._held_most(chosen, direction) + ROOM_M
        return refuted

    def _too_far(self, i: int, j: int) -> bool:
        """Tell whether two feet are never on two surfaces."""
        most = self.extent.apart_m + 2.0 * self.grow
        one, two = self.surfaces[i], self.surfaces[j]
        for p, (low, high) in zip(one.pieces, one.spans, strict=True):
            for q, (other_low, other_high) in zip(two.pieces, two.spans, strict=True):
                up = max(low - other_high, other_low - high, 0.0)
                if up <= most and np.hypot(_apart(p, q), up) <= most + ROOM_M:
                    return False
        return True

    @cached_property
    def _within(self) -> list[_Cells]:
        """Cells over which some centre of mass has a foot on each surface."""
        return [self._beside_foot(surface) for surface in self.surfaces]

    def _beside_foot(self, surface: _Surface) -> _Cells:
        """Cells over which some centre of mass has a foot on a surface."""
        reach, within = self.extent.reach_m, np.zeros(self.counts, dtype=bool)
        for piece, (_, high) in zip(surface.pieces, surface.spans, strict=True):
            flat, room = piece.vertices_m[:, :2], reach + self.grow + self.half + self.size
            low = np.floor((flat.min(axis=0) - room - self.corner) / self.size).astype(int)
            end = np.ceil((flat.max(axis=0) + room - self.corner) / self.size).astype(int)
            part = tuple(slice(max(a, 0), max(b, 0)) for a, b in zip(low, end, strict=True))
            away = _away(self.xy[part], flat)
            top = high + self.grow * float(np.sqrt(max(1.0 - piece.normal[2] ** 2, 0.0)))
            across = np.maximum(away - self.half - self.grow, 0.0)
            below = np.maximum(self._low[part] - top, 0.0)
            within[part] |= across**2 + below**2 <= (reach + ROOM_M) ** 2
        return within

    def _held_most(self, chosen: frozenset[int], direction: Array) -> float:
        """The farthest along a direction that a weight is held: the least over z₀ of the largest a +
        κ (|z − z₀| + rise), which is convex in z₀ (golden section).
        """
        rows = list[Array]()
        for piece in (piece for i in chosen for piece in self.surfaces[i].pieces):
            upright = np.clip(piece.normal[2], -1.0, 1.0)
            angle = float(np.arccos(upright) + np.arctan(piece.friction))
            if angle >= STEEPEST_RAD:
                return float("inf")
            rise = self.grow * float(np.sqrt(max(1.0 - piece.normal[2] ** 2, 0.0)))
            along, heights = piece.vertices_m[:, :2] @ direction + self.grow, piece.vertices_m[:, 2]
            rows.append(np.array(np.broadcast_arrays(along, np.tan(angle), heights, rise)))
        a, k, z, r = np.concatenate(rows, axis=1)

        def most(about: float) -> float:
            return float((a + k * (np.abs(z - about) + r)).max())

        low, high, ratio = float(z.min()), float(z.max()), 0.5 * (np.sqrt(5.0) - 1.0)
        best = min(most(low), most(high))
        for _ in range(_SECTIONS if high > low else 0):
            one, two = high - ratio * (high - low), low + ratio * (high - low)
            first, second = most(one), most(two)
            best = min(best, first, second)
            low, high = (low, two) if first < second else (one, high)
        return best

    @cached_property
    def _low(self) -> Array:
        """The lowest that a centre of mass may be over every cell [m]."""
        out = self.extent.outward_m
        if not np.isfinite(out):
            return np.full(self.counts, -np.inf)
        if out <= -2.0 * self.half:
            return self._above(self._heights(self.xy), -out)
        lines = [self.corner[k] + self.size * np.arange(self.counts[k] + 1) for k in range(2)]
        lines = [np.clip(lines[k], self.low[k], self.high[k]) for k in range(2)]
        ground = self._heights(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1))
        windows = np.lib.stride_tricks.sliding_window_view(ground, (2, 2))
        return np.asarray(windows.min(axis=(2, 3)) - self.extent.depth_m)

    @cached_property
    def _tops(self) -> frozenset[int]:
        """Tops of solids, by number in the terrain."""
        return tops_of_solids(self.passage.terrain, self.passage.footholds)

    def _heights(self, points: Array) -> Array:
        """Heights of the lowest ground at places, shape (n, m, 2), of tops of solids above it where
        there are any, −inf where there is none [m].
        """
        ground, first = np.full(points.shape[:2], np.inf), points[0, 0]
        above = np.full(points.shape[:2], -np.inf)
        for number, patch in enumerate(self.passage.terrain):
            if patch.normal[2] < FACING_UP:
                continue
            flat = patch.vertices_m[:, :2]
            low = np.floor((flat.min(axis=0) - first) / self.size).astype(int) - 1
            end = np.ceil((flat.max(axis=0) - first) / self.size).astype(int) + 2
            part = tuple(slice(max(a, 0), max(b, 0)) for a, b in zip(low, end, strict=True))
            slope = -patch.normal[:2] / patch.normal[2]
            height = patch.vertices_m[0, 2] + (points[part] - flat[0]) @ slope
            sunk = height - _SEAM_M / patch.normal[2]
            away = _away(points[part], flat)
            ground[part] = np.minimum(ground[part], np.where(away <= _SEAM_M, sunk, np.inf))
            if number in self._tops:
                above[part] = np.maximum(above[part], np.where(away <= ROOM_M, sunk, -np.inf))
        heights: Array = np.maximum(np.where(np.isinf(ground), -np.inf, ground), above)
        return heights

    def _above(self, ground: Array, radius: float) -> Array:
        """The lowest that the middle of a ball may be over every cell, for no point of the ground that
        is known to be inside of it [m].
        """
        result, count = np.full(self.counts, -np.inf), int(radius / self.size)
        padded = np.pad(ground, count, constant_values=-np.inf)
        for i in range(-count, count + 1):
            for j in range(-count, count + 1):
                away = self.size * float(np.hypot(i, j)) + self.half + _SEAM_M
                if away <= radius:
                    moved = padded[count + i :, count + j :][: self.counts[0], : self.counts[1]]
                    result = np.maximum(result, moved + np.sqrt(radius**2 - away**2))
        return result


def _beside(cells: _Cells) -> _Cells:
    """Some cells and all that touch them, corners included."""
    for axis in range(2):
        ends = [(0, 0), (0, 0)]
        ends[axis] = (1, 1)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(cells, ends), 3, axis=axis)
        cells = np.asarray(windows.any(axis=-1))
    return np.asarray(cells)


def _away(points: Array, polygon: Array) -> Array:
    """Distances of points, shape (…, 2), from a convex polygon from above, 0 inside [m]."""
    places, corners = points @ (1.0, 1.0j), polygon @ (1.0, 1.0j)
    away, sides = np.inf, list[Array]()
    for corner, along in zip(corners, np.roll(corners, -1) - corners, strict=True):
        off = places - corner
        turned = off * along.conjugate()
        share = np.clip(turned.real / max(abs(along) ** 2, 1e-24), 0.0, 1.0)
        away = np.minimum(away, np.abs(off - share * along))
        sides.append(turned.imag)
    low, high = np.min(sides, axis=0), np.max(sides, axis=0)
    return np.where((low >= 0.0) != (high <= 0.0), 0.0, away)


def _apart(one: Patch, two: Patch) -> float:
    """Horizontal distance of two convex pieces [m]."""
    import shapely  # slow to import

    return float(shapely.distance(*(shapely.polygons(p.vertices_m[:, :2]) for p in (one, two))))
