"""A robot behind a rosbridge as a world (extra ``machines``), driven by a joint trajectory controller
of ROS 1 or 2.

Every period a trajectory of one point is published, the target, to be reached ``lead_s`` later, on
the controller's topic, and each replaces the one before. A lost connection, or a host that died,
leaves the controller with one point less than ``lead_s`` away: it goes there and holds. (An action
goal a period would not do: a rosbridge keeps a client and a thread for each.)
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Self

from stancekit.planners.errors import HardwareFault
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.robot.robot_file import Servo, joint_names

from ..drives import Drives
from ..hardware import RATE_HZ, HardwareWorld
from ..settings import EstopCheck, WorldSettings
from .robot import POLL_S, RosRobot
from .setup import RosSetup


class RosWorld(HardwareWorld):
    """Joints that a controller moves; ``stop`` may come from another thread.

    Torques are the efforts that ROS reports. Raises InvalidInput for a setup that lacks joints, and
    without roslibpy or pinocchio.

    Arguments:
        estop: how the e-stop of the setup is known to work before the robot is armed.
    """

    name = "ros"
    wrong = "is its name or offset right"

    def __init__(
        self,
        robot: Robot,
        setup: RosSetup,
        servo: Servo | None = None,
        *,
        rate_hz: float = RATE_HZ,
        actuators: Actuators | None = None,
        estop: EstopCheck = "heard",
    ) -> None:
        drives = Drives.of(robot.source.legs(servo or robot.servo), actuators)
        known = actuators is not None and all(
            each.stiffness_nm_rad is not None for each in drives.actuators
        )
        super().__init__(robot, servo, replace(drives, yields=known), rate_hz)
        self.alone = f"the controller goes to its last target, {setup.lead_s:g} s away, and holds"
        self.setup, self.estop, self._evidence = setup, estop, ""
        self._robot = self._made()
        self._switched = False  # on, by an arming that did not end well

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``JointBus``."""
        setup = RosSetup.from_yaml(
            settings.file("a set-up file", cls.name), joint_names(settings.robot)
        )
        settings.check_name(setup.robot)
        return cls(
            settings.robot,
            setup,
            settings.servo,
            rate_hz=RATE_HZ if settings.rate_hz is None else settings.rate_hz,
            actuators=settings.actuators,
            estop=settings.estop,
        )

    def stop(self, *, torque_off: bool = False) -> str:
        """Send nothing any more: the controller holds its last target, and a rosbridge that is late
        is sent a hold for what waits in it; or it is switched off. Then wait until nothing moves,
        and say what may still come.

        After an arming that was interrupted it is switched off; raises HardwareFault where that
        cannot be done.
        """
        self.armed = False
        if self._switched or (torque_off and self._open):
            self._robot.switch(False)
            self._switched = False
        return "" if torque_off else self._robot.settle(1.0 / self.rate_hz, self.beat)

    def report(self) -> str:
        """Evidence about the e-stop, of the last arming."""
        return self._evidence

    def close(self) -> None:
        """Disconnect; the robot holds."""
        self.armed = self._open = False
        self._robot.link.close()

    def _reached(self) -> tuple[Array, Array, Array]:
        """Connect, check the controller's joints, measure.

        Raises InvalidInput where no rosbridge is, where it answers nonsense, for joints that do not
        match, and an e-stop that is pressed.
        """
        self.close()
        self._robot, self._driven = self._made(), False
        try:
            self._robot.connect()
        except BaseException:
            self._robot.link.close()
            raise
        self._open = True
        return self._robot.states.read()

    def _switched_on(self) -> None:
        """Have the controller hold the measured pose, switched on if the setup names its manager.

        Raises InvalidInput for an e-stop that would not be heard, for joints that another node
        moves, and for a controller that takes no commands.
        """
        period_s = 1.0 / self.rate_hz
        self._robot.wake(period_s)
        self._evidence = self._robot.confirm(self.estop)
        if not self._robot.stopped:
            self._robot.check_free()
        self._driven = True
        if self.setup.controller_manager is not None:
            self.latch.check()
            self._switched = True
            self._robot.switch(True)
            self._robot.started()
        self._robot.wake(period_s)
        self._sent = self._robot.states.read()[0]
        self._robot.take_over(self._sent, period_s)
        self.latch.check()
        self._switched = False

    def _put(self, angles_rad: Array) -> Array:
        """Stream targets, once joint states are fresh: or they would wait with what was sent
        before.
        """
        self._check()
        while not self._robot.fresh(1.0 / self.rate_hz):
            self.latch.check()
            self.beat()
            time.sleep(POLL_S)
            self._check()
        self._robot.stream(angles_rad)
        return angles_rad

    def _measured(self) -> tuple[Array, Array, Array]:
        self._check()
        return self._robot.states.read()

    def _made(self) -> RosRobot:
        return RosRobot(self.setup, self.joints, self.latch, self.capabilities.velocity_rad_s)

    def _check(self) -> None:
        """Raise HardwareFault for whatever is wrong now."""
        if (trouble := self._robot.trouble()) is not None:
            raise HardwareFault(trouble)
