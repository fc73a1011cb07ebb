"""The monitor: a small process beside the host, which acts where the host falls silent altogether
or is gone.

No thread of a process helps it when all of it hangs (SIGSTOP, a call that never returns) or is
killed. The monitor hears a beat for every command, and answers. Without one for too long, or when
the pipe ends without a farewell, it cancels all goals of a robot behind a rosbridge, over a
connection of its own. A servo bus has room for one owner, so there it opens nothing: it says that
the servos' own bus watchdogs stop them.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from dataclasses import asdict
from types import TracebackType
from typing import IO, Self

from pydantic import TypeAdapter

from stancekit.planners.errors import InvalidInput

from ..worlds.ros.bridge import RosLink
from ..worlds.ros.follow import AGAIN_S
from ..worlds.ros.goal import cancel_all, ready_to_cancel
from ..worlds.ros.setup import RosSetup

_BEAT, _REST, _CLOSE = b".", b"-", b"q"
ROUNDS = 3
"""A cancel is sent so often: one that comes before its goal is lost, and one that waits in a queue
needs time."""
_READY_S = 20.0
"""So long the monitor may take to start and to connect."""
ANSWER_S = 1.0
"""A beat may go so long without an answer, or four times the limit for the host, if that is
more."""
END_S = 5.0
"""So long it may take to end after a farewell; then it is killed."""
BUS = "the servos are stopped by their own bus watchdogs, and hold"


class HeartbeatMonitor:
    """The host's side.

    A context manager: entered, the monitor is there, and connected.

    Arguments:
        limit_s: the longest silence between two beats; the first begins the watch.
        setup: of a robot behind a rosbridge, None for anything else.

    Raises:
        InvalidInput: where the monitor could not connect.
    """

    def __init__(self, limit_s: float, setup: RosSetup | None = None) -> None:
        self.limit_s, self._setup = limit_s, setup
        self._child: subprocess.Popen[bytes] | None = None
        self._asked_s: float | None = None  # when the first beat was that has no answer yet
        self._unresponsive = False

    @property
    def pid(self) -> int:
        """Process number of the monitor."""
        return -1 if self._child is None else self._child.pid

    def beat(self) -> None:
        """The host lives."""
        if self._asked_s is None:
            self._asked_s = time.monotonic()
        self._say(_BEAT)

    def rest(self) -> None:
        """Expect no beat until the next one."""
        self._asked_s = None
        self._say(_REST)

    def gone(self) -> str | None:
        """A source of stops: a robot is not moved without its monitor."""
        if self._child is None:
            return None
        if self._child.poll() is not None:
            return "the heartbeat monitor is gone"
        asked_s = self._asked_s
        if self._answered():
            self._asked_s = None
        elif asked_s is not None and time.monotonic() - asked_s > max(4.0 * self.limit_s, ANSWER_S):
            self._unresponsive = True
        return "the heartbeat monitor does not answer" if self._unresponsive else None

    def __enter__(self) -> Self:
        orders = {
            "limit_s": self.limit_s,
            "ros": None if self._setup is None else asdict(self._setup),
        }
        command = [sys.executable, "-m", "stancekit.runner.safety.heartbeat"]
        self._child = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )  # a session of its own: Ctrl-C is for the host
        stdin, stdout = _pipes(self._child)
        with contextlib.suppress(BrokenPipeError):  # one that ended at once says nothing, either
            stdin.write(json.dumps(orders).encode() + b"\n")
        os.set_blocking(stdin.fileno(), False)  # the host never waits for its monitor
        answer = stdout.readline() if select.select([stdout], [], [], _READY_S)[0] else b""
        if answer != b"ready\n":
            self._end(kill=True)
            raise InvalidInput(
                "heartbeat monitor: "
                f"{answer.decode(errors='replace').strip() or 'expected it to start, it did not'}"
            )
        os.set_blocking(stdout.fileno(), False)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end(kill=self._unresponsive or not self._say(_CLOSE))

    def _end(self, *, kill: bool) -> None:
        """Let it end.

        Arguments:
            kill: at once, where it would take the end of the pipe for that of the host.
        """
        assert self._child is not None
        if kill:
            self._child.kill()
        for pipe in _pipes(self._child):
            pipe.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._child = None

    def _say(self, word: bytes) -> bool:
        """Send a word if there is room for it in the pipe; one that is full or broken makes
        ``gone`` say so.
        """
        if self._child is None:
            return False
        with contextlib.suppress(BrokenPipeError):
            return bool(_pipes(self._child)[0].write(word))
        return True  # to one that is gone

    def _answered(self) -> bool:
        """Tell whether it answered since the last call."""
        assert self._child is not None
        return bool(_pipes(self._child)[1].read(65536))


def _watch(stream: int, limit_s: float, answers: int) -> str:
    """Read beats until they stop; why, empty after a farewell.

    Whatever is heard is answered, as long as there is room in the pipe.

    Arguments:
        stream, answers: file descriptors of pipes.
    """
    os.set_blocking(answers, False)
    beating = False
    while True:
        if not select.select([stream], [], [], limit_s if beating else None)[0]:
            return f"the host was silent for {limit_s:g} s"
        words = os.read(stream, 4096)
        if _CLOSE in words:
            return ""
        if not words:
            return "the host is gone"
        with contextlib.suppress(
            BrokenPipeError, BlockingIOError
        ):  # the host's end is heard from its own pipe
            os.write(answers, _BEAT)
        beating = words[-1:] == _BEAT


def main() -> int:
    """The monitor's own process: one line says what to guard, then beats."""
    orders = json.loads(_line(0))
    setup = None if orders["ros"] is None else TypeAdapter(RosSetup).validate_python(orders["ros"])
    link = None if setup is None else RosLink(setup.host, setup.port, setup.timeout_s)
    if link is not None and setup is not None:
        try:
            link.open()
            ready_to_cancel(link, setup.controller, setup.ros)
        except InvalidInput as error:
            sys.stdout.write(f"{error}\n")
            return 1
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    why = _watch(0, orders["limit_s"], 1)
    if why:
        done = BUS if setup is None or link is None else _cancelled(setup, link)
        sys.stderr.write(f"stancekit: heartbeat monitor: {why}: {done}\n")
    if link is not None:
        link.close()
    return 0


def _cancelled(setup: RosSetup, link: RosLink) -> str:
    """Cancel all goals of a robot, over a new connection where the first is of no use; what to say
    of that.
    """
    try:
        with contextlib.ExitStack() as stack:
            if link.trouble() is not None:
                link.close()
                link = RosLink(setup.host, setup.port, setup.timeout_s)
                stack.callback(link.close)
                link.open()
            for _ in range(ROUNDS):
                cancel_all(link, setup.controller, setup.ros)
                time.sleep(AGAIN_S)
    except InvalidInput as error:
        return f"goals could not be cancelled: {error}"
    return f"a cancel was sent for all goals of {setup.controller}"


def _line(stream: int) -> bytes:
    """Up to the end of the line, and no byte more."""
    line = b""
    while not line.endswith(b"\n") and (byte := os.read(stream, 1)):
        line += byte
    return line


def _pipes(child: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes]]:
    assert child.stdin is not None
    assert child.stdout is not None
    return child.stdin, child.stdout


if __name__ == "__main__":
    sys.exit(main())
