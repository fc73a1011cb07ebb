"""Actuators of joints, as data: how much torque for a moment, how much for ever, how fast, and how
soon it is hot.

A file ``stancekit/actuators/1``, YAML or JSON, says which joint has which: ``joints`` maps names,
or patterns such as ``*_knee``, to names of ``actuators``, those of the file or those that come with
the package; the first that fits is it. Where there is no file, joints have what the robot's own
URDF says: its effort, at any speed up to its velocity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import check_numbers, checked, collect_errors
from ..files.codec import Within, check_limits
from ..files.documents import parse_yaml, read_json, read_yaml, shown, validated
from .leg import Joint

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
class ActuatorModel:
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

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

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
class Actuators:
    """Table of the actuators of joints.

    Arguments:
        joints: names or patterns, the first that fits counts.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

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
        known = self.known
        return tuple(known[name] for name in self.names(joints))

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
