"""Families of terrain whose difficulty is a length or an angle: stairs, stones, gaps, beams, rubble, slopes, walls.

A family is a pure function of a level in [0, 1] and a generator. The level says one physical quantity, by a formula
that is linear in it; the generator says the rest (phase, offset, friction), in draws that do not depend on the level.
So equal seeds at two levels give the same scene, easier and harder; of gaps and beams the harder one has less to stand
on and nothing else is different, and what cannot be crossed at one level cannot be crossed at a higher one.

A scene is what a robot about (0, 0, 0.2) that heads along x for 0.3 m could touch with legs of up to half a metre.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import getdoc

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked
from ..files.validation import shown
from ..plugins import Registry, takes
from .patch import Patch
from .polygon import STEEP, half_planes, surface_patch

LOW_X_M, HIGH_X_M, HALF_WIDTH_M = -0.8, 1.1, 0.8
"""The extent of every scene [m]."""
VOID_M = -0.6
"""Height of what is between stones and in gaps, where a height is needed [m]."""
EDGE_M = 1e-9
"""Neighbouring surfaces have no seam between them [m]."""
LEAST_M = 1e-3
"""A riser lower than this is none [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FamilyTerrain:
    """A drawn scene.

    patches: all surfaces; footing: whether toes may stand on each. rise: of the ground's mean per metre along x; None
    between walls, where the way is up. figures: what was drawn, by name, in SI units.
    """

    patches: tuple[Patch, ...]
    footing: tuple[bool, ...]
    rise: float | None
    figures: dict[str, float]

    def heights(self, spacing_m: float = 0.02) -> tuple[Array, Array, Array]:
        """The highest surface that faces up, or VOID_M: x, shape (n,), y, (m,), and heights, (n, m) [m].

        Raises InvalidInput for walls, which are no height field.
        """
        if self.rise is None:
            raise InvalidInput("heights: expected a family with ground, got walls, which are no height field")
        step = checked(spacing_m, "spacing_m", least=0.002, most=0.2)
        x, y = np.arange(LOW_X_M, HIGH_X_M + 1e-9, step), np.arange(-HALF_WIDTH_M, HALF_WIDTH_M + 1e-9, step)
        places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        heights = np.full((len(x), len(y)), -np.inf)
        for patch in self.patches:
            if patch.normal[2] < STEEP:
                continue
            normals, offsets = half_planes(patch.vertices_m[:, :2])
            within = np.all(places @ normals.T <= offsets + EDGE_M, axis=-1)
            lifted = patch.centre_m[2] - (places - patch.centre_m[:2]) @ patch.normal[:2] / patch.normal[2]
            heights = np.where(within, np.maximum(heights, lifted), heights)
        return x, y, np.where(np.isfinite(heights), heights, VOID_M)


Draw = Callable[[float, np.random.Generator], FamilyTerrain | Sequence[Patch]]
"""Of a level and a generator: a scene, or where all of it is level on the whole and to stand on, its surfaces."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """quantity: what the level says, by its formula. draw: the scene at a level."""

    quantity: str
    draw: Draw


def _stairs(level: float, rng: np.random.Generator) -> FamilyTerrain:
    run, phase, friction = rng.uniform(0.24, 0.32), rng.uniform(0.0, 1.0), rng.uniform(0.6, 0.9)
    riser = RISER_M * level
    patches, footing = list[Patch](), list[bool]()
    first = int(np.floor(LOW_X_M / run - phase))
    for step in range(first, int(np.ceil(HIGH_X_M / run - phase))):
        x, height = (step + phase) * run, (step + 0.5 + phase) * riser  # the mean goes through the origin
        if riser > LEAST_M and step > first:
            patches.append(_riser(x, height - riser, height, friction))
            footing.append(False)
        patches.append(_level(x, x + run, -HALF_WIDTH_M, HALF_WIDTH_M, height, friction))
        footing.append(True)
    figures = {"riser_m": riser, "run_m": run, "friction": friction}
    return FamilyTerrain(patches=tuple(patches), footing=tuple(footing), rise=riser / run, figures=figures)


def _stones(level: float, rng: np.random.Generator) -> FamilyTerrain:
    phase, friction = rng.uniform(0.0, 1.0, 2), rng.uniform(0.6, 0.9)
    shifts, tops = rng.uniform(-0.5, 0.5, (STONES, STONES, 2)), rng.uniform(-1.0, 1.0, (STONES, STONES))
    side, apart = STONE_M[0] + (STONE_M[1] - STONE_M[0]) * level, APART_M * level
    pitch = side + apart
    patches = []
    for i, j in np.ndindex(STONES, STONES):
        middle = (np.array([i, j]) - STONES // 2 + phase) * pitch + 0.5 * apart * shifts[i, j]
        low, high = middle - 0.5 * side, middle + 0.5 * side
        if _outside(low, high):
            continue
        top = STONE_TOP_M * level * float(tops[i, j])
        patches.append(_level(low[0], high[0], low[1], high[1], top, friction))
    figures = {"side_m": side, "apart_m": apart, "share_of_area": (side / pitch) ** 2, "friction": friction}
    return _standing(patches, figures)


def _gaps(level: float, rng: np.random.Generator) -> FamilyTerrain:
    middle, friction = rng.uniform(0.0, 0.35), rng.uniform(0.6, 0.9)
    gap = GAP_M * level
    ends = (middle - 0.5 * gap, middle + 0.5 * gap)
    spans = ((LOW_X_M, ends[0]), (ends[1], HIGH_X_M))
    patches = [_level(low, high, -HALF_WIDTH_M, HALF_WIDTH_M, 0.0, friction) for low, high in spans]
    return _standing(patches, {"gap_m": gap, "middle_m": middle, "friction": friction})


def _beams(level: float, rng: np.random.Generator) -> FamilyTerrain:
    offset, friction = rng.uniform(-BEAM_OFFSET_M, BEAM_OFFSET_M), rng.uniform(0.6, 0.9)
    width = BEAM_M[0] + (BEAM_M[1] - BEAM_M[0]) * level
    patch = _level(LOW_X_M, HIGH_X_M, offset - 0.5 * width, offset + 0.5 * width, 0.0, friction)
    return _standing([patch], {"width_m": width, "offset_m": offset, "friction": friction})


def _rubble(level: float, rng: np.random.Generator) -> FamilyTerrain:
    phase, friction = rng.uniform(0.0, 1.0, 2), rng.uniform(0.4, 0.7)
    heights, leans = rng.standard_normal((STONES, STONES)), rng.uniform(-1.0, 1.0, (STONES, STONES, 2))
    deviation, lean = RUBBLE_M * level, RUBBLE_RAD * level
    patches = []
    for i, j in np.ndindex(STONES, STONES):
        low = (np.array([i, j]) - STONES // 2 + phase - 0.5) * BLOCK_M
        high = low + BLOCK_M
        if _outside(low, high):
            continue
        slope = np.tan(lean * leans[i, j])
        corners = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])])
        z = deviation * heights[i, j] + (corners - 0.5 * (low + high)) @ slope
        patches.append(surface_patch(np.column_stack([corners, z]), friction))
    return _standing(patches, {"deviation_m": deviation, "lean_rad": lean, "friction": friction})


def _slopes(level: float, rng: np.random.Generator) -> FamilyTerrain:
    friction, angle = rng.uniform(0.4, 0.8), SLOPE_RAD * level
    rise = float(np.tan(angle))
    corners = np.array([(x, y, rise * x) for x, y in _around(LOW_X_M, HIGH_X_M, -HALF_WIDTH_M, HALF_WIDTH_M)])
    return FamilyTerrain(
        patches=(surface_patch(corners, friction),), footing=(True,), rise=rise,
        figures={"angle_rad": angle, "friction": friction},
    )  # fmt: skip


def _walls(level: float, rng: np.random.Generator) -> FamilyTerrain:
    friction, shares = rng.uniform(0.6, 1.0), rng.uniform(0.45, 0.55)
    apart = WALLS_M[0] + (WALLS_M[1] - WALLS_M[0]) * level
    patches = []
    for y, inward in ((shares * apart, -1.0), ((shares - 1.0) * apart, 1.0)):
        corners = np.array([(x, y, z) for x, z in _around(LOW_X_M, HIGH_X_M, -0.6, 1.2)])
        patches.append(surface_patch(corners, friction, towards_m=corners.mean(axis=0) + np.array([0.0, inward, 0.0])))
    figures = {"apart_m": apart, "middle_m": (shares - 0.5) * apart, "friction": friction}
    return FamilyTerrain(patches=tuple(patches), footing=(True, True), rise=None, figures=figures)


STONES = 15
"""Stones and blocks along each axis, before those outside of the scene are left out."""
RISER_M = 0.5
STONE_M, APART_M, STONE_TOP_M = (0.25, 0.05), 0.60, 0.05
GAP_M = 1.0
BEAM_M, BEAM_OFFSET_M = (1.2, 0.04), 0.3
BLOCK_M, RUBBLE_M, RUBBLE_RAD = 0.4, 0.6, 0.8
SLOPE_RAD = 0.8
WALLS_M = (0.56, 1.06)
TERRAIN_FAMILIES: Registry[Family | Draw] = Registry(
    "family", "stancekit.families",
    {
        "stairs": Family(quantity="height of a riser: 0.5 · level m", draw=_stairs),
        "stones": Family(
            quantity="clear distance of stones: 0.6 · level m; their side 0.25 − 0.2 · level m", draw=_stones
        ),
        "gaps": Family(quantity="width of a gap across the way: 1.0 · level m", draw=_gaps),
        "beams": Family(quantity="width of a beam along the way: 1.2 − 1.16 · level m", draw=_beams),
        "rubble": Family(quantity="deviation of blocks' heights: 0.6 · level m; leans to 0.8 · level", draw=_rubble),
        "slopes": Family(quantity="angle of a plane that is climbed: 0.8 · level rad", draw=_slopes),
        "walls": Family(quantity="distance of two walls: 0.56 + 0.5 · level m", draw=_walls),
    },
    expected="a Family, or a function of a level and a generator",
    accepts=lambda it: isinstance(it, Family) or takes(it, 2),
)  # fmt: skip
"""By name. Friction: 0.4–0.8 on slopes, 0.4–0.7 on rubble, 0.6–1.0 on walls, 0.6–0.9 on others."""


def family_terrain(family: str, level: float, seed: int) -> FamilyTerrain:
    """The scene of a family's name or FILE.py:NAME, a level in [0, 1] and a seed. Raises InvalidInput.

    >>> family_terrain("gaps", 0.5, seed=0).figures["gap_m"]
    0.5
    """
    drawn_by = terrain_family(family)
    hard = checked(level, "level", least=0.0, most=1.0)
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        raise InvalidInput(f"seed: expected a whole number of 0 or more, got {seed!r}")
    scene = drawn_by.draw(hard, np.random.Generator(np.random.PCG64(seed)))
    if isinstance(scene, list | tuple) and scene and all(isinstance(patch, Patch) for patch in scene):
        return _standing(list(scene), {})
    if not isinstance(scene, FamilyTerrain):
        raise InvalidInput(f"family {family}: expected a FamilyTerrain or a list of patches, got {shown(scene)}")
    return scene


def terrain_family(name: str) -> Family:
    """The family of a name, or of FILE.py:NAME; a plain function says what its level is in its docstring.

    Raises InvalidInput for a name that nobody has.
    """
    found = TERRAIN_FAMILIES.get(name)
    if isinstance(found, Family):
        return found
    return Family(quantity=(getdoc(found) or name).splitlines()[0], draw=found)


def _standing(patches: list[Patch], figures: dict[str, float]) -> FamilyTerrain:
    """Level on the whole, and good to stand on wherever there is something."""
    return FamilyTerrain(patches=tuple(patches), footing=(True,) * len(patches), rise=0.0, figures=figures)


def _around(low_x: float, high_x: float, low_y: float, high_y: float) -> tuple[tuple[float, float], ...]:
    return (low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)


def _level(low_x: float, high_x: float, low_y: float, high_y: float, height: float, friction: float) -> Patch:
    return surface_patch(np.array([(x, y, height) for x, y in _around(low_x, high_x, low_y, high_y)]), friction)


def _riser(x: float, low: float, high: float, friction: float) -> Patch:
    corners = np.array([(x, y, z) for y, z in _around(-HALF_WIDTH_M, HALF_WIDTH_M, low, high)])
    return surface_patch(corners, friction, towards_m=corners.mean(axis=0) - np.array([1.0, 0.0, 0.0]))


def _outside(low: Array, high: Array) -> bool:
    bounds = np.array([(LOW_X_M, HIGH_X_M), (-HALF_WIDTH_M, HALF_WIDTH_M)])
    return bool(np.any(high < bounds[:, 0]) or np.any(low > bounds[:, 1]))
