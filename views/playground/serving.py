"""A playground on a port of this machine, until somebody ends it."""

from __future__ import annotations

import logging
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stancekit.planners.errors import InvalidInput

from ..page import viser_module, viser_server
from .playground import Playground
from .scenario import Scenario


@dataclass(frozen=True)
class Page:
    """A page that is served."""

    address: str
    playground: Playground

    def wait(self) -> None:
        """Until Ctrl-C, which raises KeyboardInterrupt here."""
        threading.Event().wait()

    def open_browser(self) -> None:
        """Show it in a browser, where there is a desktop to show one on."""
        if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            webbrowser.open(self.address)


def check_port(host: str, port: int) -> None:
    """Raise InvalidInput where nobody can listen, or without viser."""
    viser_module()
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        raise InvalidInput(
            f"--port: expected a port to listen at on {host}, got {port}: {error.strerror}; --port 0 takes a free one"
        ) from None


@contextmanager
def served(
    scenario: Scenario, *, robots: Sequence[str] = (), folder: Path = Path(), host: str = "127.0.0.1", port: int = 0
) -> Iterator[Page]:
    """A playground that is served while the block runs. Raises StancekitError for a scene that is no course."""
    scenario.course()
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # it prints a stack for every tab that goes away
    with viser_server(host, port) as server:
        playground = Playground(server, scenario, robots=robots, folder=folder)
        try:
            yield Page(f"http://{host}:{server.get_port()}", playground)
        finally:
            playground.close()
