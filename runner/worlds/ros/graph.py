"""Publishers of topics, as ``/rosapi`` lists them beside a rosbridge; None for whatever it does
not.
"""

from __future__ import annotations

import time
from typing import Any

from stancekit.planners.errors import InvalidInput

from .bridge import Message, RosLink

TRIES = 2
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
        for _ in range(TRIES):
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
