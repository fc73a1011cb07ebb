"""Noise of heights that is correlated over a length, as filtered maps and most depth cameras have
it.

Planes are fitted to 3 × 3 samples that are ever farther apart. White noise leaves them the same
residuals whatever their distance; correlated noise leaves little to samples that are close, and all
of it to those that are farther apart than it reaches. Real bumps of that size look the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    correlate,
    gaussian_filter1d,
    maximum_filter,
    minimum_filter,
    uniform_filter1d,
)
from scipy.special import chdtri

from ..arguments import cached_property
from ..files.arrays import Array
from .elevation import BESIDE, LAYER_M, ElevationMap
from .triangle_mesh import connected as connected

_QUIETEST = (0.04, 0.12, 0.35)
"""Quantiles of the residuals of small windows from which the noise is estimated, the least: no edge
crosses those."""
_FINEST_M = 0.01
"""Side of the smallest cell of a cloud [m]."""

_FEW, _STRIP = 3, 1 << 14
"""Squares of so many cells a side are summed cell by cell, which is quicker; and so many cells are
looked at at once."""

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
            moments=by_strips(moments_of, one, i, j, z),
            corner_m=np.array([terrain.x_m[0], terrain.y_m[0], lowest]),
            spacing_m=terrain.spacing_m,
        )

    @classmethod
    def of_points(
        cls, points_m: Array, coarsest_m: float, noise_m: float, per_cell: float = 2.0
    ) -> GroundCells:
        """The upper side of a cloud, shape (K, 3), about so many points per cell and no cell wider
        than ``coarsest_m``.
        """
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        area = max(float(np.prod(high[:2] - low[:2])), coarsest_m**2)
        spacing = min(max(float(np.sqrt(per_cell * area / len(points_m))), _FINEST_M), coarsest_m)
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

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """Tell which cells have samples."""
        return np.asarray(self.moments[0] > 0.0)

    @cached_property
    def heights(self) -> Array:
        """Mean height of each cell's samples, NaN where there is none [m]."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.moments[6] / self.moments[0])

    @cached_property
    def places(self) -> tuple[Array, Array]:
        """Mean place of each cell's samples, the middle of a cell that has none."""
        one = np.where(self.known, self.moments[0], 1.0)
        i, j = np.indices(one.shape, dtype=np.float64)
        return np.where(self.known, self.moments[1] / one, i), np.where(
            self.known, self.moments[2] / one, j
        )

    @cached_property
    def _summed(self) -> list[tuple[Labels, Array]]:
        """The labels whose sums were asked for last, and these."""
        return []

    def sums(self, labels: Labels) -> Array:
        """Moments of each surface, of whose cells these are the labels, shape (10, S)."""
        if not (self._summed and np.array_equal(self._summed[0][0], labels)):
            sums = sums_of(labels, self.moments, int(labels.max(initial=-1)) + 1)
            self._summed[:] = [(labels.copy(), sums)]
        return self._summed[0][1]

    def only(self, wanted: NDArray[np.bool_]) -> GroundCells:
        """Cells without the samples of other cells."""
        return self if wanted[self.known].all() else replace(self, moments=self.moments * wanted)

    def weighed(self, weight: float) -> GroundCells:
        """Cells whose samples count so much each."""
        return replace(self, moments=weight / self.weight * self.moments, weight=weight)

    def noise_m(self) -> float:
        """Deviation of white noise of the heights, by the residuals of planes over 3 × 3 cells that
        no edge crosses.
        """
        one, *_ = sums = boxed(self.moments, 3)
        rms, freedom = rms_about(sums), np.round(one) - 3.0
        enough = freedom >= 3.0
        if np.count_nonzero(enough) < 20:
            return 0.0
        squares, freedom = (rms**2 * one)[enough], freedom[enough].astype(np.int_)
        known = np.arange(3.0, freedom.max() + 1.0)  # of every possible freedom its quantiles, once
        least = [
            np.quantile(squares / chdtri(known, 1.0 - share)[freedom - 3], share)
            for share in _QUIETEST
        ]
        return float(np.sqrt(min(least)))


def moments_of(one: Array, x: Array, y: Array, z: Array) -> Array:
    """The moments 1, x, y, xx, xy, yy, z, xz, yz, zz of heights, one each, shape (10, …)."""
    return np.stack([one, x, y, x * x, x * y, y * y, z, x * z, y * z, z * z])


def hanging_together(down: NDArray[np.bool_], right: NDArray[np.bool_]) -> Labels:
    """The part of each cell of a grid, numbered in the order of their first cells, shape (n, m).

    Arguments:
        down: cells that hang together with those a row before them, shape (n − 1, m).
        right: with those a column before them, shape (n, m − 1).
    """
    first = np.pad(~right, ((0, 0), (1, 0)), constant_values=True)
    run = np.cumsum(first).reshape(first.shape) - 1
    pairs = np.stack([run[:-1][down], run[1:][down]])
    pairs = pairs[:, np.any(np.diff(pairs, prepend=-1), axis=0)]
    return np.asarray(connected(pairs[0], pairs[1], int(run[-1, -1]) + 1)[1][run])


def boxed(moments: Array, side: int, beside: int = 0) -> Array:
    """Sums over squares of ``side`` cells about each cell, nothing beyond the border, shape
    (K, n, m) as that of moments; with so many cells of zeros about them.
    """
    n, m = moments.shape[1:]
    sums = np.zeros((len(moments), n + 2 * beside, m + 2 * beside))
    for values, total in zip(moments, sums, strict=True):
        if side > _FEW:
            for axis in (0, 1):
                values = uniform_filter1d(values, side, axis=axis, mode="constant")
            values = values * side**2
        else:
            values = _slid(_slid(values, side).T, side).T
        total[beside : beside + n, beside : beside + m] = values
    return sums


def _slid(values: Array, side: int) -> Array:
    """Sums over so many rows about each row."""
    total = np.zeros_like(values)
    for shift in range(-(side // 2), side - side // 2):
        ahead, behind = max(shift, 0), max(-shift, 0)
        total[behind : len(total) - ahead] += values[ahead : len(total) - behind]
    return total


def by_strips(function: Callable[..., Array], *arrays: NDArray[Any]) -> Array:
    """Results of a function that looks at each cell by itself, of arrays of shape (…, n, m), some
    rows at a time, with which a processor is far quicker.
    """
    n, m = arrays[0].shape[-2:]
    rows, whole = max(_STRIP // m, 1), np.zeros(0)
    for k in range(0, n, rows):
        strip = function(*(each[..., k : k + rows, :] for each in arrays))
        whole = whole if k else np.empty((*strip.shape[:-2], n, m))
        whole[..., k : k + rows, :] = strip
    return whole


def rms_about(moments: Array) -> Array:
    """The rms of samples off the planes of sums about each cell, shape (n, m) [m]."""
    places = np.indices(moments.shape[1:], dtype=np.float64)
    return by_strips(lambda sums, i, j: solved(about(sums, i, j))[1], moments, *places)


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
    sums = cells.sums(labels)
    planes, rms = solved(sums)
    return planes.T, rms, sums[0]


def sums_off(labels: Labels, cells: GroundCells, planes: Array | None = None) -> Array:
    """How many samples each cell of a surface has, and the sum of their distances above its plane
    [m], 0 where there are none, shape (2, n, m).

    Arguments:
        planes: of the surfaces, fitted if missing, shape (S, 3).
    """
    planes = fitted(labels, cells)[0] if planes is None else planes
    if not len(planes):
        return np.zeros((2, *labels.shape))

    def off(labels: Labels, moments: Array) -> Array:
        a, b, c = planes.T[:, np.maximum(labels, 0)]
        one, x, y, z = (np.where(labels >= 0, moments[k], 0.0) for k in (0, 1, 2, 6))
        return np.stack([one, z - a * x - b * y - c * one])

    return by_strips(off, labels, cells.moments)


def residuals(labels: Labels, cells: GroundCells, planes: Array | None = None) -> Array:
    """Mean distance of each cell's samples above the plane of its surface, 0 where there are none,
    shape (n, m) [m]; of planes that are fitted if missing, shape (S, 3).
    """
    one, off = sums_off(labels, cells, planes)
    return np.asarray(off / np.where(one > 0.0, one, 1.0))


def inside(labels: Labels) -> NDArray[np.bool_]:
    """Cells of a surface whose four neighbours are of it, shape (n, m)."""
    padded, within = np.pad(labels, 1, constant_values=-1), labels >= 0
    for u, v in ((0, 1), (2, 1), (1, 0), (1, 2)):
        within &= padded[u : u + len(labels), v : v + labels.shape[1]] == labels
    return within


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
    key = (number * (labels.shape[0] // side + 2) + i // side) * wide + j // side
    _, first, block = np.unique(key, return_index=True, return_inverse=True)
    owner = number[first]
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


_WIDEST_M = 0.13
"""Side of the largest squares of samples: most grounds have some that no edge crosses [m]."""
_MOST_SQUARES = 12_000
"""Squares of one size that are looked at, at most."""
_FEWEST_SQUARES = 60
_RISES, _BROAD_RISE = (1.06, 1.2), 2.0
"""Residuals of white noise over narrow squares do not grow with the distance of samples: not by the
second factor, and not by the first where those of wide squares grow by a third."""
_LENGTHS_M = np.geomspace(0.015, 0.2, 23)
"""Lengths that are tried [m]."""
_LONGEST_M = 0.1
"""What is correlated over more is the shape of the ground [m]."""
_HILLS = 2.0
"""Wide squares are off planes by no more than so many deviations of the noise by narrow ones."""
_WHOLE = 0.9
"""Neighbours that are off planes by more than this share of the noise are not alike."""
_EXACT_M = 1e-4
"""Residuals below this are no noise, however alike rounding makes them [m]."""
_NEIGHBOURS = 0.18
"""Correlation of neighbours' residuals by chance, and by surfaces that are no planes, is less."""
_WHITE = np.array([0.0, 0.03, 0.1, 0.2, 0.35, 0.5, 0.7])
"""Shares of white noise in the variance that are tried."""
LEAST, _BIN, _SMOOTH = 0.15, 0.05, 0.35
"""Of a mode its least share of the highest one; width of the bins of logarithms of variances, and
of what they are smoothed by."""
_QUIET, _TRUSTED = 0.04, 2.0
"""Quantile beside the mode, and how many times as large as by it the deviation by the mode may
be."""
_OFTEN = 3
"""A cell of a cloud is as good as so many places along each of its sides."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of the heights of a map or a cloud.

    Arguments:
        deviation_m: standard deviation of a height [m].
        length_m: distance at which the correlation of two heights is 1/e, 0 for white noise [m].
        correlated: share of the variance that is correlated.
        near_m: deviation of heights off planes through 3 × 3 cells beside each other [m].
    """

    deviation_m: float
    length_m: float = 0.0
    correlated: float = 0.0
    near_m: float = 0.0

    def samples_alike(self, per_m2: float) -> float:
        """Number of samples, of so many per m², that a mean is no surer by than by one of white
        noise; 1 or more.
        """
        return 1.0 + self.correlated * (max(np.pi * self.length_m**2 * per_m2, 1.0) - 1.0)


def correlated_noise(cells: GroundCells, told_m: float | None = None) -> Noise | None:
    """The noise of heights that is correlated over a few centimetres; None where it is white, or
    nothing can be said.

    Squares that are long and narrow cross fewer edges, and tell whether it is white; wide ones
    know its size. Noise of given deviation is alike over as much as neighbours miss of it.

    Arguments:
        cells: the samples.
        told_m: deviation of the noise, where it is known [m].
    """
    narrow = _residuals(cells, wide=False)
    rise = max(narrow, default=0.0) / max([*narrow[:1], 1e-9])
    if told_m is None and rise <= _RISES[0]:
        return None
    broad = _residuals(cells, wide=True)
    spread = max(broad, default=0.0) / max([*narrow[:1], 1e-9])
    if told_m is not None:
        white = not narrow or (rise <= _RISES[0] and spread <= _BROAD_RISE)
        return None if white else _alike(cells, narrow[0], told_m, _fitted(cells, broad, wide=True))
    if rise <= _RISES[1] and spread <= _BROAD_RISE:
        return None
    noise = _fitted(cells, broad, wide=True)
    if noise is not None and noise.length_m <= _LONGEST_M:
        return noise
    noise = _fitted(cells, narrow, wide=False)  # edges cross the wide squares, or it is a hill
    if noise is None or noise.length_m > _LONGEST_M or max(broad) > _HILLS * noise.deviation_m:
        return None
    return noise


def noise_of_residuals(labels: Labels, cells: GroundCells, noise_m: float) -> Noise:
    """The noise of heights that was taken for white, as the residuals of surfaces show it:
    correlated over as much as residuals of neighbouring cells are alike, else white.

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        cells: the samples.
        noise_m: its deviation [m].
    """
    rest = residuals(labels, cells)
    both = squares = count = 0.0
    for one, other in BESIDE:
        within = (labels[one] == labels[other]) & (labels[one] >= 0)
        within &= cells.known[one] & cells.known[other]
        left, right = rest[one][within], rest[other][within]
        both += float(left @ right)
        squares += 0.5 * float(left @ left + right @ right)
        count += len(left)
    if both <= _NEIGHBOURS * squares or squares <= count * _EXACT_M**2:
        return Noise(deviation_m=noise_m)
    length_m = cells.spacing_m / float(np.sqrt(np.log(squares / both)))
    return Noise(deviation_m=noise_m, length_m=length_m, correlated=1.0, near_m=noise_m)


def _alike(cells: GroundCells, near_m: float, told_m: float, fitted: Noise | None) -> Noise | None:
    """Noise of this deviation whose neighbours are off planes by so little; longer where the
    deviations of wide squares say so. None where neighbours are off by all of it.
    """
    if near_m > _WHOLE * told_m:
        return None
    left = np.array([_remaining(cells, (1, 1), length) for length in _LENGTHS_M.tolist()])
    length_m = float(_LENGTHS_M[np.abs(np.log(left / (near_m / told_m) ** 2)).argmin()])
    noise = Noise(deviation_m=told_m, length_m=length_m, correlated=1.0, near_m=near_m)
    if fitted is None or fitted.length_m > _LONGEST_M:
        return noise
    seen = replace(fitted, deviation_m=told_m)
    return max(noise, seen, key=lambda each: each.samples_alike(cells.spacing_m**-2))


def _residuals(cells: GroundCells, *, wide: bool) -> list[float]:
    """Deviation of heights off planes through 3 × 3 cells, 1, 2, 3, … cells apart, that no edge
    crosses [m]. Of narrow squares those beside each other along one axis, the quieter one of
    both.
    """
    deviations = list[float]()
    for step in range(1, int(_WIDEST_M / (2.0 * cells.spacing_m)) + 1):
        ways = [(step, step)] if wide else [(step, 1), (1, step)]
        known = [each for way in ways if (each := _along(cells, *way)) is not None]
        if not known or (deviations and min(known) > deviations[-1] * (step / (step - 1)) ** 2.5):
            break  # no noise rises so fast: edges cross all squares
        deviations.append(min(known))
    return deviations


def _fitted(cells: GroundCells, deviations: list[float], *, wide: bool) -> Noise | None:
    """The noise that leaves such deviations to planes."""
    if len(deviations) < 2:
        return None
    white = _WHITE if len(deviations) > 2 else _WHITE[:1]
    steps = range(1, len(deviations) + 1)
    shapes = np.array(
        [
            [_remaining(cells, (step, step if wide else 1), length) for step in steps]
            for length in _LENGTHS_M.tolist()
        ]
    )
    models = np.sqrt(white[:, None, None] + (1.0 - white[:, None, None]) * shapes)
    scales = models @ deviations / np.sum(models**2, axis=2)
    misfits = np.sum((scales[..., None] * models - deviations) ** 2, axis=2)
    share, length = np.unravel_index(int(misfits.argmin()), misfits.shape)
    return Noise(
        deviation_m=float(scales[share, length]),
        length_m=float(_LENGTHS_M[length]),
        correlated=float(1.0 - white[share]),
        near_m=deviations[0],
    )


def _along(cells: GroundCells, *steps: int) -> float | None:
    """Such a deviation for cells so many apart along each axis [m]."""
    n, m = (count - 2 * step for count, step in zip(cells.known.shape, steps, strict=True))
    if min(n, m) < 1:
        return None
    stride = int(np.ceil(np.sqrt(n * m / _MOST_SQUARES)))
    i, j = np.meshgrid(np.arange(0, n, stride), np.arange(0, m, stride), indexing="ij")
    sums = np.zeros((10, *i.shape))
    for u in (0, steps[0], 2 * steps[0]):
        for v in (0, steps[1], 2 * steps[1]):
            sums += cells.moments[:, u : u + n : stride, v : v + m : stride]
    whole = sums[0] >= 6.0
    if np.count_nonzero(whole) < _FEWEST_SQUARES:
        return None
    _, rms = solved(about(sums, i + steps[0], j + steps[1])[:, whole])
    freedom = np.round(sums[0][whole]) - 3.0
    squares = rms**2 * sums[0][whole]
    known, of = np.unique(freedom, return_inverse=True)
    quiet = float(np.quantile(squares / chdtri(known, 1.0 - _QUIET)[of], _QUIET))
    mode = _lowest_mode(squares / freedom)
    return float(np.sqrt(mode if mode <= _TRUSTED**2 * quiet else quiet))


def _lowest_mode(variances: Array) -> float:
    """Lowest value about which logarithms of variances gather, which is the variance itself, however many
    squares are crossed by edges.
    """
    logs = np.log(np.maximum(variances, 1e-18))
    bins = np.arange(logs.min() - 1.0, logs.max() + 1.0 + _BIN, _BIN)
    density = gaussian_filter1d(np.histogram(logs, bins)[0].astype(float), _SMOOTH / _BIN)
    peaks = np.flatnonzero((density[1:-1] >= density[:-2]) & (density[1:-1] > density[2:])) + 1
    first = peaks[density[peaks] > LEAST * density.max()][0]
    return float(np.exp(bins[first] + 0.5 * _BIN))


def _remaining(cells: GroundCells, steps: tuple[int, int], length_m: float) -> float:
    """Share of the variance of correlated noise that planes through such cells leave."""
    within = (np.arange(_OFTEN) + 0.5) / _OFTEN - 0.5 if cells.sparse else np.zeros(1)
    x, y = (
        values.ravel()
        for values in np.meshgrid(
            *(
                cells.spacing_m * (each * np.array([-1.0, 0.0, 1.0])[:, None] + within).ravel()
                for each in steps
            )
        )
    )
    correlation = np.exp(-((x[:, None] - x) ** 2 + (y[:, None] - y) ** 2) / length_m**2)
    fit = 1.0 + np.outer(x, x) / np.mean(x * x) + np.outer(y, y) / np.mean(y * y)
    alike = float(np.mean(fit * correlation))
    if not cells.sparse:
        return max((9.0 - 9.0 * alike) / 6.0, 1e-6)
    count = 9.0 * max(float(np.mean(cells.moments[0][cells.known])), 1.0)
    return max((count - 3.0 - (count - 1.0) * alike) / (count - 3.0), 1e-6)


_WINDOW_M, _FEWEST = 0.06, 2
"""Half width of the window that a step is looked for in [m], and the fewest cells."""
_SEEN = 4.0
"""Steps are seen that are so many deviations high."""
_RESIDUE = 0.02
"""Share of the variance that is taken for white at least: no noise is as smooth as its model."""
_MEDIAN, _ENOUGH = 0.6745, 40
"""Half of all values of a normal distribution are within so many deviations; and the number of
windows from which the deviation is estimated."""


def half_window(spacing_m: float) -> int:
    """Half width of the window in cells."""
    return max(round(_WINDOW_M / spacing_m), _FEWEST)


def windows(noise: Noise, spacing_m: float) -> Iterator[tuple[Array, float]]:
    """Weights of the heights in windows, shape (h, w), whose sum is the height of a step along the
    middle, in four directions; and the deviation of this height by the noise [m].
    """
    half = half_window(spacing_m)
    between, whole = np.arange(-half, half) + 0.5, np.arange(-half, half + 1.0)
    for rows, turned in ((between, False), (whole, True)):
        i, j = spacing_m * np.stack(np.meshgrid(rows, whole, indexing="ij"))
        step = 0.5 * np.sign(np.round((i + j if turned else i) / spacing_m, 3))
        weights, deviation = _weights(i.ravel(), j.ravel(), step.ravel(), noise)
        weights = weights.reshape(i.shape)
        yield weights, deviation
        yield weights[::-1] if turned else weights.T, deviation


def _weights(x: Array, y: Array, edge: Array, noise: Noise) -> tuple[Array, float]:
    """Weights that estimate the size of an edge beside a plane with the least variance, and the
    standard deviation that the noise leaves to this estimate [m].
    """
    apart = ((x[:, None] - x) ** 2 + (y[:, None] - y) ** 2) / noise.length_m**2
    smooth = min(noise.correlated, 1.0 - _RESIDUE)
    covariance = smooth * np.exp(-apart) + (1.0 - smooth) * np.eye(len(x))
    terms = np.column_stack([edge, np.ones_like(x), x, y])
    weighted = np.linalg.solve(covariance, terms)
    inverse = np.linalg.inv(terms.T @ weighted)
    return weighted @ inverse[0], float(noise.deviation_m * np.sqrt(inverse[0, 0]))


def hidden_edges(
    labels: Labels, cells: GroundCells, noise: Noise
) -> tuple[NDArray[np.bool_], float]:
    """Cells beside edges within surfaces, shape (n, m); and the deviation of a step's height [m].

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        cells: the samples.
        noise: correlated.
    """
    beside_edges = np.zeros(labels.shape, dtype=bool)
    rest, known = residuals(labels, cells), (labels >= 0) & cells.known
    count, total = boxed(np.stack([known, known * rest]).astype(np.float64), 3)
    about = count > 0.5  # a cell without samples is as those about it
    rest = np.where(known, rest, total / np.where(about, count, 1.0))
    usable = np.where(about, labels, -1)
    if cells.sparse:  # the outermost cells have points of what is beside
        low, high = (turn(usable, 3) for turn in (minimum_filter, maximum_filter))
        usable = np.where(low == high, usable, -1)
    unseen = list[float]()
    for weights, deviation in windows(noise, cells.spacing_m):
        shape = weights.shape
        size = np.abs(correlate(rest, weights, mode="nearest"))
        whole = minimum_filter(usable, shape, mode="constant", cval=-1)
        inside = (whole >= 0) & (whole == maximum_filter(usable, shape, mode="constant", cval=-1))
        if not inside.any():
            continue
        if np.count_nonzero(inside) >= _ENOUGH:
            deviation = float(np.median(size[inside])) / _MEDIAN
        unseen.append(deviation)
        beside_edges |= inside & (size > _SEEN * deviation)
    return beside_edges, max(unseen, default=noise.deviation_m)
