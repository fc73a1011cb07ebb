"""Motions sampled into tables."""

from __future__ import annotations

import numpy as np

from ..answer.plan import MotionTable
from ..files.arrays import Array, checked
from ..robot.rotation import rotations_of
from .motion import Motion

LARGEST_RATE_HZ = 10_000.0


def table_of(
    motion: Motion,
    limbs: tuple[str, ...],
    joints: tuple[str, ...] = (),
    rate_hz: float = 100.0,
    *,
    robot: str = "",
    source: str = "",
) -> MotionTable:
    """Sample a motion from its beginning to its end.

    Arguments:
        motion: what runs.
        limbs, joints: their names, in the motion's order.
        rate_hz: rows per second.
        robot, source: for people.
    """
    checked(rate_hz, "rate_hz", above=0.0, most=LARGEST_RATE_HZ)
    times = np.arange(int(np.floor(motion.duration_s * rate_hz + 1e-6)) + 1) / rate_hz
    at = motion.at(times)
    known = at.angles_rad is not None
    return MotionTable(
        joints=joints if known else (),
        limbs=limbs,
        time_s=times,
        angles_rad=at.angles_rad,
        rates_rad_s=at.rates_rad_s,
        torques_nm=at.torques_nm,
        origin_m=at.origin_m,
        quaternion=_quaternions_of(rotations_of(at.rotation_rad)),
        com_m=at.com_m,
        velocity_m_s=at.velocity_m_s,
        turning_rad_s=at.angular_velocity_rad_s,
        contact=at.stands,
        forces_n=at.forces_n,
        feet_m=at.feet_m,
        robot=robot,
        source=source,
    )


def _quaternions_of(rotations: Array) -> Array:
    """Quaternions w, x, y, z of rotation matrices, shape (T, 4), each on the side of the one
    before.
    """
    from scipy.spatial.transform import Rotation

    quaternions = np.asarray(Rotation.from_matrix(rotations).as_quat(scalar_first=True))
    turned = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    return np.asarray(
        quaternions
        * np.where(np.concatenate([[False], np.cumsum(turned) % 2 == 1]), -1.0, 1.0)[:, None]
    )
