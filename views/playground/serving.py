"""A playground on a port of this machine, until somebody ends it."""

from __future__ import annotations

import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from stancekit.planners.errors import InvalidInput

from ..page import viser_module, viser_server
from .gate import guard_messages, guarded_server, quiet

if TYPE_CHECKING:
    from .playground import Playground
    from .scenario import Scenario
    from .walk_page import WalkPage
    from .walk_scenario import WalkScenario

Shown = TypeVar("Shown", "Playground", "WalkPage")


@dataclass(frozen=True)
class Page(Generic[Shown]):
    """A page that is served."""

    address: str
    playground: Shown

    def wait(self) -> None:
        """Until Ctrl-C, which raises KeyboardInterrupt here."""
        threading.Event().wait()

    def open_browser(self) -> None:
        """Show it in a browser, where there is a desktop to show one on."""
        if (
            sys.platform != "linux"
            or os.environ.get("DISPLAY")
            or os.environ.get("WAYLAND_DISPLAY")
        ):
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
            f"--port: expected a port to listen at on {host}, got {port}: {error.strerror}; --port "
            "0 takes a free one"
        ) from None


@contextmanager
def served(
    scenario: Scenario,
    *,
    robots: Sequence[str] = (),
    folder: Path = Path(),
    host: str = "127.0.0.1",
    port: int = 0,
) -> Iterator[Page[Playground]]:
    """A playground that is served while the block runs.

    Raises StancekitError for a scene that is no course.
    """
    from .playground import Playground

    scenario.course()
    with _served(
        lambda server: Playground(server, scenario, robots=robots, folder=folder), host, port
    ) as page:
        yield page


@contextmanager
def served_walk(
    scenario: WalkScenario,
    *,
    robots: Sequence[str] = (),
    folder: Path = Path(),
    host: str = "127.0.0.1",
    port: int = 0,
) -> Iterator[Page[WalkPage]]:
    """A playground of walks that is served while the block runs.

    Raises InvalidInput for what is no walk.
    """
    from .walk_page import WalkPage

    scenario.task()
    with _served(
        lambda server: WalkPage(server, scenario, robots=robots, folder=folder), host, port
    ) as page:
        yield page


@contextmanager
def _served(make: Callable[[Any], Shown], host: str, port: int) -> Iterator[Page[Shown]]:
    with quiet(), viser_server(host, port, guarded_server(host)) as server:
        guard_messages(server)
        shown = make(server)
        try:
            yield Page(f"http://{host}:{server.get_port()}", shown)
        finally:
            shown.close()
