"""Gate of a playground: pages that it served itself, and values that make sense.

A browser lets every page of the web open a websocket to this machine. It says whose page it is
(``Origin``), and by which name it found us (``Host``); both are looked at before a connection is
made. What comes over one is looked at twice: its kinds of values before viser reads it, the values
themselves before viser keeps them.
"""

from __future__ import annotations

import http
import ipaddress
import logging
import math
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any, get_type_hints

from stancekit.planners.errors import InvalidInput

from .client_page import finished_page

FEW = 200
"""Letters of a text from a page, at most."""
log = logging.getLogger(__name__)


def may_connect(origin: str | None, host: str | None, names: frozenset[str]) -> bool:
    """Tell whether a page may open a websocket: it is one that we served, by an address or a name
    of this machine.

    Arguments:
        origin, host: headers of the request.
        names: of this machine. A page of another scheme, host or port is foreign, and so is a
            request that does not say whose it is. A name that is not ours is one that somebody
            else's name server has pointed at us.
    """
    if origin is None or host is None or origin.lower() != f"http://{host.lower()}":
        return False
    return _name(host) in names or _is_address(_name(host))


def _name(host: str) -> str:
    """The host of ``host:port``, without brackets."""
    return re.sub(r":\d*$", "", host.lower()).strip("[]")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def own_names(host: str) -> frozenset[str]:
    """Names that pages may have found us by.

    Arguments:
        host: the one we listen at.
    """
    return frozenset(
        {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
    )


@contextmanager
def guarded_server(host: str) -> Iterator[None]:
    """Guard the server that viser makes within this block: it refuses websockets from foreign pages
    and serves the pages of the playground.

    Arguments:
        host: the name or the address that the server listens at.

    Raises:
        InvalidInput: if this version of viser makes its server in another way.
    """
    websockets: Any = import_module("websockets.asyncio.server")
    made, names, guarded = websockets.serve, own_names(host), []

    def serve(*arguments: Any, **options: Any) -> Any:
        options["process_request"] = _guard(options["process_request"], names)
        options["create_connection"] = _connection(websockets.ServerConnection)
        guarded.append(True)
        return made(*arguments, **options)

    websockets.serve = serve
    try:
        yield
    finally:
        websockets.serve = made
    if not guarded:
        raise InvalidInput(
            "page: expected a viser whose websockets can be guarded, as 1.1.1, got another"
        )


def _guard(pages: Callable[[Any, Any], Any], names: frozenset[str]) -> Callable[[Any, Any], Any]:
    """The server of pages, after a look at who asks for a websocket.

    Arguments:
        pages: serves a page, or gives None for one.
    """

    def process(connection: Any, request: Any) -> Any:
        headers = request.headers
        if "websocket" not in headers.get("Upgrade", "").lower():
            return finished_page(request, pages(connection, request))
        origins, hosts = headers.get_all("Origin"), headers.get_all("Host")
        one = len(origins) <= 1 and len(hosts) == 1
        if one and may_connect(next(iter(origins), None), hosts[0], names):
            return None
        whose = f"the page of {_short(origins[0])}" if origins else "a request that names no page"
        log.warning("refused: %s is not of this playground", whose)
        return connection.respond(
            http.HTTPStatus.FORBIDDEN, "This page is not of this playground.\n"
        )

    return process


def _connection(plain: Any) -> Any:
    """The kind of a connection whose messages are read by viser only where their values are of the
    right kinds.
    """

    class GatedConnection(plain):  # type: ignore[misc]
        async def recv(self, *arguments: Any, **options: Any) -> Any:
            while True:
                raw = await super().recv(*arguments, **options)
                fault = misfit(raw)
                if not fault:
                    return raw
                log.warning("ignored: a page sent %s", fault)

    return GatedConnection


def misfit(raw: Any) -> str:
    """Value of a message, as it came, that is of another kind than viser expects; empty for a sound
    message.

    What is no message at all is left to viser, which ends the connection. What has a tuple of a
    wrong length it takes, with a warning.
    """
    msgspec = import_module("msgspec")
    kinds = import_module("viser._messages").Message._subclass_from_type_string()
    try:
        values = msgspec.msgpack.decode(raw)
        kind = kinds[values.pop("type")]
    except (msgspec.DecodeError, AttributeError, KeyError, TypeError):
        return ""
    hints = _hints(kind)
    for name in filter(hints.__contains__, values):
        wanted = float if hints[name] is int else hints[name]  # a browser has one kind of numbers
        try:
            msgspec.convert(values[name], wanted)
        except msgspec.ValidationError as error:
            return f"{kind.__name__}: {name}: {_short(str(error))}"
        except TypeError:  # a kind of value that msgspec does not know
            pass
    return ""


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


@contextmanager
def quiet() -> Iterator[None]:
    """Have nothing printed of tabs that go away, and one line of one that sends what is no
    message.
    """
    logger = logging.getLogger("websockets.server")

    def one_line(record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if record.getMessage() == "connection handler failed" and error is not None:
            log.warning(
                "ended: a page sent what is no message: %s",
                _short(str(error) or type(error).__name__),
            )
        return False

    logger.addFilter(one_line)
    try:
        yield
    finally:
        logger.removeFilter(one_line)


def guard_messages(server: Any) -> None:
    """Have nothing kept of a message whose values make no sense; one line on the console says
    so.
    """
    websocket = server._websock_server

    def checked(handle: Callable[[Any, Any], Any], *, says: bool) -> Callable[[Any, Any], Any]:
        async def handled(client_id: Any, message: Any) -> None:
            fault = wrong(message, server)
            try:
                if not fault:
                    await handle(client_id, message)
            except Exception as error:  # a page's message never ends the server
                fault = _short(str(error) or type(error).__name__)
            if fault and says:
                log.warning("ignored: a page sent %s: %s", type(message).__name__, fault)

        return handled

    def on_connect(client: Any) -> None:
        client._handle_incoming_message = checked(client._handle_incoming_message, says=False)

    websocket._handle_incoming_message = checked(websocket._handle_incoming_message, says=True)
    websocket._client_connect_cb.insert(0, on_connect)


def wrong(message: Any, server: Any) -> str:
    """Fault of a message of a page; empty for a sound one."""
    for name, value in vars(message).items():
        if not name.startswith("_") and not _finite(value):
            return f"{name}: expected finite numbers, got {_short(repr(value))}"
    if type(message).__name__ == "GuiUpdateMessage":
        return _wrong_update(message, server)
    return ""


def _wrong_update(message: Any, server: Any) -> str:
    """Fault of a new value of a control; a page may change the value, and nothing else of it."""
    handle = server.gui._gui_input_handle_from_uuid.get(message.uuid)
    if handle is None:
        return ""  # removed meanwhile, or of one page alone
    for name, value in message.updates.items():
        if name != "value":
            return f"{_short(name)}: expected value"
        now, limits = handle._impl.value, handle._impl.props
        if isinstance(now, bool):
            fine = isinstance(value, bool)
        elif isinstance(now, int | float):
            fine = isinstance(value, int | float) and not isinstance(value, bool)
            fine = fine and getattr(limits, "min", -math.inf) <= value <= getattr(
                limits, "max", math.inf
            )
        else:
            fine = isinstance(value, type(now)) and len(value) <= FEW
            fine = fine and value in getattr(limits, "options", (value,))
        if not fine:
            return f"value: expected one that the control offers, got {_short(repr(value))}"
    return ""


def _finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_finite(each) for each in value.values())
    if isinstance(value, list | tuple):
        return all(_finite(each) for each in value)
    return not isinstance(value, float) or math.isfinite(value)


def _short(text: str) -> str:
    """A text from elsewhere as part of a line."""
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line if len(line) <= 80 else f"{line[:80]}…"
