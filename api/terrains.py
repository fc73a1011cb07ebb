"""Terrains: where a foot may be put on them."""

from __future__ import annotations

from pathlib import Path

from stancekit.planners.arguments import checked, settings_from
from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain.footholds import FootholdLimits, Footholds
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.reference import named_terrain


@checked
def terrain(
    source: HeightField | str | Path,
    *,
    friction: float = 0.8,
    robot: Robot | str | Path | None = None,
    limits: FootholdLimits | None = None,
    **meaning: object,
) -> Footholds:
    """Find the footholds of a terrain: planar convex pieces, each with how certain it is, and what was refused and why.

    Arguments:
        source: a mesh, a grid of heights or a point cloud in a file; a height field; or the name of a reference or a
            random terrain, as ``walk`` has them.
        friction: Coulomb coefficient of its surfaces.
        robot: whose foot is the margin and the least width of a foothold, where ``limits`` are not given.
        limits: what counts as a foothold.
        meaning: what the numbers of a file mean, fields of ``ImportOptions``: unit_m, up, offset_m, crop_m, spacing_m,
            height_m, holes, kind, most_triangles.
    Returns:
        The ``Footholds``, over which ``plan`` plans from a start to a goal.
    Raises:
        InvalidInput: for a file that cannot be read, numbers out of range, and a terrain without footholds.
    Source:
        None: planar convex pieces with a margin.
    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.05)
        >>> round(stancekit.terrain(level).area_m2, 2)
        3.84
    """
    from stancekit.planners.robot.robot_file import robot_of
    from stancekit.planners.terrain.elevation import ElevationMap
    from stancekit.planners.terrain.foothold_search import footholds_of, read_footholds

    options = settings_from(ImportOptions, meaning, beside=("source", "friction", "robot", "limits"))
    if limits is None:
        limits = FootholdLimits() if robot is None else FootholdLimits.for_foot(_radius_m(robot_of(robot)))
    if not isinstance(source, HeightField) and Path(source).exists() and ".py" not in str(source):
        return read_footholds(source, options, limits, friction)
    field = source if isinstance(source, HeightField) else named_terrain(str(source))
    if further := [name for name, value in meaning.items() if value != getattr(ImportOptions, name)]:
        what = field.name or "a height field"
        raise InvalidInput(f"{further[0]}: expected none with {what}, which is read from no file")
    return footholds_of(ElevationMap.of_field(field), limits, friction)


@checked
def heights(source: str | Path, *, smooth_m: float = 0.0, **meaning: object) -> HeightField:
    """Read a terrain as one height at every place, to ``walk`` over and to ``warp``.

    Arguments:
        source: a grid of heights, a mesh or a point cloud in a file; the name of a reference terrain ("ripple", "cone",
            "hill", "pit", ...), a random one as "rough:0.5:7", or a function of x and y as "FILE.py:NAME".
        smooth_m: deviation of a Gaussian that smooths the heights of a file [m].
        meaning: what the numbers of a file mean, as for ``terrain``.
    Returns:
        The ``HeightField``.
    Raises:
        InvalidInput: for a file that cannot be read, an unknown name, and numbers out of range.
    Source:
        Paper W §V, for the reference terrains.
    Example:
        >>> import stancekit
        >>> stancekit.heights("hill").domain_m
        ((-4.0, 4.0), (-4.0, 4.0))
    """
    return named_terrain(str(source), settings_from(ImportOptions, meaning, beside=("source", "smooth_m")), smooth_m)


def _radius_m(robot: Robot) -> float:
    """The largest radius of its feet, 0 where none is known."""
    return robot.source.known_radius_m
