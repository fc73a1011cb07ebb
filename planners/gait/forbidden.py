"""Walks that friction forbids, said before any program is written: arguments about impulses, without a solver.

A foot on ground of normal n pushes with w·f ≥ 0 for every w that is nearer to n than 90° − atan ν. Where one such w
suits all ground that feet can have, w·(Σ f) ≥ 0 whatever the feet do, and in flight, too. So

- at rest, Σ f = m g e_z, and a w that points below the horizon is a proof: no stance there carries the weight;
- from rest to rest in T, w·Δp = ∫ (T − t) w·f / m dt − w_z g T²/2 and = w_z g T²/2 − ∫ t w·f / m dt, so that
  |w·Δp| ≤ w_z g T²/2: the net impulse does not bring the body so far.

The gradient of a cubic spline is within the hull of its derivatives' control points, cell by cell, and the normals that
suit a w are a convex cone, so that the corners of each cell's box of gradients speak for all of its ground.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..files.arrays import Array
from ..robot.single_body import GRAVITY_M_S2
from ..terrain.heightfield import HeightField
from .task import GaitSettings, GaitTask

FRICTION_ROOM = 0.02
"""Friction is taken to be this much more than it is: nothing is forbidden that the verifier tolerates."""
TURNS = np.deg2rad(5.0) * np.arange(72)
BELOW = np.array([1e-3, 0.01, 0.05])
"""Directions about the vertical, and below the horizon, in which w is looked for [rad]."""


def forbidden(task: GaitTask, settings: GaitSettings) -> str:
    """Why there is no such walk, in one sentence; empty where this proves nothing, as with feet that stick."""
    if any(task.adhesive):
        return ""
    boxes = GradientBoxes(task.terrain)
    places = [("start", task.start_xy_m)] + [("goal", task.goal_xy_m)] * settings.still_end
    for name, xy in places:
        normals = boxes.normals(xy, _reach_m(task) + 3e-3)
        if len(normals) and _tips_over(normals, task.friction + FRICTION_ROOM):
            return (
                f"at rest at the {name} ({xy[0]:g}, {xy[1]:g}) no stance carries the weight: all ground within "
                f"{_reach_m(task):.2f} m is steeper one way than friction {task.friction:g} holds"
            )
    return _too_far(task, boxes) if settings.still_end else ""


class GradientBoxes:
    """Bounds of the terrain's gradient in every cell of its spline."""

    def __init__(self, terrain: HeightField) -> None:
        control, knots = terrain.spline
        slopes = []
        for axis in range(2):
            rise = np.diff(control[0], axis=axis)
            span = (knots[axis][4:-1] - knots[axis][1:-4]) / 3.0
            slope = rise / (span[:, None] if axis == 0 else span)
            windows = sliding_window_view(slope, (3, 4) if axis == 0 else (4, 3))
            slopes += [windows.min(axis=(2, 3)), windows.max(axis=(2, 3))]
        self._bounds = slopes
        self._lines = [line[3:-3] for line in knots]

    def normals(self, xy_m: Array | None = None, radius_m: float = np.inf) -> Array:
        """Corners of the boxes of all cells that come within a distance of a point, as unit normals, shape (N, 3)."""
        chosen = [np.ones(len(line) - 1, dtype=bool) for line in self._lines]
        for axis, line in enumerate(self._lines):
            if xy_m is not None:
                chosen[axis] = (line[1:] >= xy_m[axis] - radius_m) & (line[:-1] <= xy_m[axis] + radius_m)
        x0, x1, y0, y1 = (bound[np.ix_(*chosen)].ravel() for bound in self._bounds)
        corners = np.concatenate([np.column_stack([-x, -y, np.ones_like(x)]) for x in (x0, x1) for y in (y0, y1)])
        return np.asarray(corners / np.linalg.norm(corners, axis=1, keepdims=True))


def _reach_m(task: GaitTask) -> float:
    """How far a foot may be from the torso, however that is turned [m]."""
    return max(
        float(np.linalg.norm(np.maximum(np.abs(foot.reach_min_m), np.abs(foot.reach_max_m))))
        for foot in task.robot.feet
    )


def _suits(directions: Array, normals: Array, friction: float) -> Array:
    """Which directions w, shape (W, 3), have w·f ≥ 0 for all forces of all normals."""
    least = np.full(len(directions), np.inf)
    for some in np.array_split(normals, max(1, len(normals) // 20000)):
        least = np.minimum(least, (directions @ some.T).min(axis=1))
    return np.asarray(least >= friction / np.hypot(1.0, friction))


def _tips_over(normals: Array, friction: float) -> bool:
    """Whether a direction below the horizon suits all normals."""
    level = np.column_stack([np.cos(TURNS), np.sin(TURNS)])
    below = [np.column_stack([np.cos(angle) * level, np.full(len(level), -np.sin(angle))]) for angle in BELOW]
    return bool(_suits(np.concatenate(below), normals, friction).any())


def _too_far(task: GaitTask, boxes: GradientBoxes) -> str:
    """Whether the net impulse of all the ground there is does not bring the body to the goal in time."""
    ahead = task.goal_xy_m - task.start_xy_m
    away = float(np.linalg.norm(ahead))
    if away == 0.0:
        return ""
    rises = np.linspace(1e-3, 0.5 * np.pi - 1e-3, 400)
    higher = float(np.ptp(task.terrain.heights_m)) + 2.0 * _reach_m(task)
    room = higher + 0.5 * GRAVITY_M_S2 * task.duration_s**2
    message = rises[away * np.cos(rises) > room * np.sin(rises)]
    w = np.column_stack([np.outer(np.cos(message), -ahead / away), np.sin(message)])
    normals = boxes.normals()
    if not len(message) or not (_suits(w, normals, task.friction + FRICTION_ROOM)).any():
        return ""
    return (
        f"from rest to rest in {task.duration_s:g} s friction {task.friction:g} does not bring the body {away:.2f} m "
        "far: what it can push ahead, it has to brake, too"
    )
