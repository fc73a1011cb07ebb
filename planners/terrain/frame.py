"""A place and a heading of one world in another one."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array

_NUMBER = r"(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
_PLACE = re.compile(rf"\({_NUMBER}, {_NUMBER}\)")


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A frame with z upward in the world: where it lies, and which way its x points.

    Arguments:
        origin_m: its origin, shape (3,) [m].
        heading_rad: from the world's x towards y [rad].
    """

    origin_m: Array
    heading_rad: float = 0.0

    @property
    def rotation(self) -> Array:
        """R_WF, shape (3, 3)."""
        if self.heading_rad == 0.0:
            return np.eye(3)
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @property
    def inverse(self) -> Frame:
        """The world in this frame."""
        back = Frame(origin_m=np.zeros(3), heading_rad=-self.heading_rad)
        return Frame(origin_m=-back.vectors(self.origin_m), heading_rad=-self.heading_rad)

    def vectors(self, vectors: Array) -> Array:
        """Vectors of this frame in the world, shape (…, 3)."""
        return np.asarray(vectors @ self.rotation.T)

    def places(self, places_m: Array) -> Array:
        """Places of this frame in the world, shape (…, 3) [m]."""
        return np.asarray(self.vectors(places_m) + self.origin_m)

    def in_world(self, said: str) -> str:
        """A sentence about this frame with its places, as "(1, -0.2)", those of the world."""

        def there(found: re.Match[str]) -> str:
            x, y, _ = np.round(self.places(np.array([float(found[1]), float(found[2]), 0.0])), 3)
            return f"({x + 0.0:.10g}, {y + 0.0:.10g})"

        return _PLACE.sub(there, said)
