"""The ground in MuJoCo: patches as prisms that go down behind them, heights as a field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from .files import Patch, Samples
from .settings import Contact

Array = NDArray[np.float64]
FEET, LAND = 2, 1
"""Bits of what meets what: everything of the robot meets the ground, and nothing else."""
ICE = 1e-6
"""At and below this friction a contact has no rows of friction."""
SPACING_M, AROUND_M, UNDER_M = 0.0125, 0.6, 0.5
"""Of a field of heights: its spacing, how far it goes on around the walk, how deep it is [m]."""


def geometry(friction: float, contact: Contact) -> dict[str, Any]:
    """Arguments of a piece of ground whose own friction counts."""
    return {
        "contype": LAND,
        "conaffinity": FEET,
        "priority": 1,
        "condim": 3 if friction > ICE else 1,
        "friction": [max(friction, ICE), 0.0, 0.0],
        "solref": [contact.time_s, contact.damping],
        "solimp": [*contact.impedance, 0.5, 2.0],
    }


def lay_patches(
    spec: Any, patches: Sequence[Patch], thick_m: float, share: float, contact: Contact
) -> None:
    """Add prisms of patches; share: of their friction."""
    for index, patch in enumerate(patches):
        corners = np.concatenate([patch.corners_m, patch.corners_m - thick_m * patch.normal])
        spec.add_mesh(name=f"patch_{index}", uservert=corners.ravel())
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"patch_{index}",
            **geometry(share * patch.friction, contact),
        )


def lay_heights(spec: Any, surface: Surface, walk: Samples, share: float, contact: Contact) -> None:
    """Add the field of heights about a walk."""
    lines = list[Array]()
    for axis in range(2):
        places = np.concatenate([walk.com_m[:, axis], walk.feet_m[..., axis].ravel()])
        low, high = places.min() - AROUND_M, places.max() + AROUND_M
        lines.append(np.linspace(low, high, int(np.ceil((high - low) / SPACING_M)) + 1))
    x, y = lines
    heights = surface.heights(x[:, None], y[None, :])
    low, high = float(heights.min()), max(float(heights.max()), float(heights.min()) + 1e-6)
    spec.add_hfield(
        name="heights",
        nrow=len(y),
        ncol=len(x),
        size=[np.ptp(x) / 2, np.ptp(y) / 2, high - low, UNDER_M],
        userdata=((heights.T - low) / (high - low)).ravel().tolist(),
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="heights",
        pos=[float(x.mean()), float(y.mean()), low],
        **geometry(share * walk.friction, contact),
    )


STEP_M = 1e-5
"""Slopes are differences over twice as much."""


class Surface:
    """A bicubic natural spline through heights, which goes on straight beyond its grid."""

    def __init__(self, x_m: Array, y_m: Array, heights_m: Array) -> None:
        self._x, self._y = x_m, y_m
        along = CubicSpline(y_m, heights_m, axis=1, bc_type="natural")
        self._pieces = along.c  # (4, Y − 1, X)
        self._across = [
            CubicSpline(x_m, power, axis=1, bc_type="natural") for power in self._pieces
        ]

    def heights(self, x_m: Array, y_m: Array) -> Array:
        """Heights at places of one shape, or that broadcast to one [m]."""
        x, y = np.broadcast_arrays(x_m, y_m)
        inside_x, inside_y = np.clip(x, *self._x[[0, -1]]), np.clip(y, *self._y[[0, -1]])
        value = self._inside(inside_x, inside_y)
        if (inside_x != x).any() or (inside_y != y).any():
            slope = self._slopes(inside_x, inside_y)
            value = value + slope[..., 0] * (x - inside_x) + slope[..., 1] * (y - inside_y)
        return value

    def normals(self, x_m: Array, y_m: Array) -> Array:
        """Unit normals that point up, shape (…, 3)."""
        x, y = np.clip(x_m, *self._x[[0, -1]]), np.clip(y_m, *self._y[[0, -1]])
        slope = self._slopes(x, y)
        up = np.concatenate([-slope, np.ones((*slope.shape[:-1], 1))], axis=-1)
        return np.asarray(up / np.linalg.norm(up, axis=-1, keepdims=True))

    def _slopes(self, x: Array, y: Array) -> Array:
        """Slopes along x and y at places on the grid, shape (…, 2)."""
        left, right = (np.clip(x + step, *self._x[[0, -1]]) for step in (-STEP_M, STEP_M))
        near, far = (np.clip(y + step, *self._y[[0, -1]]) for step in (-STEP_M, STEP_M))
        return np.stack(
            [
                (self._inside(right, y) - self._inside(left, y)) / (right - left),
                (self._inside(x, far) - self._inside(x, near)) / (far - near),
            ],
            axis=-1,
        )

    def _inside(self, x: Array, y: Array) -> Array:
        row = np.clip(np.searchsorted(self._y, y, side="right") - 1, 0, len(self._y) - 2)
        rest, flat_x, flat_row = y - self._y[row], x.ravel(), row.ravel()
        value = np.zeros(x.shape)
        for spline in self._across:
            value = value * rest + _picked(spline, flat_x, flat_row).reshape(x.shape)
        return value


def _picked(spline: CubicSpline, x: Array, row: NDArray[np.int64]) -> Array:
    """Values of one column each of a spline of many, shape (T,)."""
    piece = np.clip(np.searchsorted(spline.x, x, side="right") - 1, 0, len(spline.x) - 2)
    rest = x - spline.x[piece]
    value = np.zeros(len(x))
    for power in spline.c:  # (X − 1, Y − 1)
        value = value * rest + power[piece, row]
    return value


class Solids:
    """Prisms of patches as half spaces, to keep a swinging foot away from."""

    def __init__(self, patches: Sequence[Patch], thick_m: float) -> None:
        self._faces = [_faces(patch, thick_m) for patch in patches]

    def clearance(self, points_m: Array) -> float:
        """A lower bound of the distance from points to the nearest prism, shape (K, 3) [m];
        negative inside.
        """
        gaps = [float((points_m @ out.T - off).max(axis=1).min()) for out, off in self._faces]
        return min(gaps, default=np.inf)


def _faces(patch: Patch, thick_m: float) -> tuple[Array, Array]:
    """Outward normals and offsets of a prism's faces, shapes (F, 3), (F,)."""
    corners, normal = patch.corners_m, patch.normal
    sides = np.cross(np.roll(corners, -1, axis=0) - corners, normal)
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    inward = ((corners.mean(axis=0) - corners) * sides).sum(axis=1) > 0.0
    sides[inward] *= -1.0
    out = np.vstack([sides, normal, -normal])
    offsets = [*(sides * corners).sum(axis=1), normal @ corners[0], thick_m - normal @ corners[0]]
    return out, np.array(offsets)
