"""An emergency stop on a topic of std_msgs/Bool: heard, and before a robot is armed known to be
heard; and such a stop for whatever world the robot is in.
"""

from __future__ import annotations

import re
import time
from itertools import pairwise
from types import TracebackType
from typing import Any, Self

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import shown

from ..settings import EstopCheck
from .bridge import RosGraph, RosLink

BOOL = "std_msgs/Bool"
_LISTEN_S = 3.0
_TRY_S, _RELEASED_S = 60.0, 5.0
"""So long is waited for somebody to press it; one that was not heard of for RELEASED_S since is
released."""
_ASK_S = 1.0
"""So often its publishers are asked for while the robot moves."""
_MISSED, _REGULAR, _QUIET_S = 5.0, 5, 1.0
"""One that came REGULAR times is missed after MISSED of its periods, and not before QUIET_S."""
_POLL_S = 0.01


class Estop:
    """An e-stop on a topic; ``subscribe`` first. pressed: whether it was; letting go of it changes
    nothing.
    """

    def __init__(self, link: RosLink, topic: str) -> None:
        self.topic, self.pressed = topic, False
        self._link, self._graph = link, RosGraph(link)
        self._times: list[float] = []
        self._now: bool | None = None
        self._trying = self._watched = False
        self._publishers: list[list[str]] = []
        self._asked_s = -float("inf")

    def subscribe(self, kind: str) -> None:
        """Listen.

        Arguments:
            kind: the type of the topic, as this ROS names it.
        """
        self._link.subscribe(self.topic, kind, self._take)

    def confirm(self, how: EstopCheck) -> str:
        """See that it would be heard; what is known of it.

        Raises InvalidInput where that is too little.
        """
        if self.pressed:
            raise InvalidInput(f"e-stop pressed on {self.topic}")
        if how == "without":
            return f"e-stop {self.topic}: not asked for"
        if how == "try":
            return self._tried()
        publishers = self._graph.publishers(self.topic)
        kind = self._graph.type_of(self.topic) if publishers else None
        end = time.monotonic() + (0.0 if publishers and kind == BOOL else _LISTEN_S)
        while not self._times and time.monotonic() < end and self._link.trouble() is None:
            time.sleep(_POLL_S)
        if self.pressed:
            raise InvalidInput(f"e-stop pressed on {self.topic}")
        if publishers and (kind == BOOL or self._times):
            self._watched = True
            return f"e-stop {self.topic}: published by {', '.join(publishers)}"
        if self._times:
            return f"e-stop {self.topic}: heard"
        raise InvalidInput(f"e-stop {self.topic}: {self._missing(publishers, kind)}")

    def lost(self) -> str | None:
        """Why it would not be heard any more, None where nothing is known against it."""
        now = time.monotonic()
        if self._watched and now - self._asked_s > _ASK_S:
            self._asked_s = now
            self._graph.watch_publishers(self.topic, self._publishers)
        if self._watched and self._publishers and not self._publishers[-1]:
            return f"e-stop {self.topic}: it has no publisher any more"
        times = self._times
        if len(times) > _REGULAR:
            period_s = max(b - a for a, b in pairwise(times))
            if (quiet_s := now - times[-1]) > max(_MISSED * period_s, _QUIET_S):
                return f"e-stop {self.topic}: not heard for {quiet_s:.1f} s, it came every {period_s:.2f} s"
        return None

    def _tried(self) -> str:
        """Wait until it was pressed and released."""
        self._trying, end = True, time.monotonic() + _TRY_S
        try:
            while self._now is not True:
                self._wait("pressed", end)
            while self._now is not False and time.monotonic() < self._times[-1] + _RELEASED_S:
                self._wait("released", end)
        finally:
            self._trying = False
        self._watched = bool(self._graph.publishers(self.topic))
        return f"e-stop {self.topic}: pressed and released"

    def _wait(self, what: str, end_s: float) -> None:
        if time.monotonic() > end_s:
            raise InvalidInput(f"e-stop {self.topic}: expected it to be {what} within {_TRY_S:g} s")
        if (trouble := self._link.trouble()) is not None:
            raise InvalidInput(trouble)
        time.sleep(_POLL_S)

    def _missing(self, publishers: list[str] | None, kind: str | None) -> str:
        """Fault of a missing e-stop, and what can be done."""
        there = self._graph.topics_of(BOOL)
        hint = f"; of {BOOL} there are {', '.join(sorted(there)[:5])}" if there else ""
        if publishers and kind:
            return f"expected {BOOL}, it is {kind}{hint}"
        why = (
            "it has no publisher"
            if publishers == []
            else "nothing heard, and no rosapi to ask who publishes it"
        )
        others = [each for each in there or [] if each != self.topic]
        hint = f"; topics of {BOOL}: {', '.join(sorted(others)[:5])}" if others else ""
        return f"{why}{hint}; press and release it with --try-estop, or do without: --without-estop"

    def _take(self, message: Any) -> None:
        pressed = message.get("data") if isinstance(message, dict) else None
        if not isinstance(pressed, bool):
            raise InvalidInput(f"expected data to be true or false, got {shown(pressed, 40)}")
        self._times = [*self._times[-2 * _REGULAR :], time.monotonic()]
        self._now = pressed
        if not self._trying:
            self.pressed = self.pressed or pressed


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
