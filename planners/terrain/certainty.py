"""Certainty of a surface's plane and edges."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, read_only
from ..files.codec import LATER
from .frame import Frame

_BENT_M = 0.08
"""Distance over which the ground turns that is off its plane from place to place [m]."""
FOUND_SD_M = 0.0064
"""Ground that is known to this is found within 2 cm by all of thirty toes on 95 of 100 grounds [m]."""
_SIDES = 16
"""Sides of the polygon of the places where it is."""
_TINY = 1e-12
"""Variance of a slope that is known to the last digit."""
_NEGATIVE = 1e-9
"""Error of a covariance by rounding, as a share of its largest entry."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Certainty:
    """The covariance of a surface's plane, and the deviation of its edges.

    Arguments:
        about_m: place that the plane's height is meant at, shape (2,) [m].
        covariance: of the height there [m] and of the slopes along x and y [rad], shape (3, 3).
        edge_sd_m: standard deviation of the place of an edge, across it [m].
        inset_m: how far footholds keep from where edges most likely are [m].
        rough_m: standard deviation of the ground off its plane from place to place, over about a
            foot's width [m].
        wider_m: how far the surface goes on beyond where its edges most likely are, for bodies to
            keep out of; toes may not stand there [m].
    """

    about_m: Array
    covariance: Array
    edge_sd_m: float = 0.0
    inset_m: float = 0.0
    rough_m: float = field(default=0.0, metadata=LATER)
    wider_m: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "about_m", read_only(self.about_m, (2,), "about_m"))
        object.__setattr__(self, "covariance", read_only(self.covariance, (3, 3), "covariance"))
        least = float(np.linalg.eigvalsh(self.covariance)[0])
        skew = float(np.abs(self.covariance - self.covariance.T).max())
        if max(skew, -least) > _NEGATIVE * float(np.abs(self.covariance).max()):
            raise InvalidInput(
                "covariance: expected a symmetric matrix without negative eigenvalues, got "
                f"{self.covariance.tolist()}"
            )
        for name in ("edge_sd_m", "inset_m", "rough_m", "wider_m"):
            checked(getattr(self, name), name, least=0.0)

    def moved(self, frame: Frame) -> Certainty:
        """The certainty of the surface in a world that is moved with it."""
        about, slopes = frame.places(np.append(self.about_m, 0.0))[:2], np.eye(3)
        slopes[1:, 1:] = frame.rotation[:2, :2]
        return replace(self, about_m=about, covariance=slopes @ self.covariance @ slopes.T)

    def levers(self, places_m: Array) -> Array:
        """Coefficients of height and slopes in the plane's height at places, shape (…, 2), shape
        (…, 3).
        """
        return np.concatenate(
            [np.ones((*places_m.shape[:-1], 1)), places_m - self.about_m], axis=-1
        )

    def height_sd_m(self, places_m: Array) -> Array:
        """Standard deviation of the ground's height above the plane at places of shape (…, 2),
        shape (…) [m].
        """
        levers = self.levers(places_m)
        plane = np.maximum(np.einsum("...i,ij,...j->...", levers, self.covariance, levers), 0.0)
        return np.asarray(np.sqrt(plane + self.rough_m**2))

    def known_within(self, sd_m: float) -> tuple[Array, Array] | None:
        """Normals and offsets of a polygon in whose places the height is known to this deviation,
        shape (S, 2) and (S,) [m]; None where there is none.
        """
        flat = self.covariance[1:, 1:] + _TINY * np.eye(2)
        middle = -np.linalg.solve(flat, self.covariance[1:, 0])
        least = self.covariance[0, 0] + self.covariance[0, 1:] @ middle + self.rough_m**2
        if least >= sd_m**2:
            return None
        angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        normals = ways @ np.linalg.cholesky(flat).T
        radius = np.sqrt(sd_m**2 - least) * np.cos(np.pi / _SIDES)
        return normals, radius + normals @ (middle + self.about_m)

    @property
    def exact(self) -> bool:
        """True where plane and edges are known to the last digit."""
        return not (self.covariance.any() or self.edge_sd_m or self.rough_m)

    @property
    def tilt_sd_rad(self) -> float:
        """Standard deviation of the slope along the way on which it is largest [rad]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.slope_covariance)[-1], 0.0)))

    @property
    def slope_covariance(self) -> Array:
        """Covariance of the ground's slopes at a place, shape (2, 2) [rad²]: of the plane's, and by
        what the ground is off it from one foot's width to the next.
        """
        return np.asarray(self.covariance[1:, 1:] + (self.rough_m / _BENT_M) ** 2 * np.eye(2))
