"""Settings and parts of a world."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import ConfigDict, Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked
from stancekit.planners.files.documents import read_yaml, shown, validated
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import Actuators
from stancekit.planners.robot.robot_file import Servo

from .drives import Imperfections

FORMAT: Literal["stancekit/simulation/1"] = "stancekit/simulation/1"
_MOST_N_M = 1e7
"""The stiffest ground that is asked for; a world's own is about as hard."""
_DEEP_M = 0.04
"""No foot sinks deeper under the whole weight: PyBullet pushes what is deeper out by other
rules."""


@dataclass(frozen=True, kw_only=True)
class SoftContact:
    """Ground that yields under feet.

    Arguments:
        stiffness_n_m: force of a foot per depth [N/m]; 5e3 is soft turf, 1e5 a wooden floor.
        damping_ns_m: force per speed of sinking [N s/m]; None for that of a robot which, standing
            on all its feet, sinks without swinging.

    Raises:
        InvalidInput: for a number that is out of range.
    """

    stiffness_n_m: float
    damping_ns_m: float | None = None

    def __post_init__(self) -> None:
        checked(self.stiffness_n_m, "contact_stiffness_n_m", above=0.0, most=_MOST_N_M)
        if self.damping_ns_m is not None:
            checked(self.damping_ns_m, "contact_damping_ns_m", least=0.0, most=_MOST_N_M)

    @classmethod
    def of(
        cls, contact_stiffness_n_m: float | None, contact_damping_ns_m: float | None
    ) -> SoftContact | None:
        """The ground that two settings ask for, None where they ask for none.

        Raises InvalidInput for a damping alone.
        """
        if contact_stiffness_n_m is None:
            if contact_damping_ns_m is not None:
                raise InvalidInput(
                    "contact_damping_ns_m: expected contact_stiffness_n_m with it, got none"
                )
            return None
        return cls(stiffness_n_m=contact_stiffness_n_m, damping_ns_m=contact_damping_ns_m)

    def damped(self, mass_kg: float, feet: int) -> float:
        """The damping under a robot [N s/m]: what was asked for, or else 2 √(k m / n)."""
        if self.damping_ns_m is not None:
            return self.damping_ns_m
        return 2.0 * sqrt(self.stiffness_n_m * mass_kg / feet)

    def check_bears(self, weight_n: float) -> None:
        """Raise InvalidInput where a foot that carries the whole weight would sink too deep."""
        least = weight_n / _DEEP_M
        if self.stiffness_n_m < least:
            raise InvalidInput(
                f"contact_stiffness_n_m: expected {least:.3g} N/m or more, or one foot sinks more "
                "than "
                f"{1e3 * _DEEP_M:.0f} mm under all of the weight, got {self.stiffness_n_m:.4g}"
            )


def points(depths_m: Array, normals: Array) -> float:
    """Number of points as deep as the deepest that carry as much as several points of one foot do,
    along the deepest's normal.

    Arguments:
        depths_m: shape (n,) [m]; those that are not in the ground count nothing.
        normals: shape (n, 3).
    """
    first = int(np.argmax(depths_m))
    if depths_m[first] <= 0.0:
        return 1.0
    along = np.maximum(normals @ normals[first], 0.0)
    return float(np.maximum(depths_m, 0.0) @ along / depths_m[first])


@dataclass(frozen=True, kw_only=True)
class SimulationSetup:
    """The set-up file of a simulation: what of the world is not as usual.

    Arguments:
        contact_stiffness_n_m: force of each foot per depth [N/m]; without it the ground is hard.
        contact_damping_ns_m: force per speed of sinking [N s/m]; without it that of a robot which
            sinks without swinging.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    format: Literal["stancekit/simulation/1"] = FORMAT
    contact_stiffness_n_m: Annotated[float | None, Field(gt=0.0, le=_MOST_N_M)] = None
    contact_damping_ns_m: Annotated[float | None, Field(ge=0.0, le=_MOST_N_M)] = None

    def __post_init__(self) -> None:
        SoftContact.of(self.contact_stiffness_n_m, self.contact_damping_ns_m)

    @property
    def contact(self) -> SoftContact | None:
        """The ground that it asks for, None for hard ground."""
        return SoftContact.of(self.contact_stiffness_n_m, self.contact_damping_ns_m)


Setup = TypeVar("Setup")


def read_setup(kind: type[Setup], path: str | Path) -> Setup:
    """Read a set-up file, YAML or JSON, of a dataclass whose field ``format`` says how it begins.

    Raises InvalidInput with all that is wrong.
    """
    data, known = read_yaml(path), kind.__dataclass_fields__["format"].default  # type: ignore[attr-defined]
    if data.get("format") != known:
        raise InvalidInput(f"{path}: format: expected {known}, got {shown(data.get('format'), 40)}")
    return validated(kind, data, str(path))


EstopCheck = Literal["heard", "try", "without"]
"""Way in which an e-stop is known to work before a robot is armed: it, or its publisher, is there;
it is pressed and released; or it is not asked for."""


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Settings that every back end takes.

    Arguments:
        robot: who moves.
        servo: servo of drawn-up legs; None for the robot's own.
        gravity_m_s2: what pulls.
        rate_hz: targets per second, None for the world's usual rate.
        setup: the file that a world is made from, None where none was given.
        imperfections: imperfections of a simulated robot.
        contact: ground of a simulation that yields, None for hard ground.
        actuators: what turns its joints, None for what the robot's file, or the device's, says.
        estop: how an e-stop that the set-up file names is known to work before the robot is armed.
    """

    robot: Robot
    servo: Servo | None = None
    gravity_m_s2: float = GRAVITY_M_S2
    rate_hz: float | None = None
    setup: Path | None = None
    imperfections: Imperfections = field(default_factory=Imperfections)
    contact: SoftContact | None = None
    actuators: Actuators | None = None
    estop: EstopCheck = "heard"

    def __post_init__(self) -> None:
        object.__setattr__(self, "servo", self.servo or self.robot.servo)

    def file(self, content: str, world: str) -> Path:
        """The set-up file.

        Raises InvalidInput, which says what should be in it, where there is none.
        """
        if self.setup is None:
            raise InvalidInput(f"setup: expected {content} with world {world}, got none")
        return self.setup

    def check_name(self, robot: str | None) -> None:
        """Raise InvalidInput for a set-up file of another robot; None says nothing."""
        if robot not in (None, self.robot.name):
            raise InvalidInput(
                f"{self.setup}: robot: expected {self.robot.name}, whom the plan is for, got "
                f"{robot}"
            )
