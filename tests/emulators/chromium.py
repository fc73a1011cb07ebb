"""A headless Chromium, driven over its debugging protocol: pages are opened, looked at, dragged and
read.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from matplotlib.image import imread

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))),
    None,
)
OFFLINE = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--remote-debugging-port=0",
)
PATIENCE_S = 600.0
"""Of a test that hangs: nothing is late because the machine is busy."""
SELDOM = """
window.requestAnimationFrame = then => setTimeout(() => then(performance.now()), 250);
"""
"""Without a graphics card a picture takes a tenth of a second or more: four a second are enough for
a test."""
UNDRAWN = """
for (const name of ["drawElements", "drawElementsInstanced", "drawArrays"])
    WebGL2RenderingContext.prototype[name] = () => {};
"""
"""For a page that is read and clicked, but not looked at."""


class Tab:
    """A tab, over its debugger's line."""

    def __init__(self, line: Any) -> None:
        self._line, self._number = line, 0

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one command."""
        self._number += 1
        self._line.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            said = json.loads(self._line.recv(timeout=PATIENCE_S))
            if said.get("id") == self._number:
                return dict(said.get("result", {}))

    def value(self, script: str) -> Any:
        """What a JavaScript expression is, as JSON has it; a promise is waited for."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait_for(self, script: str, patience_s: float = PATIENCE_S) -> Any:
        """The value of an expression once it is true."""
        return self.until(lambda: self.value(script), patience_s, script)

    def until(self, true: Callable[[], Any], patience_s: float = PATIENCE_S, what: str = "") -> Any:
        """What a function gives once it is true."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            if found := true():
                return found
            time.sleep(0.02)
        raise AssertionError(
            f"not within {patience_s:g} s: {what}; the page says: {self.text()[:600]}"
        )

    def text(self) -> str:
        """All that the page says."""
        return str(self.value("document.body.innerText"))

    def picture(self, path: Path | None = None) -> Any:
        """What is seen, shape (H, W, 3) in [0, 1]; None while there is nothing. path: where it is
        written, too.
        """
        said = self.ask("Page.captureScreenshot")
        if "data" not in said:
            return None
        content = base64.b64decode(said["data"])
        if path is not None:
            path.write_bytes(content)
        return imread(BytesIO(content))[..., :3]

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """A mouse event (mousePressed, mouseMoved or mouseReleased) at a place of the page [px]."""
        button = {} if kind == "mouseMoved" and not more else {"button": "left", "buttons": 1}
        self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, clickCount=1, **button)

    def click(self, x: float, y: float) -> None:
        """A click."""
        self.mouse("mouseMoved", x, y)
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 3) -> None:
        """Press, move in so many steps, let go."""
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start)
        for step in range(1, steps + 1):
            x, y = (a + step / steps * (b - a) for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y, pressed=True)
        self.mouse("mouseReleased", *end)


@contextmanager
def opened(
    address: str,
    profile: Path,
    size_px: tuple[int, int] = (800, 600),
    *,
    draws: bool = True,
    seldom: bool = True,
) -> Iterator[Tab]:
    """A tab that shows an address; the browser is gone when the block ends.

    draws: whether 3D scenes are drawn. seldom: four times a second at most, and what comes from the
    server as seldom.
    """
    from websockets.sync.client import connect

    assert CHROMIUM is not None
    command = [
        CHROMIUM,
        *OFFLINE,
        f"--window-size={size_px[0]},{size_px[1]}",
        f"--user-data-dir={profile}",
    ]
    browser = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert browser.stderr is not None
        at = next(
            found
            for line in browser.stderr
            if (found := re.search(r"ws://(127\.0\.0\.1:\d+)/", line))
        )
        with urlopen(f"http://{at[1]}/json/list") as answer:
            tab = next(tab for tab in json.load(answer) if tab["type"] == "page")
        with connect(tab["webSocketDebuggerUrl"], max_size=None, open_timeout=PATIENCE_S) as line:
            shown = Tab(line)
            shown.ask("Page.enable")
            shown.ask(
                "Page.addScriptToEvaluateOnNewDocument",
                source=seldom * SELDOM + (not draws) * UNDRAWN,
            )
            shown.ask("Page.navigate", url=address)
            yield shown
    finally:
        browser.kill()
        browser.communicate()
