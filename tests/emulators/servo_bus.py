"""A servo bus on a pseudo-terminal: a USB adapter with servos behind it, as the real SDK sees it, and its faults.

``ServoBus`` runs in a thread; ``BusProcess`` runs it as a child process, which lives on when the host is killed. Both
answer ``inject(kind, at_s)``, ``state()`` and ``close()``. ``python -m tests.emulators.servo_bus --link bus`` starts
one by hand. Times are ``time.monotonic``, the same for all processes of the machine.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from . import protocol2 as p2
from .servos import Servos

BAUDS = {getattr(termios, f"B{baud}"): baud for baud in (57600, 115200, 1000000, 2000000, 3000000, 4000000)}
REGISTER_BAUDS = (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000)
FAULTS = (
    "silent servo", "corrupted packet", "corrupted packets", "delay", "overload", "power loss", "cable pulled",
)  # fmt: skip
IDLE_S = 0.002


class ServoBus(threading.Thread):
    """Servos on a pseudo-terminal; ``path`` is the port to open.

    position_rad: of the shafts at first, from tick 2048. wire: bytes take as long as at the port's baud rate.
    goal_packets_s, torque_packets_s: when a packet with goals came, and one that switches torques on; goals: the ticks
    in it, servo by servo.
    """

    def __init__(
        self, ids: Sequence[int] = tuple(range(1, 25)), position_rad: Sequence[float] | None = None, *,
        wire: bool = True, stops_rad: tuple[float, float] = (-3.0, 3.0), seed: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(daemon=True)
        self.servos = Servos(ids, position_rad, stops_rad)
        self.goal_packets_s: list[float] = []
        self.torque_packets_s: list[float] = []
        self.goals: list[list[int]] = []
        self.instructions = 0
        self._wire, self._rng = wire, np.random.default_rng(seed)
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self.path = os.ttyname(self._slave)
        self._reader, self._lock, self._ending = p2.Reader(), threading.Lock(), threading.Event()
        self._due: list[tuple[float, str]] = []
        self._happened: list[tuple[str, float]] = []
        self._silent: set[int] = set()
        self._corrupt, self._delay_s, self._pulled = 0, 0.0, False
        self.start()

    def inject(self, kind: str, at_s: float = 0.0) -> None:
        """Let a fault of ``FAULTS`` happen in so many seconds."""
        if kind not in FAULTS:
            raise ValueError(f"kind: expected one of {', '.join(FAULTS)}, got {kind!r}")
        with self._lock:
            self._due.append((time.monotonic() + at_s, kind))

    def state(self) -> dict[str, Any]:
        """What the servos are at, JSON-ready; still_s: since when none of them has moved."""
        with self._lock:
            servos, n = self.servos, range(len(self.servos.ids))
            return {
                "now_s": servos.now, "ids": servos.ids, "position_rad": servos.position.tolist(),
                "rate_rad_s": servos.rate.tolist(), "goal_rad": servos.goal.tolist(),
                "current_a": servos.current.tolist(), "torque": [bool(servos.get(i, 64)) for i in n],
                "powered": servos.powered.tolist(), "watchdog": [servos.get(i, 98) for i in n],
                "hardware_error": [servos.get(i, 70) for i in n], "goal_writes": servos.goal_writes,
                "last_goal_s": servos.last_goal_s, "refused_goals": servos.refused_goals, "still_s": servos.moved_s,
                "instructions": self.instructions, "happened": list(self._happened),
                "goal_packets_s": self.goal_packets_s[-100:], "torque_packets_s": self.torque_packets_s[-100:],
            }  # fmt: skip

    def close(self) -> None:
        """End the thread and take the port away."""
        self._ending.set()
        self.join(2.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self) -> None:
        """Listen, answer, let time pass."""
        while not self._ending.is_set():
            heard = b""
            if self._pulled:
                time.sleep(IDLE_S)
            elif select.select([self._master], [], [], IDLE_S)[0]:
                heard = os.read(self._master, 4096)
            answers = list[tuple[float, bytes]]()
            with self._lock:
                self._happen()
                began = time.monotonic()
                if not self._right_baud():
                    heard = b""
                for request in self._reader.feed(heard):
                    self.instructions += 1
                    answer, pause_s = self._answer(request)
                    answers.append((began + self._wire_s(request.size + len(answer)) + pause_s, answer))
                self.servos.advance(time.monotonic())
            for due, answer in answers:
                self._send(due + self._delay_s, answer)
        if not self._pulled:
            self._unplug()

    def _answer(self, request: p2.Request) -> tuple[bytes, float]:
        """All bytes that the servos answer, and how long they wait before."""
        servos, given = self.servos, request.parameters
        alive = [i for i in range(len(servos.ids)) if servos.powered[i] and servos.ids[i] not in self._silent]
        for index in alive:
            servos.hear(index, time.monotonic())
        servos.advance(time.monotonic())
        asked = [i for i in alive if request.servo in (servos.ids[i], p2.BROADCAST)]
        waits = {i: 2e-6 * servos.get(i, 9) for i in alive}
        if request.instruction in (p2.SYNC_READ, p2.FAST_SYNC_READ) and request.sound and len(given) > 4:
            return self._many(request, {servos.ids[i]: i for i in asked}, waits)
        if request.instruction == p2.SYNC_WRITE and request.sound and len(given) > 4:
            address, size = int.from_bytes(given[:2], "little"), int.from_bytes(given[2:4], "little")
            if address <= 116 < address + size:
                self.goal_packets_s.append(time.monotonic())
            rows = [given[k : k + 1 + size] for k in range(4, len(given), 1 + size)]
            if address <= 116 < address + size:
                at = 1 + 116 - address
                self.goals.append([int.from_bytes(row[at : at + 4], "little", signed=True) for row in rows])
            torque = 1 + 64 - address
            if 0 < torque <= size and any(row[torque : torque + 1] == b"\1" for row in rows):
                self.torque_packets_s.append(time.monotonic())
            for row in rows:
                for index in asked:
                    if servos.ids[index] == row[0] and len(row) == 1 + size:
                        servos.write(index, address, row[1:])
            return b"", 0.0
        answers = [self._one(request, index) for index in asked]
        return b"".join(answers), sum(waits[i] for i in asked)

    def _one(self, request: p2.Request, index: int) -> bytes:
        """What one servo answers to an instruction for it alone, or to a broadcast."""
        servos, given, me = self.servos, request.parameters, self.servos.ids[index]
        alert = servos._alert(index)
        if not request.sound:
            return self._sent(p2.status(me, alert | p2.BAD_CRC)) if request.servo == me else b""
        if request.instruction == p2.PING:
            return self._sent(p2.status(me, alert, servos.read(index, 0, 2)[1] + servos.read(index, 6, 1)[1]))
        if request.servo == p2.BROADCAST:
            return b""
        if request.instruction == p2.READ and len(given) == 4:
            error, data = servos.read(index, int.from_bytes(given[:2], "little"), int.from_bytes(given[2:], "little"))
            return self._sent(p2.status(me, error, data))
        if request.instruction == p2.WRITE and len(given) > 2:
            return self._sent(p2.status(me, servos.write(index, int.from_bytes(given[:2], "little"), given[2:])))
        if request.instruction == p2.REBOOT:
            servos.reboot(index)
            return self._sent(p2.status(me, 0))
        known = request.instruction in (p2.READ, p2.WRITE)
        return self._sent(p2.status(me, alert | (p2.ACCESS if known else p2.BAD_INSTRUCTION)))

    def _many(self, request: p2.Request, asked: dict[int, int], waits: dict[int, float]) -> tuple[bytes, float]:
        """One status after the other; nothing after the first that is silent, for each waits for the last."""
        given, parts = request.parameters, list[tuple[int, int, bytes]]()
        address, size = int.from_bytes(given[:2], "little"), int.from_bytes(given[2:4], "little")
        for servo in given[4:]:
            if servo not in asked:
                break
            error, data = self.servos.read(asked[servo], address, size)
            parts.append((servo, error, data.ljust(size, b"\0")))
        pause = sum(waits[asked[servo]] for servo, _, _ in parts)
        if request.instruction == p2.FAST_SYNC_READ:
            silent = [(servo, 0, bytes(size)) for servo in given[4 + len(parts) :]]
            whole = p2.fast_status(parts + silent)  # the first servo writes the length that all of them will have
            return self._sent(whole[: len(whole) - len(silent) * (size + 4)] if parts else b""), pause
        return b"".join(self._sent(p2.status(*part)) for part in parts), pause

    def _sent(self, answer: bytes) -> bytes:
        """The answer as it arrives: with a bit turned while packets are corrupted."""
        if self._corrupt and len(answer) > 9:
            self._corrupt -= 1
            place = int(self._rng.integers(8, len(answer)))
            answer = answer[:place] + bytes([answer[place] ^ 1 << int(self._rng.integers(8))]) + answer[place + 1 :]
        return answer

    def _happen(self) -> None:
        """Whatever is due."""
        now = time.monotonic()
        for due, kind in [item for item in self._due if item[0] <= now]:
            self._due.remove((due, kind))
            self._happened.append((kind, now))
            index = int(self._rng.integers(len(self.servos.ids)))
            if kind == "silent servo":
                self._silent.add(self.servos.ids[index])
            elif kind == "corrupted packet":
                self._corrupt = 1
            elif kind == "corrupted packets":
                self._corrupt = 1 << 60
            elif kind == "delay":
                self._delay_s = 0.1
            elif kind == "overload":
                self.servos.jammed[index] = True
            elif kind == "power loss":
                self.servos.powered[:] = False
                for each in range(len(self.servos.ids)):
                    self.servos.reboot(each)
            elif kind == "cable pulled":
                self._unplug()

    def _unplug(self) -> None:
        self._pulled = True
        for end in (self._master, self._slave):
            os.close(end)

    def _right_baud(self) -> bool:
        """The port talks as fast as the servos listen."""
        if self._pulled:
            return True
        self._baud = BAUDS.get(termios.tcgetattr(self._master)[5], 0)
        return self._baud == REGISTER_BAUDS[self.servos.get(0, 8)]

    def _wire_s(self, size: int) -> float:
        return 10.0 * size / self._baud if self._wire and self._baud else 0.0

    def _send(self, due: float, answer: bytes) -> None:
        if not answer or self._pulled:
            return
        while (left := due - time.monotonic()) > 0.0:
            time.sleep(min(left, IDLE_S))
            if left > IDLE_S:
                with self._lock:
                    self.servos.advance(time.monotonic())
        os.write(self._master, answer)


class BusProcess:
    """A ``ServoBus`` in a child process of its own."""

    def __init__(self, position_rad: Sequence[float] | None = None, *, count: int = 24, seed: int = 0) -> None:
        command = [sys.executable, "-m", "tests.emulators.servo_bus", "--count", str(count), "--seed", str(seed)]
        if position_rad is not None:
            command += ["--position", ",".join(f"{value:.9g}" for value in position_rad)]
        self._child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]
        )
        self.path = str(self._ask(None)["path"])

    def inject(self, kind: str, at_s: float = 0.0) -> None:
        """Let a fault happen in so many seconds."""
        self._ask({"inject": kind, "at_s": at_s})

    def state(self) -> dict[str, Any]:
        """As of ``ServoBus``."""
        return self._ask({"state": True})

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

    def _ask(self, question: dict[str, Any] | None) -> dict[str, Any]:
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        if question is not None:
            self._child.stdin.write(json.dumps(question) + "\n")
            self._child.stdin.flush()
        answer: dict[str, Any] = json.loads(self._child.stdout.readline())
        return answer


def main() -> None:
    """Run a bus until standard input ends; lines there are questions, answered on standard output."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--position", type=str, default="")
    parser.add_argument("--link", type=Path, default=None, help="a link to the port, e.g. for a calibration file")
    asked = parser.parse_args()
    position = [float(value) for value in asked.position.split(",")] if asked.position else None
    with ServoBus(range(1, asked.count + 1), position, seed=asked.seed) as bus:
        if asked.link is not None:
            asked.link.unlink(missing_ok=True)
            asked.link.symlink_to(bus.path)
        sys.stdout.write(json.dumps({"path": bus.path}) + "\n")
        sys.stdout.flush()
        for line in sys.stdin:
            question = json.loads(line)
            if "inject" in question:
                bus.inject(question["inject"], question["at_s"])
            sys.stdout.write(json.dumps(bus.state()) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
