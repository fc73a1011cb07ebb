"""Goals of FollowJointTrajectory over a rosbridge: actions of its protocol for ROS 2, actionlib's
topics for ROS 1.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array

from .bridge import Message, RosLink, roslibpy

_ERRORS = {
    -1: "invalid goal",
    -2: "invalid joints",
    -3: "old header timestamp",
    -4: "path tolerance violated",
    -5: "goal tolerance violated",
}
"""Error codes of a FollowJointTrajectory result."""
_ACTIVE = 1
"""actionlib's status of a goal that is acted on."""
_ROS1_ENDS = {
    2: "cancelled",
    3: "succeeded",
    4: "aborted",
    5: "rejected",
    8: "cancelled",
    9: "lost",
}
_ROS2_ENDS = {4: "succeeded", 5: "cancelled", 6: "aborted"}


class Goal(ABC):
    """One goal from its sending to its end. active: set once the robot acts on it, or it has ended:
    a cancel that comes earlier may be lost. ended: how, None while it goes on; "succeeded" if it
    did.
    """

    def __init__(self) -> None:
        self.done, self.active = threading.Event(), threading.Event()
        self.ended: str | None = None

    @abstractmethod
    def cancel(self, link: RosLink) -> None:
        """Ask that it stop, over this connection; ``done`` follows when the robot says so."""

    def _end(self, how: str, result: Any) -> None:
        code = result.get("error_code") if isinstance(result, dict) else None
        detail = result.get("error_string") if isinstance(result, dict) else result
        if how == "succeeded" and isinstance(code, int) and code < 0:
            how = "aborted"
        why = _ERRORS.get(code, "") if isinstance(code, int) else ""
        message = detail if isinstance(detail, str) else ""
        self.ended = (
            how
            if how == "succeeded"
            else ": ".join(part for part in (how, why, message[:100]) if part)
        )
        self.active.set()
        self.done.set()

    def _fed(self, on_feedback: Callable[[Message], None], message: Any) -> None:
        self.active.set()
        on_feedback(dict(message))


class _Ros2Goal(Goal):
    """A goal of the operations ``send_action_goal`` and ``cancel_action_goal``."""

    def __init__(
        self, link: RosLink, action: str, goal: Message, on_feedback: Callable[[Message], None]
    ) -> None:
        super().__init__()
        module = roslibpy()
        self._client = module.ActionClient(
            link.ros, action, "control_msgs/action/FollowJointTrajectory"
        )
        self.id = self._client.send_goal(
            module.Goal(goal),
            self._resulted,
            lambda message: self._fed(on_feedback, message),
            self._failed,
        )

    def cancel(self, link: RosLink) -> None:
        """Ask that it stop.

        Not by roslibpy's own verb, which knows one connection only.
        """
        link.send({"op": "cancel_action_goal", "id": self.id, "action": self._client.name})

    def _resulted(self, message: Any) -> None:
        values = message["values"]
        result = values.get("result", values) if isinstance(values, dict) else values
        self._end(_ROS2_ENDS.get(message["status"].value, "ended without a status"), result)

    def _failed(self, message: Any) -> None:
        self._end("rejected", message["values"])


class _Ros1Goal(Goal):
    """A goal of actionlib.

    It ends with its result and a final status: the result of a rejected goal looks like one.
    """

    def __init__(self, client: Any, goal: Message, on_feedback: Callable[[Message], None]) -> None:
        from roslibpy.ros1 import actionlib

        super().__init__()
        self._result: Any = None
        self._status: str | None = None
        self._goal = actionlib.Goal(client, goal)
        self._goal.on("feedback", lambda message: self._fed(on_feedback, message))
        self._goal.on("result", self._resulted)
        self._goal.on("status", self._stated)
        self._goal.send()

    def cancel(self, link: RosLink) -> None:
        """Ask that it stop, on the action's topic."""
        topic = f"{self._goal.action_client.server_name}/cancel"
        link.publish(
            topic,
            "actionlib_msgs/GoalID",
            {"stamp": {"secs": 0, "nsecs": 0}, "id": self._goal.goal_id},
        )

    def _resulted(self, message: Any) -> None:
        self._result = dict(message)
        self._ready()

    def _stated(self, message: Any) -> None:
        if message["status"] == _ACTIVE:
            self.active.set()
        self._status = _ROS1_ENDS.get(message["status"])
        self._ready()

    def _ready(self) -> None:
        if self._status is not None and self._result is not None and not self.done.is_set():
            self._end(self._status, self._result)


class Goals:
    """Sender of goals.

    Raises InvalidInput for a ROS 1 action server that is not there.
    """

    def __init__(self, link: RosLink, controller: str, ros: Literal[1, 2]) -> None:
        self._link, self._action, self._ros = link, f"{controller}/follow_joint_trajectory", ros
        self._client: Any = None
        if ros == 1:
            from roslibpy.ros1 import actionlib

            kind = "control_msgs/FollowJointTrajectoryAction"
            try:
                self._client = actionlib.ActionClient(link.ros, self._action, kind)
            except roslibpy().core.RosTimeoutError:
                raise InvalidInput(
                    f"{self._action}: expected an action server, it publishes no status"
                ) from None

    def send(self, goal: Message, on_feedback: Callable[[Message], None]) -> Goal:
        """Send a goal.

        Arguments:
            on_feedback: gets its feedback, in roslibpy's thread.
        """
        if self._ros == 1:
            return _Ros1Goal(self._client, goal, on_feedback)
        return _Ros2Goal(self._link, self._action, goal, on_feedback)


def ready_to_cancel(link: RosLink, controller: str, ros: Literal[1, 2]) -> None:
    """Say that goals may be cancelled: in ROS 1 a cancel on a topic that was not advertised comes
    late, or never.
    """
    if ros == 1:
        link.advertise(f"{controller}/follow_joint_trajectory/cancel", "actionlib_msgs/GoalID")


def cancel_all(link: RosLink, controller: str, ros: Literal[1, 2]) -> None:
    """Cancel every goal of a controller, whoever sent it.

    Raises InvalidInput where nobody answers.

    In ROS 2 by the action's own service, which knows no connections: a rosbridge cancels only goals
    that came over it.
    """
    action = f"{controller}/follow_joint_trajectory"
    if ros == 1:
        link.publish(
            f"{action}/cancel", "actionlib_msgs/GoalID", {"stamp": duration(0.0, 1), "id": ""}
        )
        return
    everything = {"goal_info": {"goal_id": {"uuid": [0] * 16}, "stamp": duration(0.0, 2)}}
    link.call(f"{action}/_action/cancel_goal", "action_msgs/srv/CancelGoal", everything)


def trajectory(
    names: tuple[str, ...],
    times_s: Array,
    positions: Array,
    velocities: Array | None,
    ros: Literal[1, 2],
    stamp_s: float = 0.0,
) -> Message:
    """A JointTrajectory; shapes (T,), (T, J), (T, J).

    Without velocities the controller goes in straight lines.

    Arguments:
        stamp_s: when it begins, by the robot's clock; one that has ended by then when it arrives is
            dropped. A stamp of 0 is "from when it arrives". Where it is left out, a rosbridge
            writes its own clock's time into it.
    """
    points = [
        {"positions": positions[k].tolist(), "time_from_start": duration(float(time_s), ros)}
        | ({} if velocities is None else {"velocities": velocities[k].tolist()})
        for k, time_s in enumerate(times_s)
    ]
    header = {"stamp": duration(stamp_s, ros), "frame_id": ""}
    return {"header": header, "joint_names": list(names), "points": points}


def standstill(names: tuple[str, ...], ros: Literal[1, 2]) -> Message:
    """A JointTrajectory without points, at which a controller of ROS 1 holds where it is, whatever
    it was doing.
    """
    return trajectory(names, np.zeros(0), np.zeros((0, len(names))), None, ros)


def follow_goal(
    path: Message,
    names: tuple[str, ...],
    path_rad: float,
    goal_rad: float,
    goal_s: float,
    ros: Literal[1, 2],
) -> Message:
    """A goal of FollowJointTrajectory."""

    def tolerances(position: float) -> list[Message]:
        return [
            {"name": name, "position": position, "velocity": 0.0, "acceleration": 0.0}
            for name in names
        ]

    return {
        "trajectory": path,
        "path_tolerance": tolerances(path_rad),
        "goal_tolerance": tolerances(goal_rad),
        "goal_time_tolerance": duration(goal_s, ros),
    }


def duration(seconds: float, ros: Literal[1, 2]) -> Message:
    """A duration as ROS 1 or ROS 2 writes it."""
    whole, nanos = divmod(round(seconds * 1e9), 1_000_000_000)
    return {"sec": whole, "nanosec": nanos} if ros == 2 else {"secs": whole, "nsecs": nanos}


def speeds(times_s: Array, angles_rad: Array, first_rad: Array) -> Array:
    """Velocities at the points of a trajectory that begins and ends at rest, shape (T, J)
    [rad/s].
    """
    result = np.gradient(
        np.vstack([first_rad, angles_rad]), np.concatenate([[0.0], times_s]), axis=0
    )[1:]
    result[-1] = 0.0
    return np.asarray(result)
