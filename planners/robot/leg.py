"""One leg of a robot's model: its joints by name, the kinematics of their chain, where its foot is,
and what drives its joints.

A leg is a chain of n joints from the base to its foot. Every joint's frame is turned so that the
joint moves about, or along, its own z: then p_BF = P₁ Z₁(q₁) P₂ Z₂(q₂) … Pₙ Zₙ(qₙ) t, where only
the Z depend on the posture, and a point goes from the foot's end to the base with four products a
joint. K postures are one array; nothing is looped over them.

Actuators are data: how much torque for a moment, how much for ever, how fast, and how soon they are
hot.

A file ``stancekit/actuators/1``, YAML or JSON, says which joint has which: ``joints`` maps names,
or patterns such as ``*_knee``, to names of ``actuators``, those of the file or those that come with
the package; the first that fits is it. Where there is no file, joints have what the robot's own
URDF says: its effort, at any speed up to its velocity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from importlib import resources
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from ..errors import InvalidInput
from ..files.arrays import (
    Array,
    cached_arrays,
    check_numbers,
    checked,
    collect_errors,
    cross,
    read_only,
    skew,
)
from ..files.codec import LATER, Within, check_limits
from ..files.documents import Strict, parse_yaml, read_json, read_yaml, shown, validated
from ..terrain.polygon import checked_sole, half_planes

_SMALL_RAD = 1e-3
"""Below this angle, sin(a/2) / a is its series."""


def rotation_of(vector: ArrayLike) -> Array:
    """exp([v]×): the rotation matrix of a rotation vector, shape (3,) [rad] → (3, 3), read-only."""
    return _rotation_of(np.array(vector, dtype=np.float64).tobytes())


@lru_cache(
    maxsize=64
)  # of one control period, and of the postures of one plan: each is asked for several times
def _rotation_of(vector: bytes) -> Array:
    matrix = rotations_of(np.frombuffer(vector))
    matrix.flags.writeable = False
    return matrix


def small_turns(rotations: Array) -> Array:
    """Turns from each rotation to the next, shape (T, …, 3, 3) to (T − 1, …, 3), which are small:
    their sines about their axes.
    """
    between = rotations[1:] @ np.swapaxes(rotations[:-1], -2, -1)
    skewed = 0.5 * (between - np.swapaxes(between, -2, -1))
    return np.stack([skewed[..., 2, 1], skewed[..., 0, 2], skewed[..., 1, 0]], axis=-1)


def rotations_of(vectors: Array) -> Array:
    """Rotation matrices of many vectors, shape (…, 3) to (…, 3, 3), by quaternions.

    SciPy's ``Rotation.from_rotvec(vectors).as_matrix()`` gives the same numbers to the last bit;
    its import takes longer than a plan takes to find.
    """
    x, y, z = np.moveaxis(np.asarray(vectors, dtype=np.float64), -1, 0)
    angle = np.sqrt(x * x + y * y + z * z)
    square, each = angle * angle, angle.ravel().tolist()
    large = np.array([math.sin(0.5 * a) / a if a > _SMALL_RAD else 0.0 for a in each]).reshape(
        angle.shape
    )
    scale = np.where(angle > _SMALL_RAD, large, 0.5 - square / 48.0 + square * square / 3840.0)
    w = np.array([math.cos(0.5 * a) for a in each]).reshape(angle.shape)
    x, y, z = scale * x, scale * y, scale * z
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    rows = (
        (xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)),
        (2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)),
        (2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def continued(vectors: Array) -> Array:
    """The same rotations by the vectors that are nearest to the one before, shape (K, 3) [rad].

    A heading that passes half a turn goes on there, where rotation vectors jump by a whole one.
    """
    result = np.array(vectors, dtype=np.float64)
    if not np.any(np.linalg.norm(np.diff(result, axis=0), axis=1) > math.pi):
        return result
    for before, vector in pairwise(result):  # rows of it, which are changed
        if (angle := float(np.linalg.norm(vector))) > 0.0:
            axis = vector / angle
            vector += math.tau * np.rint((before @ axis - angle) / math.tau) * axis
    return result


def between_rotations(first: Array, last: Array, share: Array) -> Array:
    """Rotations a share of the way from one to another, each by less than half a turn about one
    axis: (L, 3, 3).
    """
    vectors = vectors_of(np.swapaxes(first, 1, 2) @ last)
    return np.asarray(first @ rotations_of(share[:, None] * vectors))


def vectors_of(turns: Array) -> Array:
    """Rotation vectors of matrices that turn by less than half a turn, shapes (K, 3, 3) to (K, 3)
    [rad].
    """
    skew = 0.5 * (turns - np.swapaxes(turns, 1, 2))
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turns, axis1=1, axis2=2) - 1.0))
    return np.asarray(
        axis * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)[:, None]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """n joints from the base to a foot.

    Arguments:
        rotations, origins: pose of each joint's frame in the one before it (the first in the base),
            at q = 0, shapes (n, 3, 3) and (n, 3) [m].
        axes: unit vectors in the joint's own frame, shape (n, 3).
        slides: truth values, True for prismatic joints, shape (n,).
        tip_m: the foot in the last joint's frame, shape (3,) [m].
    """

    rotations: Array
    origins: Array
    axes: Array
    slides: NDArray[np.bool_]
    tip_m: Array
    turns: Array = field(init=False, repr=False)
    """From every joint's turned frame, whose z is the joint's axis, into its own, shape (n, 3,
    3)."""
    steps: Array = field(init=False, repr=False)
    shifts: Array = field(init=False, repr=False)
    """``rotations`` and ``origins`` between turned frames."""
    tip: Array = field(init=False, repr=False)
    """The foot in the last joint's turned frame, shape (3,) [m]."""

    def __post_init__(self) -> None:
        for name, shape in (
            ("rotations", (None, 3, 3)),
            ("origins", (None, 3)),
            ("axes", (None, 3)),
            ("tip_m", (3,)),
        ):
            object.__setattr__(self, name, read_only(getattr(self, name), shape, name))
        turns = np.array([_with_z(axis) for axis in self.axes])
        before = np.concatenate([np.eye(3)[None], turns[:-1]]).transpose(0, 2, 1)
        steps = np.einsum("nij,njk,nkl->nil", before, self.rotations, turns)
        shifts = np.einsum("nij,nj->ni", before, self.origins)
        for name, value in (
            ("turns", turns),
            ("steps", steps),
            ("shifts", shifts),
            ("tip", turns[-1].T @ self.tip_m),
        ):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @property
    def joints(self) -> int:
        """n, the number of joints."""
        return len(self.axes)

    @property
    def length_m(self) -> float:
        """From the first joint to the foot by way of the joints between [m]: if none slides, no
        foot is farther.
        """
        return float(np.linalg.norm(self.origins[1:], axis=1).sum() + np.linalg.norm(self.tip_m))

    def feet(self, angles: ArrayLike) -> Array:
        """Feet p_BF for postures of shape (K, n) [rad, or m where a joint slides], shape (K, 3)
        [m].
        """
        q = np.asarray(angles, dtype=np.float64)
        moved = np.repeat(self.tip[:, None, None], len(q), axis=2)
        for i in reversed(range(self.joints)):
            moved = self.outward(i, moved, q[:, i])
        return np.ascontiguousarray(moved[:, 0].T)

    def feet_and_jacobian(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Feet, shape (K, 3) [m], and ∂p_BF/∂q, shape (K, 3, n) [m per rad, or per m], both in the
        base's frame.
        """
        q = np.asarray(angles, dtype=np.float64)
        moved = np.empty(
            (3, self.joints + 1, len(q))
        )  # the foot, then a column a joint: all of them turn alike
        moved[:, 0] = self.tip[:, None]
        for i in reversed(range(self.joints)):
            column = moved[:, self.joints - i]
            if self.slides[i]:
                column[:] = np.array([0.0, 0.0, 1.0])[:, None]
            else:
                column[0], column[1], column[2] = (
                    -moved[1, 0],
                    moved[0, 0],
                    0.0,
                )  # z × v, before z turns it
            part = moved[:, : self.joints - i + 1]
            part[:] = self._turned(i, part, q[:, i])
            part[:, 0] += self._shift(i, q[:, i])
        return np.ascontiguousarray(moved[:, 0].T), np.ascontiguousarray(
            moved[:, :0:-1].transpose(2, 0, 1)
        )

    def frames(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Frames of the joints as the URDF has them: R_BJ, shape (K, n, 3, 3), and p_BJ, shape (K,
        n, 3) [m].
        """
        q = np.asarray(angles, dtype=np.float64)
        turns, places = np.empty((len(q), self.joints, 3, 3)), np.empty((len(q), self.joints, 3))
        turn, place = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
        for i in range(self.joints):
            place = place + turn @ self.origins[i]
            turn = turn @ self.rotations[i]
            if self.slides[i]:
                place = place + (turn @ self.axes[i]) * q[:, i : i + 1]
            else:
                turn = turn @ _about(self.axes[i], q[:, i])
            turns[:, i], places[:, i] = turn, place
        return turns, places

    def outward(self, joint: int, points: Array, angles: Array) -> Array:
        """Points of one joint's turned frame in the one before it (the base's for the first), at
        the joint's angles.

        So the feet are this over all joints, from the last to the first.

        Arguments:
            points: shape (3, M, K).
            angles: shape (K,).
        """
        return self._turned(joint, points, angles) + self._shift(joint, angles)[:, None]

    def _turned(self, joint: int, vectors: Array, angles: Array) -> Array:
        """Vectors of shape (3, M, K) in the frame before."""
        if not self.slides[joint]:
            cosine, sine, (x, y, z) = np.cos(angles), np.sin(angles), vectors
            vectors = np.empty_like(vectors)
            vectors[0], vectors[1], vectors[2] = cosine * x - sine * y, sine * x + cosine * y, z
        return np.asarray((self.steps[joint] @ vectors.reshape(3, -1)).reshape(vectors.shape))

    def _shift(self, joint: int, angles: Array) -> Array:
        """The frame's origin in the frame before, shape (3, K)."""
        if not self.slides[joint]:
            return np.repeat(self.shifts[joint][:, None], len(angles), axis=1)
        return np.asarray(self.shifts[joint][:, None] + self.steps[joint][:, 2:] * angles)


def _with_z(axis: Array) -> Array:
    """A rotation that takes z to a unit vector, shape (3, 3)."""
    x = cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, cross(axis, x), axis])


def _about(axis: Array, angles: Array) -> Array:
    """Rotations about a unit axis (Rodrigues), shape (K, 3, 3)."""
    across = skew(axis)
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * across + (1.0 - cosine) * (across @ across))


FULL_TURN = 2.0 * np.pi - 1e-6


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint as its URDF has it: what it may do.

    Radians, or metres where it slides; newtons there instead of Nm.

    Arguments:
        torque_nm, velocity_rad_s: 0 where the file does not say.
    """

    name: str
    lower_rad: float
    upper_rad: float
    torque_nm: float
    velocity_rad_s: float
    slides: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class FootContact:
    """A foot's contact as a person describes it: a point, a ball about that point, or a flat sole
    around it.

    Arguments:
        point_m: the point in the frame of the foot's link, shape (3,) [m].
        radius_m: radius of the ball, 0 for a point and for a sole [m].
        sole_m: corners (forward, left) of a sole about the point, level while all joints are at 0,
            shape (K, 2) [m]; None for a foot without one.
    """

    point_m: Array = field(default_factory=lambda: np.zeros(3))
    radius_m: float = 0.0
    sole_m: Array | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_m", read_only(self.point_m, (3,), "contact: point_m"))
        object.__setattr__(self, "radius_m", checked(self.radius_m, "contact: radius_m", least=0.0))
        if self.sole_m is not None:
            object.__setattr__(self, "sole_m", checked_sole(self.sole_m, "contact: sole_m"))
            if self.radius_m > 0.0:
                raise InvalidInput(
                    f"contact: radius_m: expected 0 beside a sole, got {self.radius_m:g}"
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class FootSole:
    """A flat foot, whose middle is its chain's end.

    Arguments:
        points_m: corners (forward, left) about the middle, counterclockwise, shape (K, 2) [m].
        rotation: from the sole's axes, forward, left and up, into those of the last joint, shape
            (3, 3).
    """

    points_m: Array
    rotation: Array

    @property
    def size_m(self) -> tuple[float, float]:
        """Length and width [m]."""
        length, width = np.ptp(self.points_m, axis=0).tolist()
        return length, width

    @property
    def radius_m(self) -> float:
        """Distance of the farthest corner from the middle [m]."""
        return float(np.linalg.norm(self.points_m, axis=1).max())

    def holds(self, points_m: Array) -> bool:
        """Tell whether points, shape (K, 2) [m], are on the sole."""
        normals, offsets = half_planes(self.points_m)
        return bool(np.all(points_m @ normals.T <= offsets + 1e-6))


def levelled(up: Array) -> Array:
    """Axes of a sole that looks along x, on ground along these normals, as columns, shapes (…, 3) to
    (…, 3, 3).
    """
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    ahead = np.array([1.0, 0.0, 0.0]) - up[..., :1] * up
    ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    return np.stack([ahead, cross(up, ahead), up], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mount:
    """The place of a link on the robot: the body that carries it, and where the link is in that
    body's frame.

    Arguments:
        leg: number of the leg whose joint carries the link; None for the base and for arms at rest.
        joint: number of that joint in the leg, −1 for the base.
        rotation: rotation from the link's frame to the joint's or the base's, shape (3, 3).
        origin_m: origin of the link in that frame, shape (3,) [m].
    """

    leg: int | None
    joint: int
    rotation: Array
    origin_m: Array

    def placed(self, points: Array) -> Array:
        """Points of the link, shape (K, 3) [m], in that body's frame."""
        return np.asarray(self.origin_m + points @ self.rotation.T)


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A chain of joints from the base to a foot.

    Arguments:
        joints: the joints from the base outward.
        chain: their kinematics, in the same order.
        foot: the link that touches, a sphere of radius_m [m] about the chain's end, 0 for a point.
        stance_rad: the posture in which it stands, shape (n,).
        contact: shape that touches, as a YAML file gives it; None if the collision shapes show it.
        doubt: reason why the contact shape is not known; plans for such a leg are refused.
        sole: the flat foot that touches, in place of a sphere; None for others.
    """

    name: str
    joints: tuple[Joint, ...]
    chain: Chain
    foot: str
    radius_m: float
    stance_rad: Array
    contact: FootContact | None = None
    doubt: str = ""
    sole: FootSole | None = None

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "stance_rad",
            read_only(self.stance_rad, (len(self.joints),), f"{self.name}: stance_rad"),
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, from the base outward."""
        return tuple(joint.name for joint in self.joints)

    @property
    def lower_rad(self) -> Array:
        """Lower limits, shape (n,)."""
        return np.array([joint.lower_rad for joint in self.joints])

    @property
    def upper_rad(self) -> Array:
        """Upper limits, shape (n,)."""
        return np.array([joint.upper_rad for joint in self.joints])

    @property
    def turns(self) -> np.ndarray:
        """Tell which joints turn freely: their limits are a whole turn apart, and every angle is
        within them, shape (n,).
        """
        return np.array(
            [
                not joint.slides and joint.upper_rad - joint.lower_rad > FULL_TURN
                for joint in self.joints
            ]
        )

    def wrapped(self, angles: Array) -> Array:
        """Turn joints that turn freely between their limits again, shape (K, n)."""
        return np.where(
            self.turns, self.lower_rad + np.mod(angles - self.lower_rad, 2.0 * np.pi), angles
        )

    @property
    def torque_nm(self) -> Array:
        """Torque limits, shape (n,) [Nm]."""
        return np.array([joint.torque_nm for joint in self.joints])

    @property
    def hip_m(self) -> Array:
        """p_BH, the first joint's origin in the base's frame, shape (3,) [m]."""
        return np.asarray(self.chain.origins[0])

    @cached_arrays
    def nominal_m(self) -> Array:
        """p_BF in the standing posture, shape (3,) [m]."""
        return np.asarray(self.chain.feet(self.stance_rad[None])[0])

    def random_angles(self, count: int, rng: np.random.Generator) -> Array:
        """Postures spread evenly over the joint limits, shape (count, n)."""
        return rng.uniform(self.lower_rad, self.upper_rad, (count, len(self.joints)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LegSlopes:
    """K postures of N legs with J joints in all, turned into the world.

    Arguments:
        feet: R_WB p_BF, shape (K, N, 3) [m].
        levers: levers of every joint, shape (K, J, 3) [m].
        axes: a, shape (K, J, 3).
    """

    feet: Array
    levers: Array
    axes: Array

    @classmethod
    def of(cls, legs: Sequence[Leg], angles: Array, rotations: Array) -> LegSlopes:
        """The slopes of K postures.

        Arguments:
            angles: joint angles in the legs' order, shape (K, J) [rad].
            rotations: R_WB, shape (K, 3, 3).
        """
        feet, levers, axes, begin = [], [], [], 0
        for leg in legs:
            q = angles[:, begin : begin + len(leg.joints)]
            foot, jacobian = leg.chain.feet_and_jacobian(q)
            turns = leg.chain.frames(q)[0]
            feet.append(foot[:, None])
            levers.append(jacobian.transpose(0, 2, 1))
            axes.append(
                np.einsum("knij,nj->kni", turns, leg.chain.axes) * ~leg.chain.slides[:, None]
            )
            begin += len(leg.joints)
        back = rotations.transpose(0, 2, 1)
        return cls(
            feet=np.concatenate(feet, axis=1) @ back,
            levers=np.concatenate(levers, axis=1) @ back,
            axes=np.concatenate(axes, axis=1) @ back,
        )

    def lever_slopes(self, first: np.ndarray, second: np.ndarray) -> Array:
        """∂lever/∂q of pairs of joints of one leg, by number, shape (K, pairs, 3) [m/rad]."""
        inner, outer = np.minimum(first, second), np.maximum(first, second)
        return np.asarray(cross(self.axes[:, inner], self.levers[:, outer]))


def turning(rotation_rad: Array) -> Array:
    """The left Jacobian of rotation vectors: R(Θ + δ) ≈ exp([D δ]×) R(Θ), shapes (K, 3) to (K, 3,
    3).
    """
    angle = np.linalg.norm(rotation_rad, axis=-1)[:, None, None]
    x, y, z = rotation_rad.T
    zero = np.zeros_like(x)
    cross_of = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    # (1 − cos a)/a² and (a − sin a)/a³ by their series: tilts are small
    small = angle**2
    one = 0.5 - small / 24.0 + small**2 / 720.0 - small**3 / 40320.0
    two = 1.0 / 6.0 - small / 120.0 + small**2 / 5040.0 - small**3 / 362880.0
    return np.asarray(np.eye(3) + one * cross_of + two * (cross_of @ cross_of))


JOINTS = ("yaw", "hip", "roll", "knee")
"""The joints of a limb from the shoulder outwards: about the body's z, the limb's y (down
positive), the thigh, and the limb's y again. A foot below its shoulder is on the axis of yaw: there
roll moves it sideways."""

FOOT_RADIUS_M, USUAL_REACH_M = 0.012, 0.35
"""Radius of a foot that is drawn up for a limb of the usual reach, as the default hexapod's limbs
have it; of others it follows their reach."""


_Positive = Annotated[float, Within(above=0.0)]
_TURN = Within(least=-10.0, most=10.0)
"""Range of a joint's limits [rad]."""
_Angle = Annotated[float, _TURN]


@dataclass(frozen=True, kw_only=True)
class Servo:
    """Limits of every joint, and the position loop τ = Kp (q* − q) − Kd q̇ inside the servo that
    drives it.

    Arguments:
        lower_rad, upper_rad: joint limits of yaw, hip, roll and knee [rad].
        rotor_kg_m2: inertia of the rotor, seen behind the gears.
        torque_nm, velocity_rad_s: limits of torque [Nm] and speed [rad/s].
        stiffness_nm_rad, damping_nms_rad: gains Kp and Kd.
    """

    lower_rad: tuple[_Angle, _Angle, _Angle, _Angle] = (-1.9, -1.8, -2.6, -0.05)
    upper_rad: tuple[_Angle, _Angle, _Angle, _Angle] = (1.9, 1.8, 2.6, 2.75)
    torque_nm: _Positive = 40.0
    velocity_rad_s: _Positive = 4.0
    stiffness_nm_rad: _Positive = 400.0
    damping_nms_rad: _Positive = 6.0
    rotor_kg_m2: Annotated[float, Within(least=0.0)] = 0.01

    def __post_init__(self) -> None:
        check_limits(self)
        for i in range(len(JOINTS)):
            _TURN.check(self.upper_rad[i], f"upper_rad[{i}]")
            checked(self.lower_rad[i], f"lower_rad[{i}]", least=_TURN.least, most=self.upper_rad[i])


FORMAT: Literal["stancekit/actuators/1"] = "stancekit/actuators/1"
_Curve = Literal["linear", "flat"]


@dataclass(frozen=True, kw_only=True)
class ActuatorModel(Strict):
    """One kind of actuator, all at the joint, behind its gears.

    Arguments:
        stall_nm: greatest torque at rest, for a moment.
        continuous_nm: largest torque that it can hold indefinitely; None if not known.
        no_load_rad_s: largest speed, without load.
        curve: "linear", torque falls with speed to none at no_load_rad_s, as that of a motor at its
            supply's voltage does; "flat", all of it up to there.
        gear: turns of the rotor per turn of the joint.
        rotor_kg_m2: the rotor's own inertia, before the gears; None if not known.
        thermal_s: time constant of its heating, which with continuous_nm gives how long it can hold
            more torque; None if not known: then it is taken to be as hot as it gets.
        stiffness_nm_rad, damping_nms_rad: gains of its own position loop, τ = Kp (q* − q) − Kd q̇;
            None for the robot's usual drive.
        source: origin of the numbers.
    """

    stall_nm: float
    no_load_rad_s: float
    continuous_nm: float | None = None
    curve: _Curve = "linear"
    gear: float = 1.0
    rotor_kg_m2: float | None = None
    thermal_s: float | None = None
    stiffness_nm_rad: float | None = None
    damping_nms_rad: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        collect_errors(
            lambda: check_numbers(self, above=_POSITIVE, least=("rotor_kg_m2",)),
            lambda: (
                self.continuous_nm is None
                or checked(self.continuous_nm, "continuous_nm", least=0.0, most=self.stall_nm)
            ),
        )

    @classmethod
    def of_joint(cls, joint: Joint) -> ActuatorModel:
        """Actuator that the URDF describes for a joint: ``effort`` and ``velocity``.

        Raises InvalidInput where it lacks one.
        """
        if joint.torque_nm <= 0.0:
            raise InvalidInput(
                f"joint {joint.name}: expected a torque limit above 0 Nm, got {joint.torque_nm:g}"
            )
        if joint.velocity_rad_s <= 0.0:
            raise InvalidInput(
                f"joint {joint.name}: expected a velocity limit above 0 rad/s, its file has none"
            )
        source = "the robot's URDF"
        return cls(
            stall_nm=joint.torque_nm,
            no_load_rad_s=joint.velocity_rad_s,
            curve="flat",
            source=source,
        )

    @property
    def reflected_kg_m2(self) -> float | None:
        """The rotor's inertia as the joint feels it: gear² times its own."""
        return None if self.rotor_kg_m2 is None else self.gear**2 * self.rotor_kg_m2


_POSITIVE = (
    "stall_nm",
    "continuous_nm",
    "no_load_rad_s",
    "gear",
    "thermal_s",
    "stiffness_nm_rad",
    "damping_nms_rad",
)


@dataclass(frozen=True, kw_only=True)
class Actuators(Strict):
    """Table of the actuators of joints.

    Arguments:
        joints: names or patterns, the first that fits counts.
    """

    joints: Annotated[Mapping[str, str], Field(min_length=1)]
    actuators: Mapping[str, ActuatorModel] = field(default_factory=dict)
    format: Literal["stancekit/actuators/1"] = FORMAT

    def __post_init__(self) -> None:
        known = self.known
        wrong = [
            f"joints.{pattern}: expected one of {', '.join(known)}, got {shown(name)}"
            for pattern, name in self.joints.items()
            if name not in known
        ]
        if wrong:
            raise InvalidInput("; ".join(wrong))

    @property
    def known(self) -> dict[str, ActuatorModel]:
        """All that a joint may have, by name: those that come with the package, and the file's
        own.
        """
        return {**builtin_actuators(), **self.actuators}

    def of(self, joints: Sequence[str]) -> tuple[ActuatorModel, ...]:
        """Actuators of these joints, one each.

        Raises InvalidInput for joints that have none, and for patterns of no joint.
        """
        return tuple(self.known[name] for name in self.names(joints))

    def names(self, joints: Sequence[str]) -> tuple[str, ...]:
        """Names of the actuators of these joints.

        Raises InvalidInput as ``of`` does.
        """
        fits = {joint: [p for p in self.joints if fnmatchcase(joint, p)] for joint in joints}
        lacks = [joint for joint, patterns in fits.items() if not patterns]
        if lacks:
            raise InvalidInput(f"actuators: joints: expected joint {', '.join(lacks)}, got nothing")
        idle = [p for p in self.joints if not any(fnmatchcase(joint, p) for joint in joints)]
        if idle:
            raise InvalidInput(f"actuators: joints: unknown joint {', '.join(idle)}")
        return tuple(self.joints[fits[joint][0]] for joint in joints)


@cache
def builtin_actuators() -> Mapping[str, ActuatorModel]:
    """Actuators that come with the package, by name: ``configs/actuators.yaml``, every number with
    its source.
    """
    text = (
        resources.files("stancekit.configs").joinpath("actuators.yaml").read_text(encoding="utf-8")
    )
    data = parse_yaml(text, "actuators.yaml")
    models = {
        name: validated(ActuatorModel, each, f"actuators.yaml: {name}")
        for name, each in data.items()
    }
    return MappingProxyType(models)


def read_actuators(what: str | Path) -> Actuators:
    """Read actuators of a name, which all joints then have, or of a file.

    Raises InvalidInput with all that is wrong.
    """
    name = str(what)
    if name in builtin_actuators():
        return Actuators(joints={"*": name})
    if not Path(name).suffix and not Path(name).exists():
        raise InvalidInput(
            f"actuators: expected one of {', '.join(builtin_actuators())} or a file, got "
            f"{shown(name)}"
        )
    data: Any = read_json(name) if Path(name).suffix == ".json" else read_yaml(name)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        version = data.get("format") if isinstance(data, dict) else data
        raise InvalidInput(f"{name}: format: expected {FORMAT}, got {shown(version, 40)}")
    return validated(Actuators, data, name)
