"""Record of a run: for every control period what was sent, and why, and what the world measured
after it.

There is one record. Reports, figures of tracking, estimates of friction and pictures are computed
from it.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.kinematics import Kinematics

from .control.tracker import Target
from .worlds.world import State

TOUCH_N = 1.5
"""A foot that feels more than this touches."""


@dataclass
class Record:
    """Targets and measurements of one motion.

    Arguments:
        pairs: target and state of every control period.
        began_s: when each was sent, on the performance counter.
    """

    pairs: list[tuple[Target, State]] = field(default_factory=list)
    began_s: list[float] = field(default_factory=list)

    def add(self, target: Target, state: State, began_s: float) -> None:
        """One control period."""
        self.pairs.append((target, state))
        self.began_s.append(began_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A record as arrays, a row a control period, T of them; N limbs, J joints.

    Arguments:
        com_m, planned_com_m: shape (T, 3).
        frame: progress in key frames, shape (T,).
        origin_m, rotation: of the body's frame, shape (T, 3), (T, 3, 3).
        feet_m: centres, shape (T, N, 3).
        rolled_m: of that, what they should have rolled since they were put down.
        forces_n, planned_forces_n: shape (T, N, 3).
        angles_rad, torques_nm, planned_torques_nm: shape (T, J).
        foothold: what every limb should stand on, −1 in the air, shape (T, N).
        bump_n: terrain on anything but feet, shape (T,).
    """

    time_s: Array
    frame: Array
    com_m: Array
    planned_com_m: Array
    origin_m: Array
    rotation: Array
    feet_m: Array
    rolled_m: Array
    forces_n: Array
    planned_forces_n: Array
    angles_rad: Array
    torques_nm: Array
    planned_torques_nm: Array
    foothold: Array
    bump_n: Array

    @classmethod
    def of(cls, record: Record, kinematics: Kinematics) -> Trace:
        """The arrays of a record.

        Arguments:
            kinematics: of the robot, for its centre of mass.
        """
        pairs = record.pairs
        samples, states = [target.sample for target, _ in pairs], [state for _, state in pairs]
        return cls(
            time_s=np.array([s.time_s for s in states]),
            frame=np.array([p.frame for p in samples]),
            com_m=np.array(
                [s.position_m + s.rotation @ kinematics.com_offset(s.angles_rad) for s in states]
            ),
            planned_com_m=np.array([p.com_m for p in samples]),
            origin_m=np.array([s.position_m for s in states]),
            rotation=np.array([s.rotation for s in states]),
            feet_m=np.array([s.feet_m for s in states]),
            rolled_m=np.array([target.rolled_m for target, _ in pairs]),
            forces_n=np.array([s.forces_n for s in states]),
            planned_forces_n=np.array([p.forces_n for p in samples]),
            angles_rad=np.array([s.angles_rad for s in states]),
            torques_nm=np.array([s.torques_nm for s in states]),
            planned_torques_nm=np.array([target.torques_nm for target, _ in pairs]),
            foothold=np.array([p.foothold for p in samples]),
            bump_n=np.array([s.bump_n for s in states]),
        )

    def sample(self, row: int, planned: Samples) -> Samples:
        """The robot after a control period as a sample of its motion.

        Arguments:
            planned: the sample that the motion has then, for the surfaces, which nobody measured.
        """
        from scipy.spatial.transform import Rotation  # slow to import

        return replace(
            planned,
            com_m=self.com_m[row],
            rotation_rad=Rotation.from_matrix(self.rotation[row]).as_rotvec(),
            frame=self.frame[row],
            feet_m=self.feet_m[row],
            forces_n=self.forces_n[row],
            foothold=self.foothold[row],
            origin_m=self.origin_m[row],
            angles_rad=self.angles_rad[row],
            torques_nm=self.torques_nm[row],
        )

    def slips(self, footholds: int) -> Array:
        """Slips of every foothold's foot from where it touched, while it should stand, shape (P,)
        [m].

        That is its centre's path less what it should have rolled; of one that never touches, from
        where it should have.
        """
        result, feet = np.zeros(footholds), self.feet_m - self.rolled_m
        for foothold, (rows, limbs, first) in enumerate(self._stood(footholds)):
            if len(rows):
                moved = feet[rows[first:], limbs[first:]] - feet[rows[first], limbs[first]]
                result[foothold] = float(np.linalg.norm(moved, axis=1).max())
        return result

    def late(self, footholds: int) -> Array:
        """Delays with which each foothold's foot touched after it should stand, shape (P,) [s]."""
        since = [
            self.time_s[rows[first]] - self.time_s[rows[0]] if len(rows) else 0.0
            for rows, _, first in self._stood(footholds)
        ]
        return np.array(since)

    def found(self, footholds: int) -> NDArray[np.bool_]:
        """Tell which footholds' feet touched while it should stand; true of those that never
        should, shape (P,).
        """
        touches = np.linalg.norm(self.forces_n, axis=-1) > TOUCH_N
        return np.array(
            [
                not len(rows) or bool(touches[rows, limbs].any())
                for rows, limbs, _ in self._stood(footholds)
            ]
        )

    def _stood(self, footholds: int) -> Iterator[tuple[NDArray[np.int_], NDArray[np.int_], int]]:
        """Yield for each foothold the rows and the limbs of the samples in which its foot should
        stand there, and the position in these of the first one that touches; 0 if none does.
        """
        touches = np.linalg.norm(self.forces_n, axis=-1) > TOUCH_N
        for foothold in range(footholds):
            rows, limbs = np.nonzero(self.foothold == foothold)
            yield rows, limbs, int(np.argmax(touches[rows, limbs])) if len(rows) else 0

    def to_npz(self) -> bytes:
        """All arrays by their names, as a NumPy archive."""
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer, **{item.name: getattr(self, item.name) for item in fields(self)}
        )
        return buffer.getvalue()
