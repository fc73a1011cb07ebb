"""Making a map for a terrain: the methods of Pan et al. as published, and the product's fast path.

The fast path descends the conformal energy with barrier and a soft match from a shear, whose det J
is 1, and then snaps the ground onto the terrain with a bicubic spline that fades out with height.
What is too steep for the cells is matched smoothed, and left to the snap. The first map is kept
whose det J is well above 0 everywhere, on lines three times as dense as the quadrature; where there
is none, a shear.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import process_time
from typing import Literal

import numpy as np

from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array, checked
from ..terrain.heightfield import HeightField
from .energy import MapEnergy, shear
from .gauss_newton import gauss_newton
from .gradient import descend
from .local_global import Descent, accelerated, published
from .quadrature import QuadratureGrid
from .report import TORSO_M, MapReport, conformal_error, least_determinant, match_error
from .spline_map import STEEPEST_FADE, SplineMap, terrain_digest

Method = Literal["fast", "local-global", "accelerated", "gauss-newton"]
CELLS, HEIGHT_M = (24, 24, 6), 2.3
"""The grid of a domain of 8 m, and the band: five times ANYmal's height at rest (Pan et al. §V)."""
MATCH_TOLERANCE_M = 0.0008
"""Distance by which the ground may miss the terrain where it is measured; 1 mm anywhere."""
BARRIER = 0.01
PUBLISHED_BARRIER = 0.001
MATCH_WEIGHT = 3.0
"""Weight of the fast path's E_match, in 1/m; the snap does the rest."""
SMOOTHINGS = (0.0, 0.6, 1.0, 1.5, 2.5)
"""Deviations of the Gaussian under which the terrain is matched, in cells."""
STEEPEST = 1.9
"""Steepest slope of a matched surface: the ground of a map that follows a steeper one in cells of
.3 m overhangs."""
SHORTEST_FADE_M = 0.4
"""The least height at which the snap has faded out; where it lifts the ground more, it fades more
slowly."""
LARGEST_FADE = 0.4
"""Share of a column's height that the snap may squeeze away where it fades the fastest."""
MARGIN = 4
"""Grid lines of the snap beyond the terrain: its error at its ends falls to a quarter with each."""
DET_FLOOR = 0.1
"""Least min det J at which the fast path stops trying."""
MOST_CONTROLS = 200_000
SEPARABLE, FEWEST_CELLS = ("gauss-newton", "accelerated"), 3
"""Methods that solve axis by axis, and the cells along one: with fewer, two points a cell do not
tell cells + 3 splines apart."""


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
    return fit_map(field, cells=cells, height_m=height_m).map


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
            a snap, or Algorithm W1 accelerated. Whatever comes of these three is returned: the
            report says min det J and the match. More cells let the map bend more sharply and cost
            time in proportion.

    Raises:
        InvalidInput: for a bad grid, and PlanningFailed for a terrain that is finer than the snap
            can hold.
    """
    began = process_time()
    if method in SEPARABLE and min(_cells(cells)) < FEWEST_CELLS:
        raise InvalidInput(
            f"cells: expected {FEWEST_CELLS} or more along each axis with {method}, got {cells}"
        )
    grid = QuadratureGrid.of_band(
        field.domain_m, checked(height_m, "height_m", above=0.0, most=100.0), _cells(cells), 2
    )
    if method == "fast":
        return _fast(field, grid, iterations, began)
    energy = MapEnergy.published(
        grid, field, barrier=PUBLISHED_BARRIER if method == "gauss-newton" else 0.0
    )
    if method == "accelerated":
        energy = replace(energy, scale="nearest")
    solve = {"local-global": published, "accelerated": accelerated, "gauss-newton": gauss_newton}[
        method
    ]
    descent = solve(energy, grid.identity, iterations)
    warp = _map(field, grid, descent.psi)
    return MapFit(
        map=warp, report=_report(method, field, warp, descent, match_error(warp, field), began)
    )


def _fast(field: HeightField, grid: QuadratureGrid, iterations: int, began: float) -> MapFit:
    failed = "the terrain is too steep"
    for target, sigma in _targets(field, grid):
        energy = MapEnergy(grid=grid, field=target, match_weight=MATCH_WEIGHT, barrier=BARRIER)
        descent = descend(energy, shear(grid, target), iterations)
        smooth = f"matched the terrain smoothed over {sigma:.2g} m before the snap" if sigma else ""
        try:
            fit = _snapped(field, grid, descent, smooth, began)
        except PlanningFailed as error:
            failed = str(error)
            continue
        if fit.report.least_det >= DET_FLOOR:
            return fit
        failed = f"min det J is {fit.report.least_det:.3f} after the snap"
    start = shear(grid, field)
    history = [MapEnergy(grid=grid, field=field, match_weight=MATCH_WEIGHT).at(start)]
    plain = Descent(psi=start, history=history, seconds=[process_time() - began], evaluations=1)
    message = f"a shear (x, y, z + h), for no optimised map will do: {failed}"
    fit = _snapped(field, grid, plain, message, began, fade_m=1e3 * grid.axes[2].high)
    if not fit.report.least_det > 0.0:
        raise PlanningFailed(
            f"{field.name or 'terrain'}: {message}; the shear's min det J "
            f"{fit.report.least_det:.3f}"
        )
    return fit


def _targets(field: HeightField, grid: QuadratureGrid) -> Iterator[tuple[HeightField, float]]:
    """Fields that the tri-cubic map is matched to, with their smoothing: the terrain, or what its
    cells can follow.
    """
    cell = max(axis.cell_m for axis in grid.axes[:2])
    for share in SMOOTHINGS:
        if share and not field.even:
            return
        target = field.smoothed(share * cell) if share else field
        nodes = np.stack(np.meshgrid(field.x_m, field.y_m, indexing="ij"), axis=-1)
        if float(np.linalg.norm(target.gradient(nodes), axis=-1).max()) <= STEEPEST:
            yield target, share * cell


def _snapped(
    field: HeightField,
    grid: QuadratureGrid,
    descent: Descent,
    message: str,
    began: float,
    fade_m: float | None = None,
) -> MapFit:
    """The map of a descent, its ground laid exactly on the terrain, with its report.

    Raises PlanningFailed where the map's own ground folds over, or where the snap misses the
    terrain by over 1 mm.
    """
    bare = _map(field, grid, descent.psi)
    x, y = field.x_m, field.y_m
    for _ in range(2):
        xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        delta = field.height(xy) - bare.ground_inverse(xy)[1]
        fade = (
            max(SHORTEST_FADE_M, STEEPEST_FADE * float(delta.max()) / LARGEST_FADE)
            if fade_m is None
            else fade_m
        )
        warp = replace(bare, snap=_with_margin(x, y, delta), fade_m=fade)
        match = match_error(warp, field)
        if match[0] <= MATCH_TOLERANCE_M:
            break
        x, y = (np.linspace(line[0], line[-1], 2 * len(line) - 1) for line in (x, y))
    else:
        raise PlanningFailed(
            f"{field.name or 'terrain'}: finer than a map of {bare.cells} cells can hold: its "
            "ground misses it by "
            f"{1e3 * match[0]:.1f} mm, expected {1e3 * MATCH_TOLERANCE_M:g} mm or less"
        )
    report = _report("fast", field, warp, descent, match, began)
    message = "; ".join(part for part in (descent.message, message) if part)
    return MapFit(
        map=warp, report=replace(report, unsnapped_m=match_error(bare, field), message=message)
    )


def _with_margin(x: Array, y: Array, delta: Array) -> HeightField:
    """The snap with a few more grid lines beyond each end, where δ goes on as a parabola.

    The height field's spline is straight at its ends; so its error there stays off the terrain.
    """
    k = np.arange(1.0, MARGIN + 1.0)[:, None]
    parabola = np.concatenate(
        [0.5 * (k + 1.0) * (k + 2.0), -k * (k + 2.0), 0.5 * k * (k + 1.0)], axis=1
    )
    for _ in range(2):
        delta = np.concatenate([(parabola @ delta[:3])[::-1], delta, parabola @ delta[:-4:-1]]).T
    steps = [MARGIN * np.array([line[1] - line[0], line[-1] - line[-2]]) for line in (x, y)]
    lines = [
        np.concatenate(
            [
                np.linspace(line[0] - before, line[0], MARGIN + 1)[:-1],
                line,
                np.linspace(line[-1], line[-1] + after, MARGIN + 1)[1:],
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
    began: float,
) -> MapReport:
    least, where = least_determinant(warp)
    return MapReport(
        method=method,
        terrain=field.name,
        cells=warp.cells,
        ground_error=conformal_error(warp),
        torso_error=conformal_error(warp, TORSO_M),
        least_det=least,
        least_det_at_m=where,
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


def _cells(cells: tuple[int, int, int]) -> tuple[int, int, int]:
    if len(cells) != 3 or not all(isinstance(n, int) and 2 <= n <= 200 for n in cells):
        raise InvalidInput(f"cells: expected three whole numbers in [2, 200], got {cells}")
    controls = int(np.prod([n + 3 for n in cells]))
    if controls > MOST_CONTROLS:
        raise InvalidInput(
            f"cells: expected {MOST_CONTROLS} control points or fewer, got {controls}"
        )
    return cells
