"""One connection to a rosbridge (``roslibpy``): what is said over it, and what is wrong with what
comes back.

A connection that is lost stays lost. roslibpy would connect again by itself and then send what had
been waiting, which for targets of a robot is the last thing wanted. What it cannot read is a fault.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from stancekit.planners.errors import HardwareFault, InvalidInput, installed

from ...safety.estop import StopLatch

Answer = TypeVar("Answer")
Message = dict[str, Any]
_SILENT = logging.NullHandler()
"""roslibpy logs what ``Connection`` tells, too; that is not for standard error."""


def roslibpy() -> Any:
    """The module ``roslibpy``, imported.

    Raises InvalidInput where it is not installed.
    """
    return installed("roslibpy", "world", "roslibpy", "robots behind a rosbridge", "machines")


class RosLink:
    """A connection; ``open`` first.

    Callbacks run in roslibpy's thread.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._module = roslibpy()
        self.url, self._address, self.timeout_s = f"ws://{host}:{port}", (host, port), timeout_s
        self._lost, self._wrong = threading.Event(), list[str]()
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
            callback: gets the answer, if one comes.
        """
        if self.alive:
            client = self._module.Service(self.ros, service, kind, reconnect_on_close=False)
            client.call(
                self._module.ServiceRequest(request),
                lambda answer: callback(dict(answer)),
                lambda _: None,
            )

    def answers(self, timeout_s: float) -> bool:
        """Tell whether a rosbridge has read all that was sent to it until now: it answers what is
        asked after that.
        """
        done = threading.Event()
        if not self.alive:
            return False
        client = self._module.Service(
            self.ros, "/rosapi/get_time", "rosapi/GetTime", reconnect_on_close=False
        )
        client.call(self._module.ServiceRequest({}), lambda _: done.set(), lambda _: done.set())
        return done.wait(timeout_s)

    def close(self) -> None:
        """Disconnect; once is enough."""
        if self.ros is not None and self.ros.is_connected:
            self.ros.close(timeout=self.timeout_s)
        self.ros = None

    def complain(self, what: str) -> None:
        """Take note of a trouble; the first one is what ``trouble`` says."""
        if len(self._wrong) < 10:
            self._wrong.append(what)


_TRIES = 2
"""A rosapi that does not answer in time is asked once more."""


class RosGraph:
    """Questions to ``/rosapi`` over a connection; a rosapi that is not there answers none of
    them.
    """

    def __init__(self, link: RosLink) -> None:
        self._link, self._missing = link, False

    def publishers(self, topic: str) -> list[str] | None:
        """Nodes that publish a topic."""
        return _names(self._ask("publishers", "Publishers", {"topic": topic}), "publishers")

    def type_of(self, topic: str) -> str | None:
        """Type of a topic's messages, as ROS 1 writes it; empty for a topic that is not there."""
        result = self._ask("topic_type", "TopicType", {"topic": topic})
        kind = None if result is None else result.get("type")
        return kind.replace("/msg/", "/") if isinstance(kind, str) else None

    def topics_of(self, kind: str) -> list[str] | None:
        """Topics with messages of a type."""
        return _names(self._ask("topics_for_type", "TopicsForType", {"type": kind}), "topics")

    def watch_publishers(self, topic: str, heard: list[list[str]]) -> None:
        """Ask who publishes a topic, and wait for no answer: it is appended to ``heard`` when it
        comes.
        """

        def answered(message: Message) -> None:
            names = _names(message, "publishers")
            if names is not None:
                heard.append(names)

        self._link.ask("/rosapi/publishers", "rosapi/Publishers", {"topic": topic}, answered)

    def _ask(self, service: str, kind: str, request: Message) -> Message | None:
        for _ in range(_TRIES):
            if self._missing or self._link.trouble() is not None:
                break
            begin = time.monotonic()
            try:
                return self._link.call(f"/rosapi/{service}", f"rosapi/{kind}", request)
            except InvalidInput:
                self._missing = (
                    time.monotonic() - begin < self._link.timeout_s
                )  # it answered: there is none
        return None


def _names(message: Any, key: str) -> list[str] | None:
    values = message.get(key) if isinstance(message, dict) else None
    return [str(each) for each in values] if isinstance(values, list) else None
