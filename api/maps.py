"""Maps that flatten terrains."""

from __future__ import annotations

from pathlib import Path

from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import named_terrain
from stancekit.planners.warp.conformal import CELLS, HEIGHT_M, MapFit, Method, fit_map

MOST_ITERATIONS = 10_000


@checked
def warp(
    terrain: HeightField | str | Path,
    *,
    cells: tuple[int, int, int] = CELLS,
    height_m: float = HEIGHT_M,
    method: Method = "fast",
    iterations: int = 100,
) -> MapFit:
    """Make the map that flattens a terrain, and measure it.

    Arguments:
        terrain: a ``HeightField``, a name, a file of heights, or "FILE.py:NAME", as for
            ``heights``.
        cells: numbers of cells of the tri-cubic grid along each axis; more let the map bend more
            sharply, and cost time in proportion.
        height_m: thickness of the band above the terrain [m], about five times the robot's rest
            height.
        method: "fast", exact at the ground; "local-global" (Algorithm 1 of Pan et al.),
            "gauss-newton" and "accelerated" as published, without a snap.
        iterations: largest number of iterations of the method.

    Returns:
        A ``MapFit``: the ``map``, and its ``report``, whose ``least_det`` above 0 says that the map
        folds nowhere.

    Raises:
        InvalidInput: for a bad grid, and a terrain that cannot be read.
        PlanningFailed: where every map folds, or the terrain is finer than the map's snap can hold.
    Source:
        Pan et al. §IV-A and §IV-B, W6.

    Example:
        >>> import stancekit
        >>> stancekit.warp("hill", cells=(8, 8, 3)).report.least_det > 0.0
        True
    """
    checked_int(iterations, "iterations", least=1, most=MOST_ITERATIONS)
    if any(isinstance(count, bool) or not isinstance(count, int) for count in cells):
        raise InvalidInput(f"cells: expected three whole numbers in [2, 200], got {cells}")
    field = terrain if isinstance(terrain, HeightField) else named_terrain(str(terrain))
    return fit_map(field, cells=cells, height_m=height_m, method=method, iterations=iterations)
