"""Reference terrains of Pan et al. (Fig. 3) with their tasks (Pan et al. §V), and grounds by any
name.

Pan et al. gives pictures only; the formulas here are the house's, in metres with r² = x² + y². The
world's domain is [−4, 4]².
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput, require
from ..files.arrays import Array, read_only
from ..plugins import Registry, split_name, takes
from .elevation import ElevationMap
from .families import (
    SCENE,
    TERRAIN_FAMILIES,
    WIDE,
    Shape,
    checked_draw,
    drawn_name,
    drawn_surface,
    family_terrain,
    of_heights,
    random_heights,
    read_draw,
)
from .heightfield import HeightField
from .import_options import ImportOptions, check_unasked
from .terrain_file import read_heights
from .triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from .families import Terrain
    from .footholds import FootholdLimits, Footholds


def ripple(x: Array, y: Array) -> Array:
    """Waves of 1.6 m, 12 cm high (Fig. 3a)."""
    k = 2.0 * np.pi / 1.6
    return np.asarray(0.12 * np.sin(k * x) * np.sin(k * y))


def cone(x: Array, y: Array) -> Array:
    """A blunt cone of slope 31° and 2 m radius (Fig. 3b)."""
    s = 0.60 * (2.0 - np.sqrt(x**2 + y**2 + 0.15**2))
    return np.asarray(0.5 * (s + np.sqrt(s**2 + 0.15**2)))


def hill(x: Array, y: Array) -> Array:
    """A mesa 1.5 m high, 60° at its steepest (Fig. 3c)."""
    return np.asarray(0.75 * (1.0 - np.tanh(2.0 * 1.7 / 1.5 * (np.hypot(x, y) - 1.3))))


def pit(gradient: float) -> Shape:
    """A pit 1 m deep whose wall has this gradient where it is steepest (Fig. 3d)."""
    return lambda x, y: np.asarray(-0.5 * (1.0 - np.tanh(2.0 * gradient * (np.hypot(x, y) - 1.3))))


FRICTION = 0.75
"""Friction of grounds that say none, as walks have it."""
REFERENCE_TOLERANCE_M = 0.025
"""Distance by which splines of the references may miss their formulas: the wall of 87° by 15 mm,
the others by under 1 mm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainTask:
    """One walk: from and to a point, shape (2,) [m], and which feet stick, in the order LF, RF, LH,
    RH.
    """

    start: Array
    goal: Array
    adhesive: tuple[bool, bool, bool, bool] = (False, False, False, False)

    def __post_init__(self) -> None:
        for name in ("start", "goal"):
            object.__setattr__(self, name, read_only(getattr(self, name), (2,), name))


def _around(radius_m: float, from_opposite: bool) -> tuple[TerrainTask, ...]:
    """24 directions, out of the middle or from the opposite side."""
    turns = np.deg2rad(15.0) * np.arange(24)
    goals = radius_m * np.stack([np.sin(turns), np.cos(turns)], axis=1)
    return tuple(
        TerrainTask(start=-goal if from_opposite else np.zeros(2), goal=goal) for goal in goals
    )


def _up(start: Sequence[float], goals_m: Array) -> tuple[TerrainTask, ...]:
    """15 targets from one start; both front feet stick."""
    front = (True, True, False, False)
    return tuple(TerrainTask(start=np.array(start), goal=goal, adhesive=front) for goal in goals_m)


def _out_of_the_pit() -> tuple[TerrainTask, ...]:
    turns = np.deg2rad(24.0) * np.arange(15)
    return _up((0.0, 0.0), 2.2 * np.stack([np.cos(turns), np.sin(turns)], axis=1))


TERRAINS: Registry[HeightField | Shape] = Registry(
    "terrain",
    "stancekit.terrains",
    {
        "ripple": ripple,
        "cone": cone,
        "hill": hill,
        "pit": pit(5.0),
        "pit-84": pit(10.0),
        "pit-87": pit(20.0),
    },
    expected="a height field, or a function of x and y",
    accepts=lambda thing: isinstance(thing, HeightField) or takes(thing, 2),
)
"""Terrains by name, those of Pan et al. (Fig. 3) first; the walls of the pits: 79°, 84° and 87°."""


_SPACING_M = {"pit-84": 0.025, "pit-87": 0.025}
"""Distance between the knots of splines that are finer than others' 0.05 m."""
_TASKS: dict[str, Callable[[], tuple[TerrainTask, ...]]] = {
    "ripple": lambda: _around(2.0, from_opposite=False),
    "cone": lambda: _around(2.0, from_opposite=True),
    "hill": lambda: _up((-2.6, 0.0), _spread(15, 0.5)),
    **dict.fromkeys(("pit", "pit-84", "pit-87"), _out_of_the_pit),
}


def reference_terrain(name: str) -> HeightField:
    """The terrain of a name in ``TERRAINS``, or of ``FILE.py:NAME``, over [−4, 4]² m unless it is a
    height field.

    Behind a name stands a ``HeightField``, or a function h(x, y) of arrays that gives heights [m].
    Raises InvalidInput for another name, and for a formula that is finer than its spline can hold.

    >>> reference_terrain("ripple").height(np.zeros(2))
    array(0.)
    """
    ground = TERRAINS.get(name)
    if isinstance(ground, HeightField):
        return ground
    return HeightField.from_function(
        ground,
        float(WIDE[1, 0]),
        _SPACING_M.get(name, 0.05),
        name=name,
        tolerance_m=REFERENCE_TOLERANCE_M,
    )


def reference_tasks(name: str) -> tuple[TerrainTask, ...]:
    """The walks of a terrain: Pan et al.'s benchmark (§V) on its own, 24 directions on ripple and
    cone, 15 targets on hill and pits, where both front feet stick; none on others. Raises
    InvalidInput for another name.
    """
    TERRAINS.get(name)
    return _TASKS.get(name, tuple)()


def _spread(count: int, radius_m: float) -> Array:
    """Points spread evenly over a disc on a golden spiral, shape (count, 2) [m]."""
    turns = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    radii = radius_m * np.sqrt((np.arange(count) + 0.5) / count)
    return np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1)


def named_terrain(
    name: str, options: ImportOptions = ImportOptions(), smooth_m: float = 0.0
) -> HeightField:
    """The heights of a name: one of ``TERRAINS``, ``FILE.py:NAME``, a draw FAMILY:LEVEL:SEED as in
    ``rough:0.5:7`` or ``mine.py:rolling:0.5:7``, or a file of heights.

    Raises InvalidInput.

    Arguments:
        options, smooth_m: of files, see ``terrain_file.read_heights``.
    """
    if names_ground(name):
        check_unasked(options, name)
        require(not smooth_m, f"smooth_m: expected none with {name}, which is read from no file")
        if not drawn_name(name):
            return reference_terrain(name)
        family, level, seed = read_draw(name, "terrain")
        return random_heights(family, level, checked_draw(family, level, seed), name)
    if not Path(name).exists():
        known = ", ".join(each for each in TERRAIN_FAMILIES.names() if each != "walls")
        raise InvalidInput(
            f"terrain: expected a file, one of {', '.join(TERRAINS.names())}, FILE.py:NAME, "
            f"or FAMILY:LEVEL:SEED with {known}, got {name!r}"
        )
    return read_heights(name, options, smooth_m=smooth_m)


def names_ground(name: str) -> bool:
    """Tell whether a name stands for a ground rather than a file: one of ``TERRAINS``,
    FAMILY:LEVEL:SEED, or ``FILE.py:NAME``.
    """
    family = split_name(name)[0]
    is_file = family.endswith(".py") or ".py:" in family
    return name in TERRAINS.names() or is_file or (drawn_name(name) and not Path(name).exists())


def named_ground(name: str) -> Terrain:
    """A ground by its name, with the patches about the place where courses over it begin.

    Raises InvalidInput.
    """
    if drawn_name(name):
        return family_terrain(*read_draw(name, "terrain"))
    return of_heights(named_terrain(name), FRICTION, np.zeros(3), SCENE)


def named_surface(name: str) -> TriangleMesh | ElevationMap:
    """Surface on which footholds of a named ground are looked for: its patches, or a map of its
    heights. Raises InvalidInput.
    """
    if drawn_name(name):
        patches = drawn_surface(*read_draw(name, "terrain"))
        if patches is not None:
            return TriangleMesh.of_patches(patches, name)
    return ElevationMap.of_field(named_terrain(name))


def footholds_on(
    source: str | Path, options: ImportOptions, limits: FootholdLimits, friction: float
) -> Footholds:
    """The footholds of a terrain's file, or of a ground by its name, which is read from no file.

    Raises InvalidInput.
    """
    from .footholds import footholds_of, read_footholds  # of files alone

    if Path(source).exists() and ".py" not in str(source):
        return read_footholds(source, options, limits, friction)
    surface = named_surface(str(source))
    check_unasked(options, surface.name)
    return footholds_of(surface, limits, friction)
