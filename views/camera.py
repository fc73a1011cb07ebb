"""Place and view of a camera: one perspective for pictures, pages and films."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from stancekit.planners.arguments import cached_property
from stancekit.planners.files.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A perspective on a target, shape (3,) [m], so far away [m]; what is at the target is drawn to
    scale.
    """

    target_m: Array
    azimuth_rad: float
    elevation_rad: float
    distance_m: float

    @cached_property
    def axes(self) -> Array:
        """Rows right, up and towards the viewer, shape (3, 3)."""
        (a, b), (c, d) = ((np.cos(x), np.sin(x)) for x in (self.azimuth_rad, self.elevation_rad))
        return np.array([[-b, a, 0.0], [-a * d, -b * d, c], [a * c, b * c, d]])

    @property
    def position_m(self) -> Array:
        """Place of the viewer, shape (3,)."""
        return np.asarray(self.target_m + self.distance_m * self.axes[2])

    @cached_property
    def light(self) -> Array:
        """Direction to the light, above the viewer's left, shape (3,)."""
        towards = np.array([-0.45, 0.75, 0.55]) @ self.axes
        return np.asarray(towards / np.linalg.norm(towards))

    def project(self, points: Array) -> tuple[Array, Array]:
        """Points, shape (…, 3), on the picture plane, shape (…, 2) [m], and how near they are,
        shape (…) [m].
        """
        local = (points - self.target_m) @ self.axes.T
        away = np.maximum(
            self.distance_m - local[..., 2], 0.2 * self.distance_m
        )  # what is behind the viewer: ahead
        return local[..., :2] * (self.distance_m / away)[..., None], local[..., 2]

    def near(self, point: Array) -> float:
        """Distance of one point from the camera's plane [m]."""
        return float(self.project(point)[1])

    def facing(self, points: Array, normals: Array) -> Array:
        """Cosine of the angle at which the viewer sees faces, shape (…); negative from behind."""
        towards = self.position_m - points
        length = np.maximum(np.linalg.norm(towards, axis=-1), 1e-12)
        return np.asarray(np.sum(normals * towards, axis=-1) / length)

    def lit(self, colours: Array, normals: Array) -> Array:
        """Colours of faces with these unit normals in the light, shape (…, 3)."""
        shade = 0.78 + 0.30 * np.clip(normals @ self.light, -0.4, 1.0)[..., None]
        base = colours * np.minimum(shade, 1.0)
        return np.asarray(base + (1.0 - base) * np.maximum(0.0, shade - 1.0) * 2.5)


def best_view(
    target_m: Array,
    distance_m: float,
    merit: Callable[[Camera], float],
    *,
    step_deg: float,
    elevations_deg: Sequence[float],
) -> Camera:
    """The camera of most merit, of those around the target at these elevations."""
    angles = product(np.deg2rad(np.arange(-180.0, 180.0, step_deg)), np.deg2rad(elevations_deg))
    cameras = (
        Camera(
            target_m=target_m,
            azimuth_rad=float(azimuth),
            elevation_rad=float(elevation),
            distance_m=distance_m,
        )
        for azimuth, elevation in angles
    )
    return max(cameras, key=merit)
