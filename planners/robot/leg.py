"""One leg of a robot's model: its joints by name, its chain, and where its foot is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, cross, read_only
from ..files.codec import LATER
from ..terrain.polygon import half_planes
from ..terrain.sole import checked_sole
from .chain import Chain

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

    @property
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
