"""Files ``stancekit/ros/1``: where a rosbridge is, which controller moves the robot, and what it
calls the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import Strict

from ..world import SetupFile, own

_Name = Annotated[str, Field(pattern=r"^/[A-Za-z0-9_/]+$")]


@dataclass(frozen=True, kw_only=True)
class RosJoint(Strict):
    """Name of a joint in ROS, and how it counts: ros = direction · angle + offset_rad."""

    name: Annotated[str, Field(min_length=1)]
    direction: Literal[-1, 1] = 1
    offset_rad: Annotated[float, Field(ge=-6.3, le=6.3)] = 0.0


@dataclass(frozen=True, kw_only=True)
class RosSetup(SetupFile):
    """A robot behind a rosbridge.

    Arguments:
        host: host of the rosbridge.
        port: its port.
        ros: version of ROS, by which messages are named and stamped.
        controller: name of a joint trajectory controller.
        joint_states: topic of the joint angles.
        estop: topic of std_msgs/Bool, true for pressed.
        controller_manager: manager that switches the controller off, the nearest to torque off.
        lead_s: time from sending a target to reaching it; motion lags by it, and ends within it
            when the connection is lost.
        stale_s: largest age of a measurement.
        timeout_s: time to wait for an answer.
    """

    format: Literal["stancekit/ros/1"] = "stancekit/ros/1"
    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 9090
    ros: Literal[1, 2] = 2
    controller: _Name = "/joint_trajectory_controller"
    joint_states: _Name = "/joint_states"
    estop: _Name | None = None
    controller_manager: _Name | None = None
    lead_s: Annotated[float, Field(ge=0.01, le=0.5)] = 0.06
    stale_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.2
    timeout_s: Annotated[float, Field(ge=0.1, le=30.0)] = 3.0
    joints: Annotated[dict[str, RosJoint], Field(min_length=1)]

    def __post_init__(self) -> None:
        if wrong := own(
            {joint: each.name for joint, each in self.joints.items()}, "name", "a name of its own"
        ):
            raise InvalidInput("; ".join(wrong))

    @property
    def url(self) -> str:
        """Address of the rosbridge."""
        return f"ws://{self.host}:{self.port}"


def same_names(joints: Sequence[str], **settings: Any) -> RosSetup:
    """A setup whose controller calls the joints as the robot does, e.g. ``LF_yaw``, and counts the
    same way.
    """
    return RosSetup(joints={name: RosJoint(name=name) for name in joints}, **settings)


class Mapping:
    """Between joint angles [rad] in the robot's order and what ROS says; J joints."""

    def __init__(self, setup: RosSetup, joints: Sequence[str]) -> None:
        setup.check(joints)
        mapped = [setup.joints[name] for name in joints]
        self.names = tuple(each.name for each in mapped)
        self.direction = np.array([float(each.direction) for each in mapped])
        self.offset = np.array([each.offset_rad for each in mapped])

    def to_ros(self, angles_rad: Array) -> Array:
        """Angles that are sent to ROS, shape (…, J)."""
        return np.asarray(self.direction * angles_rad + self.offset)

    def from_ros(self, values: Array) -> Array:
        """Joint angles, shape (…, J)."""
        return np.asarray(self.direction * (values - self.offset))
