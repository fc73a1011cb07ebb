"""Base of simulated worlds: one robot, driven as its servos drive it, physics in steps of a
millisecond.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from dataclasses import replace
from typing import Self

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.robot.robot_file import Servo

from .capabilities import WorldCapabilities
from .contact import SimulationSetup, SoftContact
from .drives import Drives, Imperfections
from .settings import WorldSettings
from .world import LatchedWorld, State, Terrain, WorldKind

PHYSICS_S = 1e-3
RATE_HZ = 200.0
SPACING_M = 0.025
"""Spacing of the grid that simulators get of heights."""


class SimulatedWorld(LatchedWorld):
    """One robot on one terrain, from nothing: needs no arming, and measures everything.

    Arguments:
        contact: ground that yields, None for hard ground.
    """

    kind: WorldKind = "simulation"
    name: str

    def __init__(
        self,
        robot: Robot,
        servo: Servo | None = None,
        *,
        rate_hz: float = RATE_HZ,
        gravity_m_s2: float = GRAVITY_M_S2,
        imperfections: Imperfections = Imperfections(),
        actuators: Actuators | None = None,
        contact: SoftContact | None = None,
    ) -> None:
        super().__init__()
        servo = servo or robot.servo
        self.robot, self.servo, self.rate_hz, self.gravity_m_s2 = (
            robot,
            servo,
            rate_hz,
            gravity_m_s2,
        )
        self.model, self.imperfections = robot.source.legs(servo), imperfections
        last = len(robot.limbs) - 1
        if outside := set(imperfections.deaf) - set(range(last + 1)):
            raise InvalidInput(
                f"imperfections.deaf: expected limbs from 0 to {last}, got {min(outside)}"
            )
        if contact is not None:
            contact.check_bears(robot.mass_kg * gravity_m_s2)
        self.contact = contact
        self.drives = Drives.of(robot, servo, self.model, actuators)
        self.joints = self.drives.joints
        self.capabilities = WorldCapabilities.of_drives(self.drives, rate_hz, senses=True)
        self._substeps = max(1, round(1.0 / (rate_hz * PHYSICS_S)))
        self._draw = np.random.default_rng(imperfections.seed)
        self._offset = imperfections.offset_rad * self._draw.uniform(-1.0, 1.0, len(self.joints))
        self._late = round(imperfections.delay_s * rate_hz)
        self._felt_late = round(imperfections.felt_delay_s * rate_hz)
        self._waiting: deque[Array] = deque()
        self._felt: deque[Array] = deque()
        self._carried = np.zeros(6)
        self._loads: Array | None = None

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``WorldClass``."""
        contact = settings.contact
        if settings.setup is not None:
            if contact is not None:
                raise InvalidInput(
                    "contact_stiffness_n_m: expected a value from the set-up file or from the "
                    "option, got both"
                )
            contact = SimulationSetup.from_yaml(settings.setup).contact
        rate_hz = RATE_HZ if settings.rate_hz is None else settings.rate_hz
        options = {} if contact is None else {"contact": contact}
        return cls(
            settings.robot,
            settings.servo,
            rate_hz=rate_hz,
            gravity_m_s2=settings.gravity_m_s2,
            imperfections=settings.imperfections,
            actuators=settings.actuators,
            **options,
        )

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Put the robot, at rest, into this pose over this terrain."""
        self._sent, self._loads = np.array(angles_rad, dtype=float), None
        self._waiting = deque([self._sent] * self._late)
        self._felt = deque([np.zeros((len(self.robot.limbs), 3))] * self._felt_late)
        return self._measured(
            self._placed(terrain, self._sent - self._offset, position_m, rotation)
        )

    def preload(self, targets_rad: Array) -> bool:
        """After ``reset``: the joints were sent this before, shape (J,) [rad], and press from the
        beginning.
        """
        self._sent = np.clip(targets_rad, self.drives.lower_rad, self.drives.upper_rad)
        self._waiting = deque([self._sent] * self._late)
        return True

    def carry(self, wrench: Array) -> None:
        """From now on the robot bears this beside its weight: a force on its body [N], as if at its
        centre of mass, and a moment [Nm], in the world, shape (6,).
        """
        self._carried = read_only(wrench, (6,), "wrench")

    def loaded(self, targets_rad: Array, loads_rad: Array) -> State:
        """One control period as of ``step``, but drives are told apart the angles and the loads in
        the targets, shape (J,) [rad]: the loads may lead beyond the limits of angles. The first
        of them were in the targets before.
        """
        last = self._sent - (loads_rad if self._loads is None else self._loads)
        wanted = targets_rad - loads_rad
        angles = self.drives.sendable(wanted, last, 1.0 / self.rate_hz)
        self._loads = np.array(loads_rad)
        return self._send(np.where(angles == wanted, targets_rad, angles + loads_rad))

    def step(self, targets_rad: Array) -> State:
        """One control period with these position targets, shape (J,) [rad]."""
        return self._send(self.drives.sendable(targets_rad, self._sent, 1.0 / self.rate_hz))

    def _send(self, targets: Array) -> State:
        """The state after a control period with these targets."""
        with self.latch.sending():
            self._sent = targets
            self._waiting.append(targets)
        return self._measured(self._advanced(self._waiting.popleft() - self._offset))

    def _measured(self, state: State) -> State:
        """State as the sensors of joints and feet read it."""
        noise = self.imperfections.noise_rad
        read = state.angles_rad + self._offset
        read = read + noise * self._draw.standard_normal(len(read)) if noise else read
        self._felt.append(self.imperfections.felt_n(state.forces_n, self._draw))
        return replace(state, angles_rad=read, forces_n=self._felt.popleft())

    @abstractmethod
    def _placed(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """The robot at rest in this pose over this terrain; the joints' true angles."""

    @abstractmethod
    def _advanced(self, targets_rad: Array) -> State:
        """The state after a control period in which the loops have these targets."""
