"""Family of terrain, and the boxes that key frames and walks see of its grounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array
from .patch import Patch
from .terrain import Terrain

SCENE = np.array([(-0.8, -0.8, -np.inf), (1.1, 0.8, np.inf)])
"""All that a robot about (0, 0, 0.2) that heads along x for 0.3 m may touch with legs of up to half
a metre: a box."""
WIDE = np.array([(-4.0, -4.0, -np.inf), (4.0, 4.0, np.inf)])
"""All that walks go over: a box."""
for _box in (SCENE, WIDE):
    _box.setflags(write=False)
Shape = Callable[[Array, Array], Array]
Draw = Callable[..., Terrain | Sequence[Patch] | Shape]
"""A function of a level and a generator that gives a ground: a terrain; its surfaces, where all of
it is level on the whole and to stand on; or h of x and y. Polygons go on to an ``extent``, a box as
``WIDE``, where it takes one by that name."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """A family of drawn grounds.

    Arguments:
        quantity: what the level says, by its formula.
        draw: the ground at a level.
        walked: whether it has a height at every place, so that walks can go over it.
    """

    quantity: str
    draw: Draw
    walked: bool = True
