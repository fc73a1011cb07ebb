"""A gait's trajectory as a motion that the tracker follows: at rest before and after, at its own
pace in between.

A gait is dynamic: at another pace its forces balance no longer, so it is run as planned or not at
all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.trajectory import Trajectory
from ..arguments import cached_property
from ..files.arrays import Array
from ..robot.urdf import FOOT_RADIUS_M
from ..terrain.prism import Solid
from .motion import Samples, rotation_rate

SETTLE_S = 0.5
"""At rest before and after."""
KNOT_S = 0.05
"""Comfortable postures are looked for so often."""


class GaitMotion:
    """A trajectory over time.

    Feet are spheres: a radius above what they touch. ``Samples.frame`` counts seconds.

    Arguments:
        radii_m: of the feet, shape (N,), or of all of them. stances: what every stance is called,
            of all feet; ``Samples.foothold`` counts them.
    """

    counted = "seconds"
    solids: tuple[Solid, ...] = ()

    def __init__(self, trajectory: Trajectory, radii_m: Array | float = FOOT_RADIUS_M) -> None:
        from scipy.spatial.transform import Rotation, Slerp  # slow to import

        self.trajectory = trajectory
        self._radii = np.broadcast_to(radii_m, (len(trajectory.robot.feet),))
        self._friction = np.full(len(self._radii), trajectory.friction)
        self._turned = Slerp(trajectory.times_s, Rotation.from_matrix(trajectory.rotation))
        self._normals = trajectory.terrain.normal(trajectory.feet_m[..., :2])
        self._foothold = footholds(trajectory.contact)
        self.stances: Sequence[str] = tuple(
            f"{trajectory.robot.limb_names[foot]}, put down at {trajectory.times_s[row]:.2f} s,"
            for row, foot in (
                np.argwhere(self._foothold == k)[0] for k in range(int(self._foothold.max()) + 1)
            )
        )

    @property
    def last_frame(self) -> float:
        """The end [s]."""
        return self.duration_s

    @property
    def goal_m(self) -> Array:
        """Goal of the torso, shape (3,) [m]."""
        return np.asarray(self.trajectory.torso_m[-1])

    def entry(self) -> dict[str, Any]:
        """Start and goal, for a log."""
        return {"start_m": self.trajectory.torso_m[0], "goal_m": self.trajectory.torso_m[-1]}

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.trajectory.duration_s + 2.0 * SETTLE_S

    @property
    def knots_s(self) -> Array:
        """Times at which postures are chosen, shape (T,) [s]."""
        return np.linspace(0.0, self.duration_s, int(np.ceil(self.duration_s / KNOT_S)) + 1)

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        when, times = np.asarray(times_s, dtype=np.float64), self.trajectory.times_s
        now = np.clip(times[0] + when - SETTLE_S, times[0], times[-1])
        k = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(times) - 2)
        last = times[k + 1] - times[k]
        s = (now - times[k]) / last

        def between(table: Array) -> Array:
            share = s.reshape(s.shape + (1,) * (table.ndim - 1))
            return np.asarray(table[k] + share * (table[k + 1] - table[k]))

        normals = between(self._normals)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        walks = (now == times[0] + when - SETTLE_S)[..., None] / last[..., None]
        torso, rotation = self.trajectory.torso_m, np.asarray(self._turned(now).as_rotvec())
        return Samples(
            com_m=between(torso),
            velocity_m_s=walks * (torso[k + 1] - torso[k]),
            rotation_rad=rotation,
            rotation_rate_rad_s=rotation_rate(rotation, walks * self._turns[k]),
            frame=np.clip(when, 0.0, self.duration_s),
            feet_m=between(self.trajectory.feet_m) + self._radii[:, None] * normals,
            radii_m=self._radii,
            forces_n=between(self.trajectory.forces_n),
            foothold=self._foothold[k + (s >= 1.0)],
            normals=normals,
            friction=np.broadcast_to(self._friction, (*when.shape, len(self._friction))),
        )

    @cached_property
    def _turns(self) -> Array:
        """Rotation vectors of the body from each sample to the next, world frame, shape (K − 1, 3)
        [rad].
        """
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_matrix(self.trajectory.rotation)
        return np.asarray((turns[1:] * turns[:-1].inv()).as_rotvec())


def footholds(contact: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of the stance that every foot is in, counted over all feet, −1 in the air; contact and
    result: shape (K, E).
    """
    begins = contact & ~np.vstack([np.zeros((1, contact.shape[1]), dtype=np.bool_), contact[:-1]])
    count = np.cumsum(begins, axis=0)
    before = np.concatenate([[0], np.cumsum(count[-1])[:-1]])
    return np.where(contact, before + count - 1, -1)
