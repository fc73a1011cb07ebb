"""roslibpy's connection, which tells its owner what it could not read or send.

roslibpy itself only logs that, with one logger for all connections of a process: a record does not
say whose it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from roslibpy import Ros
from roslibpy.comm import select_factory


class Connection(Ros):  # type: ignore[misc]  # roslibpy has no types
    """A connection to a rosbridge, begun at once and never begun anew.

    Arguments:
        complain: called with a message that cannot be read, and with an error that the rosbridge
            reports.
        lose: called when something could not be sent. Both are called in the thread that reads, or
            that sends.
    """

    def __init__(
        self, host: str, port: int, complain: Callable[[str], None], lose: Callable[[], None]
    ) -> None:
        self._complain, self._lose = complain, lose
        super().__init__(host, port, transport="asyncio")

    def connect(self) -> None:
        """Begin to connect; roslibpy's own beginning calls it."""
        complain, lose = self._complain, self._lose

        class Protocol(select_factory("asyncio").protocol):  # type: ignore[misc]
            """Reads and writes for this connection alone."""

            def __init__(self) -> None:
                super().__init__()
                self._message_handlers["status"] = self._reported

            def on_message(self, payload: bytes) -> None:
                """Have a message handled."""
                try:
                    super().on_message(payload)
                except Exception as error:  # its own thread would end, and nobody would hear of it
                    what = " ".join(f"{type(error).__name__}: {error}".split())
                    complain(
                        f"expected a rosbridge message, got one that cannot be read ({what:.80})"
                    )

            def send_message(self, payload: bytes) -> None:
                """Have a message sent by the thread that reads."""
                try:
                    super().send_message(payload)
                except Exception:  # any kind: the connection is lost
                    lose()

            def sendMessage(self, *values: Any, **settings: Any) -> None:
                """Send a message from that thread."""
                try:
                    super().sendMessage(*values, **settings)
                except Exception:  # any kind: the connection is lost
                    lose()

            def _reported(self, message: Any) -> None:
                if message.get("level", "error") == "error":
                    text = " ".join(str(message.get("msg", "")).split())
                    complain(f"it reported an error of its own: {text:.80}")

        self.factory.protocol, self.factory.maxRetries = Protocol, 0
        super().connect()
