"""A servo bus on a pseudo-terminal: a USB adapter with servos behind it, as the real SDK sees it,
and its faults.

``EmulatedBus`` runs in a thread; ``bus_process`` (``devices.py``) runs it as a child process, which
lives on when the host is killed. Both answer ``inject(fault, at_s)``, ``state()`` and ``close()``.
Times in ``state()`` are ``time.monotonic``, the same for all processes of the machine, but for the
servos' own, ``own_s`` and ``moved_s``, which is slower where the machine is too slow for the emulator
(``EmulatedTime``): a watchdog must not trip because nobody ran the servos.
"""

from __future__ import annotations

import os
import re
import select
import termios
import threading
import time
import tty
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from . import protocol2 as p2
from .servo_answers import ServoAnswers
from .servos import FIRMWARE, MODEL, Servos

BAUDS = {
    getattr(termios, f"B{baud}"): baud
    for baud in (57600, 115200, 1000000, 2000000, 3000000, 4000000)
}
REGISTER_BAUDS = (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000)
FAULTS = {
    "silent servo": "a servo answers nothing any more",
    "corrupted packet": "one answer has a turned bit",
    "corrupted packets": "every answer has a turned bit",
    "half packets": "answers are cut off",
    "delay": "answers come 0.1 s late",
    "frozen adapter": "nothing passes for 1 s, then all that waited does",
    "overload": "a shaft is jammed",
    "input voltage": "a servo finds its supply too low or too high",
    "overheating": "a servo gets too hot",
    "reboot": "a servo starts anew, torque off",
    "power loss": "no servo has power",
    "cable pulled": "the port is gone",
    "echo": "everything that is sent comes back",
    "garbage": "random bytes come before every answer",
    "stuck bus": "random bytes come without end",
    "same id": "a second servo has the id of a first",
    "stale values": "a servo repeats what it measured last",
    "jumping values": "a servo measures 0.6 rad too much",
    "lying values": "a servo answers soundly with random positions",
    "no fast sync read": "Fast Sync Read is not answered",
    "status return 0": "servos answer pings alone",
    "status return 1": "servos answer pings and reads alone",
    "wrong baud": "servos talk at 57,600 baud",
    "wrong model": "a servo is another model",
}
"""Faults by name, and what happens then. A number behind the name is the id of the servo, drawn
where there is none."""
FAULT = re.compile(rf"(?P<kind>{'|'.join(FAULTS)})(?: (?P<servo>\d+))?")
IDLE_S = 0.004
SLOWEST_S = 0.012
DELAY_S, FROZEN_S = 0.1, 1.0
VOLTAGE, OVERHEATING = 0x01, 0x04
OTHER_MODEL = 1020


class EmulatedTime:
    """A clock for what is emulated: the machine's, but for gaps in which the machine did not run
    the emulator.

    now: its time [s], at most that of ``time.monotonic``.
    """

    def __init__(self) -> None:
        self._last_s = self.now = time.monotonic()

    def tick(self) -> float:
        """Let time pass since the last call, ``SLOWEST_S`` at most."""
        last, self._last_s = self._last_s, time.monotonic()
        self.now += min(self._last_s - last, SLOWEST_S)
        return self.now


class EmulatedBus(threading.Thread):
    """Servos on a pseudo-terminal; ``path`` is the port to open.

    Arguments:
        position_rad: of the shafts at first, from tick 2048.
        wire: bytes take as long as at the port's baud rate.
        model, firmware, baud: of all servos. clock: their own. goal_packets_s, torque_packets_s: when a packet with
            goals came, and one that switches torques on; goals: the ticks in it, servo by servo.
    """

    def __init__(
        self,
        ids: Sequence[int] = tuple(range(1, 25)),
        position_rad: Sequence[float] | None = None,
        *,
        wire: bool = True,
        stops_rad: tuple[float, float] = (-3.0, 3.0),
        model: int = MODEL,
        firmware: int = FIRMWARE,
        baud: int = 1000000,
        seed: int = 0,
    ) -> None:
        super().__init__(daemon=True)
        self.servos = Servos(ids, position_rad, stops_rad, model=model, firmware=firmware)
        self._everywhere(8, REGISTER_BAUDS.index(baud))
        self.goal_packets_s: list[float] = []
        self.torque_packets_s: list[float] = []
        self._wire, self._rng = wire, np.random.default_rng(seed)
        self._answers, self.clock = ServoAnswers(self.servos, self._rng), EmulatedTime()
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._reader, self._lock, self._ending = p2.Reader(), threading.Lock(), threading.Event()
        self._due: list[tuple[float, str, int | None]] = []
        self._happened: list[tuple[str, float]] = []
        self._delay_s, self._thaws_s, self._pulled, self._echo, self._stuck = (
            0.0,
            0.0,
            False,
            False,
            False,
        )
        self._baud = baud
        self.start()

    @property
    def goals(self) -> list[list[int]]:
        """Ticks of all packets with goals so far."""
        return self._answers.goals

    def inject(self, fault: str, at_s: float = 0.0) -> None:
        """Let a fault happen in so many seconds.

        Arguments:
            fault: a name of ``FAULTS``, e.g. "power loss"; or with the id of a servo, "silent servo
                4".

        Raises:
            ValueError: for an unknown one.
        """
        words = FAULT.fullmatch(fault)
        if words is None:
            raise ValueError(f"expected one of {', '.join(FAULTS)}, got {fault!r}")
        servo, index = words["servo"], None
        if servo is not None:
            if int(servo) not in self.servos.ids:
                raise ValueError(
                    f"expected the id of a servo, {listed(self.servos.ids)}, got {servo}"
                )
            index = self.servos.ids.index(int(servo))
        with self._lock:
            self._due.append((time.monotonic() + at_s, words["kind"], index))

    def state(self) -> dict[str, Any]:
        """State of the servos, JSON-ready.

        own_s, moved_s: the servos' own time, and when one of them moved last in it.
        """
        with self._lock:
            servos, n = self.servos, range(len(self.servos.ids))
            return {
                "now_s": time.monotonic(),
                "ids": servos.ids,
                "position_rad": servos.position.tolist(),
                "rate_rad_s": servos.rate.tolist(),
                "goal_rad": servos.goal.tolist(),
                "current_a": servos.current.tolist(),
                "torque": [bool(servos.get(i, 64)) for i in n],
                "powered": servos.powered.tolist(),
                "watchdog": [servos.get(i, 98) for i in n],
                "hardware_error": [servos.get(i, 70) for i in n],
                "goal_writes": servos.goal_writes,
                "refused_goals": servos.refused_goals,
                "own_s": servos.now,
                "moved_s": servos.moved_s,
                "happened": list(self._happened),
                "goal_packets_s": self.goal_packets_s[-100:],
                "torque_packets_s": self.torque_packets_s[-100:],
            }

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
            heard = self._heard()
            answers = list[tuple[float, bytes]]()
            with self._lock:
                self._happen()
                began = time.monotonic()
                for request in self._reader.feed(heard if self._right_baud() else b""):
                    answers.append(self._served(request, began))
                self._pass()
            if heard and self._echo:
                self._write(heard)
            for due, answer in answers:
                self._send(due + self._delay_s, answer)
            if self._stuck:
                self._write(self._rng.bytes(512))
        if not self._pulled:
            self._unplug()

    def _heard(self) -> bytes:
        """Bytes from the host; none while the adapter is frozen, or gone."""
        if self._pulled or time.monotonic() < self._thaws_s:
            time.sleep(IDLE_S)
            return b""
        if not select.select([self._master], [], [], IDLE_S)[0]:
            return b""
        return os.read(self._master, 4096)

    def _served(self, request: p2.Request, began: float) -> tuple[float, bytes]:
        """When the last byte of an answer is due, and the answer."""
        heard = self.clock.tick()
        for index in range(len(self.servos.ids)):
            if self.servos.powered[index] and index not in self._answers.silent:
                self.servos.hear(index, heard)
        self._pass()
        goals, torques = self._answers.goal_rows, self._answers.torque_rows
        answer, pause_s = self._answers.answer(request)
        if self._answers.goal_rows > goals:
            self.goal_packets_s.append(time.monotonic())
        if self._answers.torque_rows > torques:
            self.torque_packets_s.append(time.monotonic())
        return began + self._wire_s(request.size + len(answer)) + pause_s, answer

    def _pass(self) -> None:
        """Let emulated time pass for the servos."""
        self.servos.advance(self.clock.tick())

    def _happen(self) -> None:
        """Let happen whatever is due."""
        now = time.monotonic()
        for due in [item for item in self._due if item[0] <= now]:
            self._due.remove(due)
            self._happened.append((due[1], now))
            index = int(self._rng.integers(len(self.servos.ids)))
            self._fault(due[1], index if due[2] is None else due[2])

    def _fault(self, kind: str, index: int) -> None:
        servos, answers = self.servos, self._answers
        hit = {
            "silent servo": answers.silent,
            "same id": answers.twins,
            "jumping values": answers.jumping,
            "lying values": answers.lying,
        }
        if kind in hit:
            hit[kind].add(index)
        elif kind in ("corrupted packet", "corrupted packets"):
            answers.corrupt = 1 if kind == "corrupted packet" else 1 << 60
        elif kind == "half packets":
            answers.halved = True
        elif kind == "garbage":
            answers.noisy = True
        elif kind == "stale values":
            answers.freeze(index)
        elif kind == "no fast sync read":
            answers.fast = False
        elif kind == "delay":
            self._delay_s = DELAY_S
        elif kind == "frozen adapter":
            self._thaws_s = time.monotonic() + FROZEN_S
        elif kind == "echo":
            self._echo = True
        elif kind == "stuck bus":
            self._stuck = True
        elif kind == "overload":
            servos.jammed[index] = True
        elif kind in ("input voltage", "overheating"):
            servos.fail(index, VOLTAGE if kind == "input voltage" else OVERHEATING)
        elif kind == "reboot":
            servos.reboot(index)
        elif kind == "power loss":
            servos.powered[:] = False
            for each in range(len(servos.ids)):
                servos.reboot(each)
        elif kind in ("status return 0", "status return 1"):
            self._everywhere(68, int(kind[-1]))
        elif kind == "wrong baud":
            self._everywhere(8, REGISTER_BAUDS.index(57600))
        elif kind == "wrong model":
            servos._put(index, 0, OTHER_MODEL)
        elif kind == "cable pulled":
            self._unplug()

    def _everywhere(self, address: int, value: int) -> None:
        for index in range(len(self.servos.ids)):
            self.servos._put(index, address, value)

    def _unplug(self) -> None:
        self._pulled = True
        for end in (self._master, self._slave):
            os.close(end)

    def _right_baud(self) -> bool:
        """Tell whether the port talks as fast as the servos listen."""
        if self._pulled:
            return True
        self._baud = BAUDS.get(termios.tcgetattr(self._master)[5], 0)
        return self._baud == REGISTER_BAUDS[self.servos.get(0, 8)]

    def _wire_s(self, size: int) -> float:
        return 10.0 * size / self._baud if self._wire and self._baud else 0.0

    def _send(self, due: float, answer: bytes) -> None:
        """Send an answer when its last byte is due, and let the servos' time pass meanwhile."""
        if not answer:
            return
        while (left := due - time.monotonic()) > 0.0 and not (
            self._pulled or self._ending.is_set()
        ):
            time.sleep(min(left, SLOWEST_S))
            with self._lock:
                self._pass()
        self._write(answer)

    def _write(self, data: bytes) -> None:
        """Hand bytes to the host, as many as it has room for: an adapter drops what nobody
        reads.
        """
        if not data or self._pulled:
            return
        try:
            os.write(self._master, data)
        except BlockingIOError:
            return


def listed(ids: Sequence[int]) -> str:
    """Ids for a message, e.g. "1 to 24"."""
    whole = list(ids) == list(range(ids[0], ids[0] + len(ids)))
    return f"{ids[0]} to {ids[-1]}" if whole and len(ids) > 2 else ", ".join(map(str, ids))
