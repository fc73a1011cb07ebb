"""Terrains: where a foot may be put on them."""

from __future__ import annotations

from pathlib import Path

from stancekit import HeightField, Robot
from stancekit.planners.arguments import checked, settings_from
from stancekit.planners.problem.course_terrain import footholds_for
from stancekit.planners.terrain.families import TERRAIN_FAMILIES, Terrain
from stancekit.planners.terrain.footholds import FRICTION, FootholdLimits, Footholds
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.reference import (
    named_ground,
    named_terrain,
    names_ground,
)


@checked
def terrain(
    source: HeightField | str | Path,
    *,
    friction: float = FRICTION,
    robot: Robot | str | Path | None = None,
    limits: FootholdLimits = FootholdLimits(),
    **meaning: object,
) -> Footholds:
    """Find the footholds of a terrain: planar convex pieces, each with how certain it is, and what
    was refused and why.

    Arguments:
        source: a mesh, a grid of heights or a point cloud in a file; a height field; the name of a
            reference terrain ("ripple", "hill", ...); a family's ground as "stairs:0.5:7" (family,
            level, seed); or "FILE.py:NAME".
        friction: Coulomb coefficient of its surfaces.
        robot: robot whose foot gives the margin and the least width of a foothold where ``limits``
            have none.
        limits: limits of what counts as a foothold.
        meaning: fields of ``ImportOptions`` that say what the numbers of a file mean: unit_m, up,
            offset_m, crop_m, spacing_m, height_m, holes, kind, most_triangles.

    Returns:
        The ``Footholds``, over which ``plan`` plans from a start to a goal.

    Raises:
        InvalidInput: for a file that cannot be read, numbers out of range, and a terrain without
            footholds.
    Source:
        None: planar convex pieces with a margin.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.05)
        >>> round(stancekit.terrain(level).area_m2, 2)
        3.84
    """
    options = settings_from(
        ImportOptions, meaning, beside=("source", "friction", "robot", "limits")
    )
    return footholds_for(robot, source, options=options, limits=limits, friction=friction)


@checked
def heights(source: str | Path, *, smooth_m: float = 0.0, **meaning: object) -> HeightField:
    """Read a terrain as one height at every place, to ``walk`` over and to ``warp``.

    Arguments:
        source: a grid of heights, a mesh or a point cloud in a file; the name of a reference
            terrain ("ripple", "cone", "hill", "pit", ...), a family's ground as "stairs:0.5:7"
            (family, level, seed), or a function of x and y as "FILE.py:NAME".
        smooth_m: deviation of a Gaussian that smooths the heights of a file [m].
        meaning: fields of ``ImportOptions``, as for ``terrain``.

    Returns:
        The ``HeightField``.

    Raises:
        InvalidInput: for a file that cannot be read, an unknown name, and numbers out of range.
    Source:
        Pan et al. §V, for the reference terrains.

    Example:
        >>> import stancekit
        >>> stancekit.heights("hill").domain_m
        ((-4.0, 4.0), (-4.0, 4.0))
    """
    return named_terrain(
        str(source), settings_from(ImportOptions, meaning, beside=("source", "smooth_m")), smooth_m
    )


@checked
def ground(name: str) -> Terrain:
    """Make a ground by its name: the same one for plans, walks, footholds, samples and
    environments.

    Arguments:
        name: a family's ground as "stairs:0.5:7" (family, level in [0, 1], seed), a reference
            terrain ("ripple", "hill", ...), or "FILE.py:NAME", with a level and a seed where it is
            a family.

    Returns:
        The ``Terrain``: ``patches`` about the place ``begin_m`` where courses over it begin, and
        ``heights``, to ``walk`` over, whose edges are rounded; None where all surfaces are upright.

    Raises:
        InvalidInput: for an unknown name, a level outside [0, 1], and what is no seed.
    Source:
        None: docs/reference/grounds.md has the table.

    Example:
        >>> from stancekit.terrains import ground
        >>> stairs = ground("stairs:0.5:7")
        >>> len(stairs.patches), stairs.figures["riser_m"], stairs.heights.domain_m
        (13, 0.25, ((-4.0, 4.0), (-4.0, 4.0)))
    """
    if not names_ground(name):
        raise TERRAIN_FAMILIES.unknown(name)
    return named_ground(name)
