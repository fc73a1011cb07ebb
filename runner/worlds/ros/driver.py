"""A robot behind a rosbridge as a world (extra ``machines``), driven by a joint trajectory controller
of ROS 1 or 2.

``step`` streams: every period it publishes a trajectory of one point, the target, to be reached
``lead_s`` later, on the controller's topic, and each replaces the one before. A lost connection, or
a host that died, leaves the controller with one point less than ``lead_s`` away: it goes there and
holds. (An action goal a period would not do: a rosbridge keeps a client and a thread for each.)
``run_trajectory`` hands a whole trajectory over as one action goal, which the controller itself
keeps within tolerances; nobody can stop that when the connection is lost, so it may only be short.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Self

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.robot import Robot
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.robot.robot_file import Servo, joint_names

from ..drives import Drives
from ..hardware import RATE_HZ, HardwareWorld
from ..settings import EstopCheck, WorldSettings
from ..world import State, Terrain
from .follow import Follower
from .robot import POLL_S, RosRobot
from .setup import RosSetup

_SLACK_RAD = 0.05
"""A joint measured this far beyond its limits is taken for one at its stop, farther for one that is
mapped wrong."""


class RosWorld(HardwareWorld):
    """``reset`` connects and measures, ``torque(True)`` arms, ``step`` moves.

    ``hold`` may come from another thread.

    estop: how the e-stop of the setup is known to work before the robot is armed; evidence: what is
    known of it then. pending: what may still move the robot after ``hold``. beat: called while
    ``step`` waits for joint states. Torques are the efforts that ROS reports. Raises InvalidInput
    for a setup that lacks joints, and without roslibpy or pinocchio.
    """

    name = "ros"

    def __init__(
        self,
        robot: Robot,
        setup: RosSetup,
        servo: Servo | None = None,
        *,
        rate_hz: float = RATE_HZ,
        actuators: Actuators | None = None,
    ) -> None:
        servo = servo or robot.servo
        super().__init__(robot, servo, rate_hz)
        drives = Drives.of(self._kinematics.model, actuators)
        known = actuators is not None and all(
            each.stiffness_nm_rad is not None for each in drives.actuators
        )
        self.drives = replace(drives, yields=known)
        self.setup, self.capabilities = setup, self._limits(drives)
        self._robot = self._made()
        self._follower = Follower(self._robot)
        self.estop: EstopCheck = "heard"
        self.evidence, self.pending = "", ""
        self.beat: Callable[[], None] = lambda: None
        self._switched = False  # on, by an arming that did not end well

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``WorldClass``."""
        setup = RosSetup.from_yaml(
            settings.file("a set-up file", cls.name), joint_names(settings.robot)
        )
        settings.check_name(setup.robot)
        rate_hz = RATE_HZ if settings.rate_hz is None else settings.rate_hz
        made = cls(
            settings.robot, setup, settings.servo, rate_hz=rate_hz, actuators=settings.actuators
        )
        made.estop = settings.estop
        return made

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Connect, check the controller's joints, measure; nothing is sent that could move the
        robot.

        Arguments:
            angles_rad: not used, the measured ones come back.
            position_m, rotation: where the body is taken to be.

        Raises:
            InvalidInput: where no rosbridge is, where it answers nonsense, for joints that do not
                match, angles beyond limits, and an e-stop that is pressed.
        """
        self.close()
        self._robot = self._made()
        self._follower = Follower(self._robot)
        try:
            self._robot.connect()
        except InvalidInput:
            self._robot.link.close()
            raise
        self._open = True
        self._begin(position_m, rotation)
        self._sent = self._robot.states.read()[0]
        self._check_angles(self._sent, "measured", _SLACK_RAD, ": is its name or offset right?")
        return self._state()

    def torque(self, on: bool) -> None:
        """Arm: hold the measured pose, the controller switched on if the setup names its manager;
        or switch it off.

        However an arming is interrupted, the controller is off again if it was switched on;
        ``hold`` makes sure of it. Raises InvalidInput, and nothing has moved, for an e-stop that
        would not be heard, where somebody else moves the joints, and for a controller that takes no
        commands.
        """
        if not on:
            self.relax()
            return
        if not self._open:
            raise InvalidInput("world: expected reset before torque, got no reset")
        self._robot.wake(1.0 / self.rate_hz)
        try:
            self._arm()
        except BaseException:  # joints are held, then it is raised again
            with suppress(
                HardwareFault
            ):  # what goes wrong now goes wrong in ``hold``, too, and is told there
                self.hold()
            raise
        self.armed, self._switched, self._due_s = True, False, time.monotonic()

    def step(self, targets_rad: Array) -> State:
        """Stream targets, wait for the end of the control period, measure.

        Targets are clipped to limits and to what a joint can turn in a period; ``sent_rad`` says
        what was sent. Raises InvalidInput for targets that are not finite, and where the world is
        not armed; HardwareFault when the connection is lost, for nonsense, measurements that are
        too old, and the e-stop. Then the world is not armed.
        """
        targets = self._checked(targets_rad)
        self._check()
        while not self._robot.fresh(
            1.0 / self.rate_hz
        ):  # or what is sent now would wait with what was sent before
            self.latch.check()
            self.beat()
            time.sleep(POLL_S)
            self._check()
        self._sent = self.sendable(targets)
        try:
            self._robot.stream(self._sent)
        except HardwareFault:
            self.armed = False
            raise
        self._wait()
        self._check()
        return self._state()

    def run_trajectory(
        self, times_s: Array, angles_rad: Array, on_state: Callable[[State], None] | None = None
    ) -> State:
        """Hand a whole trajectory over, from the pose held now, and wait for its end, where the
        robot is at rest.

        Arguments:
            times_s: shape (T,), from the start, increasing from above 0.
            angles_rad: shape (T, J).
            on_state: gets a state for every feedback. Before the first one a goal that holds the
                pose is sent and cancelled, to see that it can be.

        Raises:
            InvalidInput: before any motion, for a trajectory beyond limits or longer than the
                setup's alone_s, and where goals cannot be cancelled; HardwareFault for one that did
                not succeed: a trouble on the way, or ``hold``, cancels it.
        """
        if not self.armed:
            raise InvalidInput("world: expected torque(True) before run_trajectory, got no torque")
        times = read_only(times_s, (None,), "times_s")
        angles = read_only(angles_rad, (len(times), len(self.joints)), "angles_rad")
        self._check_trajectory(times, angles)
        self._check()
        self._due_s = time.monotonic()
        self._robot.controller.forget()
        try:
            self._follower.follow(
                self._sent,
                times,
                angles,
                lambda: on_state(self._state()) if on_state is not None else None,
            )
        except HardwareFault:
            self.armed = False
            raise
        self._sent = angles[-1].copy()
        return self._state()

    def hold(self) -> None:
        """Cancel a trajectory that is on its way; otherwise the controller holds its last target,
        and a rosbridge that is late is sent a hold for what waits in it. Then wait until nothing
        moves: ``pending`` says what may still come, empty where nothing may.

        After an arming that was interrupted it is switched off; raises HardwareFault where that
        cannot be done.
        """
        self.armed = False
        self._follower.stop()
        if self._switched:
            self._robot.switch(False)
            self._switched = False
        self.pending = self._robot.settle(1.0 / self.rate_hz, self.beat)

    def relax(self) -> None:
        """Switch the controller off.

        Raises HardwareFault where that cannot be done.
        """
        self.armed = False
        self._follower.stop()
        if self._open:
            self._robot.switch(False)
            self._switched = False

    def close(self) -> None:
        """Disconnect; the robot holds."""
        self.armed = self._open = False
        self._follower.stop()
        self._robot.link.close()

    def _arm(self) -> None:
        self.evidence = self._robot.confirm(self.estop)
        if not self._robot.stopped:
            self._robot.check_free()
        if self.setup.controller_manager is not None:
            self.latch.check()
            self._switched = True
            self._robot.switch(True)
            self._robot.started()
        self._robot.wake(1.0 / self.rate_hz)
        self._sent = self._robot.states.read()[0]
        self._follower.ready()
        self._robot.take_over(self._sent, 1.0 / self.rate_hz)
        self.latch.check()

    def _made(self) -> RosRobot:
        return RosRobot(self.setup, self.joints, self.latch, self.capabilities.velocity_rad_s)

    def _check(self) -> None:
        """Raise HardwareFault for whatever is wrong now; the world is not armed then."""
        trouble = self._robot.trouble()
        if trouble is not None:
            self.armed = False
            raise HardwareFault(trouble)

    def _check_angles(self, angles: Array, came: str, slack_rad: float, hint: str = "") -> None:
        can = self.capabilities
        for index in np.flatnonzero(
            (angles < can.lower_rad - slack_rad) | (angles > can.upper_rad + slack_rad)
        ):
            raise InvalidInput(
                f"{self.joints[index]}: expected an angle in [{can.lower_rad[index]:.2f}, "
                f"{can.upper_rad[index]:.2f}] "
                f"rad, {came} {angles[index]:.2f}{hint}"
            )

    def _check_trajectory(self, times: Array, angles: Array) -> None:
        if not len(times) or np.any(np.diff(times, prepend=0.0) <= 0.0):
            raise InvalidInput("times_s: expected times that increase from above 0, got others")
        if times[-1] > self.setup.alone_s:
            raise InvalidInput(
                f"times_s: expected up to {self.setup.alone_s:g} s (alone_s), got {times[-1]:g}: "
                "nobody can stop a "
                "trajectory when the connection is lost; stream it by step"
            )
        for row in angles:
            self._check_angles(row, "got", 1e-9)
        rates = (
            np.diff(angles, axis=0, prepend=self._sent[None, :])
            / np.diff(times, prepend=0.0)[:, None]
        )
        worst = np.abs(rates).max(axis=0) - self.capabilities.velocity_rad_s
        if worst.max() > 1e-9:
            index = int(np.argmax(worst))
            raise InvalidInput(
                f"{self.joints[index]}: expected up to "
                f"{self.capabilities.velocity_rad_s[index]:g} rad/s, got "
                f"{np.abs(rates[:, index]).max():.3g}"
            )

    def _state(self) -> State:
        return self._state_of(*self._robot.states.read())
