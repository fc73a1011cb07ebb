"""The one form in which motions are sampled: what body, feet and joints should do at given
times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..answer.motion import Evidence
from ..errors import InvalidInput
from ..files.arrays import Array, cached_arrays, checked, checked_name, cross, grain
from ..robot.leg import rotations_of
from ..terrain.patch import Solid, contact_frames

if TYPE_CHECKING:
    from .path import PlanPath, Segment

T = TypeVar("T", float, Array)
_FOLLOWS = ("stands", "steep", "rotation", "along_n", "across_n", "arms_m", "wrench", "frames")
"""Properties of samples that are worked out once."""
_SMALL_RAD2 = 1e-6
"""Below this squared angle series take the place of sines and cosines."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A motion at T times, N limbs, J joints; at a single time the leading dimension T is missing.

    Arguments:
        com_m, velocity_m_s: centre of mass, shape (T, 3).
        rotation_rad, rotation_rate_rad_s: rotation vector of the body and its derivative, shape (T,
        3).
        frame: progress in key frames, e.g. 1.5 half way from frame 1 to 2, or in seconds for a walk
            or a leap; (T,).
        feet_m: centres of the feet, shape (T, N, 3).
        radii_m: radii of the feet, shape (N,).
        forces_n: contact forces on the robot, shape (T, N, 3).
        foothold: number of the foothold under every limb, −1 in the air, shape (T, N).
        normals, friction: of the surface that a limb stands on, leaves or comes to, shape (T, N,
        3), (T, N).
        origin_m: of the frame of the body's link, shape (T, 3); None where the joints are not
            known.
        angles_rad, rates_rad_s, torques_nm: of the joints, shape (T, J); None where they are not
        known.
        moments_nm: of the forces on soles about their middles, shape (T, N, 3); None of point feet.
    """

    com_m: Array
    velocity_m_s: Array
    rotation_rad: Array
    rotation_rate_rad_s: Array
    frame: Array
    feet_m: Array
    radii_m: Array
    forces_n: Array
    foothold: NDArray[np.int_]
    normals: Array
    friction: Array
    origin_m: Array | None = None
    angles_rad: Array | None = None
    rates_rad_s: Array | None = None
    torques_nm: Array | None = None
    moments_nm: Array | None = None

    @property
    def angular_velocity_rad_s(self) -> Array:
        """Angular velocity of the body, in the world frame, shape (T, 3)."""
        return _angular_velocity(self.rotation_rad, self.rotation_rate_rad_s)

    @property
    def toes_m(self) -> Array:
        """Lowest points of the feet, a radius below their centres along the normal, shape (T, N,
        3).
        """
        return np.asarray(self.feet_m - self.radii_m[:, None] * self.normals)

    @cached_arrays
    def stands(self) -> NDArray[np.bool_]:
        """Tell whether each limb has a foothold, shape (T, N)."""
        return np.asarray(self.foothold >= 0)

    @cached_arrays
    def steep(self) -> NDArray[np.bool_]:
        """Tell whether the slope exceeds atan μ, so that friction alone holds no weight, shape (T,
        N).
        """
        return np.asarray(self.normals[..., 2] * np.hypot(1.0, self.friction) < 1.0)

    @cached_arrays
    def rotation(self) -> Array:
        """R_WB, the rotation matrix of the body, shape (T, 3, 3)."""
        return rotations_of(self.rotation_rad)

    @cached_arrays
    def along_n(self) -> Array:
        """Parts of the forces along the normals, shape (T, N)."""
        return np.asarray(np.einsum("...ij,...ij->...i", self.forces_n, self.normals))

    @cached_arrays
    def across_n(self) -> Array:
        """Sizes of what the forces have across the normals, shape (T, N)."""
        return np.asarray(
            np.linalg.norm(self.forces_n - self.along_n[..., None] * self.normals, axis=-1)
        )

    @cached_arrays
    def arms_m(self) -> Array:
        """Vectors from the centre of mass to the centres of the feet, world frame, shape (T, N, 3)
        [m].
        """
        return np.asarray(self.feet_m - self.com_m[..., None, :])

    @cached_arrays
    def wrench(self) -> Array:
        """Sum of the forces [N] and of their moments about the centre of mass [Nm], world frame,
        shape (T, 6).
        """
        turning = cross(self.arms_m, self.forces_n).sum(axis=-2)
        if self.moments_nm is not None:
            turning = turning + self.moments_nm.sum(axis=-2)
        return np.concatenate([self.forces_n.sum(axis=-2), turning], axis=-1)

    @cached_arrays
    def frames(self) -> Array:
        """R_WC of the surfaces, each with the axis that lies nearest to it as its shear reference,
        (T, N, 3, 3).
        """
        return contact_frames(self.normals, np.eye(3)[np.abs(self.normals).argmin(axis=-1)])

    def rows(self) -> list[Self]:
        """The samples at T times one by one, with what follows from them, which is worked out for
        all at once.
        """
        names = [
            name
            for name in self.__annotations__
            if getattr(self, name) is not None and name != "radii_m"
        ]
        tables = {name: getattr(self, name) for name in (*names, *_FOLLOWS)}
        arrays, samples = vars(self) | {"radii_m": self.radii_m}, list[Self]()
        for row in range(len(self.com_m)):
            sample = object.__new__(type(self))
            vars(sample).update(arrays)
            vars(sample).update((name, table[row]) for name, table in tables.items())
            samples.append(sample)
        return samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Played:
    """A motion over time, which a film shows, a tracker follows and an export writes.

    Arguments:
        at: the samples at times, shape (T,), or at a single one [s]; before 0 and after the end the
            ends are held.
        knots_s: times from 0 to the end at which postures are chosen, the same moments at every pace,
            shape (K,) [s].
        solids: solids that limbs keep off.
        stances: name of every foothold that samples count.
        rest_s: time at rest before anything moves, load among it [s].
        committed_s: from when to when the body is on its way through the air whatever its legs do,
            per leap [s].
        pace: of that asked for, 1 where joints and soles let it.
        bound_by: what made it slower, empty at 1.
        path: of a plan's motion, the path that it follows.
        segments, seconds: of a plan's motion, the parts of the path in order, and how long each of
            them lasts, shape (P,).
        lasting: of a plan's motion, the same one with parts that last so long, shape (P,) [s].
    """

    at: Callable[[float | Array], Samples]
    knots_s: Array
    solids: tuple[Solid, ...] = ()
    stances: tuple[str, ...] = ()
    rest_s: float | None = None
    committed_s: tuple[tuple[float, float], ...] = ()
    pace: float = 1.0
    bound_by: str = ""
    path: PlanPath | None = None
    segments: tuple[Segment, ...] = ()
    seconds: Array | None = None
    lasting: Callable[[Array], Played] | None = None

    @property
    def duration_s(self) -> float:
        """Time from the beginning to the end [s]."""
        return float(self.knots_s[-1])


def combined(samples: Sequence[Samples], join: Callable[[list[Any]], Any]) -> Samples:
    """Samples each of whose tables is made of the same one of some samples; not known where one of
    them is not.
    """
    known = dict[str, Any]()
    for name in (field.name for field in fields(Samples) if field.name != "radii_m"):
        tables = [getattr(sample, name) for sample in samples]
        known[name] = None if any(table is None for table in tables) else join(tables)
    return Samples(**known, radii_m=samples[0].radii_m)


def stacked(samples: Sequence[Samples]) -> Samples:
    """Single samples as one value with a row for each."""
    return combined(samples, np.array)


def between(rows: Samples, at: Array) -> Samples:
    """Samples between rows, at fractional indices of shape (T,) or (): straight lines join the
    rows.

    Footholds are those of the row before; an index within 1e-6 of a row is that row.
    """
    last = len(rows.com_m) - 1
    near = np.clip(np.where(np.abs(at - np.round(at)) < 1e-6, np.round(at), at), 0.0, last)
    first = np.floor(near).astype(int)
    then, share = np.minimum(first + 1, last), near - first

    def mixed(tables: list[Array]) -> Array:
        (table,) = tables
        weight = share.reshape(share.shape + (1,) * (table.ndim - 1))
        return np.asarray(table[first] + weight * (table[then] - table[first]))

    return replace(combined([rows], mixed), foothold=rows.foothold[first])


def smooth(s: T) -> T:
    """A quintic from 0 to 1 with no velocity and no acceleration at its ends."""
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def smooth_rate(s: T) -> T:
    """The derivative of ``smooth``."""
    return 30.0 * s * s * (1.0 - s) * (1.0 - s)


def _angular_velocity(rotation_rad: Array, rate_rad_s: Array) -> Array:
    """J(Θ) Θ̇ of a body whose rotation vector Θ changes at a rate, shape (…, 3) [rad/s].

    J(Θ) = I + (1 − cos a) / a² [Θ]× + (a − sin a) / a³ [Θ]×², a = |Θ|.
    """
    square = np.vecdot(rotation_rad, rotation_rad)[..., None]
    large = square > _SMALL_RAD2
    angle = np.sqrt(np.where(large, square, 1.0))
    first = np.where(large, (1.0 - np.cos(angle)) / angle**2, 0.5 - square / 24.0)
    second = np.where(large, (angle - np.sin(angle)) / angle**3, 1.0 / 6.0 - square / 120.0)
    once = cross(rotation_rad, rate_rad_s)
    return np.asarray(rate_rad_s + first * once + second * cross(rotation_rad, once))


def rotation_rate(rotation_rad: Array, angular_velocity_rad_s: Array) -> Array:
    """The inverse of ``_angular_velocity``: J(Θ)⁻¹ ω, shape (…, 3) [rad/s].

    J(Θ)⁻¹ = I − ½ [Θ]× + (1 − a / 2 · cot(a / 2)) / a² [Θ]×².
    """
    square = np.vecdot(rotation_rad, rotation_rad)[..., None]
    large = square > _SMALL_RAD2
    half = 0.5 * np.sqrt(np.where(large, square, 1.0))
    second = np.where(large, (1.0 - half / np.tan(half)) / (4.0 * half**2), 1.0 / 12.0)
    once = cross(rotation_rad, angular_velocity_rad_s)
    return np.asarray(angular_velocity_rad_s - 0.5 * once + second * cross(rotation_rad, once))


FORMAT = "stancekit/motion/1"
OF_JOINTS = MappingProxyType({"angles_rad": "q", "rates_rad_s": "qd", "torques_nm": "tau"})
"""Arrays with a column per joint, and what the columns' names begin with."""
OF_LIMBS = MappingProxyType({"contact": "contact", "forces_n": "force", "feet_m": "foot"})
"""The same of those with a column, or three, per limb."""
_LARGEST = 1e10
"""No place, speed or force of a motion is larger, nor seconds since 1970 for some centuries."""
_EVEN = 0.1
"""Times are those of a uniform grid to this share of a step: stamps of logs jitter."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionTable(Evidence):
    """A motion at T moments of a uniform grid, of J joints and N limbs; a column that is not known
    is absent.

    Arguments:
        joints, limbs: their names, in the order of the columns.
        columns: arrays by name, in the order of ``shapes``, None for an absent one:

            - time_s, shape (T,) [s], as the file has them: rounded, and off the grid by as much as
              the stamps of a log jitter;
            - angles_rad, rates_rad_s, torques_nm: of the joints, shape (T, J) [rad], [rad/s], [Nm];
            - origin_m: of the body's link, world frame, shape (T, 3);
            - quaternion: R_WB of the body's link as w, x, y, z, shape (T, 4);
            - com_m, velocity_m_s: centre of mass of the whole robot, and its velocity, world frame,
              shape (T, 3);
            - turning_rad_s: angular velocity of the body, world frame, shape (T, 3);
            - contact: whether each limb stands, shape (T, N);
            - forces_n: contact forces on the robot, world frame, shape (T, N, 3);
            - feet_m: centres of the feet, world frame, shape (T, N, 3).
        robot, source: what moves, and where the motion is from, for people.
        doubts: numbers of the robot's file that were guessed, a line each, in what was judged.
    """

    joints: tuple[str, ...]
    limbs: tuple[str, ...]
    columns: Mapping[str, Any]
    robot: str = ""
    source: str = ""
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for names, kind in ((self.joints, "joints"), (self.limbs, "limbs")):
            for name in names:
                checked_name(name, kind)
            if len(set(names)) != len(names):
                raise InvalidInput(f"{kind}: expected different names, got {', '.join(names):.200}")
        known = dict[str, NDArray[Any]]()
        for name, shape in shapes(len(self.time_s), len(self.joints), len(self.limbs)).items():
            if self.columns.get(name) is None:
                continue
            array = np.array(
                self.columns[name], dtype=np.bool_ if name == "contact" else np.float64
            )
            if array.shape != shape:
                raise InvalidInput(f"{name}: expected shape {shape}, got {array.shape}")
            off = ~(np.abs(array) <= _LARGEST)  # NaN, too
            if off.any():
                at = tuple(np.argwhere(off)[0])
                raise InvalidInput(
                    f"{name}: row {at[0]}: expected numbers up to {_LARGEST:g}, got {array[at]:g}"
                )
            array.setflags(write=False)
            known[name] = array
        object.__setattr__(self, "columns", known)
        _check_times(self.time_s)

    def with_columns(self, **columns: Array | None) -> MotionTable:
        """The table with these in place of its own, and without those that are None."""
        return replace(self, columns={**self.columns, **columns})

    @property
    def time_s(self) -> Array:
        """The moments, shape (T,) [s]."""
        return np.asarray(self.columns["time_s"])

    @property
    def rate_hz(self) -> float:
        """Rows per second."""
        return 1.0 / _grid(self.time_s)[0]

    @property
    def rotation(self) -> Array:
        """R_WB, shape (T, 3, 3).

        Raises InvalidInput where it is not known.
        """
        if "quaternion" not in self.columns:
            raise InvalidInput("quaternion: expected the orientation of the body, got none")
        return _rotations_from(self.columns["quaternion"])

    @property
    def question(self) -> dict[str, Any]:
        """Names of joints and limbs, since a plan has no request of its own."""
        return {"joints": self.joints, "limbs": self.limbs}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that are known, by name."""
        return dict(self.columns)


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


def _grid(times_s: Array) -> tuple[float, Array]:
    """The step of the uniform grid nearest to times [s], and their distances from it, shape (T,)."""
    rows, since = np.arange(len(times_s)) - 0.5 * (len(times_s) - 1), times_s - times_s[0]
    step = float(rows @ since / (rows @ rows))
    return step, np.abs(since - since.mean() - step * rows)


def _check_times(times_s: Array) -> None:
    """Raise InvalidInput for fewer than two times, and for such that are no uniform grid, to a
    share of a step, or to the digits that the file has where these are less than a third of one.
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
    step, off = _grid(times_s)
    unit = grain(times_s)
    if float(off.max()) > max(_EVEN * step, 0.55 * unit if 3.0 * unit <= step else 0.0):
        usual = float(np.median(steps))
        row = int(np.abs(steps - usual).argmax())
        raise InvalidInput(
            f"time_s: row {row + 1}: expected a uniform grid, got a gap of {steps[row]:.6g} s at "
            f"{times_s[row]:g} s where others are {usual:.6g} s"
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


LARGEST_RATE_HZ = 10_000.0


def table_of(
    motion: Played,
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
    return MotionTable(
        joints=() if at.angles_rad is None else joints,
        limbs=limbs,
        columns={
            "time_s": times,
            "angles_rad": at.angles_rad,
            "rates_rad_s": at.rates_rad_s,
            "torques_nm": at.torques_nm,
            "origin_m": at.origin_m,
            "quaternion": _quaternions_of(at.rotation),
            "com_m": at.com_m,
            "velocity_m_s": at.velocity_m_s,
            "turning_rad_s": at.angular_velocity_rad_s,
            "contact": at.stands,
            "forces_n": at.forces_n,
            "feet_m": at.feet_m,
        },
        robot=robot,
        source=source,
    )


def _quaternions_of(rotations: Array) -> Array:
    """Quaternions w, x, y, z of rotation matrices, shape (T, 4), each on the side of the one
    before.
    """
    from scipy.spatial.transform import Rotation

    return one_sided(np.asarray(Rotation.from_matrix(rotations).as_quat(scalar_first=True)))


def one_sided(quaternions: Array) -> Array:
    """The same turns, each on the side of the one before: q and −q are one, shape (T, 4)."""
    turned = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(quaternions * np.cumprod(np.append(1.0, turned))[:, None])
