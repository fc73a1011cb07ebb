"""Elevation maps: heights on a grid with holes, as files, sensors and point clouds give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array
from .heightfield import FEWEST, MOST_POINTS, WIDEST_M, HeightField, grid_lines
from .import_options import OTHER_UNIT, Holes

BESIDE = ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1]))
"""Along each axis the cells that have one before them, and those."""
LAYER_M = 0.05
"""Points of a cell this far below its highest one are of the surface seen from above [m]."""
_FARTHEST = 1e15
"""Cells from the origin, numbers of which are still exact."""
_MOST_FILLED = 400_000
"""Holes in cells that are filled at once."""
_HIGHEST_M = 0.9 * LARGEST
"""No height of a map is farther from 0: what is planned on it is higher, and stays within what
values may be [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ElevationMap:
    """Heights at the nodes of a rectilinear grid, NaN where there is none.

    Arguments:
        x_m, y_m: grid lines, shape (n,) and (m,), increasing [m].
        heights_m: shape (n, m) [m].
        samples: how many points each height is of, shape (n, m); one each where that is not known.
        points_m: those of the cloud that it is of, shape (K, 3) [m].
        name: for messages.

    Raises:
        InvalidInput: for fewer than four grid lines, one that is wider than any robot walks, and
            one of holes alone.
    """

    x_m: Array
    y_m: Array
    heights_m: Array
    name: str
    samples: NDArray[np.int_] | None = None
    points_m: Array | None = None

    def __post_init__(self) -> None:
        for axis in ("x_m", "y_m"):
            lines = grid_lines(getattr(self, axis), f"{self.name}: {axis}", f"; {OTHER_UNIT}")
            object.__setattr__(self, axis, lines)
        if np.size(self.heights_m) > MOST_POINTS:
            raise InvalidInput(
                f"{self.name}: expected {MOST_POINTS} grid points or fewer, got "
                f"{np.size(self.heights_m)}"
            )
        heights = np.array(self.heights_m, dtype=np.float64)
        if heights.shape != (len(self.x_m), len(self.y_m)):
            raise InvalidInput(
                f"{self.name}: expected heights of shape ({len(self.x_m)}, {len(self.y_m)}), got "
                f"{heights.shape}"
            )
        if (wrong := np.argwhere(np.isinf(heights))).size:
            raise InvalidInput(
                f"{self.name}: expected heights, NaN where there is none, got {len(wrong)} that "
                "are infinite, the "
                f"first {heights[tuple(wrong[0])]:g} at {wrong[0].tolist()}"
            )
        if np.all(np.isnan(heights)):
            raise InvalidInput(
                f"{self.name}: expected heights, got {heights.size} holes and nothing else"
            )
        low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
        if high - low > WIDEST_M:
            raise InvalidInput(
                f"{self.name}: expected heights within {WIDEST_M:g} m, NaN where there is none, "
                f"got {low:g} to {high:g} m; {OTHER_UNIT}"
            )
        if max(-low, high) > _HIGHEST_M:
            raise InvalidInput(
                f"{self.name}: expected heights up to {_HIGHEST_M:g} m, got {low:g} to {high:g} m"
            )
        heights.setflags(write=False)
        object.__setattr__(self, "heights_m", heights)

    @classmethod
    def of_heights(cls, heights: Array, spacing_m: float, name: str) -> ElevationMap:
        """Heights, shape (n, m) [m], on a square grid of this spacing with its middle at the
        origin.
        """
        x_m, y_m = (spacing_m * (np.arange(count) - 0.5 * (count - 1)) for count in heights.shape)
        return cls(x_m=x_m, y_m=y_m, heights_m=heights, name=name)

    @classmethod
    def of_field(cls, field: HeightField) -> ElevationMap:
        """The nodes of a height field."""
        return cls(x_m=field.x_m, y_m=field.y_m, heights_m=field.heights_m, name=field.name)

    @classmethod
    def of_points(cls, points_m: Array, spacing_m: float, name: str) -> ElevationMap:
        """The upper side of a point cloud, shape (K, 3) [m]: in each cell the mean of the points
        within 5 cm of its highest one. Cells without points are holes. Grid lines are at multiples
        of the spacing.
        """
        ends = points_m.min(axis=0), points_m.max(axis=0)
        far, wide = (
            float(np.abs(ends).max()),
            float(max(float(b) - float(a) for a, b in zip(*ends, strict=True))),
        )
        if far > LARGEST or wide > WIDEST_M:  # before they become whole numbers, which end at 2⁶³
            raise InvalidInput(
                f"{name}: expected points within {WIDEST_M:g} m, no farther than {LARGEST:g} m "
                f"away, got {wide:g} m "
                f"from end to end, {far:g} m away; {OTHER_UNIT}"
            )
        if not spacing_m > far / _FARTHEST:
            raise InvalidInput(
                f"{name}: spacing_m: expected more than {far / _FARTHEST:g} m, got {spacing_m:g}"
            )
        cells = np.round(points_m[:, :2] / spacing_m).astype(np.int64)
        first, last = cells.min(axis=0), cells.max(axis=0)
        shape = tuple((last - first + 1).tolist())
        for axis, cells_across in zip("xy", shape, strict=True):
            if cells_across < FEWEST:
                raise InvalidInput(
                    f"{name}: expected points over {FEWEST} or more cells of {spacing_m:g} m along "
                    f"{axis}, got "
                    f"{cells_across}; see spacing_m"
                )
        if shape[0] * shape[1] > MOST_POINTS:
            raise InvalidInput(
                f"{name}: expected {MOST_POINTS} cells or fewer, got {shape[0] * shape[1]}; see "
                "spacing_m"
            )
        cell = np.ravel_multi_index(tuple((cells - first).T), shape)
        top = np.full(shape[0] * shape[1], -np.inf)
        np.maximum.at(top, cell, points_m[:, 2])
        upper = points_m[:, 2] >= top[cell] - LAYER_M
        samples = np.bincount(cell[upper], minlength=len(top))
        total = np.bincount(cell[upper], weights=points_m[upper, 2], minlength=len(top))
        heights = np.where(samples > 0, total / np.maximum(samples, 1), np.nan)
        x_m, y_m = (spacing_m * np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
        return cls(
            x_m=x_m,
            y_m=y_m,
            heights_m=heights.reshape(shape),
            name=name,
            samples=samples.reshape(shape),
            points_m=points_m,
        )

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array], name: str) -> ElevationMap:
        """Read what ``HeightField.to_arrays`` wrote.

        Raises InvalidInput.
        """
        for key in ("x_m", "y_m", "heights_m"):
            if key not in arrays:
                raise InvalidInput(f"{name}: {key}: expected this array, got nothing")
            if arrays[key].dtype.kind not in "fiu":
                raise InvalidInput(
                    f"{name}: {key}: expected numbers, got an array of {arrays[key].dtype}"
                )
        return cls(x_m=arrays["x_m"], y_m=arrays["y_m"], heights_m=arrays["heights_m"], name=name)

    @property
    def spacing_m(self) -> float:
        """Spacing of the grid lines, the same along both axes [m].

        Raises InvalidInput where it is not.
        """
        steps = np.concatenate([np.diff(self.x_m), np.diff(self.y_m)])
        if float(np.ptp(steps)) > 1e-3 * float(steps.min()):
            raise InvalidInput(
                f"{self.name}: expected a square, even grid, got spacings of {steps.min():g} to "
                f"{steps.max():g} m"
            )
        return float(steps.mean())

    def cropped(self, box_m: Array) -> ElevationMap:
        """Map of the samples in a box, shape (2, 3) [m]; heights beyond it become holes.

        Raises InvalidInput for none.
        """
        (x0, y0, z0), (x1, y1, z1) = box_m
        i, j = (
            (line >= a) & (line <= b) for line, a, b in ((self.x_m, x0, x1), (self.y_m, y0, y1))
        )
        if i.sum() < FEWEST or j.sum() < FEWEST:
            raise InvalidInput(
                f"{self.name}: crop_m: expected {FEWEST} or more grid lines inside, got "
                f"{min(i.sum(), j.sum())}"
            )
        heights = self.heights_m[np.ix_(i, j)]
        with np.errstate(invalid="ignore"):
            heights = np.where((heights >= z0) & (heights <= z1), heights, np.nan)
        samples = None if self.samples is None else self.samples[np.ix_(i, j)]
        return ElevationMap(
            x_m=self.x_m[i], y_m=self.y_m[j], heights_m=heights, name=self.name, samples=samples
        )

    def filled(self) -> ElevationMap:
        """Map whose holes are filled by a membrane over their borders (Δh = 0): planes stay planes.

        No samples there.
        """
        hole = np.isnan(self.heights_m)
        measured = np.where(hole, 0, 1 if self.samples is None else self.samples)
        return ElevationMap(
            x_m=self.x_m,
            y_m=self.y_m,
            heights_m=_membrane(self.heights_m, hole),
            name=self.name,
            samples=measured,
        )

    def with_holes(self, holes: Holes) -> ElevationMap:
        """Filled where that is wanted."""
        return self.filled() if holes == "fill" else self

    def field(self) -> HeightField:
        """The map as a smooth surface.

        Raises InvalidInput where it has holes.
        """
        hole = np.argwhere(np.isnan(self.heights_m))
        if len(hole):
            i, j = hole[0]
            raise InvalidInput(
                f"{self.name}: expected a height everywhere, got holes at {len(hole)} of "
                f"{self.heights_m.size} grid "
                f"points, the first at ({self.x_m[i]:.3f}, {self.y_m[j]:.3f}) m; holes: fill lays "
                "a membrane over them"
            )
        return HeightField(self.x_m, self.y_m, self.heights_m, self.name)


def _membrane(heights: Array, hole: NDArray[np.bool_]) -> Array:
    """Heights with each hole the mean of its neighbours, those beyond the grid's border left
    out.
    """
    if not hole.any():
        return heights
    if hole.sum() > _MOST_FILLED:
        from scipy.ndimage import distance_transform_edt  # slow to import

        nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
        return np.asarray(heights[tuple(nearest)])
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import spsolve

    number = np.full(hole.shape, -1)
    number[hole] = np.arange(hole.sum())
    diagonal, known = np.zeros(hole.sum()), np.zeros(hole.sum())
    rows, columns = list[NDArray[np.int_]](), list[NDArray[np.int_]]()
    for here, there in (way for one, other in BESIDE for way in ((other, one), (one, other))):
        mine, theirs, value = number[here].ravel(), number[there].ravel(), heights[there].ravel()
        of_hole, border = (mine >= 0) & (theirs >= 0), (mine >= 0) & (theirs < 0)
        diagonal += np.bincount(mine[mine >= 0], minlength=len(diagonal))
        known += np.bincount(mine[border], weights=value[border], minlength=len(known))
        rows.append(mine[of_hole])
        columns.append(theirs[of_hole])
    count = len(diagonal)
    values = np.concatenate([diagonal, np.full(sum(map(len, rows)), -1.0)])
    places = (
        np.concatenate([np.arange(count), *rows]),
        np.concatenate([np.arange(count), *columns]),
    )
    filled = heights.copy()
    filled[hole] = spsolve(coo_array((values, places), shape=(count, count)).tocsc(), known)
    return filled
