"""Report on a map: conformal error (Pan et al. Fig. 4), injectivity, match, convergence (Fig.
5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..files.arrays import Array
from ..terrain.heightfield import HeightField
from .energy import determinant, singular_values
from .spline_map import SplineMap

_FINER = 6
"""Lines a cell on which det J is checked; the quadrature has two or three."""
_GROUND_LINES = 81
TORSO_M = 0.5
"""Height above the ground at which the torso's conformal error is measured [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapReport:
    """Quality and cost of one map.

    Arguments:
        ground_error, torso_error: 1 − σ_min/σ_max of J, shape (81, 81), at z̄ = 0 and z̄ = .5 m on
            a regular grid.
        least_det: min det J over 6 lines a cell.
        least_det_at_m: where, shape (3,).
        match_m: greatest and root-mean-square |φ_z − h(φ_xy)| at z̄ = 0 between all nodes [m].
        unsnapped_m: the same before the snap.
        energy: rows of total, conformal, barrier, match, min det J at the quadrature points, a row
            an iteration, shape (K, 5).
        seconds: CPU time until then, shape (K,) [s].
        cpu_s: all of it, with snap and checks.
        message: what had to be done otherwise.
    """

    method: str
    terrain: str
    cells: tuple[int, int, int]
    ground_error: Array
    torso_error: Array
    least_det: float
    least_det_at_m: Array
    match_m: tuple[float, float]
    unsnapped_m: tuple[float, float]
    energy: Array
    seconds: Array
    evaluations: int
    cpu_s: float
    message: str = ""

    def to_json(self) -> dict[str, Any]:
        """One line: distributions as mean, median, 95 % and maximum."""
        return {
            "method": self.method,
            "terrain": self.terrain,
            "cells": list(self.cells),
            "cpu_s": self.cpu_s,
            "iterations": len(self.energy) - 1,
            "evaluations": self.evaluations,
            "energy": self.energy[-1, 0] if len(self.energy) else None,
            "least_det": self.least_det,
            "least_det_at_m": self.least_det_at_m.tolist(),
            "match_max_mm": 1e3 * self.match_m[0],
            "match_rms_mm": 1e3 * self.match_m[1],
            "unsnapped_max_mm": 1e3 * self.unsnapped_m[0],
            "unsnapped_rms_mm": 1e3 * self.unsnapped_m[1],
            "ground_error": spread(self.ground_error),
            "torso_error": spread(self.torso_error),
            "message": self.message,
        }


def spread(values: Array) -> dict[str, float]:
    """Mean, median, 95 % and greatest of values, and the share below 5 %."""
    return {
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "p95": float(np.quantile(values, 0.95)),
        "max": float(values.max()),
        "below_5_percent": float(np.mean(values < 0.05)),
    }


def conformal_error(warp: SplineMap, height_m: float = 0.0, lines: int = _GROUND_LINES) -> Array:
    """1 − σ_min/σ_max of J on a regular grid at z̄ = height, shape (lines, lines): 0 where φ keeps
    angles.
    """
    x, y = (np.linspace(low, high, lines) for low, high in warp.domain_m)
    _, jacobian = warp.on_grid(x, y, np.array([height_m]))
    sigma = singular_values(jacobian[..., 0])
    return np.asarray(1.0 - sigma[2] / sigma[0])


def least_determinant(warp: SplineMap) -> tuple[float, Array]:
    """min det J on FINER lines a cell, twice as many near the ground, and where it is, shape (3,)
    [m].
    """
    lines = [
        np.linspace(low, high, _FINER * n + 1)
        for (low, high), n in zip(warp.domain_m, warp.cells[:2], strict=True)
    ]
    near = min(warp.fade_m, warp.height_m)
    z = np.unique(
        np.concatenate(
            [np.linspace(0.0, near, 13), np.linspace(0.0, warp.height_m, 2 * warp.cells[2] + 1)]
        )
    )
    x, y = lines
    det = np.stack(
        [determinant(warp.on_grid(x, y, z[k : k + 1])[1][..., 0]) for k in range(len(z))], axis=-1
    )
    i, j, k = np.unravel_index(int(det.argmin()), det.shape)
    return float(det[i, j, k]), np.array([x[i], y[j], z[k]])


def match_error(warp: SplineMap, field: HeightField) -> tuple[float, float]:
    """Greatest and root-mean-square |φ_z − h(φ_xy)| at z̄ = 0, on lines twice as dense as the
    terrain's [m].
    """
    lines = []
    for (low, high), cells, nodes in zip(
        warp.domain_m, warp.cells[:2], field.heights_m.shape, strict=True
    ):
        count = max(_FINER * cells, int(2.3 * nodes))
        lines.append(low + (high - low) * (np.arange(count) + 0.5) / count)
    ground = warp.ground_on_grid(lines[0], lines[1])
    miss = ground[2] - field.height(np.moveaxis(ground[:2], 0, -1))
    return float(np.abs(miss).max()), float(np.sqrt(np.mean(miss**2)))
