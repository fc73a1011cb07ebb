"""A playground on a port of this machine, until it is ended."""

from __future__ import annotations

import gzip
import http
import ipaddress
import logging
import math
import os
import re
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from stancekit.planners.errors import InvalidInput

from ..page import viser_module, viser_server

if TYPE_CHECKING:
    from .scenario import Scenario


_ADDED = """
<style>
:root[data-mantine-color-scheme] { --mantine-color-dimmed: #5b6672 !important; }
:root[data-mantine-color-scheme="dark"] { --mantine-color-dimmed: #a9b4c0 !important; }
.mantine-Slider-markLabel, .mantine-Notification-description { color: var(--mantine-color-dimmed) !important; }
[data-mantine-color-scheme="dark"] [data-dock-tab][aria-selected="true"] { color: #9db4f0 !important;
  box-shadow: inset 0 -2px 0 0 #9db4f0 !important; }
#stancekit-verdict { display: none; }
@media (max-width: 700px) {
  #stancekit-verdict { display: block; position: fixed; z-index: 1000; left: 0; right: 0; top: 0; max-height: 34vh;
    overflow: auto; padding: 2px 8px; background: Canvas; color: CanvasText; color-scheme: light;
    box-shadow: 0 1px 4px rgba(0, 0, 0, .35); }
  [data-mantine-color-scheme="dark"] #stancekit-verdict { color-scheme: dark; }
}
</style>
<script>
(() => {
  const words = element => (element?.textContent || "").trim().replace(/\\s+/g, " ");
  const set = (element, name, value) => {
    if (element.getAttribute(name) !== value) element.setAttribute(name, value);
  };
  // The nearest words before a control, in the row that it is in: viser writes them there without tying them to it.
  const label = control => {
    for (let row = control.parentElement, k = 0; row && k < 8; row = row.parentElement, k++) {
      const found = [...row.querySelectorAll("label, .mantine-Text-root, .mantine-InputWrapper-label")]
        .find(each => words(each) && !each.contains(control) &&
          (each.compareDocumentPosition(control) & Node.DOCUMENT_POSITION_FOLLOWING));
      if (found) return words(found);
    }
    return "";
  };
  // Where no words are near, the name of the drawing: viser's icons carry theirs as a class.
  const icon = element => [...element?.querySelectorAll("svg[class*=tabler-icon-]") || []]
    .flatMap(each => [...each.classList]).find(name => name.startsWith("tabler-icon-"))
    ?.replace("tabler-icon-", "").replaceAll("-", " ") || "";
  let due = false;
  const look = () => {
    due = false;
    set(document.documentElement, "lang", "en");
    for (const control of document.querySelectorAll("[role=slider], input:not([type=hidden]), [role=combobox]")) {
      if (control.labels?.length && words(control.labels[0])) continue;
      const name = label(control) || (/^wss?:/.test(control.value) ? "address of the server" : "");
      if (name) set(control, "aria-label", control.tagName === "INPUT" && control.inputMode !== "" &&
        control.closest(".mantine-NumberInput-root") ? name + ", number" : name);
    }
    for (const button of document.querySelectorAll("button"))
      if (!words(button) && !button.getAttribute("aria-label")) {
        const closes = button.closest("[role=alert]") && "Close this message";
        const near = button.title || closes || icon(button) || label(button);
        if (near) set(button, "aria-label", near);
      }
    for (const canvas of document.querySelectorAll("canvas"))
      { set(canvas, "role", "img"); set(canvas, "aria-label", "The scene in three dimensions"); }
    const verdict = document.querySelector("#verdict");
    let copy = document.querySelector("#stancekit-verdict");
    if (!copy) {
      copy = document.createElement("div");
      copy.id = "stancekit-verdict";
      copy.setAttribute("aria-hidden", "true");
      document.body.append(copy);
    }
    const shown = verdict ? verdict.outerHTML.replace('id="verdict"', "") : "";
    if (copy.dataset.shown !== shown) { copy.dataset.shown = shown; copy.innerHTML = shown; }
    if (verdict) { set(verdict, "role", "status"); }
  };
  const later = () => { if (!due) { due = true; setTimeout(look, 50); } };
  addEventListener("DOMContentLoaded", () => {
    new MutationObserver(later).observe(document.body, {childList: true, subtree: true, characterData: true});
    look();
  });
})();
</script>"""


def _finished_page(request: Any, response: Any) -> Any:
    """The answer to a request for a page or one of its parts: what we add is in the page itself."""
    kind = "" if response is None else response.headers.get("Content-Type", "")
    if response is None or response.status_code != 200 or not kind.startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    text = (gzip.decompress(response.body) if zipped else response.body).decode()
    text = text.replace("<title>Viser</title>", f"<title>Stancekit playground</title>{_ADDED}", 1)
    body = gzip.compress(text.encode()) if zipped else text.encode()
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(body))
    response.body = body
    return response


FEW = 200
"""Letters of a text from a page, at most."""
log = logging.getLogger(__name__)


def may_connect(origin: str | None, host: str | None, names: frozenset[str]) -> bool:
    """Tell whether a page may open a websocket: it is one that we served, by an address or a name
    of this machine.

    Arguments:
        origin, host: headers of the request.
        names: names of this machine. A page of another scheme, host or port is foreign, and so is a
            request that does not say whose it is. A foreign name means that another name server
            points at this machine.
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
def _guarded_server(host: str) -> Iterator[None]:
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
            return _finished_page(request, pages(connection, request))
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


def _guard_messages(server: Any) -> None:
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


@dataclass(frozen=True)
class Page:
    """A page that is served."""

    address: str
    playground: Any

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
    """Raise InvalidInput for a port that cannot be listened at, or without viser."""
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
) -> Iterator[Page]:
    """A page that is served while the block runs.

    Raises StancekitError for a scene that is no course, and what is no walk.
    """
    from .playground import Playground

    scenario.course()
    with quiet(), viser_server(host, port, _guarded_server(host)) as server:
        _guard_messages(server)
        shown = Playground(server, scenario, robots=robots, folder=folder)
        try:
            yield Page(f"http://{host}:{server.get_port()}", shown)
        finally:
            shown.close()
