"""The emergency stop as a ROS topic of std_msgs/Bool, heard through a rosbridge whatever world the
robot is in.
"""

from __future__ import annotations

import re
from types import TracebackType
from typing import Self

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import shown

from ..worlds.ros.bridge import RosLink
from ..worlds.ros.estop import BOOL, Estop
from ..worlds.settings import EstopCheck

ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9._-]+):(?P<port>\d{1,5})(?P<topic>/[A-Za-z0-9_/]+)")
_TIMEOUT_S = 3.0


class StopTopic:
    """A source of stops: call it.

    A context manager, connected while it is entered.

    Arguments:
        address: HOST:PORT/TOPIC. True stops, false does not start again. A connection that is lost,
            and a message that is no Bool, stop, too: a stop button that cannot be read is no stop
            button.
        check: how it is known to work when it is entered; None does not ask.

    Raises:
        InvalidInput: for what is no address, without roslibpy, and, when entered, where no
            rosbridge is, and for a topic of which too little is known.
    """

    def __init__(
        self, address: str, timeout_s: float = _TIMEOUT_S, check: EstopCheck | None = None
    ) -> None:
        match = ADDRESS.fullmatch(address)
        if match is None or not 0 < int(match["port"]) < 65536:
            raise InvalidInput(
                "stop_topic: expected HOST:PORT/TOPIC, as localhost:9090/e_stop, got "
                f"{shown(address)}"
            )
        self._check = check
        self._link = RosLink(match["host"], int(match["port"]), timeout_s)
        self._estop = Estop(self._link, match["topic"])

    def __call__(self) -> str | None:
        """Why to stop, None where there is no reason."""
        if self._estop.pressed:
            return f"e-stop pressed on {self._estop.topic}"
        return self._link.trouble() or self._estop.lost()

    def __enter__(self) -> Self:
        self._link.open()
        self._estop.subscribe(BOOL)  # this name both versions of ROS take
        try:
            if self._check is not None:
                self._estop.confirm(self._check)
        except InvalidInput:
            self._link.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._link.close()
