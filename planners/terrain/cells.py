"""Heights by cell: samples of a map or points of a cloud as sums of their moments, from which
planes are fitted.

Points keep their own places in the sums, so that a plane is the least-squares plane of the points
themselves, and a cell of many points counts for more than one of a single point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri

from ..files.arrays import Array
from .elevation import LAYER_M, ElevationMap

QUIETEST = (0.04, 0.12, 0.35)
"""Quantiles of the residuals of small windows from which the noise is estimated, the least: no edge
crosses those."""
POINTS_PER_CELL = 2.0
FINEST_M = 0.01
"""Side of the smallest cell of a cloud [m]."""

Labels = NDArray[np.int_]


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundCells:
    """Sums over the samples of each cell, with places in cells from the first one.

    Arguments:
        moments: sums of 1, x, y, xx, xy, yy, z, xz, yz, zz, shape (10, n, m); z in [m].
        corner_m: place of the first cell's middle, and the height that z counts from, shape (3,)
            [m].
        spacing_m: side of a cell [m].
        sparse: a cell without samples between others is by chance, and no hole.
        weight: count of a sample in the sums, below 1 where the noise of neighbours is alike.
    """

    moments: Array
    corner_m: Array
    spacing_m: float
    sparse: bool = False
    weight: float = 1.0

    @classmethod
    def of_map(cls, terrain: ElevationMap) -> GroundCells:
        """One sample per cell that has a height."""
        lowest = float(np.nanmean(terrain.heights_m))
        known = np.isfinite(terrain.heights_m)
        z = np.where(known, terrain.heights_m - lowest, 0.0)
        one = known.astype(np.float64)
        i, j = one * np.indices(z.shape)
        return cls(
            moments=np.stack([one, i, j, i * i, i * j, j * j, z, i * z, j * z, z * z]),
            corner_m=np.array([terrain.x_m[0], terrain.y_m[0], lowest]),
            spacing_m=terrain.spacing_m,
        )

    @classmethod
    def of_points(cls, points_m: Array, coarsest_m: float, noise_m: float) -> GroundCells:
        """The upper side of a cloud, shape (K, 3), about two points per cell and no cell wider than
        ``coarsest_m``.
        """
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        area = max(float(np.prod(high[:2] - low[:2])), coarsest_m**2)
        spacing = min(
            max(float(np.sqrt(POINTS_PER_CELL * area / len(points_m))), FINEST_M), coarsest_m
        )
        places = (points_m[:, :2] - low[:2]) / spacing
        cells = np.round(places).astype(np.int64)
        shape = tuple((cells.max(axis=0) + 1).tolist())
        cell = np.ravel_multi_index(tuple(cells.T), shape)
        top = np.full(shape[0] * shape[1], -np.inf)
        np.maximum.at(top, cell, points_m[:, 2])
        upper = points_m[:, 2] >= top[cell] - LAYER_M - 6.0 * noise_m
        cell, (x, y) = cell[upper], places[upper].T
        lowest = float(points_m[upper, 2].mean())
        z = points_m[upper, 2] - lowest
        values = (None, x, y, x * x, x * y, y * y, z, x * z, y * z, z * z)
        sums = [
            np.bincount(cell, weights=value, minlength=len(top)).reshape(shape) for value in values
        ]
        moments, corner = np.array(sums, dtype=np.float64), np.array([*low[:2], lowest])
        return cls(moments=moments, corner_m=corner, spacing_m=spacing, sparse=True)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Tell which cells have samples."""
        return np.asarray(self.moments[0] > 0.0)

    @property
    def heights(self) -> Array:
        """Mean height of each cell's samples, NaN where there is none [m]."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.moments[6] / self.moments[0])

    @property
    def places(self) -> tuple[Array, Array]:
        """Mean place of each cell's samples, the middle of a cell that has none."""
        one = np.where(self.known, self.moments[0], 1.0)
        i, j = np.indices(one.shape, dtype=np.float64)
        return np.where(self.known, self.moments[1] / one, i), np.where(
            self.known, self.moments[2] / one, j
        )

    def only(self, wanted: NDArray[np.bool_]) -> GroundCells:
        """Cells without the samples of other cells."""
        return replace(self, moments=self.moments * wanted)

    def weighed(self, weight: float) -> GroundCells:
        """Cells whose samples count so much each."""
        return replace(self, moments=weight / self.weight * self.moments, weight=weight)

    def noise_m(self) -> float:
        """Deviation of white noise of the heights, by the residuals of planes over 3 × 3 cells that
        no edge crosses.
        """
        one, *_ = sums = boxed(self.moments, 3)
        _, rms = solved(about(sums, *np.indices(one.shape, dtype=np.float64)))
        freedom = np.round(one) - 3.0
        enough = freedom >= 3.0
        if np.count_nonzero(enough) < 20:
            return 0.0
        squares, freedom = (rms**2 * one)[enough], freedom[enough].astype(np.int_)
        known = np.arange(3.0, freedom.max() + 1.0)  # of every possible freedom its quantiles, once
        least = [
            np.quantile(squares / chdtri(known, 1.0 - share)[freedom - 3], share)
            for share in QUIETEST
        ]
        return float(np.sqrt(min(least)))


def boxed(moments: Array, side: int) -> Array:
    """Sums over squares of ``side`` cells about each cell, nothing beyond the border; shape as that
    of moments.
    """
    sums = moments
    for axis in (-2, -1):
        sums = uniform_filter1d(sums, side, axis=axis, mode="constant")
    return np.asarray(sums * side**2)


def about(moments: Array, i: Array, j: Array) -> Array:
    """Moments with places counted from (i, j)."""
    one, x, y, xx, xy, yy, z, xz, yz, zz = moments
    return np.stack(
        [
            one,
            x - i * one,
            y - j * one,
            xx - 2.0 * i * x + i * i * one,
            xy - i * y - j * x + i * j * one,
            yy - 2.0 * j * y + j * j * one,
            z,
            xz - i * z,
            yz - j * z,
            zz,
        ]
    )


def solved(moments: Array) -> tuple[Array, Array]:
    """Least-squares planes z = a·x + b·y + c by moments, (a, b, c) first, shape (3, …), and the rms
    off them.
    """
    one, x, y, xx, xy, yy, z, xz, yz, zz = moments
    one = np.maximum(one, 1e-12)
    cxx, cxy, cyy = xx - x * x / one, xy - x * y / one, yy - y * y / one
    cxz, cyz, czz = xz - x * z / one, yz - y * z / one, zz - z * z / one
    double = cxx * cyy - cxy * cxy
    safe = np.where(double > 1e-9 * one * one, double, 1.0)
    a = np.where(double > 1e-9 * one * one, (cxz * cyy - cyz * cxy) / safe, 0.0)
    b = np.where(double > 1e-9 * one * one, (cyz * cxx - cxz * cxy) / safe, 0.0)
    c = (z - a * x - b * y) / one
    rest = czz - 2.0 * (a * cxz + b * cyz) + a * a * cxx + 2.0 * a * b * cxy + b * b * cyy
    return np.stack([a, b, c]), np.sqrt(np.maximum(rest, 0.0) / one)


def sums_of(number: Labels, moments: Array, count: int) -> Array:
    """Sums of moments, shape (10, …), by number, −1 for none of them, shape (10, count)."""
    bins = number.ravel() + 1
    return np.array(
        [np.bincount(bins, weights=value.ravel(), minlength=count + 1)[1:] for value in moments]
    )


def renumbered(labels: Labels) -> Labels:
    """Labels from 0 on without gaps; −1 stays."""
    used = np.bincount(labels.ravel() + 1) > 0
    used[:1] = False
    return np.asarray((np.cumsum(used) * used - 1)[labels + 1], dtype=np.int_)


def fitted(labels: Labels, cells: GroundCells) -> tuple[Array, Array, Array]:
    """The plane (a, b, c) of every surface with places in cells, shape (S, 3), its rms and how many
    samples it has.
    """
    sums = sums_of(labels, cells.moments, int(labels.max(initial=-1)) + 1)
    planes, rms = solved(sums)
    return planes.T, rms, sums[0]


def residuals(labels: Labels, cells: GroundCells) -> Array:
    """Mean distance of each cell's samples above the plane of its surface, 0 where there are none,
    shape (n, m) [m].
    """
    planes = fitted(labels, cells)[0]
    if not len(planes):
        return np.zeros(labels.shape)
    a, b, c = planes[np.maximum(labels, 0)].transpose(2, 0, 1)
    one, x, y, z = (cells.moments[k] for k in (0, 1, 2, 6))
    within = (labels >= 0) & (one > 0.0)
    return np.where(within, z - a * x - b * y - c * one, 0.0) / np.where(within, one, 1.0)


def block_squares(
    labels: Labels, cells: GroundCells, planes: Array, side: int
) -> tuple[Array, Array]:
    """Deviation of means over blocks of each surface from its plane: the sum of their squares times
    the samples of each, and the number of blocks, shape (S,) each.

    Arguments:
        side: of a block, in cells.
    """
    i, j = np.nonzero(labels >= 0)
    number, (one, x, y, z) = labels[i, j], (cells.moments[k, i, j] for k in (0, 1, 2, 6))
    a, b, c = planes[number].T
    rest = z - a * x - b * y - c * one
    wide = labels.shape[1] // side + 2
    _, block = np.unique(
        (number * (labels.shape[0] // side + 2) + i // side) * wide + j // side, return_inverse=True
    )
    owner = np.zeros(int(block.max(initial=-1)) + 1, dtype=np.int_)
    owner[block] = number
    weight = np.bincount(block, weights=one)
    square = np.asarray(
        np.bincount(block, weights=rest) ** 2 / np.where(weight > 0.0, weight, 1.0),
        dtype=np.float64,
    )
    return (
        np.bincount(owner, weights=square, minlength=len(planes)).astype(np.float64),
        np.bincount(owner, minlength=len(planes)).astype(np.float64),
    )


def mean_square(planes: Array, moments: Array) -> Array:
    """Mean squares of samples off planes, shape (3, …), by their moments, shape (10, …) [m²]."""
    (a, b, c), (one, x, y, xx, xy, yy, z, xz, yz, zz) = planes, moments
    total = zz + a * a * xx + b * b * yy + c * c * one - 2.0 * (a * xz + b * yz + c * z)
    total = total + 2.0 * (a * b * xy + a * c * x + b * c * y)
    return np.asarray(np.maximum(total, 0.0) / np.where(one > 0.0, one, 1.0))
