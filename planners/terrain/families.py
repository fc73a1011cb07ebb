"""Terrain, its patches and heights, which show one surface; and families of it: one table of
generators, each a ground by its name, a level in [0, 1] and a seed.

A family is a pure function of a level and a generator. The level says one physical quantity, by a
formula that is linear in it; the generator says the rest (phase, offset, friction), in draws that
do not depend on the level. So equal seeds at two levels give the same ground, easier and harder; of
gaps and beams the harder one has less to stand on and nothing else is different, and what cannot be
crossed at one level cannot be crossed at a higher one.

A family gives polygons, or heights h(x, y). The one is seen as the other where that is wanted:
heights of polygons are their surface with rounded edges (``heightfield.rounded``), polygons of heights are the
planar pieces that a foot may be put on (``map_footholds``). Key frames see the ground about their
start (``SCENE``), walks see all of it (``WIDE``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from inspect import signature
from typing import TYPE_CHECKING

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked
from ..files.documents import shown
from ..plugins import Registry, split_name, takes
from .patch import Patch
from .polygon import EDGE_M, UPRIGHT, VOID_M, half_planes, surface_patch

if TYPE_CHECKING:
    from .heightfield import HeightField  # splines are slow to import


@dataclass(frozen=True, eq=False)
class Terrain:
    """One ground, for key frames as patches and for walks as heights.

    Arguments:
        patches: every surface, in order.
        footing: per patch, whether a toe may stand on it; risers, for one, are only in the way.
        footholds: where toes may stand instead: pieces of the patches that keep ``inset_m`` from
            their borders [m].
        rise: rise of the mean ground per metre along x; None between walls, where the way is up.
        figures: what was drawn, by name, in SI units.
        begin_m: point of the ground over which a course begins, shape (3,) [m].
        laid: makes the heights where they go on beyond the patches; without it they are those of
            the patches.
        doubts: what the reader of its file mended or left out, one line each.
    """

    patches: tuple[Patch, ...]
    footing: tuple[bool, ...]
    footholds: tuple[Patch, ...] | None = None
    inset_m: float = 0.0
    rise: float | None = 0.0
    figures: Mapping[str, float] = field(default_factory=dict)
    begin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    laid: Callable[[], HeightField | None] | None = None
    doubts: tuple[str, ...] = ()

    @property
    def standing(self) -> tuple[tuple[str, Patch], ...]:
        """Surfaces that toes may stand on, each with its name in messages."""
        if self.footholds is not None:
            return tuple((f"foothold {i}", patch) for i, patch in enumerate(self.footholds))
        return tuple(
            (f"terrain patch {i}", self.patches[i])
            for i, footing in enumerate(self.footing)
            if footing
        )

    @property
    def surfaces(self) -> tuple[tuple[Patch, bool], ...]:
        """Every surface, footholds last, and whether a toe may stand on it."""
        pieces = tuple((patch, True) for patch in self.footholds or ())
        return (*zip(self.patches, self.footing, strict=True), *pieces)

    @cached_property
    def heights(self) -> HeightField | None:
        """The surface for walks, its edges rounded (``heightfield.rounded``); None where nothing faces up, as
        between walls.
        """
        if self.laid is not None:
            return self.laid()
        from .heightfield import rounded

        return rounded(self.patches)

    def grid(self, x_m: Array, y_m: Array) -> Array:
        """Heights at grid lines, shapes (n,) and (m,), shape (n, m) [m].

        Where polygons overlap the highest one that faces up counts, with sharp edges; ``VOID_M``
        where there is none.
        """
        places = np.stack(np.meshgrid(x_m, y_m, indexing="ij"), axis=-1)
        if (
            self.footholds is not None and self.heights is not None
        ):  # its patches are pieces of its heights
            return self.heights.height(places)
        heights = np.full(places.shape[:2], -np.inf)
        for patch in self.patches:
            if patch.normal[2] < UPRIGHT:
                continue
            normals, offsets = half_planes(patch.vertices_m[:, :2])
            within = np.all(places @ normals.T <= offsets + EDGE_M, axis=-1)
            heights = np.where(within, np.maximum(heights, patch.heights_at(places)), heights)
        return np.where(np.isfinite(heights), heights, VOID_M)

    def with_friction(self, factor: float) -> Terrain:
        """Ground with this factor on every friction."""
        checked(factor, "friction", least=0.0)
        patches, footholds = (
            None
            if each is None
            else tuple(patch.with_friction(factor * patch.friction) for patch in each)
            for each in (self.patches, self.footholds)
        )
        return replace(self, patches=patches or (), footholds=footholds)


SCENE = np.array([(-0.8, -0.8, -np.inf), (1.1, 0.8, np.inf)])
"""All that a robot about (0, 0, 0.2) that heads along x for 0.3 m may touch with legs of up to half
a metre: a box."""
WIDE = np.array([(-4.0, -4.0, -np.inf), (4.0, 4.0, np.inf)])
"""All that walks go over: a box."""
for _box in (SCENE, WIDE):
    _box.setflags(write=False)
Shape = Callable[[Array, Array], Array]
_Draw = Callable[..., Terrain | Sequence[Patch] | Shape]
"""A function of a level and a generator that gives a ground: a terrain; its surfaces, where all of
it is level on the whole and to stand on; or h of x and y. Polygons go on to an ``extent``, a box as
``WIDE``, where it takes one by that name."""


_LEAST_M = 1e-3
"""A riser lower than this is none [m]."""


def _stairs(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Height of a riser: 0.5 · level m."""
    low_x, high_x, half = _ends(extent)
    run, phase, friction = rng.uniform(0.24, 0.32), rng.uniform(0.0, 1.0), rng.uniform(0.6, 0.9)
    riser = _RISER_M * level
    patches, footing = list[Patch](), list[bool]()
    first = int(np.floor(low_x / run - phase))
    for step in range(first, int(np.ceil(high_x / run - phase))):
        x, height = (
            (step + phase) * run,
            (step + 0.5 + phase) * riser,
        )  # the mean goes through the origin
        if riser > _LEAST_M and step > first:
            patches.append(_riser(x, height - riser, height, friction, half))
            footing.append(False)
        patches.append(_level(x, x + run, -half, half, height, friction))
        footing.append(True)
    figures = {"riser_m": riser, "run_m": run, "friction": friction}
    return Terrain(
        patches=tuple(patches), footing=tuple(footing), rise=riser / run, figures=figures
    )


def _stones(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Clear distance of stones: 0.6 · level m; their side 0.25 − 0.2 · level m."""
    phase, friction = rng.uniform(0.0, 1.0, 2), rng.uniform(0.6, 0.9)
    shifts, tops = (
        rng.uniform(-0.5, 0.5, (_STONES, _STONES, 2)),
        rng.uniform(-1.0, 1.0, (_STONES, _STONES)),
    )
    side, apart = _STONE_M[0] + (_STONE_M[1] - _STONE_M[0]) * level, _APART_M * level
    pitch = side + apart
    if extent is not SCENE:
        shifts = _within(rng.uniform(-0.5, 0.5, (_FAR, _FAR, 2)), shifts)
        tops = _within(rng.uniform(-1.0, 1.0, (_FAR, _FAR)), tops)
    patches = []
    for i, j in np.ndindex(tops.shape):
        middle = (np.array([i, j]) - len(tops) // 2 + phase) * pitch + 0.5 * apart * shifts[i, j]
        low, high = middle - 0.5 * side, middle + 0.5 * side
        if _outside(low, high, extent):
            continue
        top = _STONE_TOP_M * level * float(tops[i, j])
        patches.append(_level(low[0], high[0], low[1], high[1], top, friction))
    figures = {
        "side_m": side,
        "apart_m": apart,
        "share_of_area": (side / pitch) ** 2,
        "friction": friction,
    }
    return _standing(patches, figures)


def _gaps(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Width of a gap across the way: 1.0 · level m."""
    low_x, high_x, half = _ends(extent)
    middle, friction = rng.uniform(0.0, 0.35), rng.uniform(0.6, 0.9)
    gap = _GAP_M * level
    ends = (middle - 0.5 * gap, middle + 0.5 * gap)
    spans = ((low_x, ends[0]), (ends[1], high_x))
    patches = [_level(low, high, -half, half, 0.0, friction) for low, high in spans]
    return _standing(patches, {"gap_m": gap, "middle_m": middle, "friction": friction})


def _beams(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Width of a beam along the way: 1.2 − 1.16 · level m."""
    low_x, high_x, _ = _ends(extent)
    offset, friction = rng.uniform(-_BEAM_OFFSET_M, _BEAM_OFFSET_M), rng.uniform(0.6, 0.9)
    width = _BEAM_M[0] + (_BEAM_M[1] - _BEAM_M[0]) * level
    patch = _level(low_x, high_x, offset - 0.5 * width, offset + 0.5 * width, 0.0, friction)
    return _standing([patch], {"width_m": width, "offset_m": offset, "friction": friction})


def _rubble(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Deviation of blocks' heights: 0.6 · level m; leans to 0.8 · level."""
    phase, friction = rng.uniform(0.0, 1.0, 2), rng.uniform(0.4, 0.7)
    heights, leans = (
        rng.standard_normal((_STONES, _STONES)),
        rng.uniform(-1.0, 1.0, (_STONES, _STONES, 2)),
    )
    deviation, lean = _RUBBLE_M * level, _RUBBLE_RAD * level
    if extent is not SCENE:
        heights = _within(rng.standard_normal((_FAR, _FAR)), heights)
        leans = _within(rng.uniform(-1.0, 1.0, (_FAR, _FAR, 2)), leans)
    patches = []
    for i, j in np.ndindex(heights.shape):
        low = (np.array([i, j]) - len(heights) // 2 + phase - 0.5) * _BLOCK_M
        high = low + _BLOCK_M
        if _outside(low, high, extent):
            continue
        slope = np.tan(lean * leans[i, j])
        corners = np.array(
            [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        )
        z = deviation * heights[i, j] + (corners - 0.5 * (low + high)) @ slope
        patches.append(surface_patch(np.column_stack([corners, z]), friction))
    return _standing(patches, {"deviation_m": deviation, "lean_rad": lean, "friction": friction})


def _slopes(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Angle of a plane that is climbed: 0.8 · level rad."""
    low_x, high_x, half = _ends(extent)
    friction, angle = rng.uniform(0.4, 0.8), _SLOPE_RAD * level
    rise = float(np.tan(angle))
    corners = np.array([(x, y, rise * x) for x, y in _around(low_x, high_x, -half, half)])
    return Terrain(
        patches=(surface_patch(corners, friction),),
        footing=(True,),
        rise=rise,
        figures={"angle_rad": angle, "friction": friction},
    )


def _walls(level: float, rng: np.random.Generator, extent: Array = SCENE) -> Terrain:
    """Distance of two walls: 0.56 + 0.5 · level m."""
    low_x, high_x, _ = _ends(extent)
    friction, shares = rng.uniform(0.6, 1.0), rng.uniform(0.45, 0.55)
    apart = _WALLS_M[0] + (_WALLS_M[1] - _WALLS_M[0]) * level
    patches = []
    for y, inward in ((shares * apart, -1.0), ((shares - 1.0) * apart, 1.0)):
        corners = np.array([(x, y, z) for x, z in _around(low_x, high_x, -0.6, 1.2)])
        patches.append(
            surface_patch(
                corners, friction, towards_m=corners.mean(axis=0) + np.array([0.0, inward, 0.0])
            )
        )
    figures = {"apart_m": apart, "middle_m": (shares - 0.5) * apart, "friction": friction}
    return Terrain(patches=tuple(patches), footing=(True, True), rise=None, figures=figures)


_HALF_WIDTH_M = float(WIDE[1, 0])
LEVEL_M = 0.6
"""Smooth terrains are level within this distance of the origin, so that a robot can stand there
[m]."""


def _rough(difficulty: float, rng: np.random.Generator) -> Shape:
    """Deviation of noise of 0.5 m wavelength: 0.08 · level m."""
    return _noise(0.08 * difficulty, 0.18, rng)


def _waves(difficulty: float, rng: np.random.Generator) -> Shape:
    """Steepness of five wave trains: up to tan(25°) · level each.

    Their directions are random, they are .8–2.4 m long.
    """
    turns, phases = rng.uniform(0.0, 2.0 * np.pi, (2, 5))
    k = 2.0 * np.pi / rng.uniform(0.8, 2.4, 5)
    rise = np.tan(np.deg2rad(25.0)) * difficulty * rng.uniform(0.2, 0.6, 5) / k
    along = np.stack([np.cos(turns), np.sin(turns)])
    return lambda x, y: np.asarray(np.sin(k * (np.stack([x, y], axis=-1) @ along) + phases) @ rise)


def _ramps(difficulty: float, rng: np.random.Generator) -> Shape:
    """Slope of three planes: up to tan(35°) · level.

    They meet in rounded ridges and valleys.
    """
    turns, levels = rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(0.8, 2.0, 3)
    slopes = (
        np.tan(np.deg2rad(35.0))
        * difficulty
        * rng.uniform(0.4, 1.0, 3)
        * rng.choice([-1.0, 1.0], 3)
    )

    def shape(x: Array, y: Array) -> Array:
        height = np.zeros_like(x)
        for turn, level, slope in zip(turns, levels, slopes, strict=True):
            beyond = np.cos(turn) * x + np.sin(turn) * y - level
            height += 0.5 * slope * (beyond + np.sqrt(beyond**2 + 0.15**2))
        return height

    return shape


def _noise(deviation_m: float, length_m: float, rng: np.random.Generator) -> Shape:
    """White noise under a Gaussian of this length, as a function."""
    from scipy.ndimage import gaussian_filter  # slow to import

    from .heightfield import HeightField  # splines are slow to import

    spacing = 0.05
    count = 2 * int(_HALF_WIDTH_M / spacing) + 1
    noise = gaussian_filter(rng.standard_normal((count, count)), length_m / spacing)
    field = HeightField.from_array(deviation_m / float(noise.std()) * noise, spacing)
    return lambda x, y: field.height(np.stack([x, y], axis=-1))


_STONES, _FAR = 15, 41
"""Stones and blocks along each axis of a scene and of all the ground, before those outside are left
out."""
_RISER_M = 0.5
_STONE_M, _APART_M, _STONE_TOP_M = (0.25, 0.05), 0.60, 0.05
_GAP_M = 1.0
_BEAM_M, _BEAM_OFFSET_M = (1.2, 0.04), 0.3
_BLOCK_M, _RUBBLE_M, _RUBBLE_RAD = 0.4, 0.6, 0.8
_SLOPE_RAD = 0.8
_WALLS_M = (0.56, 1.06)
TERRAIN_FAMILIES: Registry[_Draw] = Registry(
    "family",
    "stancekit.families",
    {
        "stairs": _stairs,
        "stones": _stones,
        "gaps": _gaps,
        "beams": _beams,
        "rubble": _rubble,
        "slopes": _slopes,
        "walls": _walls,
        "rough": _rough,
        "waves": _waves,
        "ramps": _ramps,
    },
    expected="a function of a level and a generator",
    accepts=lambda it: takes(it, 2),
)
"""By name; docstrings say what their level is.

Friction: 0.4–0.8 on slopes, 0.4–0.7 on rubble, 0.6–1.0 on walls, 0.6–0.9 on others."""
SMOOTH = ("rough", "waves", "ramps")
"""The families of heights."""
NOT_WALKED = ("walls",)
"""Those without a height at every place, so that no walks go over them."""


def family_terrain(family: str, level: float, seed: int, extent: Array = SCENE) -> Terrain:
    """The ground of a family's name or FILE.py:NAME, a level in [0, 1] and a seed.

    Raises InvalidInput.

    >>> family_terrain("gaps", 0.5, seed=0).figures["gap_m"]
    0.5

    Arguments:
        extent: how far patches go; heights go over all of ``WIDE``.
    """
    rng, name = checked_draw(family, level, seed), f"{family}:{level:g}:{seed}"
    ground = _drawn(family, level, rng, extent)
    if not isinstance(ground, Terrain):
        return _of_shape(ground, name, extent, rng)
    return replace(
        ground, laid=lambda: _heights(family, level, checked_draw(family, level, seed), name)
    )


def random_heights(
    family: str, level: float, rng: np.random.Generator, name: str = ""
) -> HeightField:
    """The heights of a family's ground over all of ``WIDE``, drawn with a generator.

    Raises InvalidInput, also for a family that has no height at a place.

    Arguments:
        name: of the field.
    """
    checked(level, "terrain: level", least=0.0, most=1.0)
    heights = _heights(family, level, rng, name or f"{family}:{level:g}")
    if heights is None:
        raise InvalidInput(
            f"terrain: expected ground to walk on, got {family}, whose surfaces are upright and "
            "have no height at a "
            "place; stancekit plan climbs there"
        )
    return heights


def drawn_surface(family: str, level: float, seed: int) -> tuple[Patch, ...] | None:
    """All patches of a family's ground over ``WIDE``; None for a family of heights.

    Raises InvalidInput.
    """
    ground = _drawn(family, level, checked_draw(family, level, seed), WIDE)
    return ground.patches if isinstance(ground, Terrain) else None


def checked_draw(family: str, level: float, seed: int) -> np.random.Generator:
    """The generator of a draw.

    Raises InvalidInput for a level outside [0, 1] and for what is no seed.
    """
    TERRAIN_FAMILIES.get(family)
    checked(level, "level", least=0.0, most=1.0)
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        raise InvalidInput(f"seed: expected a whole number of 0 or more, got {seed!r}")
    return np.random.Generator(np.random.PCG64(seed))


def drawn_name(name: str) -> bool:
    """Tell whether a name is that of a draw, as ``stairs:0.6``, ``stairs:0.6:7`` or
    ``mine.py:steps:0.6:7``.
    """
    family, numbers = split_name(name)
    return bool(numbers) and (".py:" in family or family in TERRAIN_FAMILIES.names())


def read_draw(name: str, where: str) -> tuple[str, float, int]:
    """Family, level and seed of a name, seed 0 where there is none.

    Raises InvalidInput for text where a number is expected.

    Arguments:
        where: beginning of the message.
    """
    family, numbers = split_name(name)
    try:
        level, seed = float(numbers[0]), int(numbers[1]) if len(numbers) == 2 else 0
        if len(numbers) > 2:
            raise ValueError
    except (ValueError, IndexError):
        raise InvalidInput(
            f"{where}: expected {family}:LEVEL:SEED as in {family}:0.5:7, got {name!r}"
        ) from None
    return family, level, seed


def _goes_on(draw: _Draw) -> bool:
    """Tell whether a family's polygons go on as far as they are asked to."""
    try:
        return "extent" in signature(draw).parameters
    except ValueError:  # of a function that does not say what it takes
        return False


def _drawn(family: str, level: float, rng: np.random.Generator, extent: Array) -> Terrain | Shape:
    """Ground that a family draws.

    Raises InvalidInput where that is no ground.
    """
    draw = TERRAIN_FAMILIES.get(family)
    ground = draw(level, rng, extent=extent) if _goes_on(draw) else draw(level, rng)
    if (
        isinstance(ground, list | tuple)
        and ground
        and all(isinstance(patch, Patch) for patch in ground)
    ):
        return _standing(list(ground), {})
    if isinstance(ground, Terrain) or (callable(ground) and takes(ground, 2)):
        return ground
    raise InvalidInput(
        f"family {family}: expected a Terrain, a list of patches or a function of x and y, got "
        f"{shown(ground)}"
    )


def _heights(family: str, level: float, rng: np.random.Generator, name: str) -> HeightField | None:
    """The heights of a draw over ``WIDE``, or over its patches where they do not go on; None for
    upright surfaces.
    """
    from .heightfield import rounded  # splines are slow to import

    ground = _drawn(family, level, rng, WIDE)
    if not isinstance(ground, Terrain):
        return levelled(ground, name)
    if ground.laid is not None:
        return ground.laid()
    if not _goes_on(TERRAIN_FAMILIES.get(family)):
        return rounded(ground.patches, name=name)
    low, high = WIDE[:, :2]
    return rounded(ground.patches, low, high, name=name)


def _of_shape(shape: Shape, name: str, extent: Array, rng: np.random.Generator) -> Terrain:
    """A terrain of heights that is level around the origin.

    Its courses begin 2 ``LEVEL_M`` ahead, where it is no longer level, and its patches are those
    about that place.
    """
    field, friction = levelled(shape, name), float(rng.uniform(0.6, 0.9))
    begin = np.array([2.0 * LEVEL_M, 0.0, 0.0])
    return of_heights(field, friction, begin, extent + begin if extent is SCENE else extent)


def of_heights(field: HeightField, friction: float, begin_m: Array, box_m: Array) -> Terrain:
    """A ground of heights, with the planar pieces in a box, shape (2, 3) [m], that a foot may be
    put on.

    A course begins over a place, shape (3,) [m], in the plane that is nearest to the heights about
    its way.
    """
    from .elevation import ElevationMap
    from .footholds import FootholdLimits, footholds_of

    whole = ElevationMap.of_field(field)
    about = whole.cropped(np.array([(-0.4, -0.4, -np.inf), (0.65, 0.4, np.inf)]) + begin_m)
    x, y = np.meshgrid(about.x_m - begin_m[0], about.y_m - begin_m[1], indexing="ij")
    terms = np.column_stack([np.ones(x.size), x.ravel(), y.ravel()])
    plane, *_ = np.linalg.lstsq(terms, about.heights_m.ravel(), rcond=None)
    off = about.heights_m.ravel() - terms @ plane
    limits = FootholdLimits()
    footholds = footholds_of(whole.cropped(box_m), limits, friction, none=True)
    return Terrain(
        patches=footholds.surfaces,
        footing=(False,) * len(footholds.surfaces),
        footholds=tuple(piece.patch for piece in footholds.pieces),
        inset_m=limits.inset_m,
        rise=float(plane[1]),
        figures={
            "deviation_m": float(np.sqrt(np.mean(off**2))),
            "rise": float(plane[1]),
            "friction": friction,
        },
        begin_m=(float(begin_m[0]), float(begin_m[1]), float(plane[0])),
        laid=lambda: field,
    )


def _standing(patches: list[Patch], figures: dict[str, float]) -> Terrain:
    """Level on the whole, and good to stand on wherever there is something."""
    return Terrain(
        patches=tuple(patches), footing=(True,) * len(patches), rise=0.0, figures=figures
    )


def _around(
    low_x: float, high_x: float, low_y: float, high_y: float
) -> tuple[tuple[float, float], ...]:
    return (low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)


def _level(
    low_x: float, high_x: float, low_y: float, high_y: float, height: float, friction: float
) -> Patch:
    return surface_patch(
        np.array([(x, y, height) for x, y in _around(low_x, high_x, low_y, high_y)]), friction
    )


def _riser(x: float, low: float, high: float, friction: float, half: float) -> Patch:
    corners = np.array([(x, y, z) for y, z in _around(-half, half, low, high)])
    return surface_patch(
        corners, friction, towards_m=corners.mean(axis=0) - np.array([1.0, 0.0, 0.0])
    )


def _ends(extent: Array) -> tuple[float, float, float]:
    """First and last x, and the width to each side [m]."""
    return float(extent[0, 0]), float(extent[1, 0]), float(extent[1, 1])


def _outside(low: Array, high: Array, extent: Array) -> bool:
    (x0, y0, _), (x1, y1, _) = extent
    return bool(np.any(high < (x0, y0)) or np.any(low > (x1, y1)))


def _within(far: Array, near: Array) -> Array:
    """Numbers of all the ground, those of a scene in the middle."""
    first = (len(far) - len(near)) // 2
    far[first : first + len(near), first : first + len(near)] = near
    return far


def levelled(shape: Shape, name: str) -> HeightField:
    """A shape as a height field over all of ``WIDE``, level about the origin.

    Raises InvalidInput for one that is finer than its spline can hold.
    """
    from .heightfield import HeightField  # splines are slow to import

    def height(x: Array, y: Array) -> Array:
        share = np.clip((np.hypot(x, y) - LEVEL_M) / LEVEL_M, 0.0, 1.0)
        return np.asarray(share**3 * (10.0 + share * (6.0 * share - 15.0)) * shape(x, y))

    return HeightField.from_function(height, _HALF_WIDTH_M, 0.05, name=name, tolerance_m=0.01)
