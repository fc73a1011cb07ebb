"""The map φ from warped space 𝓕 to the world 𝓐 (Pan et al. §IV-A): a tri-cubic B-spline, then a
snap onto the terrain.

With s the tri-cubic map, φ = (s_x, s_y, s_z + b(z̄)·δ(s_x, s_y)): δ is how far the terrain lies
above the ground of s, a bicubic spline over the *world's* x and y, and b fades from 1 at the ground
to 0. So det J = det J_s + b′·δ·A with A the area that s stretches a horizontal square to: a steep δ
folds nothing, only a large one that fades fast could.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array, archive_of, checked, read_archive, read_only
from ..files.writing import write_bytes
from ..terrain.heightfield import CubicBasis, HeightField
from .quadrature import Axis

if TYPE_CHECKING:
    import casadi as ca


_POLAR_STEPS = 8
"""Exact to rounding for Jacobians whose singular values differ by a factor of up to 100."""


def polar_function(steps: int = _POLAR_STEPS) -> ca.Function:
    """CasADi function (J: 3 × 3) → (R: 3 × 3): 𝒫(J) (W12) for det J > 0 by Newton's R ← ½(γR +
    R⁻ᵀ/γ), γ = det(R)^(−⅓).

    Smooth wherever det J > 0, so that solvers take exact first and second derivatives of it.
    """
    import casadi as ca

    jacobian = ca.SX.sym("J", 3, 3)
    turned = jacobian
    for _ in range(steps):
        rows = [turned[k, :] for k in range(3)]
        cofactor = ca.vertcat(
            ca.cross(rows[1], rows[2]), ca.cross(rows[2], rows[0]), ca.cross(rows[0], rows[1])
        )
        determinant = ca.dot(rows[0], cofactor[0, :])
        size = ca.exp(ca.log(determinant) / 3.0)
        turned = 0.5 * (turned / size + cofactor * (size / determinant))
    return ca.Function("polar", [jacobian], [turned], ["J"], ["R"])


_NEWTON_STEPS = 30


def surface(bases: Sequence[CubicBasis], control: Array, at: Array) -> tuple[Array, Array, Array]:
    """A bicubic surface with control points (k, n, m) at points (N, 2): value and both derivatives,
    (N, k) each.
    """
    (i, (x, dx)), (j, (y, dy)) = (
        basis.weights(np.ascontiguousarray(at[:, a]), 1) for a, basis in enumerate(bases)
    )
    width = control.shape[2]
    steps = (width * np.arange(4)[:, None] + np.arange(4)).ravel()
    near = control.reshape(len(control), -1)[:, (i * width + j)[:, None] + steps].reshape(
        len(control), -1, 4, 4
    )
    level, across = (np.matmul(near, row[:, :, None])[..., 0] for row in (y, dy))
    value, along_x, along_y = (
        np.einsum("kni,ni->nk", rows, weights)
        for rows, weights in ((level, x), (level, dx), (across, x))
    )
    return value, along_x, along_y


class _Starts:
    """Points from which Newton's method inverts a map, shape (k, …), with their images, likewise,
    and the Jacobians there, shape (k, k, …).
    """

    def __init__(self, points: Array, images: Array, jacobians: Array) -> None:
        from scipy.spatial import cKDTree

        size = len(points)
        self._points, self._images = (each.reshape(size, -1).T for each in (points, images))
        self._jacobians = np.moveaxis(jacobians.reshape(size, size, -1), -1, 0)
        self._tree = cKDTree(self._images)

    def inverted(self, function: Callable[[Array], tuple[Array, Array]], goal: Array) -> Array:
        """Newton's method for function(x) = goal, (N, k), from the start whose image is the nearest.

        Arguments:
            function: values and Jacobians at points, (N, k) → (N, k), (N, k, k). A step that does
                not help is halved.

        Raises:
            PlanningFailed: for a goal that it does not reach.
        """
        nearest = self._tree.query(goal)[1]
        points, at, jacobian = (
            each[nearest] for each in (self._points, self._images, self._jacobians)
        )
        miss, share, left = (
            np.linalg.norm(at - goal, axis=1),
            np.ones(len(goal)),
            np.arange(len(goal)),
        )
        for _ in range(_NEWTON_STEPS):
            left = left[miss[left] > 1e-11]
            if not left.size:
                break
            try:
                step = np.linalg.solve(jacobian[left], (goal[left] - at[left])[..., None])[..., 0]
            except np.linalg.LinAlgError:
                break
            tried = points[left] + share[left, None] * step
            tried_at, tried_jacobian = function(tried)
            tried_miss = np.linalg.norm(tried_at - goal[left], axis=1)
            better = tried_miss < miss[left]
            share[left] = np.where(better, np.minimum(1.0, 2.0 * share[left]), 0.5 * share[left])
            left_better = left[better]
            points[left_better], at[left_better], jacobian[left_better] = (
                tried[better],
                tried_at[better],
                tried_jacobian[better],
            )
            miss[left_better] = tried_miss[better]
        if miss.size and not miss.max() < 1e-8:
            worst = int(miss.argmax())
            place = ", ".join(f"{value:.3f}" for value in goal[worst])
            raise PlanningFailed(f"map: reaches ({place}) m only to {1e3 * miss[worst]:.3g} mm")
        return points


FORMAT = "stancekit/warp/1"
_REACH_M = 20.0
"""Distance beyond its band that a map goes on along straight lines [m]."""
STEEPEST_FADE = 1.875
"""Fastest fading of the snap, times the height at which it has faded out."""
_TEXTS = ("name", "terrain_digest")


@dataclass(frozen=True, kw_only=True, eq=False)
class SplineMap:
    """φ: x̄ ↦ x, both in metres; C² everywhere, and the ground z̄ = 0 becomes the terrain.

    Raises InvalidInput.

    Arguments:
        domain_m: x̄ and ȳ span these [m].
        height_m: z̄ spans 0 to this [m].
        control_m: ψ, shape (3, nx, ny, nz) [m], component first, cells + 3 along an axis.
        snap: δ over the world's x and y; it fades out from z̄ = 0 to fade_m. None is a plain
            tri-cubic map, as published.
        terrain_digest: what it was made for.
    """

    domain_m: tuple[tuple[float, float], tuple[float, float]]
    height_m: float
    control_m: Array
    snap: HeightField | None = None
    fade_m: float = 1.0
    name: str = ""
    terrain_digest: str = ""

    def __post_init__(self) -> None:
        domain = read_only(self.domain_m, (2, 2), "domain_m")
        object.__setattr__(
            self, "domain_m", tuple((float(low), float(high)) for low, high in domain)
        )
        object.__setattr__(self, "height_m", checked(self.height_m, "height_m", above=0.0))
        object.__setattr__(self, "fade_m", checked(self.fade_m, "fade_m", above=0.0))
        object.__setattr__(
            self, "control_m", read_only(self.control_m, (3, None, None, None), "control_m")
        )
        if not all(high > low for low, high in self.domain_m):
            raise InvalidInput(f"domain_m: expected increasing spans, got {self.domain_m}")
        if min(self.control_m.shape[1:]) < 4:
            raise InvalidInput(
                "control_m: expected 4 or more points along each axis, got "
                f"{self.control_m.shape[1:]}"
            )

    @property
    def cells(self) -> tuple[int, int, int]:
        """Cells of the tri-cubic grid along x̄, ȳ and z̄."""
        x, y, z = self.control_m.shape[1:]
        return x - 3, y - 3, z - 3

    @cached_property
    def _bases(self) -> list[CubicBasis]:
        spans = (*self.domain_m, (0.0, self.height_m))
        return [
            CubicBasis.over(np.linspace(low, high, n + 1), _REACH_M)
            for (low, high), n in zip(spans, self.cells, strict=True)
        ]

    @cached_property
    def _padded(self) -> Array:
        """Control points with those of the straight continuation, component first."""
        padded: Array = self.control_m
        spans = (*self.domain_m, (0.0, self.height_m))
        for axis, (basis, (low, high), cells) in enumerate(
            zip(self._bases, spans, self.cells, strict=True)
        ):
            inner = Axis(low=low, high=high, cells=cells, points=1).identity
            padded = np.moveaxis(
                _continued(np.moveaxis(padded, axis + 1, 0), inner, basis.greville), 0, axis + 1
            )
        return np.ascontiguousarray(padded)

    @property
    def spline(self) -> tuple[Array, tuple[Array, ...]]:
        """Control points of s, the map without its snap, component first, shape (3, …) [m], and the
        knots along each axis [m]; straight continuation included.
        """
        return self._padded, tuple(basis.knots for basis in self._bases)

    def points(self, x_bar: Array) -> Array:
        """φ(x̄), shape (…, 3) [m] → (…, 3) [m]."""
        return self.points_and_jacobians(x_bar)[0]

    def jacobians(self, x_bar: Array) -> Array:
        """J = ∂φ/∂x̄, shape (…, 3) → (…, 3, 3), component before derivative."""
        return self.points_and_jacobians(x_bar)[1]

    def points_and_jacobians(self, x_bar: Array) -> tuple[Array, Array]:
        """φ and J by one look-up, shapes (…, 3) [m] and (…, 3, 3)."""
        x_bar = np.asarray(x_bar, dtype=np.float64)
        flat = np.ascontiguousarray(x_bar.reshape(-1, 3))
        first, rows = zip(
            *(basis.weights(flat[:, k], 1) for k, basis in enumerate(self._bases)), strict=True
        )
        ny, nz = self._padded.shape[2:]
        steps = (
            ny * nz * np.arange(4)[:, None, None] + nz * np.arange(4)[:, None] + np.arange(4)
        ).ravel()
        start = (first[0] * ny + first[1]) * nz + first[2]
        near = self._padded.reshape(3, -1)[:, start[:, None] + steps].reshape(3, -1, 4, 4, 4)
        (x, dx), (y, dy), (z, dz) = rows
        along, across = np.einsum("cnijk,nk->cnij", near, z), np.einsum("cnijk,nk->cnij", near, dz)
        level = np.einsum("cnij,nj->cni", along, y)
        point = np.einsum("cni,ni->nc", level, x)
        jacobian = np.stack(
            [
                np.einsum("cni,ni->nc", level, dx),
                np.einsum("cnij,nj,ni->nc", along, dy, x),
                np.einsum("cnij,nj,ni->nc", across, y, x),
            ],
            axis=-1,
        )
        if self.snap is not None:
            extra, slope = self.snap.height_and_gradient(point[:, :2])
            fade, faster = fading(flat[:, 2], self.fade_m)
            point[:, 2] += fade * extra
            jacobian[:, 2] += fade[:, None] * np.einsum("na,nad->nd", slope, jacobian[:, :2])
            jacobian[:, 2, 2] += faster * extra
        return point.reshape(x_bar.shape), jacobian.reshape(*x_bar.shape, 3)

    def ground_on_grid(self, x: Array, y: Array) -> Array:
        """φ(x̄, ȳ, 0) on a regular grid, shape (3, X, Y) [m]."""
        point = self._on((x, y, np.zeros(1)), (0, 0, 0))[..., 0]
        if self.snap is not None:
            point[2] += self.snap.height(np.moveaxis(point[:2], 0, -1))
        return point

    def on_grid(self, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """φ, shape (3, X, Y, Z) [m], and J, shape (3, 3, X, Y, Z), on a regular grid of x̄, ȳ and
        z̄ [m].
        """
        lines = (x, y, z)
        point = self._on(lines, (0, 0, 0))
        jacobian = np.stack(
            [self._on(lines, orders) for orders in ((1, 0, 0), (0, 1, 0), (0, 0, 1))], axis=1
        )
        if (
            self.snap is not None and np.min(z, initial=np.inf) < self.fade_m
        ):  # beyond, nothing is left of it
            extra, slope = self.snap.height_and_gradient(np.moveaxis(point[:2], 0, -1))
            fade, faster = fading(np.asarray(z, dtype=np.float64), self.fade_m)
            point[2] += fade * extra
            for axis in range(2):
                jacobian[2] += (fade * slope[..., axis]) * jacobian[axis]
            jacobian[2, 2] += faster * extra
        return point, jacobian

    def _on(self, lines: tuple[Array, Array, Array], orders: tuple[int, int, int]) -> Array:
        """A derivative of the tri-cubic part on a regular grid, shape (3, X, Y, Z)."""
        control = self._padded
        for axis in (2, 1, 0):
            rows = self._bases[axis].matrix(lines[axis], orders[axis]).toarray()
            control = np.moveaxis(np.tensordot(rows, control, axes=(1, axis + 1)), 0, axis + 1)
        return np.array(control)

    def inverse(self, points: Array) -> Array:
        """x̄ with φ(x̄) = x, shape (…, 3) [m] → (…, 3) [m].

        Raises PlanningFailed for a point that φ does not reach.
        """
        points = np.asarray(points, dtype=np.float64)
        flat = self._starts.inverted(self.points_and_jacobians, points.reshape(-1, 3))
        return flat.reshape(points.shape)

    @cached_property
    def _starts(self) -> _Starts:
        """A grid twice as dense as the cells."""
        spans = (*self.domain_m, (0.0, self.height_m))
        lines = [
            np.linspace(low, high, 2 * n + 1)
            for (low, high), n in zip(spans, self.cells, strict=True)
        ]
        return _Starts(np.stack(np.meshgrid(*lines, indexing="ij")), *self.on_grid(*lines))

    def ground_inverse(self, xy: Array) -> tuple[Array, Array]:
        """(x̄, ȳ) with s_xy(x̄, ȳ, 0) = (x, y), and s_z there: (…, 2) [m] → (…, 2) [m], (…) [m], s
        without the snap.

        Raises PlanningFailed for a point that the ground of s does not reach.
        """
        xy = np.asarray(xy, dtype=np.float64)
        bases, ground = self._bases[:2], self._ground

        def plan(at: Array) -> tuple[Array, Array]:
            value, along_x, along_y = surface(bases, ground[:2], at)
            return value, np.stack([along_x, along_y], axis=-1)

        points = self._ground_starts.inverted(plan, xy.reshape(-1, 2))
        height = surface(bases, ground[2:], points)[0]
        return points.reshape(xy.shape), height.reshape(xy.shape[:-1])

    @cached_property
    def _ground(self) -> Array:
        """Control points of the ground of s, shape (3, …) [m]."""
        return np.asarray(self._padded @ self._bases[2].matrix(np.zeros(1)).toarray()[0])

    @cached_property
    def _ground_starts(self) -> _Starts:
        """A grid of the ground eight times as dense as the cells."""
        lines = [
            np.linspace(low, high, 8 * n + 1)
            for (low, high), n in zip(self.domain_m, self.cells[:2], strict=True)
        ]
        (x, dx), (y, dy) = (
            [basis.matrix(line, order).toarray() for order in (0, 1)]
            for basis, line in zip(self._bases, lines, strict=False)
        )
        images, *slopes = (
            rows @ self._ground[:2] @ columns.T for rows, columns in ((x, y), (dx, y), (x, dy))
        )
        starts = np.stack(np.meshgrid(*lines, indexing="ij"))
        return _Starts(starts, images, np.stack(slopes, axis=1))

    def check_fits(self, field: HeightField) -> None:
        """Raise InvalidInput unless the map was made for this terrain."""
        if self.terrain_digest != terrain_digest(field):
            raise InvalidInput(
                f"map {self.name or 'without a name'}: was made for another terrain than "
                f"{field.name or 'this one'}"
            )

    def to_file(self, path: str | Path) -> None:
        """Write the map as .npz, whole or not at all."""
        if Path(path).suffix != ".npz":
            raise InvalidInput(f"{path}: expected a name that ends in .npz, got something else")
        write_bytes(path, archive_of(self.to_arrays()))

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays that ``from_arrays`` reads."""
        arrays: dict[str, NDArray[Any]] = {"format": np.array(FORMAT), "control_m": self.control_m}
        arrays |= {
            key: np.array(getattr(self, key)) for key in ("domain_m", "height_m", "fade_m", *_TEXTS)
        }
        return arrays | (
            {} if self.snap is None else {f"snap_{k}": v for k, v in self.snap.to_arrays().items()}
        )

    @classmethod
    def from_file(cls, path: str | Path) -> SplineMap:
        """Read what ``to_file`` wrote.

        Raises InvalidInput.
        """
        data = read_archive(path)
        try:
            return cls.from_arrays(data)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> SplineMap:
        """Read what ``to_arrays`` gave.

        Raises InvalidInput.
        """
        data = dict(arrays)
        if str(data.pop("format", "")) != FORMAT:
            raise InvalidInput(f"expected format {FORMAT}, got something else")
        snap = {key[5:]: data.pop(key) for key in list(data) if key.startswith("snap_")}
        names = {"control_m", "domain_m", "height_m", "fade_m", *_TEXTS}
        if set(data) != names:
            wrong = sorted(set(data) ^ names)
            raise InvalidInput(
                f"expected the arrays {', '.join(sorted(names))}, wrong: {', '.join(wrong)}"
            )
        texts = {key: str(data.pop(key)) for key in _TEXTS}
        return cls(**data, **texts, snap=HeightField.from_arrays(snap, "snap") if snap else None)  # type: ignore[arg-type]


def fading(z_bar: Array, fade_m: float) -> tuple[Array, Array]:
    """Share of the snap that is left at a height, 1 at the ground and 0 from fade_m on, C², and its
    derivative [1/m].
    """
    u = np.clip(np.asarray(z_bar) / fade_m, 0.0, 1.0)
    return np.asarray(1.0 - u**3 * (10.0 + u * (6.0 * u - 15.0))), -30.0 * (
        u * (1.0 - u)
    ) ** 2 / fade_m


def terrain_digest(field: HeightField) -> str:
    """Digest that tells terrains apart: SHA-256 of grid and heights."""
    digest = hashlib.sha256()
    for array in (field.x_m, field.y_m, field.heights_m):
        digest.update(
            np.ascontiguousarray(array + 0.0, dtype="<f8").tobytes()
        )  # + 0.0: no negative zeros
    return digest.hexdigest()


def _continued(control: Array, inner: Array, sites: Array) -> Array:
    """Control points at ``inner``, shape (n, …), and on both sides, at ``sites``, those of a
    straight continuation.
    """
    before, after = sites[sites < inner[0] - 1e-9], sites[sites > inner[-1] + 1e-9]

    def beyond(at: Array, end: int, next_to: int) -> Array:
        share = (at - inner[end]) / (inner[next_to] - inner[end])
        return np.asarray(
            control[end]
            + share.reshape(-1, *[1] * (control.ndim - 1)) * (control[next_to] - control[end])
        )

    return np.concatenate([beyond(before, 0, 1), control, beyond(after, -1, -2)])
