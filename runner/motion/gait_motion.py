"""A gait's trajectory as a motion that the tracker follows: at rest before and after, at its own pace in between.

A gait is dynamic: at another pace its forces balance no longer, so it is run as planned or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.urdf import FOOT_RADIUS_M
from stancekit.planners.terrain.prism import Solid

from .motion import MotionSample

SETTLE_S = 0.5
"""At rest before and after."""
KNOT_S = 0.05
"""Comfortable postures are looked for so often."""


class GaitMotion:
    """A trajectory over time. Feet are spheres: a radius above what they touch. ``MotionSample.frame`` counts seconds.

    radii_m: of the feet, shape (N,), or of all of them. stances: what every stance is called, of all feet;
    ``MotionSample.foothold`` counts them.
    """

    counted = "seconds"
    solids: tuple[Solid, ...] = ()

    def __init__(self, trajectory: Trajectory, radii_m: Array | float = FOOT_RADIUS_M) -> None:
        self.trajectory = trajectory
        self._radii = np.broadcast_to(radii_m, (len(trajectory.robot.feet),))[:, None]
        self._friction = np.full(len(self._radii), trajectory.friction)
        self._turned = Slerp(trajectory.times_s, Rotation.from_matrix(trajectory.rotation))
        self._normals = trajectory.terrain.normal(trajectory.feet_m[..., :2])
        self._foothold = footholds(trajectory.contact)
        self.stances: Sequence[str] = tuple(
            f"{trajectory.robot.foot_names[foot]}, put down at {trajectory.times_s[row]:.2f} s,"
            for row, foot in (np.argwhere(self._foothold == k)[0] for k in range(int(self._foothold.max()) + 1))
        )

    @property
    def last_frame(self) -> float:
        """The end [s]."""
        return self.seconds

    @property
    def goal_m(self) -> Array:
        """Where the torso ends, shape (3,) [m]."""
        return np.asarray(self.trajectory.torso_m[-1])

    def entry(self) -> dict[str, Any]:
        """Where it goes, for a log."""
        return {"start_m": self.trajectory.torso_m[0], "goal_m": self.trajectory.torso_m[-1]}

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return self.trajectory.duration_s + 2.0 * SETTLE_S

    @property
    def knots_s(self) -> Array:
        """Times at which postures are chosen, shape (T,) [s]."""
        return np.linspace(0.0, self.seconds, int(np.ceil(self.seconds / KNOT_S)) + 1)

    def at(self, time_s: float) -> MotionSample:
        """What should be at a time; the ends are held."""
        times = self.trajectory.times_s
        now = float(np.clip(times[0] + time_s - SETTLE_S, times[0], times[-1]))
        k = min(max(int(np.searchsorted(times, now, side="right")) - 1, 0), len(times) - 2)
        s = (now - times[k]) / (times[k + 1] - times[k])

        def between(table: Array) -> Array:
            return np.asarray(table[k] + s * (table[k + 1] - table[k]))

        normals = between(self._normals)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return MotionSample(
            com_m=between(self.trajectory.torso_m),
            rotation_rad=self._turned(now).as_rotvec(),
            frame=min(max(time_s, 0.0), self.seconds),
            feet_m=between(self.trajectory.feet_m) + self._radii * normals,
            forces_n=between(self.trajectory.forces_n),
            foothold=tuple(self._foothold[k + (s >= 1.0)].tolist()),
            normals=normals,
            friction=self._friction,
        )


def footholds(contact: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Which stance every foot is in, counted over all feet, −1 in the air; contact and result: shape (K, E)."""
    begins = contact & ~np.vstack([np.zeros((1, contact.shape[1]), dtype=np.bool_), contact[:-1]])
    count = np.cumsum(begins, axis=0)
    before = np.concatenate([[0], np.cumsum(count[-1])[:-1]])
    return np.where(contact, before + count - 1, -1)
