"""How sure the plane and the edges of a surface are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array, checked, read_only


@dataclass(frozen=True, kw_only=True, eq=False)
class Certainty:
    """The covariance of a surface's plane, and the deviation of its edges.

    Arguments:
        about_m: place that the plane's height is meant at, shape (2,) [m].
        covariance: of the height there [m] and of the slopes along x and y [rad], shape (3, 3).
        edge_sd_m: standard deviation of the place of an edge, across it [m].
        inset_m: how far footholds keep from the edges, beside half a sample's distance [m].
    """

    about_m: Array
    covariance: Array
    edge_sd_m: float = 0.0
    inset_m: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "about_m", read_only(self.about_m, (2,), "about_m"))
        object.__setattr__(self, "covariance", read_only(self.covariance, (3, 3), "covariance"))
        for name in ("edge_sd_m", "inset_m"):
            checked(getattr(self, name), name, least=0.0)

    def levers(self, places_m: Array) -> Array:
        """What the plane's height at places, shape (…, 2), takes of height and slopes, shape (…, 3)."""
        return np.concatenate([np.ones((*places_m.shape[:-1], 1)), places_m - self.about_m], axis=-1)

    def height_sd_m(self, places_m: Array) -> Array:
        """Standard deviation of the plane's height at places, shape (…, 2) to (…) [m]."""
        levers = self.levers(places_m)
        return np.asarray(np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", levers, self.covariance, levers), 0.0)))

    @property
    def tilt_sd_rad(self) -> float:
        """Standard deviation of the slope along the way on which it is largest [rad]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[1:, 1:])[-1], 0.0)))
