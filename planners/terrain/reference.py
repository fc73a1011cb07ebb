"""Reference terrains of paper W (Fig. 3) with their tasks (paper W §V), and random families by difficulty and seed.

Paper W gives pictures only; the formulas here are the house's, in metres with r² = x² + y². The world's domain is
[−4, 4]².
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from ..errors import InvalidInput
from ..files.arrays import Array, checked, read_only
from ..files.validation import shown
from ..plugins import Registry, split_name, takes
from .heightfield import HeightField
from .import_options import ImportOptions
from .terrain_file import read_heights

HALF_WIDTH_M = 4.0
LEVEL_M = 0.6
"""Random terrains are level within this distance of the origin, so that a robot can stand there [m]."""
Shape = Callable[[Array, Array], Array]


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


REFERENCE_TOLERANCE_M = 0.025
"""What the splines of the references may miss of their formulas: the wall of 87° by 15 mm, the others by under 1 mm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainTask:
    """One walk: from and to a point, shape (2,) [m], and which feet stick, in the order LF, RF, LH, RH."""

    start_xy_m: Array
    goal_xy_m: Array
    adhesive: tuple[bool, bool, bool, bool] = (False, False, False, False)

    def __post_init__(self) -> None:
        for name in ("start_xy_m", "goal_xy_m"):
            object.__setattr__(self, name, read_only(getattr(self, name), (2,), name))


def _around(radius_m: float, from_opposite: bool) -> tuple[TerrainTask, ...]:
    """24 directions, out of the middle or from the opposite side."""
    turns = np.deg2rad(15.0) * np.arange(24)
    goals = radius_m * np.stack([np.sin(turns), np.cos(turns)], axis=1)
    return tuple(TerrainTask(start_xy_m=-goal if from_opposite else np.zeros(2), goal_xy_m=goal) for goal in goals)


def _up(start_xy_m: Sequence[float], goals_m: Array) -> tuple[TerrainTask, ...]:
    """15 targets from one start; both front feet stick."""
    front = (True, True, False, False)
    return tuple(TerrainTask(start_xy_m=np.array(start_xy_m), goal_xy_m=goal, adhesive=front) for goal in goals_m)


def _out_of_the_pit() -> tuple[TerrainTask, ...]:
    turns = np.deg2rad(24.0) * np.arange(15)
    return _up((0.0, 0.0), 2.2 * np.stack([np.cos(turns), np.sin(turns)], axis=1))


@dataclass(frozen=True, kw_only=True)
class Terrain:
    """A terrain by its formula. shape: h of x and y, arrays of one shape [m]; spacing_m: of its spline's knots; tasks:
    walks that it is known for, none if missing."""

    shape: Shape
    spacing_m: float = 0.05
    tasks: Callable[[], tuple[TerrainTask, ...]] = tuple


RIPPLE = Terrain(shape=ripple, tasks=lambda: _around(2.0, from_opposite=False))
CONE = Terrain(shape=cone, tasks=lambda: _around(2.0, from_opposite=True))
HILL = Terrain(shape=hill, tasks=lambda: _up((-2.6, 0.0), _spread(15, 0.5)))
PIT = Terrain(shape=pit(5.0), tasks=_out_of_the_pit)
PIT_84 = Terrain(shape=pit(10.0), spacing_m=0.025, tasks=_out_of_the_pit)
PIT_87 = Terrain(shape=pit(20.0), spacing_m=0.025, tasks=_out_of_the_pit)
TERRAINS: Registry[Terrain | HeightField | Shape] = Registry(
    "terrain",
    "stancekit.terrains",
    {
        "ripple": f"{__name__}:RIPPLE",
        "cone": f"{__name__}:CONE",
        "hill": f"{__name__}:HILL",
        "pit": f"{__name__}:PIT",
        "pit-84": f"{__name__}:PIT_84",
        "pit-87": f"{__name__}:PIT_87",
    },
    expected="a height field, a Terrain, or a function of x and y",
    accepts=lambda thing: isinstance(thing, Terrain | HeightField) or takes(thing, 2),
)
"""Terrains by name, those of paper W (Fig. 3) first; the walls of the pits: 79°, 84° and 87°."""


def _formula(name: str) -> Terrain | HeightField:
    """What stands behind a name, a plain function as a formula. Raises InvalidInput."""
    found = TERRAINS.get(name)
    return found if isinstance(found, Terrain | HeightField) else Terrain(shape=found)


def reference_terrain(name: str) -> HeightField:
    """The terrain of a name in ``TERRAINS``, or of ``FILE.py:NAME``, over [−4, 4]² m unless it is a height field.

    Behind a name stands a ``HeightField``, a ``Terrain``, or a function h(x, y) of arrays that gives heights [m].
    Raises InvalidInput for another name, and for a formula that is finer than its spline can hold.

    >>> reference_terrain("ripple").height(np.zeros(2))
    array(0.)
    """
    found = _formula(name)
    if isinstance(found, HeightField):
        return found
    return HeightField.from_function(
        found.shape, HALF_WIDTH_M, found.spacing_m, name=name, tolerance_m=REFERENCE_TOLERANCE_M
    )


def reference_tasks(name: str) -> tuple[TerrainTask, ...]:
    """The walks of a terrain: paper W's benchmark (§V) on its own, 24 directions on ripple and cone, 15 targets on hill
    and pits, where both front feet stick; none on others. Raises InvalidInput for another name."""
    found = _formula(name)
    return () if isinstance(found, HeightField) else found.tasks()


def _spread(count: int, radius_m: float) -> Array:
    """Points spread evenly over a disc on a golden spiral, shape (count, 2) [m]."""
    turns = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    radii = radius_m * np.sqrt((np.arange(count) + 0.5) / count)
    return np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1)


def _rough(difficulty: float, rng: np.random.Generator) -> Shape:
    """Smooth noise of .5 m wavelength, up to 8 cm deviation."""
    return _noise(0.08 * difficulty, 0.18, rng)


def _waves(difficulty: float, rng: np.random.Generator) -> Shape:
    """Five wave trains in random directions, .8–2.4 m long, up to 25° steep each."""
    turns, phases = rng.uniform(0.0, 2.0 * np.pi, (2, 5))
    k = 2.0 * np.pi / rng.uniform(0.8, 2.4, 5)
    rise = np.tan(np.deg2rad(25.0)) * difficulty * rng.uniform(0.2, 0.6, 5) / k
    along = np.stack([np.cos(turns), np.sin(turns)])
    return lambda x, y: np.asarray(np.sin(k * (np.stack([x, y], axis=-1) @ along) + phases) @ rise)


def _stairs(difficulty: float, rng: np.random.Generator) -> Shape:
    """Straight stairs up and down through the domain, steps up to 22 cm, edges rounded over 10 cm."""
    turn, tread = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.5, 0.8)
    edges = LEVEL_M + 0.1 + tread * np.arange(int((HALF_WIDTH_M * 1.5) / tread))
    steps = 0.22 * difficulty * rng.uniform(0.7, 1.0, len(edges)) * rng.choice([1.0, 1.0, -1.0], len(edges))

    def shape(x: Array, y: Array) -> Array:
        along = np.abs(np.cos(turn) * x + np.sin(turn) * y)
        return sum(
            (s * 0.5 * (1.0 + np.tanh((along - e) / 0.06)) for s, e in zip(steps, edges, strict=True)),
            start=np.zeros_like(x),
        )

    return shape


def _stones(difficulty: float, rng: np.random.Generator) -> Shape:
    """Stepping stones, tops within 5 cm of level, in a moat up to 40 cm deep; harder ones are smaller."""
    pitch, depth = 0.7, 0.4 * difficulty
    lattice = pitch * np.arange(-7, 8)
    centres = np.stack(np.meshgrid(lattice, lattice, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = centres + rng.uniform(-0.08, 0.08, centres.shape)
    radii = rng.uniform(0.36, 0.42, len(centres)) - 0.12 * difficulty
    tops = depth + 0.05 * difficulty * rng.uniform(-1.0, 1.0, len(centres))

    def shape(x: Array, y: Array) -> Array:
        height = np.full(x.shape, -depth)
        for (cx, cy), radius, top in zip(centres, radii, tops, strict=True):
            height += top * 0.5 * (1.0 - np.tanh((np.hypot(x - cx, y - cy) - radius) / 0.07))
        return height

    return shape


def _ramps(difficulty: float, rng: np.random.Generator) -> Shape:
    """Planes up to 35° steep that meet in rounded ridges and valleys."""
    turns, levels = rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(0.8, 2.0, 3)
    slopes = np.tan(np.deg2rad(35.0)) * difficulty * rng.uniform(0.4, 1.0, 3) * rng.choice([-1.0, 1.0], 3)

    def shape(x: Array, y: Array) -> Array:
        height = np.zeros_like(x)
        for turn, level, slope in zip(turns, levels, slopes, strict=True):
            beyond = np.cos(turn) * x + np.sin(turn) * y - level
            height += 0.5 * slope * (beyond + np.sqrt(beyond**2 + 0.15**2))
        return height

    return shape


FAMILIES: Registry[Callable[[float, np.random.Generator], Shape]] = Registry(
    "family", "stancekit.height_families",
    {"rough": _rough, "stairs": _stairs, "stones": _stones, "waves": _waves, "ramps": _ramps},
    expected="a function of a difficulty and a generator", accepts=lambda it: takes(it, 2),
)  # fmt: skip
"""Random terrains by name: a function of a difficulty in [0, 1] and a generator gives h of x and y [m]."""


def random_terrain(family: str, difficulty: float, rng: np.random.Generator) -> HeightField:
    """A terrain drawn from a family; difficulty in [0, 1], 0 is level ground. Raises InvalidInput.

    family: a name in ``FAMILIES``, or FILE.py:NAME. Within LEVEL_M of the origin it is level, whatever the family says.
    """
    hard = checked(difficulty, "terrain: difficulty", least=0.0, most=1.0)
    shape = FAMILIES.get(family)(hard, rng)
    if not takes(shape, 2):
        raise InvalidInput(f"family {family}: expected a function of x and y, got {shown(shape)}")

    def levelled(x: Array, y: Array) -> Array:
        share = np.clip((np.hypot(x, y) - LEVEL_M) / LEVEL_M, 0.0, 1.0)
        return np.asarray(share**3 * (10.0 + share * (6.0 * share - 15.0)) * shape(x, y))

    return HeightField.from_function(levelled, HALF_WIDTH_M, 0.05, name=f"{family}:{hard:g}", tolerance_m=0.01)


def _noise(deviation_m: float, length_m: float, rng: np.random.Generator) -> Shape:
    """White noise under a Gaussian of this length, as a function."""
    spacing = 0.05
    count = 2 * int(HALF_WIDTH_M / spacing) + 1
    drawn = gaussian_filter(rng.standard_normal((count, count)), length_m / spacing)
    field = HeightField.from_array(deviation_m / float(drawn.std()) * drawn, spacing)
    return lambda x, y: field.height(np.stack([x, y], axis=-1))


def named_terrain(name: str, options: ImportOptions = ImportOptions(), smooth_m: float = 0.0) -> HeightField:
    """The terrain of a name: one of ``TERRAINS``, ``FILE.py:NAME``, a draw ``family:difficulty:seed`` as in
    ``rough:0.5:7`` or ``mine.py:rolling:0.5:7``, or a file of heights.

    options, smooth_m: of files, see ``terrain_file.read_heights``. Raises InvalidInput.
    """
    family, numbers = split_name(name)
    own = family.endswith(".py") or ".py:" in family
    if name in TERRAINS.names() or (own and not numbers):
        return reference_terrain(name)
    if own or (family in FAMILIES.names() and not Path(name).exists()):
        try:
            hard, drawn = numbers
            difficulty, seed = float(hard), int(drawn)
        except ValueError:
            like = f"{family}:DIFFICULTY:SEED as in {family}:0.5:7"
            raise InvalidInput(f"terrain: expected {like}, got {name!r}") from None
        if not 0 <= seed < 2**63:
            raise InvalidInput(f"terrain: expected a seed of 0 or more, got {seed}")
        field = random_terrain(family, difficulty, np.random.Generator(np.random.PCG64(seed)))
        return HeightField(field.x_m, field.y_m, field.heights_m, name)
    if not Path(name).exists():
        raise InvalidInput(
            f"terrain: expected a file, one of {', '.join(TERRAINS.names())}, FILE.py:NAME, "
            f"or FAMILY:DIFFICULTY:SEED with {', '.join(FAMILIES.names())}, got {name!r}"
        )
    return read_heights(name, options, smooth_m=smooth_m)
