"""Grounds that are nobody's reference, written to a folder as files that ``stancekit gait`` takes.

    python benchmarks/_grounds.py --folder FOLDER [--seed 0]

knolls.npy: a random smooth map of .3 m wavelength and more, a grid of 5 cm, up to 25° steep.
ramps.stl: a mesh of planes ahead of level ground: up a ramp of 17°, steeper to the left, over a
crest that leans by 3° and down again. ``mound`` is a mesa as Pan et al.'s hill, lower and less
steep: 24° at its edge in place of 60°, so that feet that only push walk over it;
``benchmarks/_grounds.py:mound`` is its name as a terrain. A walk of the benchmark begins in the
middle of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from _bench import Options, launch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
HALF_M, SPACING_M = 3.0, 0.05
WAVE_M = 0.14
"""Deviation of the Gaussian that smooths ``knolls``."""
STEEPEST = float(np.tan(np.deg2rad(25.0)))


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Where to."""

    folder: Path


def main(arguments: Arguments) -> None:
    """Write both."""
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(arguments.seed)
    np.save(arguments.folder / "knolls.npy", knolls(rng))
    (arguments.folder / "ramps.stl").write_text(stl(ramps()), encoding="ascii")


def mound(x: Array, y: Array) -> Array:
    """h(x, y) of a mesa .5 m high, whose edge is 1 m from the origin."""
    gradient = float(np.tan(np.deg2rad(24.0)))
    return np.asarray(0.25 * (1.0 - np.tanh(4.0 * gradient * (np.hypot(x, y) - 1.0))))


def knolls(rng: np.random.Generator) -> Array:
    """Heights on a grid, shape (K, K) [m]; level at the origin, as steep as ``STEEPEST``
    somewhere.
    """
    axis = np.arange(-HALF_M, HALF_M + 1e-9, SPACING_M)
    heights = gaussian_filter(rng.standard_normal((len(axis), len(axis))), WAVE_M / SPACING_M)
    far = np.hypot(axis[:, None], axis[None])
    heights *= np.clip(far - 0.4, 0.0, 0.5) / 0.5
    slopes = np.gradient(heights, SPACING_M)
    return np.asarray(STEEPEST / np.hypot(*slopes).max() * heights)


def ramps() -> list[Array]:
    """Triangles between lines along y, shape (3, 3) each [m]; right of the origin every line is
    level.
    """
    ahead = np.array([-3.0, -0.5, 0.5, 0.9, 1.2, 3.0])
    middle = np.array([0.0, 0.0, 0.0, 0.12, 0.12, -0.3])
    left = np.array([0.0, 0.0, 0.0, 0.24, 0.30, -0.1])
    rows = zip(ahead, middle, left, strict=True)
    lines = [np.array([[x, -3.0, h], [x, 0.0, h], [x, 3.0, top]]) for x, h, top in rows]
    found = list[Array]()
    for before, after in pairwise(lines):
        for k in range(2):
            a, b, c, d = before[k], after[k], after[k + 1], before[k + 1]
            found += [np.array([a, b, c]), np.array([a, c, d])]
    return found


def stl(triangles: list[Array]) -> str:
    """As an ASCII STL file."""
    lines = ["solid ramps"]
    for triangle in triangles:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid ramps", ""])


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
