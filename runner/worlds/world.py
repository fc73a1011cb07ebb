"""Worlds: joints under position control on a terrain, one control period a step; drives of joints,
and how simulated ones differ from them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from inspect import isabstract
from math import isfinite, sqrt
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar, get_args

import numpy as np
from pydantic import Field

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import (
    Array,
    check_numbers,
    checked,
    checked_int,
    checked_name,
    read_only,
)
from stancekit.planners.files.documents import Strict, read_yaml, shown, validated, yaml_of
from stancekit.planners.files.writing import write_text
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.plugins import Registry
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import ActuatorModel, Actuators
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.robot.robot_model import DAMPING_S, RobotModel, resisting_nm
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.obstacles import Ground as Ground
from stancekit.planners.terrain.patch import Solid

from ..safety.estop import StopLatch


@dataclass(frozen=True, kw_only=True, eq=False)
class Drives:
    """The position loops τ = Kp (q* − q) − Kd q̇ at J joints, and their limits, shape (J,) each.

    Arguments:
        joints: names, in the order of all arrays.
        lower_rad, upper_rad, velocity_rad_s, torque_nm: limits.
        stiffness_nm_rad, damping_nms_rad: Kp, Kd.
        rotor_kg_m2: inertia of the rotors, seen behind the gears.
        viscous_nms_rad, dry_nm: damping and dry friction of the joints themselves.
        actuators: what turns every joint, J of them.
        assigned: what names them, None where the robot's own file says what its joints can.
        yields: to loads, as those loops do; False where a joint is to be where it is sent: its loop
            is not known, or carries nothing.
    """

    joints: tuple[str, ...]
    lower_rad: Array
    upper_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    stiffness_nm_rad: Array
    damping_nms_rad: Array
    rotor_kg_m2: Array
    viscous_nms_rad: Array
    dry_nm: Array
    actuators: tuple[ActuatorModel, ...]
    assigned: Actuators | None = None
    yields: bool = True

    def __post_init__(self) -> None:
        for name in self.__annotations__:
            if name not in ("joints", "actuators", "assigned", "yields"):
                object.__setattr__(
                    self,
                    name,
                    read_only(getattr(self, name), (len(self.joints),), f"drives.{name}"),
                )

    @classmethod
    def of(cls, model: RobotModel, actuators: Actuators | None = None) -> Self:
        """The servo's at every joint that is drawn up; of a robot with a model of its own, its
        file's limits, and a loop as stiff as such a weight needs.

        Arguments:
            actuators: in place of either; of those without a loop of their own the loops stay.

        Raises:
            InvalidInput: for a joint that slides, one without a limit of torque or velocity, and
                for actuators of other joints.
        """
        joints = [joint for leg in model.legs for joint in leg.joints]
        if sliding := [joint.name for joint in joints if joint.slides]:
            raise InvalidInput(
                f"robot {model.name}: expected joints that turn, got {sliding[0]}, which slides"
            )
        names = tuple(joint.name for joint in joints)
        models = (
            tuple(ActuatorModel.of_joint(joint) for joint in joints)
            if actuators is None
            else actuators.of(names)
        )
        gains, (viscous, dry) = model.drive[:2], model.resistance
        loops = np.array(
            [
                _loop(actuator, (*gains, float(rotor)))
                for actuator, rotor in zip(models, model.rotors_kg_m2, strict=True)
            ]
        )
        return cls(
            joints=names,
            lower_rad=np.array([joint.lower_rad for joint in joints]),
            upper_rad=np.array([joint.upper_rad for joint in joints]),
            velocity_rad_s=np.array([actuator.no_load_rad_s for actuator in models]),
            torque_nm=np.array([actuator.stall_nm for actuator in models]),
            stiffness_nm_rad=loops[:, 0],
            damping_nms_rad=loops[:, 1],
            rotor_kg_m2=loops[:, 2],
            viscous_nms_rad=viscous,
            dry_nm=dry,
            actuators=models,
            assigned=actuators,
        )

    @cached_property
    def fading(self) -> Array:
        """Loss of a joint's torque per rad/s, as a share, shape (J,) [s]; 0 where it loses none."""
        return np.array(
            [1.0 / each.no_load_rad_s if each.curve == "linear" else 0.0 for each in self.actuators]
        )

    def resistance(self, rates_rad_s: Array) -> Array:
        """Torque that joints turn against at these speeds, beside their loops' Kd q̇ [Nm]."""
        return resisting_nm(self.viscous_nms_rad, self.dry_nm, rates_rad_s)

    def torque_range(self, rates_rad_s: Array) -> tuple[Array, Array]:
        """The least and the greatest torque at these speeds, shape (J,) each: a joint that is
        turned against its torque gives all of it, one that turns with it no more than its curve.
        """
        lost = self.fading * rates_rad_s
        upper = self.torque_nm * np.clip(1.0 - lost, 0.0, 1.0)
        return -self.torque_nm * np.clip(1.0 + lost, 0.0, 1.0), upper

    def sendable(self, targets: Array, before: Array, period_s: float) -> Array:
        """Targets as a drive takes them: within the joints' limits, no farther from the last than
        it can turn.
        """
        step = self.velocity_rad_s * period_s
        bounded = np.minimum(np.maximum(targets, self.lower_rad), self.upper_rad)
        return np.asarray(np.minimum(np.maximum(bounded, before - step), before + step))


def _loop(actuator: ActuatorModel, gains: tuple[float, float, float]) -> tuple[float, float, float]:
    """Kp, Kd and the rotor's inertia: the actuator's own, or else these."""
    stiffness, damping, rotor = gains
    if actuator.stiffness_nm_rad is not None:
        stiffness, damping = actuator.stiffness_nm_rad, DAMPING_S * actuator.stiffness_nm_rad
    damping = damping if actuator.damping_nms_rad is None else actuator.damping_nms_rad
    return (
        stiffness,
        damping,
        rotor if actuator.reflected_kg_m2 is None else actuator.reflected_kg_m2,
    )


@dataclass(frozen=True, kw_only=True)
class Push:
    """A force on a simulated body, at its own centre of mass: force_n in the world, shape (3,) [N],
    from at_s after the reset on for seconds.
    """

    force_n: tuple[float, float, float]
    at_s: float
    seconds: float

    def __post_init__(self) -> None:
        check_numbers(self, "push.", above=("seconds",), least=("at_s",))


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """Imperfections of a simulated robot, by which it differs from its file; drawn once, from the
    seed.

    Arguments:
        offset_rad: joints are mounted off by up to so much, either way, and measure themselves
            wrong by that.
        noise_rad: standard deviation of what they measure.
        delay_s: from a command to its effect, felt_delay_s: from a contact to when its force is
            felt, both in whole control periods.
        felt_share: of a foot's force, what it reads.
        felt_noise_n: standard deviation of that along every axis [N].
        deaf: numbers of the limbs whose feet read nothing.
        stiffness_share, mass_share: of the loops' Kp, and of all masses.
        pushes: on its body.
    """

    offset_rad: float = 0.0
    noise_rad: float = 0.0
    delay_s: float = 0.0
    felt_delay_s: float = 0.0
    felt_share: float = 1.0
    felt_noise_n: float = 0.0
    deaf: tuple[int, ...] = ()
    stiffness_share: float = 1.0
    mass_share: float = 1.0
    pushes: tuple[Push, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        least = ("offset_rad", "noise_rad", "delay_s", "felt_delay_s", "felt_share", "felt_noise_n")
        check_numbers(self, "imperfections.", above=("stiffness_share", "mass_share"), least=least)
        checked_int(self.seed, "imperfections.seed")

    def felt_n(self, forces_n: Array, draw: np.random.Generator) -> Array:
        """Forces that sensors of the feet read, shape (N, 3) [N]."""
        read = self.felt_share * forces_n
        if self.felt_noise_n > 0.0:
            read = read + self.felt_noise_n * draw.standard_normal(read.shape)
        if self.deaf:
            read[list(self.deaf)] = 0.0
        return read

    def pushed_n(self, time_s: float) -> Array:
        """Sum of the pushes at a time, shape (3,) [N]."""
        now = [
            push.force_n for push in self.pushes if push.at_s <= time_s < push.at_s + push.seconds
        ]
        return sum(map(np.array, now), start=np.zeros(3))


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
class SetupFile(Strict):
    """The joints of a device, by name.

    Subclasses have ``joints``, and ``format`` by which their files begin.

    Arguments:
        robot: the name of the robot that the device moves; a plan for another one is refused. None
            says nothing.
    """

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


_Setup = TypeVar("_Setup", bound=SetupFile)
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

    def device(self, kind: type[_Setup], content: str, world: str) -> _Setup:
        """The set-up file of a device, as it is for this robot and its joints.

        Raises InvalidInput, which says what should be in it, where there is none, for what is wrong
        with it, and for a file of another robot.
        """
        if self.setup is None:
            raise InvalidInput(f"setup: expected {content} with world {world}, got none")
        setup = kind.from_yaml(self.setup, self.robot.joint_names)
        if setup.robot not in (None, self.robot.name):
            raise InvalidInput(
                f"{self.setup}: robot: expected {self.robot.name}, whom the plan is for, got "
                f"{setup.robot}"
            )
        return setup


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
WorldKind = Literal["simulation", "hardware"]
"""Whether a world computes what happens, or moves something real."""


class JointBus(ABC):
    """Joints under position control, over a terrain: simulators and devices fill in ``connect``,
    ``send``, ``read`` and ``close``, what is real ``arm`` and ``stop``, too.

    ``SafeWorld`` is the one guard around each of them. A context manager; ``connect`` may be called
    again.

    Arguments:
        drives: the loops of its joints, whose names, limits and order count.
        rate_hz: targets per second.
        senses: the body's pose and contact forces are measured.
        gravity_m_s2: gravity, None for the plan's.

    kind: "hardware" unless a world says that it is not; that moves only when armed. lacks: what it cannot do as the robot has it.
    capabilities: its drives within the limits of all that it has, the narrowest.
    alone: what stops the robot where its host is silent or gone. latch: a device asks it directly
    before every write. beat: called while ``send`` waits for a device. armed: its torque is on.
    """

    kind: WorldKind = "hardware"
    name: str
    lacks = ""
    alone = "nothing is known to stop the robot"

    def __init__(
        self,
        robot: Robot,
        servo: Servo | None,
        drives: Drives,
        rate_hz: float,
        *,
        senses: bool,
        gravity_m_s2: float | None = None,
    ) -> None:
        self.latch, self.armed = StopLatch(), False
        self.robot, self.servo = robot, servo or robot.servo
        self.drives, self.joints = drives, drives.joints
        self.rate_hz = checked(rate_hz, "rate_hz", above=0.0)
        self.gravity_m_s2 = gravity_m_s2
        self.capabilities, self.senses = drives, senses
        self.beat: Callable[[], None] = lambda: None

    @classmethod
    @abstractmethod
    def make(cls, settings: WorldSettings) -> Self:
        """A world.

        Raises InvalidInput for a rate or a file that it does not take, and for a package that is
        not installed; nothing is sent to anything.
        """

    @abstractmethod
    def connect(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Put a simulated robot, at rest, into this pose over this terrain; measure a real one, which
        does not move.
        """

    def arm(self) -> None:
        """Switch the torque on, at the measured pose.

        An arming that is interrupted, by whatever it raises, leaves no torque on that was off
        before.
        """
        self.armed = True

    def preload(self, targets_rad: Array) -> bool:
        """After ``connect``, let joints begin loaded, as if they had been sent this before, shape (J,)
        [rad]; tell whether they can.
        """
        return False

    def carry(self, wrench: Array) -> bool:
        """Let a body bear this from now on beside its weight: a force, as if at the robot's centre of
        mass [N], and a moment [Nm], in the world, shape (6,); tell whether it can.
        """
        return False

    @abstractmethod
    def send(self, targets_rad: Array, loads_rad: Array | None = None) -> None:
        """Send position targets, shape (J,) [rad].

        Arguments:
            loads_rad: in a leap, by how much targets lead beyond angles, shape (J,).
        """

    @abstractmethod
    def read(self) -> State:
        """The state at the end of the control period, for which a device is waited for."""

    def stop(self, *, torque_off: bool = False) -> str:
        """Send nothing any more, and say what may still move the robot, empty where nothing may.

        Joints keep their last targets. Where an arming was interrupted, the torque is as it was
        before it. Raises HardwareFault where that cannot be made sure of.

        Arguments:
            torque_off: everywhere.
        """
        return ""

    def report(self) -> str:
        """Evidence since it was armed that its e-stop works; empty where there is none."""
        return ""

    @abstractmethod
    def close(self) -> None:
        """Give everything back; once is enough."""

    def step(self, targets_rad: Array) -> State:
        """One control period: send, and read."""
        self.send(targets_rad)
        return self.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


def is_bus(kind: Any) -> bool:
    """Tell whether something is a class of worlds; one that says how it is armed and stopped is
    hardware, and no other.
    """
    if not isinstance(kind, type) or not issubclass(kind, JointBus) or isabstract(kind):
        return False
    own = [getattr(kind, verb) is not getattr(JointBus, verb) for verb in ("arm", "stop")]
    right = all(own) if kind.kind == "hardware" else not any(own)
    return right and kind.kind in get_args(WorldKind)


def check_world(world: Any) -> None:
    """Raise InvalidInput, in one line, for an object that is no ``JointBus``, or has something of
    another kind.
    """
    name = checked_name(getattr(world, "name", None), "world: name")
    if not is_bus(type(world)) or world.kind != type(world).kind:
        raise InvalidInput(f"world {name}: expected {EXPECTED}, got another object")
    types = {
        "latch": StopLatch,
        "robot": Robot,
        "servo": Servo,
        "drives": Drives,
        "capabilities": Drives,
    }
    for attribute, type_ in types.items():
        if not isinstance(value := getattr(world, attribute, None), type_):
            raise InvalidInput(
                f"world {name}: {attribute}: expected a {type_.__name__}, got {shown(value)}"
            )
    checked(getattr(world, "rate_hz", None), f"world {name}: rate_hz", above=0.0)
    if not world.joints == world.drives.joints == world.capabilities.joints:
        raise InvalidInput(f"world {name}: joints: expected those of its drives, got other names")


EXPECTED = "a JointBus (kind, make, connect, send, read, close; of hardware, and of that alone, arm and stop)"


_NUMBER = np.dtype(np.float64)


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
                f"world {name}: expected numbers in {attribute}, got other values"
            ) from None
        if value.shape != shape:
            raise HardwareFault(
                f"world {name}: expected shape {shape} of {attribute}, got {value.shape}"
            )
        if not finite:
            raise HardwareFault(
                f"world {name}: expected finite measurements, got other values in {attribute}"
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


WORLDS: Registry[type[JointBus]] = Registry(
    "world",
    "stancekit.worlds",
    {
        "bullet": "stancekit.runner.worlds.bullet:BulletWorld",
        "mujoco": "stancekit.runner.worlds.mujoco:MujocoWorld",
        "dynamixel": "stancekit.runner.worlds.dynamixel.driver:DynamixelWorld",
        "ros": "stancekit.runner.worlds.ros.driver:RosWorld",
    },
    expected=EXPECTED,
    accepts=is_bus,
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
) -> JointBus:
    """Make a world, with one robot in it.

    Arguments:
        name: of ``WORLDS``, or FILE.py:NAME.
        servo: of drawn-up legs, in place of the robot's own.
        rate_hz: targets a second, the world's own where None.
        setup: the calibration file of ``dynamixel``, the set-up file of ``ros``.
        imperfections: of a simulated robot.
        actuators: what turns its joints, None for what its file, or the device's, says.
        contact: ground of a simulation that yields, None for hard ground.

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
