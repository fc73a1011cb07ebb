"""One leg of a robot's model: its joints by name, its chain, and where its foot is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..files.arrays import Array, checked, read_only
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
    """A foot's contact as a person describes it: a point, or a ball about that point.

    Arguments:
        point_m: the point in the frame of the foot's link, shape (3,) [m].
        radius_m: radius of the ball, 0 for a point [m].
    """

    point_m: Array = field(default_factory=lambda: np.zeros(3))
    radius_m: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_m", read_only(self.point_m, (3,), "contact: point_m"))
        object.__setattr__(self, "radius_m", checked(self.radius_m, "contact: radius_m", least=0.0))


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
    """

    name: str
    joints: tuple[Joint, ...]
    chain: Chain
    foot: str
    radius_m: float
    stance_rad: Array
    contact: FootContact | None = None
    doubt: str = ""

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
