"""A motion as a table: one row per moment, one column per number, with names, as other programs
read and write it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked_name

FORMAT = "stancekit/motion/1"
OF_JOINTS = {"angles_rad": "q", "rates_rad_s": "qd", "torques_nm": "tau"}
"""Arrays with a column per joint, and what the columns' names begin with."""
OF_LIMBS = {"contact": "contact", "forces_n": "force", "feet_m": "foot"}
"""The same of those with a column, or three, per limb."""
EVEN = 1e-4
"""Times are a uniform grid to this share of a step; files round them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionTable:
    """A motion at T moments of a uniform grid, of J joints and N limbs; what is not known is None.

    Arguments:
        joints, limbs: their names, in the order of the columns.
        time_s: shape (T,) [s].
        angles_rad, rates_rad_s, torques_nm: of the joints, shape (T, J) [rad], [rad/s], [Nm].
        origin_m: of the body's link, world frame, shape (T, 3).
        quaternion: R_WB of the body's link as w, x, y, z, shape (T, 4).
        com_m, velocity_m_s: centre of mass of the whole robot, and its velocity, world frame, shape
        (T, 3).
        turning_rad_s: angular velocity of the body, world frame, shape (T, 3).
        contact: whether each limb stands, shape (T, N).
        forces_n: contact forces on the robot, world frame, shape (T, N, 3).
        feet_m: centres of the feet, world frame, shape (T, N, 3).
        robot, source: what moves, and where the motion is from, for people.
    """

    joints: tuple[str, ...]
    limbs: tuple[str, ...]
    time_s: Array
    angles_rad: Array | None = None
    rates_rad_s: Array | None = None
    torques_nm: Array | None = None
    origin_m: Array | None = None
    quaternion: Array | None = None
    com_m: Array | None = None
    velocity_m_s: Array | None = None
    turning_rad_s: Array | None = None
    contact: NDArray[np.bool_] | None = None
    forces_n: Array | None = None
    feet_m: Array | None = None
    robot: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        for names, kind in ((self.joints, "joints"), (self.limbs, "limbs")):
            for name in names:
                checked_name(name, kind)
            if len(set(names)) != len(names):
                raise InvalidInput(f"{kind}: expected different names, got {', '.join(names):.200}")
        for name, shape in shapes(len(self.time_s), len(self.joints), len(self.limbs)).items():
            value = getattr(self, name)
            if value is None:
                continue
            array = np.array(value, dtype=np.bool_ if name == "contact" else np.float64)
            if array.shape != shape:
                raise InvalidInput(f"{name}: expected shape {shape}, got {array.shape}")
            if not np.isfinite(array).all():
                row = int(np.argwhere(~np.isfinite(array))[0, 0])
                raise InvalidInput(
                    f"{name}: row {row}: expected finite numbers, got "
                    f"{array[row][~np.isfinite(array[row])][0]}"
                    if array.ndim > 1
                    else f"{name}: row {row}: expected a finite number, got {array[row]}"
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        _check_times(self.time_s)

    @property
    def rate_hz(self) -> float:
        """Rows per second."""
        return float((len(self.time_s) - 1) / (self.time_s[-1] - self.time_s[0]))

    @property
    def rotation(self) -> Array:
        """R_WB, shape (T, 3, 3).

        Raises InvalidInput where it is not known.
        """
        if self.quaternion is None:
            raise InvalidInput("quaternion: expected how the body is turned, got nothing")
        return _rotations_from(self.quaternion)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of names and numbers, to the last bit."""
        content = hashlib.sha256(repr((self.joints, self.limbs)).encode())
        for name, array in self.known().items():
            content.update(
                f"\n{name} {array.dtype.str} {array.shape}\n".encode()
                + np.ascontiguousarray(array).tobytes()
            )
        return content.hexdigest()

    def known(self) -> dict[str, NDArray[Any]]:
        """The arrays that are there, by name."""
        columns = {name: getattr(self, name) for name in shapes(0, 0, 0)}
        return {name: array for name, array in columns.items() if array is not None}


def shapes(rows: int, joints: int, limbs: int) -> dict[str, tuple[int, ...]]:
    """The shape of each array of a table with so many of them."""
    return {
        "time_s": (rows,),
        "angles_rad": (rows, joints),
        "rates_rad_s": (rows, joints),
        "torques_nm": (rows, joints),
        "origin_m": (rows, 3),
        "quaternion": (rows, 4),
        "com_m": (rows, 3),
        "velocity_m_s": (rows, 3),
        "turning_rad_s": (rows, 3),
        "contact": (rows, limbs),
        "forces_n": (rows, limbs, 3),
        "feet_m": (rows, limbs, 3),
    }


def _check_times(times_s: Array) -> None:
    """Raise InvalidInput for times that are no uniform grid: fewer than two, backwards, with
    gaps.
    """
    if len(times_s) < 2:
        raise InvalidInput(f"time_s: expected two rows or more, got {len(times_s)}")
    steps = np.diff(times_s)
    if not float(steps.min()) > 0.0:
        row = int(steps.argmin())
        raise InvalidInput(
            f"time_s: row {row + 1}: expected times that increase, got {times_s[row]:g} s then "
            f"{times_s[row + 1]:g} s"
        )
    usual = float(np.median(steps))
    off = np.abs(steps - usual)
    if float(off.max()) > EVEN * usual:
        row = int(off.argmax())
        raise InvalidInput(
            f"time_s: row {row + 1}: expected a uniform grid, got a gap of {steps[row]:.6g} s at "
            f"{times_s[row]:g} s "
            f"where others are {usual:.6g} s"
        )


def _rotations_from(quaternions: Array) -> Array:
    """Rotation matrices of quaternions w, x, y, z, shape (T, 3, 3).

    Raises InvalidInput for other lengths than 1.
    """
    from scipy.spatial.transform import Rotation

    sizes = np.linalg.norm(quaternions, axis=1)
    if (off := np.abs(sizes - 1.0)).max() > 1e-3:
        row = int(off.argmax())
        raise InvalidInput(f"quaternion: row {row}: expected a length of 1, got {sizes[row]:.4g}")
    return np.asarray(Rotation.from_quat(quaternions, scalar_first=True).as_matrix())
