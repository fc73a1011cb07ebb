"""The public rosbridge v2 protocol as tables: operations and ROS messages with their fields, and a
client.

Written from the protocol's specification (rosbridge_suite) and the definitions of trajectory_msgs.
"""

from __future__ import annotations

import contextlib
import json
import queue
import threading
import time
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection

OPERATIONS: dict[str, dict[str, tuple[type, ...]]] = {
    "advertise": {"topic": (str,), "type": (str,)},
    "unadvertise": {"topic": (str,)},
    "publish": {"topic": (str,), "msg": (dict,)},
    "subscribe": {"topic": (str,)},
    "unsubscribe": {"topic": (str,)},
    "call_service": {"service": (str,)},
}
"""Operations that a client may send, and the fields that the protocol requires of it."""
OPTIONAL: dict[str, tuple[type, ...]] = {
    "id": (str, int),
    "type": (str,),
    "throttle_rate": (int,),
    "queue_length": (int,),
    "queue_size": (int,),
    "fragment_size": (int,),
    "compression": (str,),
    "args": (list, dict),
    "latch": (bool,),
    "timeout": (int, float),
}
HEADER = {"header"}
FIELDS = {
    "JointTrajectory": {"joint_names", "points"} | HEADER,
    "JointTrajectoryPoint": {
        "positions",
        "velocities",
        "accelerations",
        "effort",
        "time_from_start",
    },
}
"""Fields of the ROS messages; a rosbridge refuses any other."""


HEARD: dict[int, int] = {}
"""Messages that a host of this process took from its connection, by the connection's own port."""


class Client:
    """One connection: what it listens to, and a thread that sends, so that a delay can be put
    in.
    """

    def __init__(self, socket: ServerConnection) -> None:
        self.socket, self.topics = socket, set[str]()
        self._sent, self._port = 0, int(socket.remote_address[1])
        HEARD.pop(self._port, None)
        self.advertised = dict[str, float]()  # topic, and when
        self.ended = set[str]()  # topics that were advertised no more, once
        self._waiting: queue.Queue[tuple[float, str] | None] = queue.Queue()
        threading.Thread(target=self._send, daemon=True).start()

    def say(self, message: Any, due_s: float) -> None:
        """Send at a time; a text as it is."""
        self._waiting.put((due_s, message if isinstance(message, str) else json.dumps(message)))

    def end(self) -> None:
        """Send nothing any more."""
        self._waiting.put(None)

    def drop(self) -> None:
        """Cut the line, as a cable that is pulled."""
        with contextlib.suppress(OSError):
            self.socket.socket.shutdown(2)

    def _send(self) -> None:
        while (item := self._waiting.get()) is not None:
            time.sleep(max(0.0, item[0] - time.monotonic()))
            with contextlib.suppress(ConnectionClosed, OSError):
                self._sent += 1
                self.socket.send(item[1])

    def behind(self) -> bool:
        """Tell whether a host that counts what it hears (``HEARD``) has yet to hear something."""
        return HEARD.get(self._port, self._sent) < self._sent


def operation_wrong(message: Any) -> str | None:
    """Fault of an operation by the protocol, None if there is none."""
    if not isinstance(message, dict) or not isinstance(message.get("op"), str):
        return "no op"
    needed = OPERATIONS.get(message["op"])
    if needed is None:
        return f"unknown op {message['op']}"
    for key, kinds in (OPTIONAL | needed).items():
        if key in needed and key not in message:
            return f"{message['op']}: {key} is missing"
        if key in message and not isinstance(message[key], kinds):
            return f"{message['op']}: {key} is {type(message[key]).__name__}"
    return None


def fields_wrong(said: Any, kind: str) -> str | None:
    """Fault of the fields of a message."""
    if not isinstance(said, dict):
        return f"{kind}: not an object"
    unknown = set(said) - FIELDS[kind]
    return f"{kind}: no field {min(unknown)}" if unknown else None


def path_wrong(said: Any, nanos: str) -> str | None:
    """Fault of a JointTrajectory."""
    if (wrong := fields_wrong(said, "JointTrajectory")) is not None:
        return wrong
    if "header" in said and not set(said["header"]) <= {"stamp", "frame_id", "seq"}:
        return f"Header: fields {sorted(said['header'])}"
    whole = "sec" if nanos == "nanosec" else "secs"
    for point in said["points"]:
        if (wrong := fields_wrong(point, "JointTrajectoryPoint")) is not None:
            return wrong
        time_s = point["time_from_start"]
        if set(time_s) != {whole, nanos} or not all(
            type(v) is int and v >= 0 for v in time_s.values()
        ):
            return f"JointTrajectoryPoint: time_from_start is {time_s}"
        if len(point["positions"]) != len(said["joint_names"]):
            return "JointTrajectoryPoint: positions are not one a joint"
    return None
