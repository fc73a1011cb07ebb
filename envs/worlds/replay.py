"""A world that replays a log: it answers every command with what was measured then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.arrays import Array
from stancekit.planners.outcome import HardwareFault, InvalidInput
from stancekit.planners.scene import Robot
from stancekit.planners.scene.urdf import Servo, joint_names

from .capabilities import WorldCapabilities
from .world import LatchedWorld, State, Terrain


class ReplayWorld(LatchedWorld):
    """The measurements of a log, one a step. Nothing moves; commands are compared with those of the log.

    worst_rad: largest difference between a command and what was sent at that step of the log. Raises InvalidInput for a
    log of another robot.
    """

    name = "replay"

    def __init__(self, path: str | Path, robot: Robot, servo: Servo = Servo()) -> None:
        from ..runner.log import read_log, state_from_json

        super().__init__()
        recorded = read_log(path)
        plan: dict[str, Any] = recorded.of("plan")[0]
        self.robot, self.servo, self.rate_hz = robot, servo, float(plan["rate_hz"])
        self.joints = joint_names(robot)
        if tuple(plan["joints"]) != self.joints:
            raise InvalidInput(f"{path}: expected a log of a robot with joints {self.joints[0]} …, got another's")
        self.digest, self.whole = str(plan["digest"]), recorded.whole
        self._states = [state_from_json(each, f"{path}: measurement") for each in recorded.of("measurement")]
        self._sent = [np.array(each["sent_rad"], dtype=float) for each in recorded.of("command")]
        if not self._states:
            raise InvalidInput(f"{path}: expected measurements, got none: the run ended before it began")
        self._sees = bool(plan.get("sees", True))
        self._row = 0
        self.worst_rad = 0.0
        limbs = len(robot.limbs)
        self.capabilities = WorldCapabilities(
            joints=self.joints, rate_hz=self.rate_hz, lower_rad=np.tile(servo.lower_rad, limbs),
            upper_rad=np.tile(servo.upper_rad, limbs), velocity_rad_s=np.full(len(self.joints), servo.velocity_rad_s),
            torque_nm=np.full(len(self.joints), servo.torque_nm), has_body_pose=self._sees,
            has_contact_forces=self._sees,
        )  # fmt: skip

    def reset(self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array) -> State:
        """The first measurement of the log."""
        self._row, self.worst_rad = 0, 0.0
        return self._states[0]

    def step(self, targets_rad: Array) -> State:
        """The next measurement. Raises HardwareFault where the log ends."""
        self._row += 1
        if self._row >= len(self._states) or self._row > len(self._sent):
            raise HardwareFault(f"replay: the log ends after {self._row - 1} commands")
        away = float(np.abs(np.asarray(targets_rad) - self._sent[self._row - 1]).max())
        with self.latch.sending():
            self.worst_rad = max(self.worst_rad, away)
        return self._states[self._row]

    def close(self) -> None:
        """Nothing is held."""
