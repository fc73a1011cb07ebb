"""One connection to a rosbridge (``roslibpy``): what is said over it, what is wrong with what comes
back, and an emergency stop on a topic of std_msgs/Bool, for whatever world the robot is in: before
a robot is armed it is known to be heard.

A connection that is lost stays lost. roslibpy would connect again by itself and then send what had
been waiting, which for targets of a robot is the last thing wanted. What it cannot read is a fault.
"""

from __future__ import annotations

import asyncio
import logging
import re
import socket
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Self, TypeVar

from stancekit.planners.errors import HardwareFault, InvalidInput, installed
from stancekit.planners.files.documents import shown

from ...safety.estop import StopLatch
from ..world import EstopCheck

Answer = TypeVar("Answer")
Message = dict[str, Any]
_SILENT = logging.NullHandler()
"""roslibpy logs what ``Connection`` tells, too; that is not for standard error."""


def roslibpy() -> Any:
    """The module ``roslibpy``, imported.

    Raises InvalidInput where it is not installed.
    """
    return installed("roslibpy", "world", "roslibpy", "robots behind a rosbridge", "machines")


POLL_S = 0.01


def waited(
    over: Callable[[], bool], seconds: float, meanwhile: Callable[[], None] = lambda: None
) -> bool:
    """Wait until this is so, for so long at most; tell whether it is."""
    end = time.monotonic() + seconds
    while not (so := over()) and time.monotonic() < end:
        meanwhile()
        time.sleep(POLL_S)
    return so


_TRIES = 2
"""A rosapi that does not answer in time is asked once more."""


class RosLink:
    """A connection; ``open`` first.

    Callbacks run in roslibpy's thread.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._module = roslibpy()
        self.url, self._address, self.timeout_s = f"ws://{host}:{port}", (host, port), timeout_s
        self._lost, self._wrong, self._missing = threading.Event(), list[str](), False
        self._topics: dict[str, Any] = {}
        self.ros: Any = None

    def open(self) -> None:
        """Connect.

        Raises InvalidInput for a host that does not answer, or does not speak WebSocket.
        """
        try:
            socket.create_connection(self._address, timeout=self.timeout_s).close()
        except OSError as error:
            raise InvalidInput(
                f"rosbridge {self.url}: expected a rosbridge, got no answer: {error}"
            ) from None
        for name in ("roslibpy", "autobahn"):
            logging.getLogger(name).addHandler(_SILENT)
        from .connection import Connection

        self.ros = Connection(*self._address, self.complain, self._lost.set)
        self.ros.on("close", lambda _: self._lost.set())
        try:
            self.ros.run(timeout=self.timeout_s)
        except self._module.core.RosTimeoutError:
            self.close()
            raise InvalidInput(
                f"rosbridge {self.url}: expected a rosbridge, what answers there does not speak "
                "WebSocket"
            ) from None

    def trouble(self) -> str | None:
        """Fault of the connection, None if there is none."""
        if self._wrong:
            return f"rosbridge {self.url}: {self._wrong[0]}"
        if not self.alive:
            return f"rosbridge {self.url}: the connection is lost"
        return None

    @property
    def alive(self) -> bool:
        """Tell whether something can be sent, whatever came."""
        return self.ros is not None and not self._lost.is_set() and bool(self.ros.is_connected)

    def subscribe(self, topic: str, kind: str, callback: Callable[[Message], None]) -> None:
        """Call back for every message.

        A callback that refuses one with InvalidInput makes it a trouble.
        """

        def on_message(message: Message) -> None:
            try:
                callback(message)
            except InvalidInput as error:
                self.complain(f"{topic}: {error}")

        self._topics[topic] = self._module.Topic(
            self.ros, topic, kind, queue_length=1, reconnect_on_close=False
        )
        self._topics[topic].subscribe(on_message)

    def publish(self, topic: str, kind: str, message: Message) -> None:
        """Send a message; nothing is sent, and nothing kept for later, where the connection is
        lost.
        """
        if self.alive:
            self._publisher(topic, kind).publish(message)

    def advertise(self, topic: str, kind: str) -> None:
        """Advertise a topic: messages that follow at once wait for subscribers, or are lost."""
        self._publisher(topic, kind).advertise()

    def unadvertise(self, topic: str) -> None:
        """Say that nothing will be published until it is advertised again."""
        if topic in self._topics:
            self._topics.pop(topic).unadvertise()

    def _publisher(self, topic: str, kind: str) -> Any:
        if topic not in self._topics:
            self._topics[topic] = self._module.Topic(
                self.ros, topic, kind, queue_size=1, reconnect_on_close=False
            )
        return self._topics[topic]

    def through(self, latch: StopLatch, hand_over: Callable[[], Answer]) -> Answer:
        """Hand over what moves the robot, and wait until it was written.

        Raises Stopped, and HardwareFault in time.

        roslibpy writes from a thread of its own, in order, at its next turn. The latch is asked
        there, at the last moment, and held until that turn is over.
        """
        given_up = threading.Event()

        async def sent() -> Answer:
            with latch.sending():
                if given_up.is_set():  # nobody waits for it any more
                    raise TimeoutError
                answer = hand_over()
                await asyncio.sleep(0)
                return answer

        future = asyncio.run_coroutine_threadsafe(sent(), self.ros.factory.manager.loop)
        try:
            return future.result(self.timeout_s)
        except TimeoutError:
            given_up.set()  # or it would be sent whenever that thread goes on
            raise HardwareFault(
                f"rosbridge {self.url}: nothing could be sent for {self.timeout_s:g} s"
            ) from None

    def call(self, service: str, kind: str, request: Message) -> Message:
        """Call a service and wait.

        Raises InvalidInput where it refuses or does not answer in time.
        """
        client = self._module.Service(self.ros, service, kind, reconnect_on_close=False)
        try:
            return dict(client.call(self._module.ServiceRequest(request), timeout=self.timeout_s))
        except Exception as error:  # roslibpy raises its own, and what the service said
            raise InvalidInput(f"{service}: expected an answer, got {error!s:.80}") from None

    def ask(
        self, service: str, kind: str, request: Message, callback: Callable[[Message], None]
    ) -> None:
        """Call a service and wait for nothing.

        Arguments:
            callback: gets the answer, if one comes; an empty one where the service refuses.
        """
        if self.alive:
            client = self._module.Service(self.ros, service, kind, reconnect_on_close=False)
            client.call(
                self._module.ServiceRequest(request),
                lambda answer: callback(dict(answer)),
                lambda _: callback({}),
            )

    def answers(self, timeout_s: float) -> bool:
        """Tell whether a rosbridge has read all that was sent to it until now: it answers what is
        asked after that.
        """
        done = threading.Event()
        self.ask("/rosapi/get_time", "rosapi/GetTime", {}, lambda _: done.set())
        return self.alive and done.wait(timeout_s)

    def publishers(self, topic: str) -> list[str] | None:
        """Nodes that publish a topic, by ``/rosapi``; where none is there, this and the next are None."""
        return _names(self._asked("publishers", "Publishers", {"topic": topic}), "publishers")

    def type_of(self, topic: str) -> str | None:
        """Type of a topic's messages, as ROS 1 writes it; empty for a topic that is not there."""
        result = self._asked("topic_type", "TopicType", {"topic": topic})
        kind = None if result is None else result.get("type")
        return kind.replace("/msg/", "/") if isinstance(kind, str) else None

    def topics_of(self, kind: str) -> list[str] | None:
        """Topics with messages of a type."""
        return _names(self._asked("topics_for_type", "TopicsForType", {"type": kind}), "topics")

    def watch_publishers(self, topic: str, heard: list[list[str]]) -> None:
        """Ask who publishes a topic, and wait for no answer: it is appended to ``heard`` when it
        comes.
        """

        def answered(message: Message) -> None:
            names = _names(message, "publishers")
            if names is not None:
                heard.append(names)

        self.ask("/rosapi/publishers", "rosapi/Publishers", {"topic": topic}, answered)

    def _asked(self, service: str, kind: str, request: Message) -> Message | None:
        for _ in range(_TRIES):
            if self._missing or self.trouble() is not None:
                break
            begin = time.monotonic()
            try:
                return self.call(f"/rosapi/{service}", f"rosapi/{kind}", request)
            except InvalidInput:
                self._missing = (
                    time.monotonic() - begin < self.timeout_s
                )  # it answered: there is none
        return None

    def close(self) -> None:
        """Disconnect; once is enough."""
        if self.ros is not None and self.ros.is_connected:
            self.ros.close(timeout=self.timeout_s)
        self.ros = None

    def complain(self, what: str) -> None:
        """Take note of a trouble; the first one is what ``trouble`` says."""
        if len(self._wrong) < 10:
            self._wrong.append(what)


def _names(message: Any, key: str) -> list[str] | None:
    values = message.get(key) if isinstance(message, dict) else None
    return [str(each) for each in values] if isinstance(values, list) else None


BOOL = "std_msgs/Bool"
_LISTEN_S = 3.0
_TRY_S, _RELEASED_S = 60.0, 5.0
"""So long is waited for somebody to press it; one that was not heard of for RELEASED_S since is
released."""
_ASK_S = 1.0
"""So often its publishers are asked for while the robot moves."""
_MISSED, _REGULAR, _QUIET_S = 5.0, 5, 1.0
"""One that came REGULAR times is missed after MISSED of its periods, and not before QUIET_S."""


class Estop:
    """An e-stop on a topic; ``subscribe`` first. pressed: whether it was; letting go of it changes
    nothing.
    """

    def __init__(self, link: RosLink, topic: str) -> None:
        self.topic, self.pressed = topic, False
        self._link = link
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
        publishers = self._link.publishers(self.topic)
        kind = self._link.type_of(self.topic) if publishers else None
        known = bool(publishers and kind == BOOL)
        waited(
            lambda: bool(self._times) or self._link.trouble() is not None,
            0.0 if known else _LISTEN_S,
        )
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
            self._link.watch_publishers(self.topic, self._publishers)
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
        self._watched = bool(self._link.publishers(self.topic))
        return f"e-stop {self.topic}: pressed and released"

    def _wait(self, what: str, end_s: float) -> None:
        if time.monotonic() > end_s:
            raise InvalidInput(f"e-stop {self.topic}: expected it to be {what} within {_TRY_S:g} s")
        if (trouble := self._link.trouble()) is not None:
            raise InvalidInput(trouble)
        time.sleep(POLL_S)

    def _missing(self, publishers: list[str] | None, kind: str | None) -> str:
        """Fault of a missing e-stop, and what can be done."""
        others = sorted({*(self._link.topics_of(BOOL) or ())} - {self.topic})[:5]
        hint = f"; topics of {BOOL}: {', '.join(others)}" if others else ""
        if publishers and kind:
            return f"expected {BOOL}, it is {kind}{hint}"
        why = (
            "it has no publisher"
            if publishers == []
            else "nothing heard, and no rosapi to ask who publishes it"
        )
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

    def __exit__(self, *raised: object) -> None:
        self._link.close()
