"""Height fields h(x, y): terrain as a bicubic C² spline, with an exact gradient (Pan et al. §III-B,
after W5).

A basis of cubic B-splines over K knots has K − 4 functions and is C² from its fourth knot to its
fourth last. Outside that span the first and the last polynomial piece go on; the knots reach ``_REACH_M`` beyond the
data, and control points there go on straight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import factorial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_members, checked_name, read_only
from .patch import Patch
from .polygon import EDGE_M, UPRIGHT, VOID_M, nearest

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_REACH_M = 100.0
"""Distance beyond its data that a spline's knots reach [m]."""


def cubics(x: Array, knots: Array, order: int = 0) -> tuple[NDArray[np.intp], Array]:
    """The first of the four cubic B-splines that live at each x, shape (N,), and their values (or a
    derivative), shape (N, 4), by the recursion of Cox and de Boor.

    Arguments:
        x: from the fourth knot to the fourth last, shape (N,).
        knots: never falling, shape (K,).

    It is scipy's, to the last bit, whose splines take a tenth of a second to import.
    """
    interval = np.clip(np.searchsorted(knots, x, side="right") - 1, 3, len(knots) - 5)
    values = np.zeros((4, len(x)))
    values[0] = 1.0
    for degree in range(1, 4):
        lower = values[:degree].copy()
        values[0] = 0.0
        for n in range(1, degree + 1):
            after, before = knots[interval + n], knots[interval + n - degree]
            width = after - before
            share = np.zeros_like(x)
            slope = degree * lower[n - 1] if degree > 3 - order else lower[n - 1]
            np.divide(slope, width, out=share, where=width != 0.0)
            if degree > 3 - order:
                values[n - 1] -= share
                values[n] = share
            else:
                values[n - 1] += share * (after - x)
                values[n] = share * (x - before)
    return interval - 3, values.T


def rows_of(first: NDArray[np.intp], values: Array, size: int) -> csr_array:
    """Rows of a sparse matrix with so many columns, each of four values, shape (N, 4), from the
    column ``first`` on, shape (N,).
    """
    from scipy.sparse import csr_array  # slow to import

    columns = first[:, None] + np.arange(4)
    rows = np.repeat(np.arange(len(columns)), 4)
    return csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(columns), size))


class CubicBasis:
    """Cubic B-splines over ``knots``, shape (K,), strictly increasing, K ≥ 8."""

    def __init__(self, knots: Array) -> None:
        self.knots = np.array(knots, dtype=np.float64)
        self.knots.setflags(write=False)
        self.size = len(self.knots) - 4

    @classmethod
    def over(cls, sites: Array, reach_m: float = _REACH_M) -> CubicBasis:
        """The basis with a knot at each site, shape (n,), and others beyond both ends, ever wider
        up to ``reach_m``.
        """
        before, after = (
            _beyond(sites[1] - sites[0], reach_m),
            _beyond(sites[-1] - sites[-2], reach_m),
        )
        return cls(np.concatenate([sites[0] - before[::-1], sites, sites[-1] + after]))

    @property
    def greville(self) -> Array:
        """Control points of x ↦ x, shape (size,): where the basis's functions sit."""
        return np.asarray((self.knots[1:-3] + self.knots[2:-2] + self.knots[3:-1]) / 3.0)

    @cached_property
    def _pieces(self) -> Array:
        """Polynomials of the four functions that live on an interval, by (power, interval,
        function).
        """
        starts = self.knots[3 : self.size]
        powers = [cubics(starts, self.knots, order)[1] / factorial(order) for order in range(4)]
        return np.ascontiguousarray(np.stack(powers))

    def weights(self, x: Array, orders: int = 0) -> tuple[NDArray[np.intp], list[Array]]:
        """The first of the four functions that live at x, shape (N,), and their derivatives
        0…orders, shape (N, 4).
        """
        interval = np.searchsorted(self.knots[4 : self.size], x, side="right")
        u = (x - self.knots[interval + 3])[:, None]
        c = [np.take(piece, interval, axis=0) for piece in self._pieces]
        values = [c[0] + u * (c[1] + u * (c[2] + u * c[3]))]
        if orders > 0:
            values.append(c[1] + u * (2.0 * c[2] + 3.0 * u * c[3]))
        if orders > 1:
            values.append(2.0 * c[2] + 6.0 * u * c[3])
        if orders > 2:
            values.append(6.0 * c[3])
        values += [np.zeros_like(c[0])] * (orders - 3)
        return interval, values

    def matrix(self, x: Array, order: int = 0) -> csr_array:
        """Values (or a derivative) of every function at x, sparse, shape (len(x), size)."""
        first, values = self.weights(np.asarray(x, dtype=np.float64), order)
        return rows_of(first, values[order], self.size)

    def interpolate(self, sites: Array, values: Array) -> Array:
        """Coefficients, shape (size, …), of the natural spline through values at the sites of
        ``over``, shape (n, …).

        Its second derivative is 0 at both ends and beyond: it goes on as a straight line, and stays
        C².
        """
        from scipy.sparse import vstack
        from scipy.sparse.linalg import splu  # slow to import

        inner = self.knots[3:-3]
        straight = self.matrix(inner[(inner <= sites[0]) | (inner >= sites[-1])], 2)
        rows = vstack([self.matrix(sites), straight], format="csc")
        right = np.zeros((rows.shape[0], int(np.prod(values.shape[1:]))))
        right[: len(sites)] = values.reshape(len(sites), -1)
        return np.asarray(splu(rows).solve(right)).reshape(self.size, *values.shape[1:])


def _beyond(step: float, reach_m: float) -> Array:
    """Distances of knots beyond the last site: three cells, then ever wider, and three more for the
    basis.
    """
    far = (
        3.0 * step * 2.0 ** np.arange(1, max(2, int(np.ceil(np.log2(reach_m / (3.0 * step)))) + 1))
    )
    return np.concatenate([step * np.arange(1.0, 4.0), far, far[-1] * np.array([2.0, 3.0, 4.0])])


FEWEST = 4
"""Grid lines along each axis that a bicubic spline needs."""
WIDEST_M = 200.0
"""No terrain of a legged robot spans more [m]; one that does is a file in millimetres."""
MOST_POINTS = 4_000_000
_STEP_M = 0.05
"""Distance of the places at which the steepest is looked for [m]."""


@dataclass(frozen=True, eq=False)
class HeightField:
    """Terrain heights on a rectilinear grid, interpolated by a natural bicubic spline.

    C² everywhere: beyond the grid the surface goes on along straight lines. ``from_function``,
    ``from_array`` and ``from_file`` make one, too.

    Arguments:
        x_m, y_m: grid lines, shape (n,) and (m,), increasing [m].
        heights_m: h at (x_i, y_j), shape (n, m) [m].
        name: what the terrain is called in messages.
        doubts: what the reader of its file mended or left out, one line each.

    Raises:
        InvalidInput: for fewer than four grid lines, a hole (NaN), and for more than 200 m along an
            axis.
    Source:
        Pan et al. §III-B, after W5.

    Example:
        >>> import numpy as np
        >>> from stancekit import HeightField
        >>> bowl = HeightField.from_function(lambda x, y: 0.1 * (x**2 + y**2), half_width_m=1.0, name="bowl")
        >>> bowl.gradient(np.array([0.5, 0.25])).round(4).tolist()
        [0.1, 0.05]
    """

    x_m: Array
    y_m: Array
    heights_m: Array
    name: str = ""
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or self.name:
            checked_name(self.name, "name")
        where = self.name or "terrain"
        object.__setattr__(self, "doubts", checked_members(self.doubts, str, f"{where}: doubts"))
        for axis in ("x_m", "y_m"):
            object.__setattr__(self, axis, grid_lines(getattr(self, axis), f"{where}: {axis}"))
        try:
            heights = np.asarray(self.heights_m)
        except (TypeError, ValueError):  # rows of different lengths
            heights = np.zeros(())
        shape = (len(self.x_m), len(self.y_m))
        if heights.size > MOST_POINTS:
            raise InvalidInput(
                f"{where}: expected {MOST_POINTS} grid points or fewer, got {heights.size}"
            )
        if heights.ndim == 2 and heights.dtype.kind == "f" and not np.all(np.isfinite(heights)):
            raise InvalidInput(_hole(heights, f"{where}: heights_m"))
        object.__setattr__(self, "heights_m", read_only(heights, shape, f"{where}: heights_m"))

    @property
    def domain_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((x0, x1), (y0, y1)), the span of the grid [m]."""
        return (float(self.x_m[0]), float(self.x_m[-1])), (float(self.y_m[0]), float(self.y_m[-1]))

    @property
    def even(self) -> bool:
        """Tell whether the grid lines are equally far apart along each axis."""
        return all(
            float(np.ptp(np.diff(line))) <= 1e-6 * float(line[1] - line[0])
            for line in (self.x_m, self.y_m)
        )

    def contains(self, xy: Array) -> Any:
        """Tell whether points, shape (…, 2) [m], lie on the grid's domain, shape (…)."""
        (x0, x1), (y0, y1) = self.domain_m
        xy = np.asarray(xy, dtype=np.float64)
        return (xy[..., 0] >= x0) & (xy[..., 0] <= x1) & (xy[..., 1] >= y0) & (xy[..., 1] <= y1)

    @cached_property
    def _bases(self) -> tuple[CubicBasis, CubicBasis]:
        return CubicBasis.over(self.x_m), CubicBasis.over(self.y_m)

    @cached_property
    def _coefficients(self) -> Array:
        """Control points, shape (n + pads, m + pads) [m]."""
        along_x, along_y = self._bases
        half = along_x.interpolate(self.x_m, self.heights_m)
        return np.ascontiguousarray(along_y.interpolate(self.y_m, half.T).T)

    @property
    def spline(self) -> tuple[Array, tuple[Array, Array]]:
        """Control points, component first, shape (1, n + pads, m + pads) [m], and the knots along x
        and y [m].
        """
        along_x, along_y = self._bases
        return self._coefficients[None], (along_x.knots, along_y.knots)

    def _derivatives(self, xy: Array, orders: tuple[tuple[int, int], ...]) -> list[Array]:
        """∂^(a+b) h / ∂x^a ∂y^b at points, shape (…, 2), one array of shape (…) for each (a, b)."""
        xy = np.asarray(xy, dtype=np.float64)
        flat = xy.reshape(-1, 2)
        highest = max(max(pair) for pair in orders)
        (i, along_x), (j, along_y) = (
            basis.weights(np.ascontiguousarray(flat[:, k]), highest)
            for k, basis in enumerate(self._bases)
        )
        width = self._coefficients.shape[1]
        first = i * width + j
        offsets = (width * np.arange(4)[:, None] + np.arange(4)).ravel()
        near = self._coefficients.ravel()[first[:, None] + offsets].reshape(-1, 4, 4)
        rows = {
            b: np.matmul(near, along_y[b][:, :, None])[:, :, 0]
            for b in {pair[1] for pair in orders}
        }
        return [
            np.einsum("ni,ni->n", rows[b], along_x[a]).reshape(xy.shape[:-1]) for a, b in orders
        ]

    def height(self, xy: Array) -> Array:
        """The height at points, shape (…, 2) [m] → (…) [m]."""
        return self._derivatives(xy, ((0, 0),))[0]

    def gradient(self, xy: Array) -> Array:
        """∇h, shape (…, 2) → (…, 2)."""
        return np.stack(self._derivatives(xy, ((1, 0), (0, 1))), axis=-1)

    def height_and_gradient(self, xy: Array) -> tuple[Array, Array]:
        """The height and ∇h by one look-up, shape (…, 2) → (…), (…, 2)."""
        value, *slopes = self._derivatives(xy, ((0, 0), (1, 0), (0, 1)))
        return value, np.stack(slopes, axis=-1)

    @cached_property
    def steepest(self) -> float:
        """The largest gradient over a grid of 5 cm on the domain, non-dimensional."""
        (x, along_x), (y, along_y) = (
            [basis.matrix(np.arange(low, high + 0.5 * _STEP_M, _STEP_M), order) for order in (0, 1)]
            for basis, (low, high) in zip(self._bases, self.domain_m, strict=True)
        )
        slopes = (along_x @ self._coefficients @ y.T, x @ self._coefficients @ along_y.T)
        return float(np.hypot(*slopes).max())

    def normal(self, xy: Array) -> Array:
        """Upward unit normal (−∇h, 1)/‖·‖ (Pan et al., after W5), shape (…, 2) → (…, 3)."""
        slope = self.gradient(xy)
        up = np.concatenate([-slope, np.ones((*slope.shape[:-1], 1))], axis=-1)
        return np.asarray(up / np.linalg.norm(up, axis=-1, keepdims=True))

    def frame(self, xy: Array) -> Array:
        """R_WC, shape (…, 2) → (…, 3, 3): columns t₁ (over the world's x), t₂ = n × t₁ and the
        normal n.
        """
        slope, normal = self.gradient(xy), self.normal(xy)
        first = np.stack(
            [np.ones(slope.shape[:-1]), np.zeros(slope.shape[:-1]), slope[..., 0]], axis=-1
        )
        first = first / np.linalg.norm(first, axis=-1, keepdims=True)
        return np.stack([first, np.cross(normal, first), normal], axis=-1)

    @classmethod
    def from_function(
        cls,
        function: Callable[[Array, Array], Array],
        half_width_m: float = 4.0,
        spacing_m: float = 0.05,
        *,
        name: str = "",
        tolerance_m: float = 0.005,
    ) -> HeightField:
        """Sample ``function(x, y)``, vectorised, on [−half_width, half_width]² every ``spacing_m``
        or a little less.

        Raises InvalidInput where the spline then misses the function by more than ``tolerance_m``
        between its nodes; the message says by how much.
        """
        half = checked(half_width_m, "half_width_m", above=0.0, most=0.5 * WIDEST_M)
        spacing = checked(spacing_m, "spacing_m", above=0.0, most=half)
        cells = int(np.ceil(2.0 * half / spacing - 1e-9))
        if (cells + 1) ** 2 > MOST_POINTS:
            raise InvalidInput(
                f"spacing_m: expected {MOST_POINTS} grid points or fewer, got {(cells + 1) ** 2}"
            )
        lines = np.linspace(-half, half, cells + 1)
        field = cls(lines, lines, _sampled(function, lines, name), name)
        middles = 0.5 * (lines[1:] + lines[:-1])
        grid = np.stack(np.meshgrid(middles, middles, indexing="ij"), axis=-1)
        missed = np.abs(field.height(grid) - _sampled(function, middles, name))
        if float(missed.max()) > tolerance_m:
            i, j = np.unravel_index(int(missed.argmax()), missed.shape)
            raise InvalidInput(
                f"{name or 'terrain'}: finer than a spline of {1e3 * spacing:g} mm spacing can "
                "hold: it misses by "
                f"{1e3 * missed.max():.1f} mm at ({middles[i]:.2f}, {middles[j]:.2f}) m, expected "
                f"{1e3 * tolerance_m:g} mm or less; take a smaller spacing_m, or smooth the terrain"
            )
        return field

    @classmethod
    def from_array(
        cls, heights_m: Array, spacing_m: float = 0.05, *, name: str = ""
    ) -> HeightField:
        """Make a height field on a grid of square cells whose middle is the origin.

        Arguments:
            heights_m: the height h at (x_i, y_j), shape (n, m) [m].
            spacing_m: distance between neighbouring grid points along x and along y [m].
            name: name of the terrain.
        """
        try:
            heights = np.asarray(heights_m)
        except ValueError:  # rows of several lengths
            raise InvalidInput(
                f"{name or 'terrain'}: expected heights of shape (n, m), got rows that differ"
            ) from None
        if heights.ndim != 2:
            raise InvalidInput(
                f"{name or 'terrain'}: expected heights of shape (n, m), got shape {heights.shape}"
            )
        spacing = checked(spacing_m, "spacing_m", above=0.0)
        x_m, y_m = (spacing * (np.arange(count) - 0.5 * (count - 1)) for count in heights.shape)
        return cls(x_m, y_m, heights, name)

    def smoothed(self, sigma_m: float) -> HeightField:
        """The field under a Gaussian of this deviation; planes stay.

        Raises InvalidInput where the grid is uneven.
        """
        heights: Array = self.heights_m
        if not self.even:
            raise InvalidInput(
                f"{self.name or 'terrain'}: expected an even grid to smooth, got uneven spacing"
            )
        for axis, lines in enumerate((self.x_m, self.y_m)):
            sigma = checked(sigma_m, "sigma_m", least=0.0) / float(lines[1] - lines[0])
            radius = int(4.0 * sigma + 0.5)
            weights = np.exp(-0.5 / (sigma**2 or 1.0) * np.arange(-radius, radius + 1) ** 2)
            weights /= weights.sum()
            pads = [(radius, radius), (0, 0)]
            rows = np.pad(heights.swapaxes(0, axis), pads, mode="reflect", reflect_type="odd")
            moved = [rows[k : k + len(lines)] for k in range(len(weights))]
            smooth = moved[radius] * weights[radius]
            for k in range(radius):  # in the order in which SciPy's filter adds them
                smooth += (moved[k] + moved[-1 - k]) * weights[k]
            heights = np.ascontiguousarray(smooth.swapaxes(0, axis))
        return HeightField(self.x_m, self.y_m, heights, self.name)

    def scaled(self, factor: float) -> HeightField:
        """Terrain whose heights are multiplied by a factor."""
        return HeightField(
            self.x_m, self.y_m, checked(factor, "factor") * self.heights_m, self.name
        )

    def to_arrays(self) -> dict[str, Array]:
        """Arrays that ``from_arrays`` reads, for an .npz file."""
        return {"x_m": self.x_m, "y_m": self.y_m, "heights_m": self.heights_m}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array], name: str = "") -> HeightField:
        """Read what ``to_arrays`` wrote.

        Raises InvalidInput.
        """
        missing = [key for key in ("x_m", "y_m", "heights_m") if key not in arrays]
        if missing:
            raise InvalidInput(
                f"{name or 'terrain'}: {missing[0]}: expected this array, got nothing"
            )
        return cls(arrays["x_m"], arrays["y_m"], arrays["heights_m"], name)


def grid_lines(lines: Array, where: str, hint: str = "") -> Array:
    """Lines of a grid, increasing, shape (X,) [m].

    Raises InvalidInput for others, with a hint where they are too wide.
    """
    lines = read_only(lines, (None,), where)
    if len(lines) < FEWEST:
        raise InvalidInput(f"{where}: expected {FEWEST} or more grid lines, got {len(lines)}")
    if not float(np.diff(lines).min()) > 0.0:
        raise InvalidInput(
            f"{where}: expected increasing values, got a step of {np.diff(lines).min():g} m"
        )
    if lines[-1] - lines[0] > WIDEST_M:
        raise InvalidInput(
            f"{where}: expected {WIDEST_M:g} m or less from end to end, got "
            f"{lines[-1] - lines[0]:g} m{hint}"
        )
    return lines


def _hole(heights: Array, where: str) -> str:
    holes = np.argwhere(~np.isfinite(heights))
    row, column = holes[0]
    return (
        f"{where}: expected finite heights, got {heights[row, column]} at [{row}, {column}]"
        + (f" and {len(holes) - 1} more" if len(holes) > 1 else "")
        + f" of {heights.size}"
    )


def _sampled(function: Callable[[Array, Array], Array], lines: Array, name: str) -> Array:
    x, y = np.meshgrid(lines, lines, indexing="ij")
    heights = np.asarray(function(x, y), dtype=np.float64)
    if heights.ndim == 0:
        heights = np.full(x.shape, float(heights))
    if heights.shape != x.shape:
        raise InvalidInput(
            f"{name or 'terrain'}: expected a height for each point {x.shape}, got shape "
            f"{heights.shape}"
        )
    return heights


ROUND_M, SLOPE = 0.03, 3.0
"""Radius of an edge, about that of a foot [m], and gradient of what falls beyond it (72°)."""
SPACING_M = 0.025
"""Spacing of the grid [m]."""
_FIRST_M = 0.15
"""Distance from a patch at which its fall is looked at first; twice as far as long as it is above
all else [m]."""


def rounded(
    patches: Sequence[Patch],
    low_m: Array | None = None,
    high_m: Array | None = None,
    *,
    name: str = "",
) -> HeightField | None:
    """The highest surface over a rectangle, rounded beyond edges; None where no patch faces up.

    Arguments:
        low_m, high_m: corners of the rectangle, shape (2,), by the patches where they are missing
            [m].
        name: of the field.
    """
    up = [patch for patch in patches if patch.normal[2] >= UPRIGHT]
    if not up:
        return None
    corners = np.concatenate([patch.vertices_m for patch in up])
    low = corners[:, :2].min(axis=0) if low_m is None else low_m
    high = corners[:, :2].max(axis=0) if high_m is None else high_m
    x, y = (
        np.linspace(a, b, max(4, round(float(b - a) / SPACING_M) + 1))
        for a, b in zip(low, high, strict=True)
    )
    heights = np.full((len(x), len(y)), min(VOID_M, float(corners[:, 2].min())))
    for patch in up:
        _raise_to(heights, x, y, patch, 0.0)
    for patch in up:
        reach = _FIRST_M
        while _raise_to(heights, x, y, patch, reach):
            reach *= 2.0
    return HeightField(x, y, heights, name)


def _raise_to(heights: Array, x: Array, y: Array, patch: Patch, reach_m: float) -> bool:
    """Raise the grid to a patch and what falls off from it within a reach; whether it was raised at
    the end of that.
    """
    corners = patch.vertices_m[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = reach_m + EDGE_M
    i, j = (
        slice(*np.searchsorted(line, (a - room, b + room)))
        for line, a, b in zip((x, y), low, high, strict=True)
    )
    if i.start == i.stop or j.start == j.stop:
        return False
    places = np.stack(np.meshgrid(x[i], y[j], indexing="ij"), axis=-1)
    upright = len(corners) == 4 and bool(np.all((corners == low) | (corners == high)))
    on = (
        np.clip(places, low, high) if upright else nearest(corners, places)
    )  # most are rectangles along the axes
    beyond = np.sqrt(((places - on) ** 2).sum(axis=-1))
    lifted = patch.heights_at(on)
    lifted -= SLOPE * (np.sqrt(beyond**2 + ROUND_M**2) - ROUND_M)
    raised = (lifted > heights[i, j]) & (beyond <= room)
    heights[i, j] = np.where(raised, lifted, heights[i, j])
    return reach_m > 0.0 and bool(np.any(raised & (beyond > reach_m - 2.0 * SPACING_M)))
