"""Rungs: round bars, on which a foot stands on a line.

The surface of a rung turns away to both sides of its highest line, so that a toe beside the line,
by as much as feet are off, finds a normal that leans to that side. What both such normals bear is a
cone about the upright one whose angle is smaller by the turn: the foothold is a strip as wide as
that, with the friction of both sides,

    tan(arctan μ − turn),   turn = arcsin(half width / radius).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..files.arrays import Array, cross
from .patch import Patch
from .polygon import shear_of

HALF_WIDTH_M, SHARE = 6e-4, 0.05
"""Half the width of a rung's line: this, or this share of the radius where that is more [m]."""
SIDES = np.array([0.0, 0.6, 1.2, 1.8])
"""Angles from the line at which the flat sides of a rung that limbs keep out of begin and end
[rad]."""


def held_on_both_sides(friction: float, turn_rad: float) -> float:
    """The friction that holds on both sides of a rung's line, of which the surface turns by so much
    to each side.
    """
    return float(np.tan(max(np.arctan(friction) - turn_rad, 0.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Rung:
    """A round bar.

    Arguments:
        axis: along it, shape (3,).
        upright: normal of its highest line, across the axis, shape (3,).
        middle_m: a point of that line, shape (3,) [m].
        radius_m: of its surface [m].
    """

    axis: Array
    upright: Array
    middle_m: Array
    radius_m: float

    @classmethod
    def between(cls, ends_m: Array, radius_m: float) -> Rung:
        """One whose axis goes from one end to the other, shape (2, 3) [m]."""
        axis = (ends_m[1] - ends_m[0]) / np.linalg.norm(ends_m[1] - ends_m[0])
        upright = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
        upright /= np.linalg.norm(upright)
        return cls(
            axis=axis,
            upright=upright,
            middle_m=ends_m.mean(axis=0) + radius_m * upright,
            radius_m=radius_m,
        )

    @property
    def half_width_m(self) -> float:
        """Half the width of the line that a toe may be on [m]."""
        return max(HALF_WIDTH_M, SHARE * self.radius_m)

    @property
    def turn_rad(self) -> float:
        """Angle by which the surface turns from the middle of the line to its border."""
        return float(np.arcsin(min(self.half_width_m / self.radius_m, 1.0)))

    def line(self, low_m: float, high_m: float, friction: float) -> Patch:
        """The strip that feet may stand on, from one place along the axis to another, counted from
        the middle.

        Arguments:
            friction: of the rung's surface; the strip has that of both sides.
        """
        return self._patch(
            0.0, self.half_width_m, low_m, high_m, held_on_both_sides(friction, self.turn_rad)
        )

    def sides(self, low_m: float, high_m: float, friction: float) -> tuple[Patch, ...]:
        """The upper half and some more of the surface as flat patches, which limbs keep out of."""
        patches = []
        for begin, end in pairwise(SIDES):
            middle, half = 0.5 * (begin + end), self.radius_m * np.sin(0.5 * (end - begin))
            patches += [
                self._patch(sign * middle, half, low_m, high_m, friction) for sign in (-1.0, 1.0)
            ]
        return tuple(patches)

    def _patch(
        self, angle: float, half_m: float, low_m: float, high_m: float, friction: float
    ) -> Patch:
        """A rectangle along the axis that touches the surface from within at its long borders, at
        an angle about it.
        """
        across = cross(self.upright, self.axis)
        normal = np.cos(angle) * self.upright + np.sin(angle) * across
        aside = cross(normal, self.axis)
        inner = self.radius_m if angle == 0.0 else float(np.sqrt(self.radius_m**2 - half_m**2))
        centre = self.middle_m - self.radius_m * self.upright + inner * normal
        corners = [
            centre + along * self.axis + way * half_m * aside
            for along, way in ((low_m, -1.0), (high_m, -1.0), (high_m, 1.0), (low_m, 1.0))
        ]
        return Patch(
            vertices_m=np.array(corners),
            normal=normal,
            shear_reference=shear_of(normal),
            friction=friction,
        )
