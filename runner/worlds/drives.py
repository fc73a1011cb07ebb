"""Drives of a robot's joints in simulation, and their imperfections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, check_numbers, checked_int, read_only
from stancekit.planners.robot.leg import ActuatorModel, Actuators
from stancekit.planners.robot.robot_model import DAMPING_S, RobotModel, resisting_nm


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
