"""Sources of a robot's legs: its own file, its limbs, which have legs drawn up for them, or
nowhere.

There is one class for each, and every question whose answer depends on legs is a method of it:
callers ask ``robot.source`` and do not look which of them it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import to_json
from .actuators import FOOT_RADIUS_M, JOINTS, USUAL_REACH_M, Servo
from .model_json import model_to_json

if TYPE_CHECKING:
    from .limb import Limb
    from .robot_model import RobotModel

_NO_LEGS = "no legs are known, only its reach: name its URDF, or, in a course, ask for drawn-up legs (legs: {})"
"""Why nothing is known of a robot's joints, torques and bodies."""


def no_legs(name: str) -> InvalidInput:
    """The error for a robot of this name whose legs are unknown."""
    return InvalidInput(f"robot {name}: {_NO_LEGS}")


class LegSource:
    """Knowledge about the legs of one robot: none beside a mass and the reach of limbs, unless a
    class below has more.

    Arguments:
        own: whether legs and reach are those of a file, so that plans keep to inner sets of the
            legs and have joints, and proofs are over outer sets.
        identity: that of the robot whose reach it is; empty where it is no robot's.
        point: whether feet are points.
    """

    own: bool = False

    def __init__(self, name: str, limbs: int, identity: str = "", *, point: bool = False) -> None:
        self.name, self.limbs, self.identity, self.point = name, limbs, identity, point

    def legs(self, servo: Servo | None = None) -> RobotModel:
        """The robot joint by joint; loads pinocchio.

        Arguments:
            servo: drive of drawn-up legs, in place of the robot's own.

        Raises:
            InvalidInput: where no legs are known.
        """
        raise no_legs(self.name)

    def own_model(self) -> RobotModel:
        """The model of the robot's own file.

        Raises InvalidInput for a robot without one.
        """
        raise InvalidInput(
            f"robot: expected one whose legs are known, got {self.name}, of which only the limbs "
            "are known"
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints, limb by limb, from the base outward; none where no legs are
        known.
        """
        return ()

    @property
    def foot_radii_m(self) -> Array:
        """Radii of the feet, shape (N,) [m]."""
        return np.full(self.limbs, 0.0 if self.point else FOOT_RADIUS_M)

    @property
    def known_radius_m(self) -> float:
        """Largest radius of a foot that the robot's file has, 0 where none says one [m]."""
        return 0.0

    @property
    def origin_m(self) -> Array:
        """p_BO, the origin that limbs are given from, in the base of the legs, shape (3,) [m]."""
        return np.zeros(3)

    @property
    def inertia_kgm2(self) -> Array | None:
        """Inertia about the centre of mass, shape (3, 3) [kg m²]; None where unknown."""
        return None

    @property
    def digest(self) -> str:
        """SHA-256 of a file's legs; empty without a file."""
        return ""

    @property
    def unrunnable(self) -> tuple[str, ...]:
        """Reasons why a simulation refuses the legs as their file is, a line each."""
        return ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """Numbers of the robot's file that are hard to believe, one line each."""
        return ()

    @property
    def hindrance(self) -> str:
        """The reason why nothing executes plans of such legs; empty where something does."""
        return str(no_legs(self.name))

    def to_json(self) -> dict[str, Any]:
        """The keys of a robot in files that say its legs, or whose reach it has."""
        return {"identity": self.identity} if self.identity else {}


class OwnLegs(LegSource):
    """The legs of the robot's own file."""

    own = True

    def __init__(self, model: RobotModel) -> None:
        super().__init__(model.name, len(model.legs))
        self.model = model

    def own_model(self) -> RobotModel:
        """The model as it was read."""
        return self.model

    def legs(self, servo: Servo | None = None) -> RobotModel:
        """The model as it was read; its file says what its joints can."""
        return self.model

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, as the file has them."""
        return self.model.joint_names

    @property
    def foot_radii_m(self) -> Array:
        """Radii of the feet, as the file has them [m]."""
        return np.array([leg.radius_m for leg in self.model.legs])

    @property
    def known_radius_m(self) -> float:
        """The largest of them."""
        return float(self.foot_radii_m.max())

    @property
    def origin_m(self) -> Array:
        """The centre of mass of the standing robot, which Lin et al. take for the body's origin."""
        return self.model.body.com_m

    @property
    def inertia_kgm2(self) -> Array:
        """Inertia of the standing robot."""
        return self.model.body.inertia_kgm2

    @property
    def digest(self) -> str:
        """The model's."""
        return self.model.digest

    @property
    def unrunnable(self) -> tuple[str, ...]:
        """The reasons that the model gives."""
        return self.model.unrunnable

    @property
    def doubts(self) -> tuple[str, ...]:
        """The model's."""
        return self.model.doubts

    @property
    def hindrance(self) -> str:
        """None: what its joints cannot do, ``unrunnable`` names."""
        return ""

    def to_json(self) -> dict[str, Any]:
        """The model, from which it is read again."""
        return {"model": model_to_json(self.model)}


class DrawnLegs(LegSource):
    """Legs of four joints that are drawn up for every limb, and the servo that drives them."""

    def __init__(
        self,
        name: str,
        mass_kg: float,
        limbs: Sequence[Limb],
        servo: Servo,
        identity: str = "",
        *,
        said: bool,
    ) -> None:
        super().__init__(name, len(limbs), identity)
        self._mass_kg, self._limbs, self._servo = mass_kg, limbs, servo
        self._said = said

    def legs(self, servo: Servo | None = None) -> RobotModel:
        """The model of ``drawn_urdf``, which is kept."""
        from .drawn_model import drawn_model  # slow to import

        return drawn_model(self.name, self._mass_kg, self._limbs, servo or self._servo)

    @property
    def foot_radii_m(self) -> Array:
        """Radii of the feet, which follow the reach of their limbs [m]."""
        return np.array([limb.reach_m / USUAL_REACH_M * FOOT_RADIUS_M for limb in self._limbs])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Yaw, hip, roll and knee of every limb, e.g. ``LF_yaw``."""
        return tuple(f"{limb.name}_{joint}" for limb in self._limbs for joint in JOINTS)

    @property
    def hindrance(self) -> str:
        """The reason why its legs cannot be drawn up."""
        from .drawn_legs import drawn_urdf  # asked for by few

        try:
            drawn_urdf(self.name, self._mass_kg, self._limbs, self._servo)
        except InvalidInput as error:
            return str(error)
        return ""

    def to_json(self) -> dict[str, Any]:
        """The identity, and the servo where the limbs do not say it, as those of the default
        hexapod do.
        """
        return super().to_json() | ({"legs": to_json(self._servo)} if self._said else {})
