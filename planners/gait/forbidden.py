"""Walks that friction forbids, said before any program is written: arguments about impulses,
without a solver; and those that are not forbidden, but that no search finds (``unheld``).

A foot on ground of normal n pushes with w·f ≥ −s, s its suction, for every unit w that is nearer to
n than 90° − atan ν. Where one such w suits all ground that feet can have, w·(Σ f) ≥ −S whatever
they do, and in flight, too; S is the suction of all feet that stick. So

- at rest, Σ f = m g e_z, and a w with −w_z m g > S is a proof: no stance there carries the weight;
- for a way e along the ground and w = (∓e cos β, sin β), ±a_e ≤ A± + tan β± a_z, A = g tan β + S / (m cos β). From rest
  to rest in T, e·Δp = ∫ (c − t) a_e dt ≤ A₊ c²/2 + A₋ (T − c)²/2 + rise (tan β₊ + tan β₋) for every
  c in [0, T]: what pushes ahead until c has to brake thereafter. rise bounds how far the body is
  above either end at c. That is known where some foot always stands; where none may, c = 0 and T
  alone are taken, where one of the ends is meant.

The gradient of a cubic spline is within the hull of its derivatives' control points, cell by cell,
and the normals that suit a w are a convex cone, so that the corners of each cell's box of gradients
speak for all of its ground.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..files.arrays import Array
from ..physics import GRAVITY_M_S2
from ..problem.walk import Walk
from ..terrain.heightfield import HeightField
from .settings import GaitSettings

_FRICTION_ROOM = 0.02
"""Friction is taken to be this much more than it is: nothing is forbidden that the verifier
tolerates."""
_TURNS = np.deg2rad(5.0) * np.arange(72)
_BELOW = np.array([1e-3, 0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0])
"""Directions about the vertical, and below the horizon, in which w is looked for [rad]."""
_AROUND_M, _MORE, _FAR = 3.0, 1.3, 1.35
"""Ways are looked for so far about the straight one [m], with so many times the friction, over what
is so many times as wide as feet reach from the body.
"""
LEAST, _GREATEST = 1e-6, 0.5 * np.pi - 1e-6
"""β that are taken, above the horizon [rad]."""


def forbidden(task: Walk, settings: GaitSettings) -> str:
    """Why there is no such walk, in one sentence; empty where this proves nothing."""
    boxes = GradientBoxes(task.terrain)
    places = [("start", task.start)] + [("goal", task.goal)] * settings.still_end
    for name, xy in places:
        normals = boxes.normals(xy, _reach_m(task) + 3e-3)
        if len(normals) and _tips_over(normals, task.friction + _FRICTION_ROOM, _pull(task)):
            return (
                f"at rest at the {name} ({xy[0]:g}, {xy[1]:g}) no stance carries the weight: all "
                "ground within "
                f"{_reach_m(task):.2f} m is steeper one way than friction {task.friction:g}"
                f"{_suction(task)} holds"
            )
    return _too_far(task, boxes, settings) if settings.still_end else ""


def unheld(task: Walk) -> str:
    """Why a walk is unlikely, in one sentence; empty where it is likely. A rule of thumb, no proof.

    Feet step over ground that is steeper than friction holds, momentum carries the body on, and
    between two walls feet press on both. Where, on every way, the places that hold feet (with 1.3
    times the friction) are farther apart than 1.35 times the reach of the feet, the optimizer found
    no walk on the hills and cones that were tried, in gaits that move one foot of an end at a time.
    """
    ground, ends = task.terrain, np.array([task.start, task.goal])
    lines = [
        line[slice(*np.searchsorted(line, (min(along) - _AROUND_M, max(along) + _AROUND_M)))]
        for line, along in zip((ground.x_m, ground.y_m), ends.T, strict=True)
    ]
    places = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
    heights, gradient = ground.height_and_gradient(places)
    steep = np.linalg.norm(gradient, axis=1)
    down = gradient / np.maximum(steep, LEAST)[:, None]
    across = ground.gradient(
        np.clip(places - 0.5 * _reach_m(task) * down, *np.transpose(ground.domain_m))
    )
    held = (steep <= _MORE * task.friction) | (np.vecdot(across, gradient) < 0.0)
    if held.all() or any(task.adhesive) or task.gait in ("bound", "gallop"):
        return ""
    from scipy.spatial import cKDTree  # slow to import

    far_m = _FAR * _reach_m(task)
    nodes = np.column_stack([places, heights])[held]
    away = np.linalg.norm(nodes[:, None, :2] - ends, axis=2)
    come_to = new = away[:, 0] <= _reach_m(task)
    while new.any():
        near = cKDTree(nodes[new]).query(nodes, distance_upper_bound=far_m)[0]
        new = np.isfinite(near) & ~come_to
        come_to |= new
    if not come_to.any() or away[come_to, 1].min() <= _reach_m(task):
        return ""
    last = nodes[come_to][(away[come_to] @ (1.0, 2.0)).argmin()]
    return (
        f"undecided, not looked for: from about ({last[0]:.2f}, {last[1]:.2f}) on the ground is "
        f"steeper than friction {task.friction:g} holds, and what holds feet beyond is more than "
        f"{far_m:.2f} m away; one chart alone, chart NAME, looks all the same"
    )


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
        """Corners of the boxes of all cells that come within a distance of a point, as unit
        normals, shape (N, 3).
        """
        chosen = [np.ones(len(line) - 1, dtype=bool) for line in self._lines]
        for axis, line in enumerate(self._lines):
            if xy_m is not None:
                chosen[axis] = (line[1:] >= xy_m[axis] - radius_m) & (
                    line[:-1] <= xy_m[axis] + radius_m
                )
        x0, x1, y0, y1 = (bound[np.ix_(*chosen)].ravel() for bound in self._bounds)
        corners = np.concatenate(
            [np.column_stack([-x, -y, np.ones_like(x)]) for x in (x0, x1) for y in (y0, y1)]
        )
        return np.asarray(corners / np.linalg.norm(corners, axis=1, keepdims=True))


def _reach_m(task: Walk) -> float:
    """Largest distance of a foot from the torso, however that is turned [m]."""
    return max(
        float(np.linalg.norm(np.maximum(np.abs(foot.reach_min_m), np.abs(foot.reach_max_m))))
        for foot in task.robot.feet
    )


def _suits(directions: Array, normals: Array, friction: float) -> Array:
    """Tell which directions w, shape (W, 3), have w·f ≥ 0 for all forces of all normals."""
    least = np.full(len(directions), np.inf)
    for some in np.array_split(normals, max(1, len(normals) // 20000)):
        least = np.minimum(least, (directions @ some.T).min(axis=1))
    return np.asarray(least >= friction / np.hypot(1.0, friction))


def _pull(task: Walk) -> float:
    """Largest pull of all adhesive feet together, in units of the weight."""
    assert task.suction_n is not None
    return sum(task.adhesive) * task.suction_n / task.robot.weight_n


def _suction(task: Walk) -> str:
    """Largest pull of all adhesive feet together, in words; empty if no foot is adhesive."""
    return (
        f" and suction of {_pull(task) * task.robot.weight_n:.0f} N" if any(task.adhesive) else ""
    )


def _tips_over(normals: Array, friction: float, pull: float) -> bool:
    """Tell whether a direction below the horizon suits all normals, so far below that suction does
    not hold the weight.
    """
    level = np.column_stack([np.cos(_TURNS), np.sin(_TURNS)])
    angles = _BELOW[np.sin(_BELOW) > pull]
    below = [
        np.column_stack([np.cos(angle) * level, np.full(len(level), -np.sin(angle))])
        for angle in angles
    ]
    return bool(len(below)) and bool(_suits(np.concatenate(below), normals, friction).any())


def _too_far(task: Walk, boxes: GradientBoxes, settings: GaitSettings) -> str:
    """Reason why the net impulse of all the ground there is does not bring the body to the goal in
    time.
    """
    ahead = task.goal - task.start
    away = float(np.linalg.norm(ahead))
    if away == 0.0:
        return ""
    normals, friction = boxes.normals(), task.friction + _FRICTION_ROOM
    slopes = np.array([_least(way * ahead / away, normals, friction) for way in (-1.0, 1.0)])
    pulled = _pull(task) * np.hypot(1.0, slopes) if any(task.adhesive) else 0.0
    most = GRAVITY_M_S2 * (slopes + pulled)  # A₊ and A₋ [m/s²]
    higher = float(np.ptp(task.terrain.heights_m)) + 2.0 * _reach_m(task)
    bounds = most * 0.5 * task.duration_s**2 + higher * slopes
    if np.isfinite(most).all() and _always_stands(task, settings):
        both = most.prod() / most.sum() * 0.5 * task.duration_s**2 + higher * slopes.sum()
        bounds = np.append(bounds, both)
    if away <= bounds.min():
        return ""
    return (
        f"from rest to rest in {task.duration_s:g} s friction {task.friction:g}{_suction(task)} "
        "brings the body no "
        f"farther than {bounds.min():.2f} m, the goal is {away:.2f} m away: what it can push "
        "ahead, it has to brake"
    )


def _least(towards: Array, normals: Array, friction: float) -> float:
    """tan of the least β at which (towards cos β, sin β) suits all normals; inf where none does.

    For one normal that is R sin(β + φ) ≥ ν / √(1 + ν²), a range of β; a w within all of them suits
    all.
    """
    along, up = normals[:, :2] @ towards, normals[:, 2]
    sine = friction / np.hypot(1.0, friction) / np.hypot(along, up)
    if np.any(sine > 1.0):
        return np.inf
    ahead, half = np.arctan2(along, up), np.arcsin(sine)
    least, most = max(LEAST, float((half - ahead).max())), float((np.pi - half - ahead).min())
    return float(np.tan(least)) if least <= min(most, _GREATEST) else np.inf


def _always_stands(task: Walk, settings: GaitSettings) -> bool:
    """Tell whether some foot is on the ground at every moment, as the timing has it."""
    if task.timings != "fixed":
        return False
    feet = task.phases(settings.step_s)
    edges = np.unique(np.concatenate([foot.edges_s for foot in feet]))
    moments = np.concatenate([0.5 * (edges[1:] + edges[:-1]), edges])
    return bool(np.any([foot.stands(moments) for foot in feet], axis=0).all())
