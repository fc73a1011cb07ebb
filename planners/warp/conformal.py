"""Making a map for a terrain: the methods of Pan et al. as published, and the product's fast path.

The fast path descends the conformal energy with barrier and a soft match from a shear, whose det J
is 1, and then snaps the ground onto the terrain with a bicubic spline that fades out with height.
What is too steep for the cells is matched smoothed, and left to the snap. The first map is kept
whose det J is well above 0 everywhere, on lines three times as dense as the quadrature; where there
is none, a shear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from time import process_time
from typing import Literal, NamedTuple

import numpy as np

from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array, checked
from ..terrain.heightfield import HeightField
from .energy import Evaluation, MapEnergy, cofactor, determinant, rotation, shear
from .local_global import Descent, published
from .quadrature import QuadratureGrid, SeparableSolver
from .report import TORSO_M, MapReport, conformal_error, least_determinant, match_error
from .spline_map import STEEPEST_FADE, SplineMap, terrain_digest

_MEMORY = 8
_SHORTEST_MOVE = 1e-5
_RIDGE = 0.003
"""Larger ones tame the control points beyond the corners more, and cost iterations."""


def descend(
    energy: MapEnergy, psi: Array, iterations: int = 60, tolerance: float = 1e-4
) -> Descent:
    """Lower the energy from ψ, shape (3, nx, ny, nz), until an iteration gains less than
    ``tolerance`` of it.

    With a barrier det J > 0 at ψ is expected; the line search keeps it.
    """
    began = process_time()
    solver = SeparableSolver(energy.grid, energy.match_weight, _RIDGE)
    pairs: list[tuple[Array, Array]] = []
    now = energy.at(psi)
    history, seconds, evaluations, message = [now], [process_time() - began], 1, "iteration limit"
    for _ in range(iterations):
        way = -_preconditioned(now.gradient, pairs, solver)
        slope = float(np.sum(way * now.gradient))
        share = 1.0
        state = energy.at(psi + way)
        evaluations += 1
        while not state.total <= now.total + 1e-4 * share * slope and share > _SHORTEST_MOVE:
            share *= _shrink(now, state, share * slope)
            state = energy.at(psi + share * way)
            evaluations += 1
        if not state.total <= now.total:
            message = "no lower point along the search direction"
            break
        step, turn = share * way, state.gradient - now.gradient
        if float(np.sum(step * turn)) > 1e-12:
            pairs = [*pairs, (step, turn)][-_MEMORY:]
        gained = now.total - state.total
        psi, now = psi + step, state
        history.append(now)
        seconds.append(process_time() - began)
        if gained < tolerance * (now.conformal + now.match):
            message = "converged"
            break
    return Descent(
        psi=psi, history=history, seconds=seconds, evaluations=evaluations, message=message
    )


def _shrink(now: Evaluation, found: Evaluation, slope: float) -> float:
    """Factor by which to shorten a step: to the parabola's minimum where there is one, within [.1,
    .5].
    """
    if not np.isfinite(found.total):
        return 0.5
    return float(np.clip(-0.5 * slope / (found.total - now.total - slope), 0.1, 0.5))


def _preconditioned(
    gradient: Array, pairs: list[tuple[Array, Array]], solver: SeparableSolver
) -> Array:
    """The two-loop recursion of L-BFGS over ½·K⁻¹."""
    way, shares = gradient, []
    for step, turn in reversed(pairs):
        shares.append(float(np.sum(step * way)) / float(np.sum(step * turn)))
        way = way - shares[-1] * turn
    way = 0.5 * solver.solve(way)
    for (step, turn), share in zip(pairs, reversed(shares), strict=True):
        way = way + (share - float(np.sum(turn * way)) / float(np.sum(step * turn))) * step
    return way


_SHORTEST = 1e-6
_MOST_PRODUCTS = 80
"""Products with the normal matrix in one Gauss-Newton step."""


def gauss_newton(
    energy: MapEnergy, psi: Array, iterations: int, tolerance: float = 1e-4
) -> Descent:
    """Gauss-Newton from ψ, shape (3, nx, ny, nz), until a step changes the energy by less than
    ``tolerance`` of it.

    Expects an energy of scale "published", and det J > 0 at ψ where it has a barrier.
    """
    began = process_time()
    precondition = SeparableSolver(energy.grid, energy.match_weight).solve
    now = energy.at(psi)
    history, seconds, evaluations, products, message = (
        [now],
        [process_time() - began],
        1,
        0,
        "iteration limit",
    )
    for _ in range(iterations):
        step, count = _conjugate_gradients(_normal_matrix(energy, psi), -now.gradient, precondition)
        products += count
        slope = float(np.sum(step * now.gradient))
        share = 1.0
        state = energy.at(psi + step)
        evaluations += 1
        while not state.total <= now.total + 1e-4 * share * slope and share > _SHORTEST:
            share *= 0.5
            state = energy.at(psi + share * step)
            evaluations += 1
        if not state.total <= now.total:
            message = "no lower point along the search direction"
            break
        gained = now.total - state.total
        psi, now = psi + share * step, state
        history.append(now)
        seconds.append(process_time() - began)
        if gained < tolerance * (now.conformal + now.match):
            message = "converged"
            break
    return Descent(
        psi=psi,
        history=history,
        seconds=seconds,
        evaluations=evaluations,
        message=message,
        settings={"matrix_products": float(products)},
    )


def _normal_matrix(energy: MapEnergy, psi: Array) -> Callable[[Array], Array]:
    """v ↦ (2 DᵀD + barrier) v of the residuals' derivatives D at ψ."""
    grid = energy.grid
    jacobian = grid.gradient(psi)
    blocks = grid.weight.ravel() * point_blocks(jacobian.reshape(3, 3, -1), energy.barrier)
    _, slope = energy.miss(psi)
    row = np.stack([-slope[..., 0], -slope[..., 1], np.ones(slope.shape[:-1])])
    area = 2.0 * energy.match_weight * grid.floor_weight

    def product(vector: Array) -> Array:
        bent = np.einsum("abn,bn->an", blocks, grid.gradient(vector).reshape(9, -1)).reshape(
            jacobian.shape
        )
        lifted = row * (area * np.sum(row * grid.floor(vector), axis=0))
        return grid.gradient_adjoint(bent) + grid.floor_adjoint(lifted)

    return product


def point_blocks(jacobian: Array, barrier: float) -> Array:
    """Gauss-Newton matrices of ρ at Jacobians, shape (3, 3, N) → (9, 9, N), rows by component and
    derivative.
    """
    cof = cofactor(jacobian)
    det = determinant(jacobian, cof)
    jacobian, det = jacobian * np.where(det < 0.0, -1.0, 1.0), np.maximum(np.abs(det), 1e-12)
    slopes = residual_slopes(jacobian, cof, det)
    blocks = 2.0 * np.einsum("ran,rbn->abn", slopes, slopes)
    if barrier > 0.0:
        first = (cof / det).reshape(9, -1)
        blocks += barrier * first[:, None] * first[None, :]
    return np.asarray(blocks)


def residual_slopes(jacobian: Array, cof: Array, det: Array) -> Array:
    """∂(J − R g)/∂J with R = UVᵀ and g = |Σ|^(1/3), shape (3, 3, N) → (9, 9, N), for det J > 0.

    ∂R = R [w]× with w = (tr(S)I − S)⁻¹ axial(Rᵀ∂J − ∂JᵀR) and S = RᵀJ (Corollary IV.1), ∂g = g/(3
    det) cof J : ∂J.
    """
    turned, size = rotation(jacobian, cof=cof), np.cbrt(det)
    stretch = np.einsum("can,cbn->abn", turned, jacobian)
    trace = stretch[0, 0] + stretch[1, 1] + stretch[2, 2]
    inner = np.moveaxis(trace * np.eye(3)[:, :, None] - stretch, -1, 0)
    inverse = np.moveaxis(np.linalg.inv(inner), 0, -1)
    out = np.zeros((9, 9, jacobian.shape[-1]))
    for c in range(3):
        for d in range(3):
            unit = np.zeros((3, 1))
            unit[d] = 1.0
            w = np.einsum("abn,bn->an", inverse, np.cross(unit, turned[c], axis=0))
            spun = np.cross(turned, w[None], axis=1)  # R[w]×, row by row
            column = -turned * (size / (3.0 * det) * cof[c, d]) - size * spun
            out[:, 3 * c + d] = column.reshape(9, -1)
            out[3 * c + d, 3 * c + d] += 1.0
    return out


def _conjugate_gradients(
    product: Callable[[Array], Array],
    right: Array,
    precondition: Callable[[Array], Array],
    tolerance: float = 0.03,
) -> tuple[Array, int]:
    """A step that solves the normal equations to ``tolerance`` by the preconditioner's norm, and
    how many products.
    """
    solution, left = np.zeros_like(right), right
    near = precondition(left)
    way, size = near, float(np.sum(left * near))
    first, count = size, 0
    while count < _MOST_PRODUCTS and size > tolerance**2 * first:
        count += 1
        bent = product(way)
        share = size / float(np.sum(way * bent))
        solution, left = solution + share * way, left - share * bent
        near = precondition(left)
        before, size = size, float(np.sum(left * near))
        way = near + (size / before) * way
    return solution, count


Method = Literal["fast", "local-global", "gauss-newton"]
CELLS, HEIGHT_M = (24, 24, 6), 2.3
"""The grid of a domain of 8 m, and the band: five times ANYmal's height at rest (Pan et al. §V)."""
_MATCH_TOLERANCE_M = 0.0008
"""Distance by which the ground may miss the terrain where it is measured; 1 mm anywhere."""
_HALVED = 2.0**4
"""Factor by which a cubic spline's error falls when its grid lines are made twice as dense."""
_BARRIER = 0.01
_PUBLISHED_BARRIER = 0.001
_MATCH_WEIGHT = 3.0
"""Weight of the fast path's E_match, in 1/m; the snap does the rest."""
_SMOOTHINGS = (0.0, 0.6, 1.0, 1.5, 2.5)
"""Deviations of the Gaussian under which the terrain is matched, in cells."""
_STEEPEST = 1.9
"""Steepest slope of a matched surface: the ground of a map that follows a steeper one in cells of
.3 m overhangs."""
_SHORTEST_FADE_M = 0.4
"""The least height at which the snap has faded out; where it lifts the ground more, it fades more
slowly."""
_LARGEST_FADE = 0.4
"""Share of a column's height that the snap may squeeze away where it fades the fastest."""
_MARGIN = 4
"""Grid lines of the snap beyond the terrain: its error at its ends falls to a quarter with each."""
DET_FLOOR = 0.1
"""Least min det J at which the fast path stops trying."""
_MOST_CONTROLS = 200_000
_FEWEST_CELLS = 3
"""Cells along an axis that Gauss-Newton solves for: with fewer, two points a cell do not tell cells
+ 3 splines apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapFit:
    """A map that flattens a terrain, and what is known of it.

    Arguments:
        map: from the band [m] to the world [m]; ``to_file`` writes it.
        report: ``least_det``, how far its ground is from the terrain, conformal error, and what it
            cost.
    Source:
        Pan et al. §IV.

    Example:
        >>> import stancekit
        >>> stancekit.warp("hill", cells=(8, 8, 3)).report.cells
        (8, 8, 3)
    """

    map: SplineMap
    report: MapReport


def flatten(
    field: HeightField, cells: tuple[int, int, int] = CELLS, height_m: float = HEIGHT_M
) -> SplineMap:
    """The product's map φ of a terrain: locally injective, exact at the ground (W6 with the house's
    weights).

    Arguments:
        field: the terrain.
        cells: of the tri-cubic grid along x̄, ȳ and z̄; more let the map bend more sharply, and
            cost time in proportion.
        height_m: thickness of the band above the terrain [m], about five times the robot's rest
            height.

    Returns:
        The map from the band [m] to the world [m]; it fits this terrain alone
        (``SplineMap.check_fits``).

    Raises:
        InvalidInput: for a bad grid.
        PlanningFailed: where every map folds, or the terrain is finer than the map's snap can hold.
    Source:
        Pan et al. §IV-A and §IV-B; see ``fit_map`` for its own methods, and for a report.
    """
    return _fast(field, _grid(field, cells, height_m), 100).map


def fit_map(
    field: HeightField,
    *,
    cells: tuple[int, int, int] = CELLS,
    height_m: float = HEIGHT_M,
    method: Method = "fast",
    iterations: int = 100,
) -> MapFit:
    """Make a map of a terrain (W6): x̄ and ȳ span its domain, z̄ spans 0 to ``height_m`` [m].

    Arguments:
        method: fast, checked to have det J > 0 and a match of 1 mm; or Pan et al.'s local-global
            (Algorithm W1) or gauss-newton (with barrier and line search), as published and without
            a snap. Whatever comes of these two is returned: the report says min det J and the
            match. More cells let the map bend more sharply and cost
            time in proportion.

    Raises:
        InvalidInput: for a bad grid, and PlanningFailed for a terrain that is finer than the snap
            can hold.
    """
    began = process_time()
    if method == "gauss-newton" and min(_cells(cells)) < _FEWEST_CELLS:
        raise InvalidInput(
            f"cells: expected {_FEWEST_CELLS} or more along each axis with {method}, got {cells}"
        )
    grid = _grid(field, cells, height_m)
    if method == "fast":
        found = _fast(field, grid, iterations)
        report = _report(method, field, found.map, found.descent, found.match, found.least, began)
        unsnapped = match_error(replace(found.map, snap=None), field)
        return MapFit(map=found.map, report=replace(report, unsnapped_m=unsnapped))
    energy = MapEnergy.published(
        grid, field, barrier=_PUBLISHED_BARRIER if method == "gauss-newton" else 0.0
    )
    solve = published if method == "local-global" else gauss_newton
    descent = solve(energy, grid.identity, iterations)
    warp = _map(field, grid, descent.psi)
    match, least = match_error(warp, field), least_determinant(warp)
    return MapFit(map=warp, report=_report(method, field, warp, descent, match, least, began))


class _Snapped(NamedTuple):
    """A map whose ground is laid on the terrain, the descent that it comes of, and what
    ``match_error`` and ``least_determinant`` say of it.
    """

    map: SplineMap
    descent: Descent
    match: tuple[float, float]
    least: tuple[float, Array]


def _fast(field: HeightField, grid: QuadratureGrid, iterations: int) -> _Snapped:
    began = process_time()
    failed = "the terrain is too steep"
    for target, sigma in _targets(field, grid):
        energy = MapEnergy(grid=grid, field=target, match_weight=_MATCH_WEIGHT, barrier=_BARRIER)
        descent = descend(energy, shear(grid, target), iterations)
        smooth = f"matched the terrain smoothed over {sigma:.2g} m before the snap" if sigma else ""
        try:
            found = _snapped(field, grid, descent, smooth)
        except PlanningFailed as error:
            failed = str(error)
            continue
        if found.least[0] >= DET_FLOOR:
            return found
        failed = f"min det J is {found.least[0]:.3f} after the snap"
    start = shear(grid, field)
    history = [MapEnergy(grid=grid, field=field, match_weight=_MATCH_WEIGHT).at(start)]
    plain = Descent(psi=start, history=history, seconds=[process_time() - began], evaluations=1)
    message = f"a shear (x, y, z + h), for no optimised map will do: {failed}"
    found = _snapped(field, grid, plain, message, fade_m=1e3 * grid.axes[2].high)
    if not found.least[0] > 0.0:
        raise PlanningFailed(
            f"{field.name or 'terrain'}: {message}; the shear's min det J {found.least[0]:.3f}"
        )
    return found


def _targets(field: HeightField, grid: QuadratureGrid) -> Iterator[tuple[HeightField, float]]:
    """Fields that the tri-cubic map is matched to, with their smoothing: the terrain, or what its
    cells can follow.
    """
    cell = max(axis.cell_m for axis in grid.axes[:2])
    for share in _SMOOTHINGS:
        if share and not field.even:
            return
        target = field.smoothed(share * cell) if share else field
        nodes = np.stack(np.meshgrid(field.x_m, field.y_m, indexing="ij"), axis=-1)
        if float(np.linalg.norm(target.gradient(nodes), axis=-1).max()) <= _STEEPEST:
            yield target, share * cell


def _snapped(
    field: HeightField,
    grid: QuadratureGrid,
    descent: Descent,
    message: str,
    fade_m: float | None = None,
) -> _Snapped:
    """The map of a descent, its ground laid exactly on the terrain.

    Raises PlanningFailed where the map's own ground folds over, or where the snap misses the
    terrain by over 1 mm.
    """
    bare = _map(field, grid, descent.psi)
    x, y = field.x_m, field.y_m
    for _ in range(2):
        xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        delta = field.height(xy) - bare.ground_inverse(xy)[1]
        fade = (
            max(_SHORTEST_FADE_M, STEEPEST_FADE * float(delta.max()) / _LARGEST_FADE)
            if fade_m is None
            else fade_m
        )
        warp = replace(bare, snap=_with_margin(x, y, delta), fade_m=fade)
        match = match_error(warp, field)
        if match[0] <= _MATCH_TOLERANCE_M:
            message = "; ".join(part for part in (descent.message, message) if part)
            descent = replace(descent, message=message)
            return _Snapped(warp, descent, match, least_determinant(warp))
        if match[0] > _HALVED * _MATCH_TOLERANCE_M:
            break
        x, y = (np.linspace(line[0], line[-1], 2 * len(line) - 1) for line in (x, y))
    raise PlanningFailed(
        f"{field.name or 'terrain'}: finer than a map of {bare.cells} cells can hold: its ground "
        f"misses it by {1e3 * match[0]:.1f} mm, expected {1e3 * _MATCH_TOLERANCE_M:g} mm or less"
    )


def _with_margin(x: Array, y: Array, delta: Array) -> HeightField:
    """The snap with a few more grid lines beyond each end, where δ goes on as a parabola.

    The height field's spline is straight at its ends; so its error there stays off the terrain.
    """
    k = np.arange(1.0, _MARGIN + 1.0)[:, None]
    parabola = np.concatenate(
        [0.5 * (k + 1.0) * (k + 2.0), -k * (k + 2.0), 0.5 * k * (k + 1.0)], axis=1
    )
    for _ in range(2):
        delta = np.concatenate([(parabola @ delta[:3])[::-1], delta, parabola @ delta[:-4:-1]]).T
    steps = [_MARGIN * np.array([line[1] - line[0], line[-1] - line[-2]]) for line in (x, y)]
    lines = [
        np.concatenate(
            [
                np.linspace(line[0] - before, line[0], _MARGIN + 1)[:-1],
                line,
                np.linspace(line[-1], line[-1] + after, _MARGIN + 1)[1:],
            ]
        )
        for line, (before, after) in zip((x, y), steps, strict=True)
    ]
    return HeightField(lines[0], lines[1], delta, "snap")


def _map(field: HeightField, grid: QuadratureGrid, psi: Array) -> SplineMap:
    return SplineMap(
        domain_m=field.domain_m,
        height_m=grid.axes[2].high,
        control_m=psi,
        name=field.name,
        terrain_digest=terrain_digest(field),
    )


def _report(
    method: str,
    field: HeightField,
    warp: SplineMap,
    descent: Descent,
    match: tuple[float, float],
    least: tuple[float, Array],
    began: float,
) -> MapReport:
    return MapReport(
        method=method,
        terrain=field.name,
        cells=warp.cells,
        ground_error=conformal_error(warp),
        torso_error=conformal_error(warp, TORSO_M),
        least_det=least[0],
        least_det_at_m=least[1],
        match_m=match,
        unsnapped_m=match,
        energy=np.array(
            [[e.total, e.conformal, e.barrier, e.match, e.least_det] for e in descent.history]
        ),
        seconds=np.array(descent.seconds),
        evaluations=descent.evaluations,
        cpu_s=process_time() - began,
        message=descent.message,
    )


def _grid(field: HeightField, cells: tuple[int, int, int], height_m: float) -> QuadratureGrid:
    """The grid over a terrain.

    Raises InvalidInput.
    """
    height = checked(height_m, "height_m", above=0.0, most=100.0)
    return QuadratureGrid.of_band(field.domain_m, height, _cells(cells), 2)


def _cells(cells: tuple[int, int, int]) -> tuple[int, int, int]:
    if len(cells) != 3 or not all(isinstance(n, int) and 2 <= n <= 200 for n in cells):
        raise InvalidInput(f"cells: expected three whole numbers in [2, 200], got {cells}")
    controls = int(np.prod([n + 3 for n in cells]))
    if controls > _MOST_CONTROLS:
        raise InvalidInput(
            f"cells: expected {_MOST_CONTROLS} control points or fewer, got {controls}"
        )
    return cells
