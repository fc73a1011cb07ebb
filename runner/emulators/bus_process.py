"""An emulated servo bus in a process of its own, and whether this computer is fast enough for
one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Self

from . import protocol2 as p2
from .servo_bus import EmulatedBus

PERIOD_S = 0.02
GOAL, POSITION = b"\x74\0\x04\0", b"\x84\0\x04\0"


class BusProcess:
    """A ``EmulatedBus`` in a child process; ``path`` is the port to open.

    A context manager.
    """

    def __init__(
        self, position_rad: Sequence[float] | None = None, *, count: int = 24, seed: int = 0
    ) -> None:
        command = [sys.executable, "-m", "stancekit.runner.emulators.bus_process"]
        command += ["--count", str(count), "--seed", str(seed)]
        if position_rad is not None:
            command += ["--position=" + ",".join(f"{value:.9g}" for value in position_rad)]
        self._child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.path = str(self._answer()["path"])

    def inject(self, fault: str, at_s: float = 0.0) -> None:
        """Let a fault happen in so many seconds, as ``EmulatedBus.inject``."""
        self._ask(f"{fault} in {at_s:.6f}")

    def state(self) -> dict[str, Any]:
        """State as of ``EmulatedBus.state``."""
        return self._ask("")

    def close(self) -> None:
        """End the process."""
        if self._child.stdin is not None:
            self._child.stdin.close()
        self._child.wait(5.0)
        if self._child.stdout is not None:
            self._child.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, line: str) -> dict[str, Any]:
        assert self._child.stdin is not None
        self._child.stdin.write(line + "\n")
        self._child.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._child.stdout is not None
        answer: dict[str, Any] = json.loads(self._child.stdout.readline())
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer


@dataclass(frozen=True, kw_only=True)
class BusPace:
    """Pace of an emulated bus on this computer.

    Arguments:
        time_share: emulated time over the computer's, 1 where it keeps up.
        usual_s: median wait for the answer to one period's packets [s].
        worst_s: longest wait for it [s].
        period_s: period of the packets [s].
    """

    time_share: float
    usual_s: float
    worst_s: float
    period_s: float = PERIOD_S

    @property
    def keeps_up(self) -> bool:
        """Tell whether runs on the emulated bus take the time that they would on servos."""
        return self.time_share > 0.98 and self.worst_s < 0.2


def bus_pace(count: int = 24, seconds: float = 1.0) -> BusPace:
    """Measure whether this computer keeps up with an emulated bus of ``count`` servos at 50 Hz, in
    ``seconds``.
    """
    ids = range(1, count + 1)
    goals = b"".join(bytes([i]) + (2048).to_bytes(4, "little") for i in ids)
    send = p2.packet(p2.BROADCAST, p2.SYNC_WRITE, GOAL + goals)
    send += p2.packet(p2.BROADCAST, p2.FAST_SYNC_READ, POSITION + bytes(ids))
    size, waited_s = len(p2.fast_status([(i, 0, bytes(4)) for i in ids])), list[float]()
    with BusProcess(count=count) as bus:
        port = os.open(bus.path, os.O_RDWR | os.O_NOCTTY)
        try:
            tty.setraw(port)
            settings = termios.tcgetattr(port)
            settings[4] = settings[5] = termios.B1000000
            settings[6][termios.VMIN], settings[6][termios.VTIME] = 0, 10
            termios.tcsetattr(port, termios.TCSANOW, settings)
            began_s = due_s = time.monotonic()
            while due_s < began_s + seconds:
                asked_s, left = time.monotonic(), size
                os.write(port, send)
                while left > 0 and (data := os.read(port, left)):
                    left -= len(data)
                waited_s.append(time.monotonic() - asked_s)
                due_s = max(due_s + PERIOD_S, time.monotonic())
                time.sleep(max(0.0, due_s - time.monotonic()))
        finally:
            os.close(port)
        return BusPace(
            time_share=float(bus.state()["time_share"]),
            usual_s=median(waited_s),
            worst_s=max(waited_s),
        )


def main() -> None:
    """Run a bus until standard input ends: a line is a fault, an empty one asks for the state."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--position", type=str, default="")
    arguments = parser.parse_args()
    position = (
        [float(value) for value in arguments.position.split(",")] if arguments.position else None
    )
    with EmulatedBus(range(1, arguments.count + 1), position, seed=arguments.seed) as bus:
        _say({"path": bus.path})
        for line in sys.stdin:
            answer: dict[str, Any] = {}
            try:
                if line.strip():
                    bus.inject(line.strip())
            except ValueError as error:
                answer = {"error": str(error)}
            _say(bus.state() | answer)


def _say(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
