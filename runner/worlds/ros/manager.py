"""The controller manager of ros_control: whether a controller runs, over which joints, and
switching it on and off.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from stancekit.planners.errors import HardwareFault, InvalidInput

from .bridge import RosLink
from .setup import RosSetup

RUNNING = ("running", "active")
DEFAULT = "/controller_manager"


@dataclass(frozen=True, kw_only=True)
class Listed:
    """A controller as its manager lists it.

    Arguments:
        state: "running" or "active" where it is.
        joints: that it moves.
    """

    state: str
    joints: frozenset[str]

    @property
    def runs(self) -> bool:
        """Tell whether it moves its joints."""
        return self.state in RUNNING


class ControllerManager:
    """The manager that a setup names, over a connection."""

    def __init__(self, link: RosLink, setup: RosSetup) -> None:
        self._link, self._setup = link, setup
        self._controller = setup.controller.rsplit("/", 1)[-1]

    def listed(self, manager: str | None = None) -> Listed | None:
        """Entry of the setup's controller; None where nobody answers, or does not know it.

        Arguments:
            manager: another one to ask.
        """
        name = manager or self._setup.controller_manager or DEFAULT
        try:
            answer = self._link.call(f"{name}/list_controllers", self._kind("ListControllers"), {})
        except InvalidInput:
            return None
        for each in answer.get("controller") or []:
            if isinstance(each, dict) and each.get("name") == self._controller:
                return Listed(state=str(each.get("state")), joints=_joints(each))
        return None

    def switch(self, on: bool, sending: AbstractContextManager[None] | None = None) -> None:
        """Switch the controller on or off, within ``sending``.

        Raises HardwareFault where that is refused, or nobody is there to ask.
        """
        manager, ros = self._setup.controller_manager, self._setup.ros
        if manager is None:
            raise HardwareFault(
                "torque: cannot be switched, the setup names no controller_manager; the robot holds"
            )
        verbs = ("activate", "deactivate") if ros == 2 else ("start", "stop")
        lists = {
            f"{verb}_controllers": [self._controller] if on == (k == 0) else []
            for k, verb in enumerate(verbs)
        }
        try:
            with sending or nullcontext():
                request = lists | {"strictness": 1}
                answer = self._link.call(
                    f"{manager}/switch_controller", self._kind("SwitchController"), request
                )
        except InvalidInput as error:
            raise HardwareFault(f"torque: {error}") from None
        if answer.get("ok") is not True:
            raise HardwareFault(
                f"torque: {manager} did not switch {self._controller} {'on' if on else 'off'}"
            )

    def _kind(self, name: str) -> str:
        return "controller_manager_msgs/" + ("srv/" if self._setup.ros == 2 else "") + name


def _joints(controller: dict[str, Any]) -> frozenset[str]:
    """Joints among what it claims, of either version of ROS."""
    claimed = controller.get("claimed_resources") or []
    names = {
        str(name)
        for each in claimed
        if isinstance(each, dict)
        for name in each.get("resources") or []
    }
    interfaces = (
        controller.get("required_command_interfaces") or controller.get("claimed_interfaces") or []
    )
    return frozenset(names | {str(each).rsplit("/", 1)[0] for each in interfaces})
