"""The emergency stop as a ROS topic of std_msgs/Bool, heard through a rosbridge whatever world the robot is in."""

from __future__ import annotations

import re
from types import TracebackType
from typing import Self

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown

from ..worlds.ros.bridge import Message, RosLink

ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9._-]+):(?P<port>\d{1,5})(?P<topic>/[A-Za-z0-9_/]+)")
TIMEOUT_S = 3.0


class StopTopic:
    """A source of stops: call it. A context manager, connected while it is entered.

    address: HOST:PORT/TOPIC. True stops, false does not start again. A connection that is lost, and a message that is
    no Bool, stop, too: a stop button that cannot be read is no stop button. Raises InvalidInput for what is no address,
    without roslibpy, and, when entered, where no rosbridge is.
    """

    def __init__(self, address: str, timeout_s: float = TIMEOUT_S) -> None:
        found = ADDRESS.fullmatch(address)
        if found is None or not 0 < int(found["port"]) < 65536:
            raise InvalidInput(f"stop_topic: expected HOST:PORT/TOPIC, as localhost:9090/e_stop, got {shown(address)}")
        self.topic, self._pressed = found["topic"], False
        self._link = RosLink(found["host"], int(found["port"]), timeout_s)

    def __call__(self) -> str | None:
        """Why to stop, None where there is no reason."""
        return f"e-stop pressed on {self.topic}" if self._pressed else self._link.trouble()

    def __enter__(self) -> Self:
        self._link.open()
        self._link.subscribe(self.topic, "std_msgs/Bool", self._on_message)  # this name both versions of ROS take
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._link.close()

    def _on_message(self, message: Message) -> None:
        pressed = message.get("data")
        if not isinstance(pressed, bool):
            raise InvalidInput(f"expected data to be true or false, got {shown(pressed, 40)}")
        self._pressed = self._pressed or pressed
