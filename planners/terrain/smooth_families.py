"""Families of terrain that are smooth: heights h(x, y) of a level in [0, 1] and a generator, level
about the origin.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from ..files.arrays import Array
from .families import WIDE, Family, Shape
from .heightfield import HeightField

_HALF_WIDTH_M = float(WIDE[1, 0])
LEVEL_M = 0.6
"""Smooth terrains are level within this distance of the origin, so that a robot can stand there
[m]."""


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


def _ramps(difficulty: float, rng: np.random.Generator) -> Shape:
    """Planes up to 35° steep that meet in rounded ridges and valleys."""
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
    spacing = 0.05
    count = 2 * int(_HALF_WIDTH_M / spacing) + 1
    noise = gaussian_filter(rng.standard_normal((count, count)), length_m / spacing)
    field = HeightField.from_array(deviation_m / float(noise.std()) * noise, spacing)
    return lambda x, y: field.height(np.stack([x, y], axis=-1))


ROUGH = Family(quantity="deviation of noise of 0.5 m wavelength: 0.08 · level m", draw=_rough)
WAVES = Family(quantity="steepness of five wave trains: up to tan(25°) · level each", draw=_waves)
RAMPS = Family(quantity="slope of three planes: up to tan(35°) · level", draw=_ramps)


def levelled(shape: Shape, name: str) -> HeightField:
    """A shape as a height field over all of ``WIDE``, level about the origin.

    Raises InvalidInput for one that is finer than its spline can hold.
    """

    def height(x: Array, y: Array) -> Array:
        share = np.clip((np.hypot(x, y) - LEVEL_M) / LEVEL_M, 0.0, 1.0)
        return np.asarray(share**3 * (10.0 + share * (6.0 * share - 15.0)) * shape(x, y))

    return HeightField.from_function(height, _HALF_WIDTH_M, 0.05, name=name, tolerance_m=0.01)
