"""Surfaces of noisy heights: planes that end at steps, though a step may be no higher than two
deviations of the noise.

1. About every cell a square of 3 × 3 blocks is fitted by a plane. A step, a ridge or a crease under it moves the means
   of its blocks off the plane, by more than the noise of means: its lack of fit.
2. Every cell takes the plane of that square about it whose blocks fit best, which is one on its own side of an edge.
3. Neighbouring cells whose planes go on in one another are of one surface; a surface whose blocks do not fit one plane
   is parted in two, again and again; two that one plane fits as well as two are one.
4. Cells at borders go to the neighbouring surface whose plane is nearer, in view of the noise and of their neighbours.
5. What is left is looked at again with smaller squares that see nothing else: strips.
6. Where means over a few cells of a surface are off its plane, another surface is: few samples among many do not bend
   the whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from ..files.arrays import Array
from .correlation import (
    GroundCells,
    Labels,
    Noise,
    about,
    block_squares,
    boxed,
    by_strips,
    fitted,
    half_window,
    hanging_together,
    hidden_edges,
    mean_square,
    moments_of,
    renumbered,
    residuals,
    rms_about,
    solved,
    sums_of,
    sums_off,
)
from .elevation import BESIDE
from .footholds import FootholdLimits
from .map_certainty import LEAST_STEP_M

_FINE_SD_M = 0.0035
"""Deviation that the height of a square's plane is to have at its middle; squares are as large as
that takes [m]."""
COARSE_SD_M = 0.012
"""That of the smallest square that is looked at [m]."""
LARGEST_M = 0.27
"""Side of the largest square; one of 3 × 3 cells is looked at however large cells are [m]."""
TURN_RAD = 0.12
"""Planes of neighbouring cells that differ by more are of two surfaces, where there is no noise
[rad]."""
_FEWEST = 6
"""Samples that a plane is fitted to."""
_FEWEST_ALIKE = 2.0
"""The same of samples whose noise is alike, by what they count."""
_SURE = 16.4
"""Mean plus three deviations of χ² of six degrees of freedom, as many as 3 × 3 blocks leave a
plane."""
_ALIKE = 25.0
"""Two surfaces of one plane have a larger sum of squares than of two planes by more than this, in
variances of the noise, once in ten thousand times."""
_OF_PLACES = np.array([1.0] * 6 + [0.0] * 4)[:, None]
"""Of moments those without heights."""
OFF = 2.5
NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_FARTHEST = 3.0
"""A cell is off the plane of its surface by no more than this, in deviations."""
_AWAY = (0.5, 0.1)
"""Cells may be so far off the plane of their surface beside its noise, of noisy ones and of exact
grids, in shares of the roughness."""
_AGREEMENT, _SWEEPS = 1.5, 4
"""What a neighbour of the same surface counts for, as a difference of squares in variances of the
noise, and how often borders are looked at."""
_JUDGED_M, _CHOSEN = 0.1, 6.0
"""Side of the blocks by which surfaces are joined at last [m], and how many deviations those of the
smaller one may be off, whose cells were chosen by their heights."""
_ROUNDS, _LLOYD, _JOINED = 12, 4, 16
QUIET = 0.25
"""Noise below this share of the roughness is a part of it: heights are exact."""
_FINE_M, _SPIKES, _TWO, _NARROWEST_M = 0.04, 0.02, 0.5, 0.08
"""Of exact heights: side of the blocks that are looked at first [m]; a surface is no plane of whose
cells more than this share is off it by more than the roughness; two planes are far nearer than one
if their rms is less than this share of its; halves that are narrower in the mean are waves of one
surface [m]."""
_TRIMMED = (2.0, 2.0, 1.7, 1.7, 1.5)
"""Cells farther than this off a surface that is no plane are taken from it, in its largest rms,
round by round."""
_LUMPS, _LUMP_SD = (((3, 5, 7), 2.0), ((1,), 1.0)), 3.5
"""Sides of squares of cells whose means over a surface are looked at, of noisy and of exact heights, and how far
they may be off its plane: in times the roughness, and in deviations of the mean."""
_LOOKS = 4
"""How often hidden edges are looked for, each time without those that were found."""
_CLOSED, _MOST_VOTES, _ALONE = 3, 5, 4.5
"""How often single cells are closed, how many of eight neighbours of one surface that takes, and
how far off it they may be in deviations of the noise."""


def noisy_surfaces(cells: GroundCells, limits: FootholdLimits, noise_m: float) -> Labels:
    """The surface of every cell, −1 for none, shape (n, m). Heights with next to no noise are exact:
    planes are far smaller than the roughness off them where they can be.

    Arguments:
        cells: the samples.
        limits: for roughness and slope.
        noise_m: deviation of a sample, whose noise is white [m].
    """
    labels = np.full(cells.known.shape, -1)
    if np.count_nonzero(cells.known) < _FEWEST:
        return labels
    exact, whole = noise_m < QUIET * limits.roughness_m, np.where(cells.known, 0, -1)
    if exact and not cells.sparse and np.abs(residuals(whole, cells)).max() <= noise_m:  # one plane
        return _large_enough(whole, cells)
    fine, coarse = (_side(cells, noise_m, sd) for sd in (_FINE_SD_M, COARSE_SD_M))
    if exact:
        fine = max(fine, round(_FINE_M / cells.spacing_m))
    sides = sorted({fine, (fine + coarse) // 2, coarse}, reverse=True)
    for side in sides:
        left = cells.known & (labels < 0)
        if np.count_nonzero(left) < _FEWEST:
            break
        result = _of_squares(cells.only(left), side, limits, noise_m)
        result = _joined(
            _parted(result, cells, limits, noise_m, side), cells, limits, noise_m, side
        )
        labels = np.where(result >= 0, result + labels.max() + 1, labels)
        labels = _bordered(_large_enough(labels, cells), cells, limits, noise_m)
    labels = _joined(renumbered(labels), cells, limits, noise_m, coarse)
    labels = _large_enough(_bordered(labels, cells, limits, noise_m), cells)
    if exact:
        labels = _large_enough(_without_steps(labels, cells), cells)
    labels = _parted(
        _trimmed(renumbered(labels), cells, limits, noise_m), cells, limits, noise_m, coarse
    )
    labels = _bordered(_rejoined(labels, cells, noise_m), cells, limits, noise_m)
    lumps = _lumps(labels, cells, limits, noise_m)
    if lumps.any():
        labels = apart(np.where(lumps, labels + labels.max() + 1, labels))
        labels = _bordered(_large_enough(labels, cells), cells, limits, noise_m)
    labels = _large_enough(_closed(labels, cells, noise_m), cells)
    lumps = _lumps(labels, cells, limits, noise_m)
    return renumbered(_large_enough(np.where(lumps, -1, labels), cells) if lumps.any() else labels)


def _without_steps(labels: Labels, cells: GroundCells) -> Labels:
    """Surfaces without the cells between which there is a step, though they are about one plane."""
    off = np.where(labels >= 0, residuals(labels, cells), np.nan)
    beside = np.zeros(labels.shape, dtype=bool)
    for one, other in BESIDE:
        step = (labels[one] == labels[other]) & (np.abs(off[one] - off[other]) > LEAST_STEP_M)
        beside[one] |= step
        beside[other] |= step
    return np.where(beside, -1, labels)


def on_creases(
    labels: Labels, cells: GroundCells, planes: Array, exact: NDArray[np.bool_], within_m: float
) -> Labels:
    """The second surface of each cell of a map whose sample is on the planes of two that meet all
    along their border, one nowhere above the other; −1 for none, shape (n, m).

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        planes: of the surfaces, shape (S, 3).
        exact: which of them are looked at, shape (S,).
        within_m: how far off a plane samples on it may be [m].
    """
    second, plane = np.full(labels.shape, -1), np.append(exact, False)
    around, (i, j) = _around(labels, plane[labels], same=False)
    beside = around[:4]
    k, at = np.nonzero(plane[beside] & (beside != labels[i, j]))
    i, j, other = i[at], j[at], beside[k, at]
    pairs = np.stack([labels[i, j], other])
    a, b, c = planes.T[:, pairs]
    level = a * i + b * j + c
    on = np.abs(level - cells.heights[i, j]).max(axis=0, initial=0.0) <= within_m
    key, above = pairs.min(axis=0) * len(planes) + pairs.max(axis=0), level[1] - level[0]
    for each in np.unique(key[on]).tolist():
        its = key == each
        if (above[its].min() < -within_m) == (above[its].max() > within_m):
            on &= ~its
    second[i[on], j[on]] = other[on]
    return second


def correlated_surfaces(
    cells: GroundCells, limits: FootholdLimits, noise: Noise
) -> tuple[Labels, float]:
    """The surface of every cell, −1 for none, shape (n, m), of heights whose noise is correlated;
    and the deviation of what a step would be that is not seen [m].

    Arguments:
        cells: the samples.
        limits: for roughness and slope.
        noise: correlated.
    """
    labels, noise_m = np.full(cells.known.shape, -1), noise.deviation_m
    if np.count_nonzero(cells.known) < _FEWEST:
        return labels, noise_m
    side, beside = _side(cells, noise_m, COARSE_SD_M), 2 * half_window(cells.spacing_m) + 1
    whole = _between_edges(cells, noise.near_m)
    hidden = np.zeros(labels.shape, dtype=bool)
    for _ in range(_LOOKS):
        labels = apart(np.where(maximum_filter(hidden, beside), -1, whole))
        labels = _large_enough(_parted(labels, cells, limits, noise_m, side), cells)
        labels = _closed(_bordered(labels, cells, limits, noise_m), cells, noise_m)
        labels = renumbered(_large_enough(labels, cells))
        edges, unseen_m = hidden_edges(labels, cells, noise)
        if not (edges & ~hidden).any():
            break
        hidden |= edges
    return renumbered(_large_enough(np.where(edges, -1, labels), cells)), unseen_m


def _side(cells: GroundCells, noise_m: float, deviation_m: float) -> int:
    """Side of the blocks, 3 × 3 of which have a plane whose height is known to this deviation, in
    cells.
    """
    dense = max(float(np.mean(cells.moments[0][cells.known])), cells.weight)
    largest = max(int(LARGEST_M / (3.0 * cells.spacing_m)), 1)
    return int(np.clip(np.ceil(noise_m / (deviation_m * 3.0 * np.sqrt(dense))), 1, largest))


def _lumps(
    labels: Labels, cells: GroundCells, limits: FootholdLimits, noise_m: float
) -> NDArray[np.bool_]:
    """Cells about which the mean of a surface is off its plane by more than noise and roughness
    are; of exact heights each cell by itself.
    """
    lumps, sums = np.zeros(labels.shape, dtype=bool), sums_off(labels, cells)
    sides, rough = _LUMPS[noise_m < QUIET * limits.roughness_m]
    for side in sides:
        count, off = boxed(sums, side)
        most = (_LUMP_SD * noise_m) ** 2 * count + (rough * limits.roughness_m * count) ** 2
        lumps |= (labels >= 0) & (off**2 > most)
    return lumps


def _between_edges(cells: GroundCells, near_m: float) -> Labels:
    """Surfaces of cells that hang together beside those that an edge crosses: planes through 3 × 3
    cells are off them by more than noise is that is alike in neighbours.
    """
    sums = boxed(cells.moments, 3) / cells.weight
    squares, freedom = rms_about(sums) ** 2 * sums[0], np.maximum(sums[0] - 3.0, 1.0)
    inside = cells.known & (squares <= _SURE / 6.0 * near_m**2 * freedom)
    return apart(np.where(inside, 0, -1))


def _trimmed(labels: Labels, cells: GroundCells, limits: FootholdLimits, noise_m: float) -> Labels:
    """Surfaces that are no planes within the noise, without the cells that are farthest off."""
    most = float(np.hypot(limits.roughness_m, noise_m))
    for share in _TRIMMED:
        planes, rms, count = fitted(labels, cells)
        bent = rms > most * (1.0 + 3.0 / np.sqrt(2.0 * np.maximum(count, 1.0)))
        if not bent.any():
            break
        of = np.maximum(labels, 0)
        off = mean_square(planes[of].transpose(2, 0, 1), cells.moments)
        labels = np.where((labels >= 0) & bent[of] & (off > (share * most) ** 2), -1, labels)
    return labels


def _closed(labels: Labels, cells: GroundCells, noise_m: float) -> Labels:
    """Labels with single cells in the midst of a surface given to it: of noise far off, or of a
    cloud's chance.
    """
    n, m = labels.shape
    fillable = np.ones((n, m), dtype=bool) if cells.sparse else cells.known
    planes, (x, y), mean = fitted(labels, cells)[0], cells.places, cells.heights
    for _ in range(_CLOSED):
        around, (i, j) = _around(labels, fillable & (labels < 0))
        votes = np.sum(around[None] == around[:, None], axis=0) * (around >= 0)
        best = around[votes.argmax(axis=0), np.arange(len(i))]
        a, b, c = planes[np.maximum(best, 0)].T if len(planes) else np.zeros((3, len(i)))
        off = np.abs(a * x[i, j] + b * y[i, j] + c - mean[i, j])
        chosen = (votes.max(axis=0) >= _MOST_VOTES) & ~(off > _ALONE * noise_m)
        if not chosen.any():
            break
        labels = labels.copy()
        labels[i[chosen], j[chosen]] = best[chosen]
    return labels


def _around(
    labels: Labels, wanted: NDArray[np.bool_], *, same: bool = True
) -> tuple[Labels, tuple[Labels, Labels]]:
    """The surfaces of the eight neighbours of cells, shape (8, K), −1 beyond the map, and which
    cells: those wanted, without those whose neighbours are all of their own surface where not
    ``same``.
    """
    padded = np.pad(labels, 1, constant_values=-1)
    (n, m), row = labels.shape, labels.shape[1] + 2
    if not same:
        differ = np.zeros((n, m), dtype=bool)
        for u, v in NEIGHBOURS:
            differ |= padded[1 + u : 1 + u + n, 1 + v : 1 + v + m] != labels
        wanted = wanted & differ
    i, j = np.nonzero(wanted)
    at = (i + 1) * row + j + 1
    return np.stack([padded.ravel()[at + row * u + v] for u, v in NEIGHBOURS]), (i, j)


def _of_squares(cells: GroundCells, side: int, limits: FootholdLimits, noise_m: float) -> Labels:
    """Surfaces by the best square about each cell, of 3 × 3 blocks of this side in cells."""
    padded = boxed(cells.moments, side, side)
    shifts = [(side * u, side * v) for u in (-1, 0, 1) for v in (-1, 0, 1)]
    n, m = cells.known.shape
    parts = (padded[:, side + u : side + u + n, side + v : side + v + m] for u, v in shifts)
    i, j = np.indices((n, m), dtype=np.float64)

    def fit(i: Array, j: Array, *blocks: Array) -> Array:
        total = sum(blocks, start=np.zeros(blocks[0].shape))
        (a, b, c), rms = solved(about(total, i, j))
        off = np.zeros(i.shape)
        for one, x, y, z in (block[[0, 1, 2, 6]] for block in blocks):
            rest = z - a * (x - i * one) - b * (y - j * one) - c * one
            off += rest**2 / np.maximum(one, cells.weight)
        return np.stack([total[0], a, b, c, rms, off])

    number, a, b, c, rms, off = by_strips(fit, i, j, *parts)
    count = np.maximum(number, cells.weight)
    variance = noise_m**2
    slope = np.hypot(a, b) / cells.spacing_m
    spread = cells.spacing_m * side * np.sqrt(6.0 / 9.0)  # of places in a square along an axis
    slope_sd = noise_m / (spread * np.sqrt(count))
    fits = (number >= _FEWEST) & (off / count <= limits.roughness_m**2 + _SURE * variance / count)
    fits &= rms <= np.hypot(limits.roughness_m, noise_m) * (1.0 + 3.0 / np.sqrt(2.0 * count))
    fits &= slope <= np.tan(min(limits.slope_rad + TURN_RAD, 1.5)) + 3.0 * slope_sd
    score = np.where(fits, (off + 6.0 * variance) / count, np.inf)
    best = np.full((n, m), np.inf)
    away = np.zeros((2, n, m), dtype=np.int_)
    for u, v in sorted(shifts, key=lambda way: abs(way[0]) + abs(way[1])):
        here, there = zip(_overlap(n, u), _overlap(m, v), strict=True)
        better = score[there] < best[here] * (0.9 if (u, v) != (0, 0) else 1.0)
        np.copyto(best[here], score[there], where=better)
        np.copyto(away[:, *here], np.reshape([u, v], (2, 1, 1)), where=better)
    at = np.arange(n * m).reshape(n, m) + m * away[0] + away[1]
    a, b, c, count, slope_sd = (each.ravel()[at] for each in (a, b, c, count, slope_sd))
    plane = np.stack([a, b, c - a * away[0] - b * away[1]])
    lever = np.sqrt(1.0 + 1.5 * np.abs(away).sum(axis=0) / side)
    deviation = np.stack([lever * noise_m / np.sqrt(count), slope_sd])
    ground = cells.known & np.isfinite(best)
    goes_on = (
        _continued(plane, deviation, ground, axis, cells.spacing_m, limits) for axis in (0, 1)
    )
    return renumbered(np.where(ground, hanging_together(*goes_on), -1))


def _overlap(count: int, shift: int) -> tuple[slice, slice]:
    """Cells along an axis, and those so many further on."""
    return slice(max(-shift, 0), count - max(shift, 0)), slice(
        max(shift, 0), count - max(-shift, 0)
    )


def _continued(
    plane: Array,
    deviation: Array,
    ground: NDArray[np.bool_],
    axis: int,
    spacing: float,
    limits: FootholdLimits,
) -> NDArray[np.bool_]:
    """Tell whose planes go on in those of the cells before them along an axis, in view of their
    deviations.
    """
    there, here = BESIDE[axis]
    (a, b, c), (d, e, f) = plane[:, *here], plane[:, *there]
    wide, turning = np.hypot(deviation[:, *here], deviation[:, *there])
    rise = np.abs(f - c - 0.5 * ((a + d) if axis == 0 else (b + e)))
    fits = ground[here] & ground[there] & (rise <= OFF * np.hypot(limits.roughness_m, wide))
    fits &= (
        np.hypot(a - d, b - e) / spacing
        <= TURN_RAD * (1.0 + (a * a + b * b) / spacing**2) + 3.0 * turning
    )
    return np.asarray(fits)


def _misfits(
    labels: Labels, cells: GroundCells, limits: FootholdLimits, noise_m: float, side: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
    """Surfaces that are no planes, by means over blocks of this side in cells; those of exact
    heights that two planes may be far nearer to; and the rms off each.
    """
    planes, rms, count = fitted(labels, cells)
    squares, blocks = block_squares(labels, cells, planes, side)
    freedom = np.maximum(blocks - 3.0, 0.0)
    allowed = limits.roughness_m**2 * count + noise_m**2 * (
        freedom + 3.0 * np.sqrt(2.0 * freedom) + 3.0
    )
    bent = (squares > allowed) & (blocks > 3)
    bent |= rms > np.hypot(limits.roughness_m, noise_m) * (
        1.0 + 3.0 / np.sqrt(2.0 * np.maximum(count, 1.0))
    )
    large = count >= 2 * _FEWEST
    exact = noise_m < QUIET * limits.roughness_m
    if exact:
        far = (labels >= 0) & (np.abs(residuals(labels, cells, planes)) > limits.roughness_m)
        bent |= np.bincount(labels[far], minlength=len(rms)) > _SPIKES * count
    return bent & large, exact & large & (rms > QUIET * limits.roughness_m), rms


def _borders(halves: Labels, count: int) -> Labels:
    """Number of neighbouring cells in different halves of each surface, whose halves are 2k and
    2k + 1.
    """
    borders = np.zeros(count, dtype=np.int_)
    for one, other in ((halves[each], halves[before]) for each, before in BESIDE):
        differ = (one >= 0) & (one != other) & (one // 2 == other // 2)
        borders += np.bincount(one[differ] // 2, minlength=count)
    return borders


def _smoothed(labels: Labels, cells: GroundCells, side: int) -> Array:
    """Heights of cells as means over the cells of the same surface in a square, by its plane's
    slope.
    """
    planes = fitted(labels, cells)[0]
    of = np.maximum(labels, 0)
    a, b, c = (planes[of, k] for k in range(3))
    box = boxed(sums_off(labels, cells, planes), 2 * (side // 2) + 1)
    i, j = np.indices(labels.shape)
    return np.asarray(a * i + b * j + c + box[1] / np.maximum(box[0], 0.5 * cells.weight))


def _parted(
    labels: Labels, cells: GroundCells, limits: FootholdLimits, noise_m: float, side: int
) -> Labels:
    """Surfaces parted in two until each is a plane."""
    for _ in range(_ROUNDS):
        bent, coarse, rms = _misfits(labels, cells, limits, noise_m, side)
        if not (bent | coarse).any():
            break
        chosen = (labels >= 0) & np.append(bent | coarse, False)[labels]
        smooth = _smoothed(np.where(chosen, labels, -1), cells, 1 if coarse.any() else side)
        i, j = np.nonzero(chosen)
        number, z, size = labels[i, j], smooth[i, j], len(bent)
        half, off = _halved(number, i.astype(float), j.astype(float), z, size)
        if coarse.any():
            halves = np.full(labels.shape, -1)
            halves[i, j] = half
            count = np.maximum(np.bincount(number, minlength=size), 1)
            squares = np.bincount(number, off.min(axis=0) ** 2, minlength=size)
            two = np.sqrt(squares / count) < _TWO * rms
            narrowest = max(_NARROWEST_M / cells.spacing_m, 2.0)
            bent |= coarse & two & (_borders(halves, size) * narrowest <= count)
            if not bent.any():
                break
        key, parted = labels.copy(), bent[number]
        key[i[parted], j[parted]] = size + half[parted]
        labels = apart(key)
    return labels


def _halved(number: Labels, x: Array, y: Array, z: Array, count: int) -> tuple[Labels, Array]:
    """Surfaces parted in two, 2k and 2k + 1, each cell with the plane that is nearer, and how far it
    is off either, shape (2, K).
    """
    moments, sides = moments_of(np.ones_like(x), x, y, z), _halves_of(number, x, y, count)
    for _ in range(_LLOYD):
        both, _ = solved(sums_of(2 * number + sides, moments, 2 * count))
        a, b, c = both[:, np.stack([2 * number, 2 * number + 1])]
        off = np.abs(a * x + b * y + c - z)
        sides = (off[1] < off[0]).astype(int)
    return 2 * number + sides, off


def _halves_of(number: Labels, x: Array, y: Array, count: int) -> Labels:
    """On which side of the middle of its surface, across its longer axis, each cell is."""
    one, sx, sy, sxx, sxy, syy = (
        np.bincount(number, weights=value, minlength=count)
        for value in (None, x, y, x * x, x * y, y * y)
    )
    one = np.maximum(one, 1)
    mx, my = sx / one, sy / one
    angle = 0.5 * np.arctan2(
        2.0 * (sxy / one - mx * my), sxx / one - mx * mx - (syy / one - my * my)
    )
    return (
        (x - mx[number]) * np.cos(angle)[number] + (y - my[number]) * np.sin(angle)[number] > 0.0
    ).astype(int)


def apart(key: Labels) -> Labels:
    """Labels anew, of which what does not hang together is apart."""
    part = hanging_together(*(key[each] == key[before] for each, before in BESIDE))
    return renumbered(np.where(key >= 0, part, -1))


def _touching(labels: Labels) -> Labels:
    """Pairs of surfaces that touch, shape (2, K)."""
    touching = [
        np.stack([one[differ], other[differ]])
        for one, other in ((labels[each], labels[before]) for each, before in BESIDE)
        for differ in [(one != other) & (one >= 0) & (other >= 0)]
    ]
    return _distinct(np.concatenate(touching, axis=1))


def _distinct(pairs: Labels) -> Labels:
    """Pairs of two surfaces, each once, the smaller number first, in order, shape (2, K)."""
    low, high = pairs.min(axis=0), pairs.max(axis=0)
    size = int(high.max(initial=0)) + 1
    return np.stack(np.divmod(np.unique((low * size + high)[low < high]), size))


def _joined(
    labels: Labels, cells: GroundCells, limits: FootholdLimits, noise_m: float, side: int
) -> Labels:
    """Neighbouring surfaces made one while one plane fits both as well as two, the most alike
    first.
    """
    pairs, sums = _touching(labels), cells.sums(labels)
    whose = np.arange(sums.shape[1])
    for _ in range(_JOINED):
        if not pairs.size:
            break
        planes, rms = solved(sums)
        squares = rms**2 * sums[0]
        both = sums[:, pairs[0]] + sums[:, pairs[1]]
        worse = solved(both)[1] ** 2 * both[0] - squares[pairs[0]] - squares[pairs[1]]
        smaller = np.where(sums[0][pairs[0]] < sums[0][pairs[1]], pairs[0], pairs[1])
        few = sums[0][smaller]
        apart = mean_square(
            planes[:, pairs[0]] - planes[:, pairs[1]], sums[:, smaller] * _OF_PLACES
        )
        unseen = (
            0.5 * limits.roughness_m
        ) ** 2 + 12.0 * noise_m**2 / few  # two deviations of the smaller one's plane
        cost = np.minimum(worse / noise_m**2 / _ALIKE, apart / unseen)
        alike = cost <= 1.0
        least = np.full(len(squares), np.inf)
        for row in pairs:
            np.minimum.at(least, row[alike], cost[alike])
        mutual = alike & (cost <= least[pairs[0]]) & (cost <= least[pairs[1]]) & (few > 0)
        if not mutual.any():
            break
        target = np.arange(len(squares))
        target[pairs[1][mutual]] = pairs[0][mutual]
        target = renumbered(target)
        sums = sums_of(target, sums, int(target.max()) + 1)
        whose, pairs = target[whose], _distinct(target[pairs])
    return np.append(whose, -1)[labels]


def _excess(
    parts: Array,
    block: Labels,
    sums: Array,
    rows: list[Labels],
    pair: tuple[int, ...],
    noise_m: float,
) -> float:
    """Amount by which means over blocks are off one plane of two surfaces, beyond the effect of
    noise, below 0 where they are not; the larger of that of both and that of the smaller one alone,
    in its deviations.
    """
    one, other = pair
    a, b, c = solved(sums[:, one] + sums[:, other])[0]
    members = np.concatenate([rows[one], rows[other]])
    n, x, y, z = (parts[k, members] for k in (0, 1, 2, 6))
    rest = z - a * x - b * y - c * n
    places, at = np.unique(block[members], return_inverse=True)
    together = np.bincount(at, weights=rest) ** 2 / np.bincount(at, weights=n)
    small = (
        slice(0, len(rows[one])) if sums[0, one] < sums[0, other] else slice(len(rows[one]), None)
    )
    alone = rest[small] ** 2 / n[small]
    return max(
        float((squares.sum() / noise_m**2 - freedom) / np.sqrt(2.0 * freedom) - times)
        for squares, freedom, times in (
            (together, max(len(places) - 3.0, 1.0), 3.0),
            (alone, max(float(len(alone)), 1.0), _CHOSEN),
        )
    )


def _rejoined(labels: Labels, cells: GroundCells, noise_m: float) -> Labels:
    """Neighbouring surfaces made one while means over blocks are off one plane of both by no more
    than their noise, all together and those of the smaller one alone: noise parts a wide surface
    here and there, and each part is biased.
    """
    side = max(round(_JUDGED_M / cells.spacing_m), 1)
    wide, count = labels.shape[1] // side + 2, int(labels.max(initial=-1)) + 1
    pairs, whose, (i, j) = _touching(labels), np.arange(count), np.nonzero(labels >= 0)
    keys, parts = (i // side * wide + j // side) * count + labels[i, j], cells.moments[:, i, j]
    known = dict[tuple[int, ...], float]()
    for _ in range(_JOINED):
        if not pairs.size:
            break
        keys, _, of = np.unique(keys, return_index=True, return_inverse=True)  # in long runs
        parts, (block, owner) = sums_of(of, parts, len(keys)), np.divmod(keys, count)
        sums = sums_of(owner, parts, count)
        order = np.argsort(owner, kind="stable")
        rows = np.split(order, np.searchsorted(owner[order], np.arange(1, count)))
        known |= {
            pair: _excess(parts, block, sums, rows, pair, noise_m)
            for pair in zip(*pairs.tolist(), strict=True)
            if pair not in known
        }
        excess = np.array([known[pair] for pair in zip(*pairs.tolist(), strict=True)])
        least = np.full(count, np.inf)
        for row in pairs:
            np.minimum.at(least, row, excess)
        mutual = (excess <= 0.0) & (excess <= least[pairs[0]]) & (excess <= least[pairs[1]])
        if not mutual.any():
            break
        target = np.arange(count)
        target[pairs[1][mutual]] = pairs[0][mutual]
        grown = set(pairs[0][mutual].tolist())
        known = {pair: each for pair, each in known.items() if grown.isdisjoint(pair)}
        keys, whose, pairs = block * count + target[owner], target[whose], _distinct(target[pairs])
    return renumbered(np.append(whose, -1)[labels])


def _bordered(labels: Labels, cells: GroundCells, limits: FootholdLimits, noise_m: float) -> Labels:
    """Cells at borders and without a surface, given to the one about them that height and
    neighbours speak for.
    """
    planes, rms, _ = fitted(labels, cells)
    if not len(planes):
        return labels
    labels = labels.copy()
    rough_m = _AWAY[noise_m < QUIET * limits.roughness_m and not cells.sparse] * limits.roughness_m
    variance = np.maximum(np.minimum(rms, limits.roughness_m), noise_m) ** 2 + rough_m**2
    mean, (x, y), one = cells.heights, cells.places, cells.moments[0]
    for _ in range(_SWEEPS):
        around, (i, j) = _around(labels, cells.known, same=False)
        label = labels[i, j]
        candidates = np.concatenate([label[None], around])
        of = np.maximum(candidates, 0)
        a, b, c = (planes[of, k] for k in range(3))
        off = (
            (a * x[i, j] + b * y[i, j] + c - mean[i, j]) ** 2
            * np.minimum(one[i, j], 4.0 * cells.weight)
            / variance[of]
        )
        votes = np.sum(around[None] == candidates[:, None], axis=1)
        energy = np.where(
            (candidates >= 0) & (off <= _FARTHEST**2 * cells.weight),
            off - _AGREEMENT * votes,
            np.inf,
        )
        alone = ~np.isfinite(energy).any(axis=0)
        best = np.where(alone, -1, candidates[energy.argmin(axis=0), np.arange(len(i))])
        if np.array_equal(best, label):
            break
        labels[i, j] = best
    return labels


def _large_enough(labels: Labels, cells: GroundCells) -> Labels:
    """Labels without surfaces of few samples, and parts apart from each other."""
    labels = apart(labels)
    fewest = _FEWEST if cells.weight == 1.0 else max(_FEWEST * cells.weight, _FEWEST_ALIKE)
    count = np.bincount(
        labels[labels >= 0],
        weights=cells.moments[0][labels >= 0],
        minlength=labels.max(initial=-1) + 1,
    )
    return renumbered(
        np.where((labels >= 0) & np.append(count >= fewest, False)[labels], labels, -1)
    )
