"""The monitor: a small process beside the host, which says what stops the robot where the host falls
silent altogether or is gone.

No thread of a process helps it when all of it hangs (SIGSTOP, a call that never returns) or is
killed. Then nothing is sent any more, and the robot stops by itself: servos by their own bus
watchdogs, a controller behind a rosbridge at its last target. The monitor hears a beat for every
command, and answers; it opens nothing. Without a beat for too long, or when the pipe ends without a
farewell, it tells whoever reads the terminal.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from typing import IO, Self

from stancekit.planners.errors import InvalidInput

_BEAT, _REST, _CLOSE = b".", b"-", b"q"
_READY_S = 20.0
"""So long the monitor may take to start."""
ANSWER_S = 1.0
"""A beat may go so long without an answer, or four times the limit for the host, if that is
more."""
END_S = 5.0
"""So long it may take to end after a farewell; then it is killed."""


class HeartbeatMonitor:
    """The host's side.

    A context manager: entered, the monitor is there.

    Arguments:
        limit_s: the longest silence between two beats; the first begins the watch.
        alone: what stops the robot then, in words (``JointBus.alone``).
        clock: by which answers are late, in seconds, never set back.

    Raises:
        InvalidInput: where the monitor did not start.
    """

    def __init__(
        self, limit_s: float, alone: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.limit_s, self._alone, self._clock = limit_s, alone, clock
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
            self._asked_s = self._clock()
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
        elif asked_s is not None and self._clock() - asked_s > max(4.0 * self.limit_s, ANSWER_S):
            self._unresponsive = True
        return "the heartbeat monitor does not answer" if self._unresponsive else None

    def __enter__(self) -> Self:
        module = "stancekit.runner.safety.heartbeat"
        command = [sys.executable, "-m", module, str(self.limit_s), self._alone]
        self._child = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )  # a session of its own: Ctrl-C is for the host
        stdin, stdout = _pipes(self._child)
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

    def __exit__(self, *raised: object) -> None:
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
    """The monitor's own process: how long a silence may be, and what stops the robot then; then
    beats.
    """
    limit_s, alone = sys.argv[1:]
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    if why := _watch(0, float(limit_s), 1):
        sys.stderr.write(f"stancekit: heartbeat monitor: {why}: {alone}\n")
    return 0


def _pipes(child: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes]]:
    assert child.stdin is not None
    assert child.stdout is not None
    return child.stdin, child.stdout


if __name__ == "__main__":
    sys.exit(main())
