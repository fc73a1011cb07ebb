"""Initial guesses: a straight walk that turns evenly and follows the terrain, and perturbations."""

from __future__ import annotations

import numpy as np

from ...files.arrays import Array
from ..constraints.feet import sure_xy
from ..variables import NOTHING, Index, Structure

_RAMP = 0.15
"""Share of the time in which a walk gets up to speed, and in which it slows down."""
_LOADING_S = 0.1
"""Time that a foot takes to get its full share of the weight after touchdown, and to lose it before
lift-off [s]."""


def terrain_following(structure: Structure) -> Array:
    """A decision vector: torso at stand height over the smoothed terrain along a straight line,
    feet beneath it, the weight shared by the feet that stand. Shape (size,).
    """
    x, walk = np.zeros(structure.layout.size), GuessedWalk(structure)
    x[structure.layout.torso] = walk.torso_bar(structure.layout.torso_times_s)
    for number, foot in enumerate(structure.layout.feet):
        stood = walk.footholds(number)
        bar = structure.chart.foot_bar(stood)
        _put(x, foot.stances, bar)
        x[foot.swings] = walk.swings_bar(number, stood, bar)
        for index, entries in enumerate(foot.forces):
            times_s = structure.layout.force_times_s(number, index)
            _put(x, entries, walk.forces_bar(number, times_s, bar[index]))
        x[foot.switches] = foot.phases.switches_s if len(foot.switches) else 0.0
    return x


def perturbed(
    x: Array, rng: np.random.Generator, structure: Structure, size: float = 0.02
) -> Array:
    """``x`` with normal noise of this deviation on every variable [m, rad, m·g]; switching times
    keep theirs.
    """
    moved = x + size * rng.standard_normal(len(x))
    for foot in structure.layout.feet:
        moved[foot.switches] = x[foot.switches]
    return moved


class GuessedWalk:
    """The walk that the guess describes, in world quantities."""

    def __init__(self, structure: Structure) -> None:
        self._structure, self._task = structure, structure.task
        self._body = structure.task.terrain.smoothed(structure.settings.smoothing_m)
        edges = [foot.phases.edges_s for foot in structure.layout.feet]
        self._begins_s = max(0.5 * min(edge[1] for edge in edges), 1e-3)
        self._ends_s = structure.task.duration_s - 0.5 * min(edge[-1] - edge[-2] for edge in edges)

    def share(self, times_s: Array) -> Array:
        """Share of the way that is behind the torso, with smooth ends, shape (K,)."""
        share = np.clip(
            (np.asarray(times_s) - self._begins_s) / (self._ends_s - self._begins_s), 0.0, 1.0
        )
        return _eased(share, _RAMP)

    def torso_xy(self, times_s: Array) -> Array:
        """Along the line from start to goal, shape (K, 2) [m]."""
        share = self.share(times_s)[:, None]
        return (1.0 - share) * self._task.start + share * self._task.goal

    def yaw(self, times_s: Array) -> Array:
        """From the heading at the start evenly along the way to that at the end, shape (K,)
        [rad].
        """
        start, end = self._task.yaws()
        return np.asarray(start + self.share(times_s) * (end - start))

    def torso(self, times_s: Array) -> tuple[Array, Array]:
        """p_WB, shape (K, 3) [m], and R_WB, (K, 3, 3): along the smoothed terrain, at stand height
        from its slope.
        """
        xy = self.torso_xy(times_s)
        height, slope = self._body.height_and_gradient(xy)
        lift = self._task.robot.stand_height_m * np.sqrt(1.0 + np.sum(slope**2, axis=1))
        yaw = self.yaw(times_s)
        cosine, sine, zero = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
        yaws = np.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1.0], axis=-1)
        return np.column_stack([xy, height + lift]), np.asarray(
            _shear_rotations(slope) @ yaws.reshape(-1, 3, 3)
        )

    def torso_bar(self, times_s: Array) -> Array:
        """(p̄, θ̄), shape (K, 6)."""
        p, rotation = self.torso(times_s)
        chart, yaw = self._structure.chart, self.yaw(times_s)
        angles = np.column_stack([np.zeros((len(p), 2)), yaw])
        if not chart.flat:
            angles = euler_angles(rotation)
            angles[:, 2] += 2.0 * np.pi * np.rint((yaw - angles[:, 2]) / (2.0 * np.pi))
        return np.column_stack([chart.torso_bar(p), angles])

    def footholds(self, foot: int) -> Array:
        """Footholds of a foot, stance by stance, shape (S + 1, 3): on the ground where its nominal
        place, in the axes of the torso half-way through the stance, is seen from above; up a slope
        that is ahead of the torso.
        """
        phases = self._structure.layout.feet[foot].phases
        middles = np.array([np.mean(phases.stance(index)) for index in range(phases.swings + 1)])
        middles[0], middles[-1] = 0.0, self._task.duration_s
        p, rotation = self.torso(middles)
        xy = (p + rotation @ self._task.robot.feet[foot].nominal_m)[:, :2]
        share = self._structure.settings.footing
        if share and not self._task.adhesive[foot]:
            xy = sure_xy(self._task, share, xy)
        return np.column_stack([xy, self._task.terrain.height(xy)])

    def swings_bar(self, foot: int, footholds: Array, bar: Array) -> Array:
        """Place and velocity half-way through each swing, shape (S, 6)."""
        phases = self._structure.layout.feet[foot].phases
        lasting = np.array(
            [np.subtract(*phases.swing(index)[::-1]) for index in range(phases.swings)]
        )
        middle, across = 0.5 * (bar[1:] + bar[:-1]), (bar[1:] - bar[:-1]) / lasting[:, None]
        lift = self._structure.settings.swing_height_m
        if self._structure.chart.flat:
            middle[:, 2] = lift
        else:
            along = np.linspace(0.0, 1.0, 9)[:, None, None]
            paths = footholds[:-1] + along * (footholds[1:] - footholds[:-1])
            over = self._task.terrain.height(paths[..., :2]) - paths[..., 2]
            middle[:, 2] += np.maximum(over.max(axis=0), 0.0) + lift
        return np.column_stack([middle, 1.5 * across])

    def forces_bar(self, foot: int, times_s: Array, bar: Array) -> Array:
        """A share of the weight, straight up, at times of one stance of a foot, shape (K, 3)
        [m·g].
        """
        loads = [self._load(other, times_s) for other in range(self._structure.feet)]
        share = np.zeros((len(times_s), 3))
        share[:, 2] = loads[foot] / np.maximum(np.sum(loads, axis=0), 1e-6)
        return self._structure.chart.force_bar(share, np.tile(bar, (len(times_s), 1)))

    def _load(self, foot: int, times_s: Array) -> Array:
        """Part that a foot takes in carrying, shape (K,): 0 in swing, 1 in stance, ramps of
        LOADING_S between.
        """
        edges = self._structure.layout.feet[foot].phases.edges_s
        begins, ends = edges[0::2].copy(), edges[1::2].copy()
        begins[0], ends[-1] = -np.inf, np.inf
        within = np.minimum(times_s[:, None] - begins, ends - times_s[:, None]).max(axis=1)
        return np.asarray(np.clip(within / _LOADING_S, 0.0, 1.0))


def _eased(share: Array, ramp: float) -> Array:
    """Distance covered at a share of the time, speeding up and slowing down smoothly over ``ramp``
    of it.
    """

    def rise(s: Array) -> Array:  # of the integral of 3u² − 2u³
        return np.asarray(ramp * (s**3 - 0.5 * s**4))

    up, down = np.clip(share / ramp, 0.0, 1.0), np.clip((share - 1.0 + ramp) / ramp, 0.0, 1.0)
    return np.asarray((rise(up) + np.maximum(share - ramp, 0.0) - rise(down)) / (1.0 - ramp))


def euler_angles(rotation: Array) -> Array:
    """θ of rotations, shape (…, 3, 3) → (…, 3) [rad], pitch in [−π/2, π/2]."""
    roll = np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    pitch = -np.arcsin(np.clip(rotation[..., 2, 0], -1.0, 1.0))
    return np.stack([roll, pitch, np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])], axis=-1)


def _put(x: Array, entries: Index, values: Array) -> None:
    there = entries != NOTHING
    x[entries[there]] = values[there]


def _shear_rotations(slope: Array) -> Array:
    """``shear_rotation`` of numbers, shape (K, 2) → (K, 3, 3)."""
    scale = np.sqrt(4.0 + np.sum(slope**2, axis=1))
    x, y, zero = slope[:, 1] / scale, -slope[:, 0] / scale, np.zeros(len(slope))
    skew = np.stack([zero, zero, y, zero, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + 2.0 / scale)[:, None, None])
