"""Interface of a world: joints under position control on a terrain, one control period a step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isfinite
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, get_args, runtime_checkable

import numpy as np
from pydantic import ConfigDict, Field

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array, checked, checked_name, read_only
from stancekit.planners.files.documents import read_yaml, shown, validated, yaml_of
from stancekit.planners.files.writing import write_text
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.plugins import Registry
from stancekit.planners.robot import Robot
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.obstacles import Ground as Ground
from stancekit.planners.terrain.patch import Solid

from ..safety.estop import StopLatch
from .drives import Drives, Imperfections
from .settings import SoftContact, WorldSettings


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """State of a world after a control period; J joints, N limbs.

    Arguments:
        time_s: since the reset.
        position_m, rotation: of the body's frame in the world, shape (3,), (3, 3).
        velocity: linear [m/s] and angular [rad/s], world frame, shape (6,).
        angles_rad, rates_rad_s, torques_nm: of the joints, shape (J,).
        feet_m: centres of the feet, shape (N, 3).
        forces_n: contact forces on the feet, world frame, mean over the period, shape (N, 3) [N].
        bump_n: mean force of the terrain on anything but feet, and of the robot's links on each
            other [N].
        sent_rad: the targets that were really sent, after limits, shape (J,).
    """

    time_s: float
    position_m: Array
    rotation: Array
    velocity: Array
    angles_rad: Array
    rates_rad_s: Array
    torques_nm: Array
    feet_m: Array
    forces_n: Array
    bump_n: float
    sent_rad: Array


Solids = Sequence[Solid | Ground]
"""Solids that have a ``distance``."""
Terrain = Sequence[Patch] | Ground
"""Flat patches, each a solid body behind its surface; or heights."""
WorldKind = Literal["simulation", "recording", "hardware"]
"""Whether a world computes what happens, repeats what happened, or moves something real."""


class World(Protocol):
    """Three methods, and what it can do.

    A context manager; ``reset`` may be called again. A world may have besides: ``capabilities``
    (``WorldCapabilities``), ``drives`` (``Drives``), ``preload(targets_rad)``, which says whether
    joints can begin loaded, ``carry(wrench)``, which a simulated body bears beside its weight,
    ``beat``, which it calls while it waits for a device, ``evidence`` of its e-stop, and
    ``pending``, which names what may still move the robot after ``hold``, in words.

    Arguments:
        kind: what is of "hardware" is an ``Actuator``, too, and moves only when armed.
        latch: what it sends to the robot goes through ``estop.StopLatch.sending()``; tripped, it sends
            nothing any more.
    """

    kind: WorldKind
    name: str
    latch: StopLatch
    robot: Robot
    servo: Servo
    joints: tuple[str, ...]
    rate_hz: float

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Put the robot, at rest, into this pose over this terrain."""
        ...

    def step(self, targets_rad: Array) -> State:
        """One control period with these position targets, shape (J,) [rad]."""
        ...

    def close(self) -> None:
        """Give everything back; once is enough."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@runtime_checkable
class Stoppable(Protocol):
    """A world that can be left in a state: standing as it is, or without torque."""

    def hold(self) -> None:
        """Send nothing any more; the joints keep what they were sent last.

        Where an arming was interrupted, it makes sure that the torque is as it was before, or
        raises HardwareFault.
        """
        ...

    def relax(self) -> None:
        """Torque off everywhere."""
        ...


@runtime_checkable
class Actuator(Stoppable, Protocol):
    """A world that moves something real: it takes no step unless armed."""

    armed: bool

    def torque(self, on: bool) -> None:
        """Arm, at the measured pose; or let go.

        An arming that is interrupted, by whatever it raises, leaves no torque on that was off
        before.
        """
        ...


class LatchedWorld(ABC):
    """Base of the worlds here: a latch, and that they close at the end of a ``with`` block.

    Arguments:
        kind: "hardware" unless a world says that it is not.
    """

    kind: WorldKind = "hardware"

    def __init__(self) -> None:
        self.latch = StopLatch()

    @abstractmethod
    def close(self) -> None:
        """Give everything back; once is enough."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldCapabilities:
    """Limits and senses of a world; J joints.

    Arguments:
        joints: names, in the order of all arrays.
        rate_hz: of the targets.
        lower_rad, upper_rad, velocity_rad_s, torque_nm: limits of the joints, shape (J,).
        has_body_pose, has_contact_forces: whether it measures them; where it does not, a ``State``
            repeats the assumed pose and has zeros.
    """

    joints: tuple[str, ...]
    rate_hz: float
    lower_rad: Array
    upper_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    has_body_pose: bool
    has_contact_forces: bool

    @classmethod
    def of_drives(cls, drives: Drives, rate_hz: float, *, senses: bool) -> Self:
        """Capabilities of such drives.

        Arguments:
            senses: the body's pose and contact forces are measured.
        """
        return cls(
            joints=drives.joints,
            rate_hz=rate_hz,
            lower_rad=drives.lower_rad,
            upper_rad=drives.upper_rad,
            velocity_rad_s=drives.velocity_rad_s,
            torque_nm=drives.torque_nm,
            has_body_pose=senses,
            has_contact_forces=senses,
        )

    def __post_init__(self) -> None:
        checked(self.rate_hz, "capabilities.rate_hz", above=0.0)
        for name in ("lower_rad", "upper_rad", "velocity_rad_s", "torque_nm"):
            object.__setattr__(
                self,
                name,
                read_only(getattr(self, name), (len(self.joints),), f"capabilities.{name}"),
            )


_NUMBER = np.dtype(np.float64)
METHODS = ("reset", "step", "close")


def check_world(world: Any) -> None:
    """Raise InvalidInput, in one line, for an object that is no ``World``: what it lacks, or has of
    another kind.
    """
    name = checked_name(getattr(world, "name", None), "world: name")
    types = {"latch": StopLatch, "robot": Robot, "servo": Servo}
    for attribute, type_ in types.items():
        if not isinstance(value := getattr(world, attribute, None), type_):
            raise InvalidInput(
                f"world {name}: {attribute}: expected a {type_.__name__}, got {shown(value)}"
            )
    if (kind := getattr(world, "kind", None)) not in get_args(WorldKind):
        raise InvalidInput(
            f"world {name}: kind: expected one of {', '.join(get_args(WorldKind))}, got "
            f"{shown(kind)}"
        )
    checked(getattr(world, "rate_hz", None), f"world {name}: rate_hz", above=0.0)
    joints = getattr(world, "joints", None)
    if (
        not isinstance(joints, tuple)
        or not joints
        or not all(isinstance(each, str) for each in joints)
    ):
        raise InvalidInput(f"world {name}: joints: expected a tuple of names, got {shown(joints)}")
    can = getattr(world, "capabilities", None)
    if can is not None and not isinstance(can, WorldCapabilities):
        raise InvalidInput(
            f"world {name}: capabilities: expected a WorldCapabilities, got {shown(can)}"
        )
    if can is not None and can.joints != joints:
        raise InvalidInput(f"world {name}: capabilities: expected those of its joints, got others")
    for method in METHODS:
        if not callable(getattr(world, method, None)):
            raise InvalidInput(f"world {name}: expected the method {method}, got none")


def check_state(state: Any, joints: int, limbs: int, name: str) -> None:
    """Raise HardwareFault for measurements that are no ``State`` of so many joints and limbs, or no
    finite numbers.
    """
    if not isinstance(state, State):
        raise HardwareFault(f"world {name}: expected a State, got {shown(state)}")
    shapes = _shapes(joints, limbs)
    if _plain_and_finite(state, shapes):
        return
    for attribute, shape in shapes.items():
        try:
            value = np.asarray(getattr(state, attribute))
            finite = value.shape == shape and bool(np.isfinite(value).all())
        except (TypeError, ValueError):
            raise HardwareFault(
                f"world {name}: expected numbers in {attribute}, got others"
            ) from None
        if value.shape != shape:
            raise HardwareFault(
                f"world {name}: expected shape {shape} of {attribute}, got {value.shape}"
            )
        if not finite:
            raise HardwareFault(
                f"world {name}: expected finite measurements, got others in {attribute}"
            )


@lru_cache(maxsize=8)
def _shapes(joints: int, limbs: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays in a state."""
    return {
        "time_s": (),
        "bump_n": (),
        "position_m": (3,),
        "rotation": (3, 3),
        "velocity": (6,),
        **dict.fromkeys(("angles_rad", "rates_rad_s", "torques_nm", "sent_rad"), (joints,)),
        **dict.fromkeys(("feet_m", "forces_n"), (limbs, 3)),
    }


def _plain_and_finite(state: State, shapes: dict[str, tuple[int, ...]]) -> bool:
    """Tell whether all of it is arrays of finite numbers in these shapes, as it nearly always
    is.
    """
    arrays = list[Array]()
    for name, shape in shapes.items():
        value = getattr(state, name)
        if shape:
            if type(value) is not np.ndarray or value.shape != shape or value.dtype is not _NUMBER:
                return False
            arrays.append(value)
        elif type(value) is not float or not isfinite(value):
            return False
    return bool(np.isfinite(np.concatenate(arrays, axis=None)).all())


__all__ = [
    "WORLDS",
    "Imperfections",
    "SoftContact",
    "State",
    "World",
    "WorldClass",
    "WorldSettings",
    "make_world",
]


class WorldClass(Protocol):
    """The class of a world, as it is registered.

    Subclasses of ``SimulatedWorld`` have all that but physics.

    Arguments:
        kind: what is of "hardware" has the methods torque, hold and relax, too (``world.Actuator``):
            nothing real moves unless it was armed.
    """

    kind: WorldKind

    def make(self, settings: WorldSettings) -> World:
        """A world.

        Raises InvalidInput for a rate or a file that it does not take, and for a package that is
        not installed; nothing is sent to anything.
        """
        ...


def _is_world_class(thing: Any) -> bool:
    kind = getattr(thing, "kind", None)
    methods = (
        "make",
        "reset",
        "step",
        "close",
        *(("torque", "hold", "relax") if kind == "hardware" else ()),
    )
    return kind in get_args(WorldKind) and all(
        callable(getattr(thing, method, None)) for method in methods
    )


WORLDS: Registry[WorldClass] = Registry(
    "world",
    "stancekit.worlds",
    {
        "bullet": "stancekit.runner.worlds.bullet:BulletWorld",
        "mujoco": "stancekit.runner.worlds.mujoco:MujocoWorld",
        "replay": "stancekit.runner.worlds.hardware:ReplayWorld",
        "dynamixel": "stancekit.runner.worlds.dynamixel.driver:DynamixelWorld",
        "ros": "stancekit.runner.worlds.ros.driver:RosWorld",
    },
    expected="a world (kind, make, reset, step, close; of hardware torque, hold and relax, too)",
    accepts=_is_world_class,
)


def make_world(
    name: str,
    robot: Robot,
    servo: Servo | None = None,
    *,
    rate_hz: float | None = None,
    gravity_m_s2: float = GRAVITY_M_S2,
    setup: str | Path | None = None,
    imperfections: Imperfections = Imperfections(),
    actuators: Actuators | None = None,
    contact: SoftContact | None = None,
) -> World:
    """Make a world, with one robot in it.

    Arguments:
        name: of ``WORLDS``, or FILE.py:NAME.
        servo: of drawn-up legs, in place of the robot's own.
        rate_hz: targets a second, the world's own where None.
        setup: the log of ``replay``, the calibration file of ``dynamixel``, the set-up file of
            ``ros``, ground that yields in simulations.
        imperfections: of a simulated robot.
        actuators: what turns its joints, None for what its file, or the device's, says.
        contact: ground of a simulation that yields, None for hard ground, unless the set-up file
            says otherwise.

    Raises:
        InvalidInput: for an unknown name, a file that is missing or wrong, and a package that is
            not installed.
    """
    settings = WorldSettings(
        robot=robot,
        servo=servo,
        rate_hz=rate_hz,
        gravity_m_s2=gravity_m_s2,
        setup=None if setup is None else Path(setup),
        imperfections=imperfections,
        actuators=actuators,
        contact=contact,
    )
    return WORLDS.get(name).make(settings)


@dataclass(frozen=True, kw_only=True)
class SetupFile:
    """The joints of a device, by name.

    Subclasses have ``joints``, and ``format`` by which their files begin.

    Arguments:
        robot: the name of the robot that the device moves; a plan for another one is refused. None
            says nothing.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    format: str
    robot: Annotated[str | None, Field(min_length=1)] = None
    joints: Mapping[str, Any]

    def check(self, joints: Sequence[str]) -> None:
        """Raise InvalidInput unless it has exactly these joints."""
        missing = [name for name in joints if name not in self.joints]
        unknown = [name for name in self.joints if name not in joints]
        wrong = [f"expected joint {', '.join(missing)}, got nothing"] if missing else []
        wrong += [f"unknown joint {', '.join(unknown)}"] if unknown else []
        if wrong:
            raise InvalidInput("joints: " + "; ".join(wrong))

    @classmethod
    def from_yaml(cls, path: str | Path, joints: Sequence[str] | None = None) -> Self:
        """Read a file, YAML or JSON, for a robot with these joints.

        Raises InvalidInput with all that is wrong.
        """
        data, known = read_yaml(path), cls.__dataclass_fields__["format"].default
        if data.get("format") != known:
            raise InvalidInput(
                f"{path}: format: expected {known}, got {shown(data.get('format'), 40)}"
            )
        setup = validated(cls, data, str(path))
        if joints is not None:
            try:
                setup.check(joints)
            except InvalidInput as error:
                raise InvalidInput(f"{path}: {error}") from None
        return setup

    def write(self, path: str | Path) -> None:
        """Write a file that ``from_yaml`` reads."""
        write_text(path, yaml_of(asdict(self), flow=False))


def own(names: Mapping[str, Any], key: str, what: str) -> list[str]:
    """One line for every joint whose name or number at the device another joint before it has."""
    owner, wrong = dict[Any, str](), list[str]()
    for joint, name in names.items():
        if name in owner:
            wrong.append(
                f"joints.{joint}.{key}: expected {what}, got {name}, which {owner[name]} has"
            )
        owner.setdefault(name, joint)
    return wrong
