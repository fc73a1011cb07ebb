"""Rungs of maps and clouds: cells that hang together, longer than wide, whose heights lie on one cylinder.

A cylinder is fitted to the heights by least squares (Gauss–Newton, after a parabola across). How far its line may be
off by the noise widens the turn of the surface that both of its sides have to hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, distance_transform_edt

from ..files.arrays import Array
from .correlation import GroundCells, Labels, hanging_together, inside, renumbered
from .elevation import BESIDE
from .footholds import FootholdLimits, Rung, TerrainPatch, held_on_both_sides
from .patch import Certainty, Patch

_SLIMMEST_M, _WIDEST_M = 8e-3, 0.06
"""Radii of rungs that a map shows [m]."""
_STEEPEST, _NOISES = 2.5, 6.0
"""Cells beside each other are of one bar up to this slope, and so many deviations of the noise more."""
LONG, _ROWS = 3.0, 3
"""A rung is so many times as long as wide, and so many cells wide."""
_ROUND = 0.03
"""Heights are off the cylinder by no more, in radii, beside the noise."""
_BENT, _NOISY = 0.08, 0.3
"""Heights are off a plane by so many radii more than off the cylinder; and the most noise, in radii: with more the
cylinder that fits is not where the rung is."""
_ARC_RAD = 0.7
"""A rung's surface is seen so far to both sides of its line [rad]."""
_SURE, _KNOWN = 3.0, 0.3
"""Deviations of the place of the line across that a foot may be off it, and the most in radii."""
_STEPS = 30
_NEAR, _LUMP_SD = 1.5, 4.0
"""Heights within so many cells along the line are looked at together, whose mean is off the cylinder by no more than so
many times a rung's, and deviations of the noise's mean."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapRung:
    """A rung of a map.

    Arguments:
        rung: its cylinder.
        cells: which are of it, shape (n, m).
        span_m: of the cells along its axis from the middle, from and to [m].
        seen_m: parts of the span along which cells bear the line on both sides, shape (S, 2) [m].
        turn_rad: by which its surface turns from the middle of the line to where a foot may be.
        rms_m: of heights off the cylinder [m].
        certainty: of its line; None where heights are exact.
    """

    rung: Rung
    cells: NDArray[np.bool_]
    span_m: tuple[float, float]
    seen_m: Array
    turn_rad: float
    rms_m: float
    certainty: Certainty | None

    def pieces(
        self, surface: int, limits: FootholdLimits, friction: float
    ) -> tuple[TerrainPatch, ...]:
        """The line as footholds where it is seen, the margin away from each end."""
        pieces = list[TerrainPatch]()
        for low, high in self.seen_m + limits.inset_m * np.array([1.0, -1.0]):
            if high - low <= limits.least_m:
                continue
            patch = self.rung.line(low, high, friction)
            patch = patch.with_friction(held_on_both_sides(friction, self.turn_rad))
            pieces.append(
                TerrainPatch(
                    patch=patch.with_certainty(self.certainty),
                    rms_m=self.rms_m,
                    samples=int(self.cells.sum()),
                    surface=surface,
                    turn_rad=self.turn_rad,
                )
            )
        return tuple(pieces)

    def footprint_m(self, beside_m: float) -> Array:
        """Corners of the ground under it and so far beside, in order, shape (4, 2) [m]."""
        way = self.rung.axis[:2] / np.linalg.norm(self.rung.axis[:2])
        aside = (self.rung.radius_m + beside_m) * np.array([-way[1], way[0]])
        low, high = (
            self.rung.middle_m[:2] + along * way
            for along in (self.span_m[0] - beside_m, self.span_m[1] + beside_m)
        )
        return np.array([low - aside, high - aside, high + aside, low + aside])

    def sides(self, friction: float) -> tuple[Patch, ...]:
        """The round surface as planes, for bodies to keep out of."""
        return self.rung.sides(*self.span_m, friction)


def map_rungs(
    labels: Labels, cells: GroundCells, noise_m: float, slope_rad: float
) -> list[MapRung]:
    """The rungs among cells of no surface or of narrow ones.

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        noise_m: deviation of a sample [m].
        slope_rad: largest angle of a line with the horizontal [rad].
    """
    spacing = cells.spacing_m
    free = cells.known & ~_wide(labels, spacing)
    i, j = np.nonzero(free)
    heights, dense = cells.heights, max(cells.moments[0][free].sum() / max(len(i), 1), 1.0)
    most = _STEEPEST * spacing + _NOISES * noise_m / np.sqrt(dense)
    with np.errstate(invalid="ignore"):
        near = (
            free[one] & free[other] & (np.abs(heights[one] - heights[other]) <= most)
            for one, other in BESIDE
        )
        group = renumbered(np.where(free, hanging_together(*near), -1))[i, j]
    count = int(group.max(initial=-1)) + 1
    x, y = (each[i, j] for each in cells.places)
    places = np.column_stack([spacing * x, spacing * y, heights[i, j]]) + cells.corner_m
    weights = cells.moments[0][i, j] / cells.weight
    order = np.argsort(group, kind="stable")
    first = np.searchsorted(group[order], np.arange(count + 1))
    rungs = list[MapRung]()
    for k in range(count):
        members = order[first[k] : first[k + 1]]
        if len(members) < LONG * _ROWS * _ROWS:
            continue
        mask = np.zeros(free.shape, dtype=bool)
        mask[i[members], j[members]] = True
        rung = _rung(places[members], weights[members], mask, noise_m, slope_rad)
        if rung is None:
            continue
        seen_m = _seen(rung, places[members], weights[members], cells, noise_m)
        rungs.append(replace(rung, seen_m=seen_m))
    return rungs


def _seen(
    rung: MapRung, points_m: Array, weights: Array, cells: GroundCells, noise_m: float
) -> Array:
    """Parts of a rung's span along which the cells under its line and half a cell to both sides are its own, and their
    heights about each place on its cylinder, shape (S, 2) [m].
    """
    spacing, bar, (low, high) = cells.spacing_m, rung.rung, rung.span_m
    covered = rung.cells
    if cells.sparse:  # a cell without samples between others is by chance
        covered = covered | (~cells.known & binary_closing(covered, np.ones((3, 3), dtype=bool)))
    along = np.linspace(low, high, max(int(np.ceil(4.0 * (high - low) / spacing)), 2))
    aside = np.array([-bar.axis[1], bar.axis[0]]) / np.linalg.norm(bar.axis[:2])
    beside = 0.5 * spacing * np.array([-1.0, 0.0, 1.0])
    places = bar.middle_m[:2] + along[:, None, None] * bar.axis[:2] + beside[:, None] * aside
    cell = np.round((places - cells.corner_m[:2]) / spacing).astype(np.int_)
    inside = np.all((cell >= 0) & (cell < covered.shape), axis=-1)
    cell = np.clip(cell, 0, np.array(covered.shape) - 1)
    seen = (inside & covered[cell[..., 0], cell[..., 1]]).all(axis=1)
    from_axis = points_m - bar.middle_m + bar.radius_m * bar.upright
    length = from_axis @ bar.axis
    off = np.linalg.norm(from_axis - length[:, None] * bar.axis, axis=1) - bar.radius_m
    near = weights * (np.abs(along[:, None] - length) <= _NEAR * spacing)
    count = near.sum(axis=1)
    most = np.hypot(
        _NEAR * _ROUND * bar.radius_m, _LUMP_SD * noise_m / np.sqrt(np.maximum(count, 1))
    )
    seen &= np.abs(near @ off) <= most * np.maximum(count, 1e-9)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]])))
    parts = along[edges.reshape(-1, 2) - [0, 1]]
    # the next cell that is not its own may be half a cell nearer
    parts[parts[:, 0] > low, 0] += 0.5 * spacing
    parts[parts[:, 1] < high, 1] -= 0.5 * spacing
    return np.asarray(parts)


def _wide(labels: Labels, spacing: float) -> NDArray[np.bool_]:
    """Cells of surfaces that are wider than a rung is somewhere."""
    deep = distance_transform_edt(inside(labels)) * spacing
    return np.isin(labels, np.unique(labels[deep > _WIDEST_M]))


def _rung(
    points_m: Array, weights: Array, cells: NDArray[np.bool_], noise_m: float, slope_rad: float
) -> MapRung | None:
    """The rung of points, shape (K, 3) [m], that are of these cells; None where they are none."""
    middle = np.average(points_m, axis=0, weights=weights)
    flat = points_m - middle
    spread, ways = np.linalg.eigh(np.cov(flat[:, :2].T, aweights=weights))
    if spread[0] <= 0.0 or spread[1] < LONG**2 * spread[0]:
        return None
    along, across = flat[:, :2] @ ways[:, 1], flat[:, :2] @ np.array([-ways[1, 1], ways[0, 1]])
    z = flat[:, 2]
    # z = a + b u + c v + d v²: the plane's own residuals, and where a cylinder begins
    table = np.column_stack([np.ones_like(z), along, across, across**2])
    root = np.sqrt(weights)
    plane = np.linalg.lstsq(table[:, :3] * root[:, None], z * root, rcond=None)[0]
    off_plane = np.sqrt(np.average((z - table[:, :3] @ plane) ** 2, weights=weights))
    bent = np.linalg.lstsq(table * root[:, None], z * root, rcond=None)[0]
    if bent[3] >= 0.0:
        return None
    radius = float(np.clip(-0.5 / bent[3], _SLIMMEST_M, _WIDEST_M))
    radius = max(radius, 0.5 * float(np.ptp(across)))
    values = np.array([0.5 * (across.min() + across.max()), 0.0, z.max() - radius, bent[1], radius])
    for _ in range(_STEPS):
        off, slopes = _off(values, along, across, z)
        step = np.linalg.lstsq(slopes * root[:, None], -off * root, rcond=None)[0]
        values = values + np.clip(step, -0.3 * radius, 0.3 * radius)
        if np.abs(step).max() < 1e-9:
            break
    off, slopes = _off(values, along, across, z)
    rms = float(np.sqrt(np.average(off**2, weights=weights)))
    v0, turn, top, rise, radius = values.tolist()
    if not _SLIMMEST_M <= radius <= _WIDEST_M or not np.isfinite(values).all():
        return None
    if rms > np.hypot(_ROUND * radius, 1.2 * noise_m / np.sqrt(max(weights.mean(), 1.0))):
        return None
    if noise_m > _NOISY * radius or off_plane**2 - rms**2 < (_BENT * radius) ** 2:
        return None
    beside = across - v0 - turn * along
    if min(beside.max(), -beside.min()) < np.sin(_ARC_RAD) * radius or abs(rise) > np.tan(
        slope_rad
    ):
        return None
    inverse = np.linalg.pinv((slopes * weights[:, None]).T @ slopes)
    covariance = max(rms**2 * max(weights.mean(), 1.0), noise_m**2) * inverse
    sd_across, sd_radius = np.sqrt(np.maximum(np.diag(covariance)[[0, 4]], 0.0))
    if max(_SURE * sd_across, sd_radius) > _KNOWN * radius:
        return None
    level = ways[:, 1] + turn * np.array([-ways[1, 1], ways[0, 1]])
    axis = np.array([*level, rise]) / np.linalg.norm([*level, rise])
    upright = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    upright /= np.linalg.norm(upright)
    centre = middle + np.array([*(v0 * np.array([-ways[1, 1], ways[0, 1]])), top])
    rung = Rung(axis=axis, upright=upright, middle_m=centre + radius * upright, radius_m=radius)
    length = (points_m - rung.middle_m) @ axis
    certainty = None
    if noise_m > 0.0:
        height, slope = (
            covariance[2, 2] + covariance[4, 4] + 2.0 * covariance[2, 4],
            covariance[3, 3],
        )
        plane_of = np.zeros((3, 3))
        plane_of[0, 0] = height
        plane_of[1:, 1:] = slope * np.outer(axis[:2], axis[:2])
        certainty = Certainty(about_m=rung.middle_m[:2], covariance=plane_of)
    aside = min((rung.half_width_m + _SURE * sd_across) / radius, 1.0)
    return MapRung(
        rung=rung,
        cells=cells,
        span_m=(float(length.min()), float(length.max())),
        seen_m=np.zeros((0, 2)),
        turn_rad=float(np.arcsin(aside)),
        rms_m=rms,
        certainty=certainty,
    )


def _off(values: Array, along: Array, across: Array, z: Array) -> tuple[Array, Array]:
    """Distance of points off a cylinder, outside of it positive, shape (K,) [m]; and its slopes along place and turn of
    the axis across, its height and rise, and the radius, shape (K, 5).
    """
    v0, turn, top, rise, radius = values
    v, w = across - v0 - turn * along, z - top - rise * along
    length = np.maximum(np.hypot(v, w), 1e-9)
    slopes = np.stack([-v, -v * along, -w, -w * along, -length], axis=1) / length[:, None]
    return length - radius, slopes
