"""A robot behind a rosbridge: its controller, what it says of its joints, its e-stop, and what is wrong with any."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.validation import shown

from ...safety.latch import StopLatch
from .bridge import RosLink
from .goal import Goals, trajectory
from .joint_states import JointStates
from .setup import Mapping, RosSetup

POLL_S = 0.01
LOOK_S = 0.1
"""So long is listened at least, for nonsense between what makes sense."""


class RosRobot:
    """One connection to one robot. ``listen`` first; a robot that is lost stays lost. J joints.

    latch: whatever moves it passes this. pressed: whether the e-stop was pressed since; letting go of the button
    changes nothing. Raises InvalidInput for a
    setup that lacks joints, and without roslibpy.
    """

    def __init__(self, setup: RosSetup, joints: Sequence[str], latch: StopLatch) -> None:
        self.setup, self.mapping, self.latch = setup, Mapping(setup, joints), latch
        self.states = JointStates(self.mapping, joints)
        self.link = RosLink(setup.host, setup.port, setup.timeout_s)
        self.goals: Goals
        self.pressed = False
        self._joints, self._controlled = tuple(joints), list[str]()

    def connect(self) -> None:
        """Connect and subscribe; nothing is sent that could move the robot. Raises InvalidInput."""
        setup = self.setup
        self.link.open()
        self.link.subscribe(setup.joint_states, self.kind("sensor_msgs", "JointState"), self.states.take)
        state = "controller_state" if setup.ros == 2 else "state"
        self.link.subscribe(
            f"{setup.controller}/{state}", self.kind("control_msgs", "JointTrajectoryControllerState"), self._controls
        )
        if setup.estop is not None:
            self.link.subscribe(setup.estop, self.kind("std_msgs", "Bool"), self._press)
        self.listen()
        self.goals = Goals(self.link, setup.controller, setup.ros)

    def listen(self) -> None:
        """Wait until the robot has spoken of all joints, and see that its controller means the same ones.

        Raises InvalidInput for silence, nonsense, and joints that do not match.
        """
        setup, url = self.setup, f"rosbridge {self.setup.url}"
        begin, late, missing = time.monotonic(), False, list(self._joints)
        while not late and self.trouble(silence=False) is None:
            time.sleep(POLL_S)
            spent_s, missing = time.monotonic() - begin, self.states.silent(setup.stale_s)
            if not missing and self._controlled and spent_s > LOOK_S:
                break
            late = spent_s > setup.timeout_s
        if (trouble := self.trouble(silence=False)) is not None:
            raise InvalidInput(trouble)
        others = sorted(self.states.others)
        if late and missing and len(missing) == len(self._joints) and not others:
            raise InvalidInput(f"{url}: expected joint states on {setup.joint_states}, heard none")
        if late and missing:
            there = f"; other names there: {listed(others)}" if others else ""
            raise InvalidInput(f"{url}: {setup.joint_states}: expected all joints, nothing of {listed(missing)}{there}")
        if late:
            raise InvalidInput(f"{url}: expected the state of {setup.controller}, heard nothing: is it running?")
        wrong = sorted(set(self._controlled).symmetric_difference(self.mapping.names))
        if wrong:
            raise InvalidInput(f"{setup.controller}: expected the joints of the setup, they differ in {listed(wrong)}")

    def trouble(self, *, silence: bool = True) -> str | None:
        """What is wrong now, None if nothing is. silence: joints that were not heard of lately are."""
        found = self.link.trouble()
        if found is None and self.pressed:
            found = f"e-stop pressed on {self.setup.estop}"
        if found is None and silence and (late := self.states.silent(self.setup.stale_s)):
            stale_ms = 1e3 * self.setup.stale_s
            found = f"{self.setup.joint_states}: {listed(late)}: nothing heard for {stale_ms:.0f} ms"
        return found

    def stream(self, targets_rad: Array) -> None:
        """Publish a trajectory of one point, shape (J,), ``lead_s`` ahead; it replaces the one before.

        Raises Stopped after a stop, HardwareFault where it cannot be sent.
        """
        topic = "joint_trajectory" if self.setup.ros == 2 else "command"
        point = self.mapping.to_ros(targets_rad)[None, :]
        path = trajectory(self.mapping.names, np.array([self.setup.lead_s]), point, None, self.setup.ros)
        message = f"{self.setup.controller}/{topic}", self.kind("trajectory_msgs", "JointTrajectory"), path
        self.link.through(self.latch, lambda: self.link.publish(*message))

    def switch(self, on: bool) -> None:
        """Switch the controller on or off. Raises HardwareFault where that is refused, or nobody is there to ask; and
        Stopped after a stop, for on."""
        manager, controller = self.setup.controller_manager, self.setup.controller.rsplit("/", 1)[-1]
        if manager is None:
            raise HardwareFault("torque: cannot be switched, the setup names no controller_manager; the robot holds")
        verbs = ("activate", "deactivate") if self.setup.ros == 2 else ("start", "stop")
        lists = {f"{verb}_controllers": [controller] if on == (k == 0) else [] for k, verb in enumerate(verbs)}
        kind = "controller_manager_msgs/" + ("srv/" if self.setup.ros == 2 else "") + "SwitchController"
        try:
            with self.latch.sending() if on else nullcontext():
                answer = self.link.call(f"{manager}/switch_controller", kind, lists | {"strictness": 1})
        except InvalidInput as error:
            raise HardwareFault(f"torque: {error}") from None
        if answer.get("ok") is not True:
            raise HardwareFault(f"torque: {manager} did not switch {controller} {'on' if on else 'off'}")

    def kind(self, package: str, name: str) -> str:
        """The type of a message, as this ROS names it."""
        return f"{package}/msg/{name}" if self.setup.ros == 2 else f"{package}/{name}"

    def _controls(self, message: Any) -> None:
        names = message.get("joint_names") if isinstance(message, dict) else None
        if not isinstance(names, list):
            raise InvalidInput(f"expected joint_names to be a list, got {shown(names, 40)}")
        self._controlled = [str(name) for name in names]

    def _press(self, message: Any) -> None:
        pressed = message.get("data") if isinstance(message, dict) else None
        if not isinstance(pressed, bool):
            raise InvalidInput(f"expected data to be true or false, got {shown(pressed, 40)}")
        self.pressed = self.pressed or pressed


def listed(names: Sequence[str]) -> str:
    """The first three of them, and how many more."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
