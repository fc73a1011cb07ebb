"""A patch: a flat convex piece of terrain on which one toe may stand, with its friction and its contact frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, checked, cross, frozen, gathered
from ..outcome import InvalidInput

FLATNESS = 2e-3
"""Vertices may leave the plane by this share of the patch's diameter: room for rounded files, not for a bent patch."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch:
    """A convex planar polygon with a Coulomb friction coefficient (paper E §II, Fig. 2).

    vertices_m: v_u in the world, in order around the border, shape (U, 3) with U ≥ 3 [m].
    normal: unit normal n, out of the terrain towards the robot, shape (3,).
    shear_reference: direction whose projection on the patch is the second shear axis z, shape (3,); not along n.
    friction: μ ≥ 0.
    Raises InvalidInput for a bent, non-convex or degenerate polygon and for a shear reference along the normal.
    """

    vertices_m: Array
    normal: Array
    shear_reference: Array
    friction: float

    def __post_init__(self) -> None:
        put = object.__setattr__
        gathered(
            lambda: put(self, "vertices_m", frozen(self.vertices_m, (None, 3), "vertices_m")),
            lambda: put(self, "normal", _unit(self.normal, "normal")),
            lambda: put(self, "shear_reference", _unit(self.shear_reference, "shear_reference", any_length=True)),
            lambda: put(self, "friction", checked(self.friction, "friction", least=0.0)),
        )
        if len(self.vertices_m) < 3:
            raise InvalidInput(f"vertices_m: expected 3 or more vertices, got {len(self.vertices_m)}")
        if abs(self.normal @ self.shear_reference) > 1.0 - 5e-7:
            raise InvalidInput(
                f"shear_reference: expected a direction not along the normal, got {self.shear_reference.tolist()}"
            )
        _check_polygon(self.vertices_m, self.normal, self.shear_reference)

    @cached_property
    def frame(self) -> Array:
        """R_WC, columns n, y = z × n, z: the axes of f_n, f_y, f_z (eq. 3), shape (3, 3)."""
        axes = _frame(self.normal, self.shear_reference)
        axes.setflags(write=False)
        return axes

    def with_friction(self, friction: float) -> Patch:
        """The same surface with another friction; its geometry is not looked at again. Raises InvalidInput."""
        new = object.__new__(Patch)
        new.__dict__.update(self.__dict__)
        object.__setattr__(new, "friction", checked(friction, "friction", least=0.0))
        return new

    @property
    def centre_m(self) -> Array:
        """Mean of the vertices, shape (3,) [m]."""
        return np.asarray(self.vertices_m.mean(axis=0))


def _unit(value: Array, where: str, *, any_length: bool = False) -> Array:
    vector = frozen(value, (3,), where)
    length = float(np.linalg.norm(vector))
    if length < 1e-9 or not (any_length or abs(length - 1.0) < 1e-3):
        raise InvalidInput(f"{where}: expected a {'non-zero' if any_length else 'unit'} vector, got length {length:g}")
    return vector if abs(length - 1.0) < 1e-12 else frozen(vector / length, (3,), where)


def _frame(normal: Array, shear_reference: Array) -> Array:
    z = shear_reference - (shear_reference @ normal) * normal
    z = z / np.sqrt(z @ z)
    return np.array([normal, cross(z, normal), z]).T


def _check_polygon(vertices: Array, normal: Array, shear: Array) -> None:
    """Raise InvalidInput unless the vertices are in order around a flat convex polygon with an area."""
    local = (vertices - vertices[0]) @ _frame(normal, shear)
    height, y, z = local[:, 0] - local[:, 0].mean(), local[:, 1], local[:, 2]
    diameter = float(np.sqrt(np.max((y[:, None] - y) ** 2 + (z[:, None] - z) ** 2)))
    off_plane = float(np.max(np.abs(height)))
    if diameter < 1e-4:
        raise InvalidInput(f"vertices_m: expected a patch with an area, got one of diameter {diameter:g} m")
    if off_plane > FLATNESS * diameter:
        raise InvalidInput(
            f"vertices_m: expected a plane with the given normal, got vertices {1e3 * off_plane:.3g} mm off it"
        )
    y, z = _without_doubles(y, z, diameter)
    following = [*range(1, len(y)), 0]
    area = 0.5 * float(np.sum(y * z[following] - z * y[following]))
    if abs(area) < 1e-4 * diameter**2:
        raise InvalidInput(f"vertices_m: expected a patch with an area, got {abs(area):.3g} m² on {diameter:.3g} m")
    dy, dz = y[following] - y, z[following] - z
    turns = dy * dz[following] - dz * dy[following]  # of each corner, positive to the left
    turned = np.arctan2(turns, dy * dy[following] + dz * dz[following]).sum()
    if np.min(turns * np.sign(area)) < -1e-6 * diameter**2 or round(abs(float(turned)) / (2.0 * np.pi)) != 1:
        raise InvalidInput("vertices_m: expected a convex polygon, its vertices in order around the border")


def _without_doubles(y: Array, z: Array, diameter: float) -> tuple[Array, Array]:
    """The border without corners that are given twice in a row."""
    new = np.hypot(y - np.roll(y, 1), z - np.roll(z, 1)) > 1e-9 * diameter
    return (y, z) if new.all() else (y[new], z[new])
