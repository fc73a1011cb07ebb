"""Status packets of emulated servos: who answers an instruction, with which bytes, and what lies or
spoils them.
"""

from __future__ import annotations

import numpy as np

from . import protocol2 as p2
from .servos import REALTIME_TICK, Servos

RETURN_DELAY, STATUS_RETURN, GOAL, TORQUE = 9, 68, 116, 64
FAST_FIRMWARE = 45
POSITION = range(132, 136)
TWIN_RAD, JUMP_RAD = 0.3, 0.6
"""How far the shaft of a second servo with the same id is turned, and how far a measurement
jumps."""
NOISE_BYTES = 64


class ServoAnswers:
    """Answers of servos to instructions.

    Arguments:
        servos: the servos, whose tables are read and written.
        rng: draws who is hit and which bits turn. fast: whether Fast Sync Read is answered at all.
            goal_rows, torque_rows: numbers of Sync Writes with goals, and of those that switch a
            torque on; goals: ticks of each of them. silent, twins, stale, jumping, lying: indices
            of servos that answer nothing, share their id with another servo, repeat old
            measurements, measure too much by JUMP_RAD, and answer soundly with nonsense. corrupt:
            number of status packets that get a turned bit. halved, noisy: whether answers are cut
            off, and come after random bytes.
    """

    def __init__(self, servos: Servos, rng: np.random.Generator) -> None:
        self.servos, self._rng, self.fast = servos, rng, True
        self.goal_rows, self.torque_rows = 0, 0
        self.goals: list[list[int]] = []
        self.silent, self.twins, self.jumping, self.lying = (
            set[int](),
            set[int](),
            set[int](),
            set[int](),
        )
        self.stale: dict[int, bytes] = {}
        self.corrupt, self.halved, self.noisy = 0, False, False

    def answer(self, request: p2.Request) -> tuple[bytes, float]:
        """All bytes that come back for a request, and how long the servos wait before [s]."""
        answer, pause_s = self._answer(request)
        if answer and self.halved:
            answer = answer[: len(answer) // 2]
        if answer and self.noisy:
            answer = self._rng.bytes(NOISE_BYTES) + answer
        return answer, pause_s

    def freeze(self, index: int) -> None:
        """Let a servo repeat what it measures now."""
        self.servos.read(index, 0, 1)
        self.stale[index] = bytes(self.servos.table[index][REALTIME_TICK : POSITION.stop])

    def _answer(self, request: p2.Request) -> tuple[bytes, float]:
        servos, parameters = self.servos, request.parameters
        n = range(len(servos.ids))
        alive = [i for i in n if servos.powered[i] and i not in self.silent]
        indices = [i for i in alive if request.servo in (servos.ids[i], p2.BROADCAST)]
        waits = {i: 2e-6 * servos.get(i, RETURN_DELAY) for i in alive}
        many = request.sound and len(parameters) > 4
        if request.instruction in (p2.SYNC_READ, p2.FAST_SYNC_READ) and many:
            return self._many(request, {servos.ids[i]: i for i in indices}, waits)
        if request.instruction == p2.SYNC_WRITE and many:
            self._write_many(parameters, indices)
            return b"", 0.0
        return b"".join(self._one(request, i) for i in indices), sum(waits[i] for i in indices)

    def _write_many(self, given: bytes, asked: list[int]) -> None:
        address, size = int.from_bytes(given[:2], "little"), int.from_bytes(given[2:4], "little")
        rows = [given[k : k + 1 + size] for k in range(4, len(given), 1 + size)]
        if address <= GOAL < address + size:
            at = 1 + GOAL - address
            self.goal_rows += 1
            self.goals.append(
                [int.from_bytes(row[at : at + 4], "little", signed=True) for row in rows]
            )
        at = 1 + TORQUE - address
        if 0 < at <= size and any(row[at : at + 1] == b"\1" for row in rows):
            self.torque_rows += 1
        for row in rows:
            for index in asked:
                if self.servos.ids[index] == row[0] and len(row) == 1 + size:
                    self.servos.write(index, address, row[1:])

    def _one(self, request: p2.Request, index: int) -> bytes:
        """Answer of one servo to an instruction for it alone, or to a broadcast."""
        servos, parameters, me = self.servos, request.parameters, self.servos.ids[index]
        alert, level = servos.alert(index), servos.get(index, STATUS_RETURN)
        if not request.sound:
            damaged = request.servo == me and level == 2
            return self._sent(p2.status(me, alert | p2.BAD_CRC)) if damaged else b""
        if request.instruction == p2.PING:
            return self._sent(
                p2.status(me, alert, servos.read(index, 0, 2)[1] + servos.read(index, 6, 1)[1])
            )
        if request.servo == p2.BROADCAST:
            return b""
        if request.instruction == p2.READ and len(parameters) == 4:
            address, size = (
                int.from_bytes(parameters[:2], "little"),
                int.from_bytes(parameters[2:], "little"),
            )
            return self._read(index, address, size) if level else b""
        if request.instruction == p2.WRITE and len(parameters) > 2:
            error = servos.write(index, int.from_bytes(parameters[:2], "little"), parameters[2:])
            return self._sent(p2.status(me, error)) if level == 2 else b""
        if request.instruction == p2.REBOOT:
            servos.reboot(index)
            return self._sent(p2.status(me, 0)) if level == 2 else b""
        known = request.instruction in (p2.READ, p2.WRITE)
        return (
            self._sent(p2.status(me, alert | (p2.ACCESS if known else p2.BAD_INSTRUCTION)))
            if level == 2
            else b""
        )

    def _read(self, index: int, address: int, size: int) -> bytes:
        """Status packet with data; those of two servos with one id lie over each other, and a 0 bit
        wins.
        """
        error, data = self._measured(index, address, size)
        first = self._sent(p2.status(self.servos.ids[index], error, data))
        if index not in self.twins:
            return first
        error, data = self._measured(index, address, size, turned_rad=TWIN_RAD)
        second = p2.status(self.servos.ids[index], error, data)
        return bytes(a & b for a, b in zip(first, second, strict=False))

    def _measured(
        self, index: int, address: int, size: int, turned_rad: float = 0.0
    ) -> tuple[int, bytes]:
        """Error and bytes as the servo reports them, which need not be true."""
        servos, position = self.servos, self.servos.position[index]
        turned_rad += JUMP_RAD if index in self.jumping else 0.0
        if index in self.lying:
            turned_rad += float(self._rng.uniform(-2.5, 2.5))
        servos.position[index] = position + turned_rad
        if index in self.stale:
            error, data = servos.read(index, address, size, self.stale[index])
        else:
            error, data = servos.read(index, address, size)
        servos.position[index] = position
        return error, data

    def _many(
        self, request: p2.Request, asked: dict[int, int], waits: dict[int, float]
    ) -> tuple[bytes, float]:
        """One status after the other; nothing after the first that is silent, for each waits for
        the last.
        """
        parameters, parts, singles = (
            request.parameters,
            list[tuple[int, int, bytes]](),
            list[bytes](),
        )
        address, size = (
            int.from_bytes(parameters[:2], "little"),
            int.from_bytes(parameters[2:4], "little"),
        )
        fast = request.instruction == p2.FAST_SYNC_READ
        for servo in parameters[4:]:
            index = asked.get(servo)
            if index is None or not self.servos.get(index, STATUS_RETURN):
                break
            if fast and not (self.fast and self.servos.get(index, 6) >= FAST_FIRMWARE):
                break
            error, data = self._measured(index, address, size)
            parts.append((servo, error, data.ljust(size, b"\0")))
            if not fast:
                singles.append(self._read(index, address, size))
        pause = sum(waits[asked[servo]] for servo, _, _ in parts)
        if not fast:
            return b"".join(singles), pause
        silent = [(servo, 0, bytes(size)) for servo in parameters[4 + len(parts) :]]
        whole = p2.fast_status(
            parts + silent
        )  # the first servo writes the length that all of them will have
        if (
            any(asked[servo] in self.twins for servo, _, _ in parts)
            and address + size > POSITION.start
        ):
            whole = whole[:-9] + bytes(byte & 0x55 for byte in whole[-9:])
        return self._sent(whole[: len(whole) - len(silent) * (size + 4)] if parts else b""), pause

    def _sent(self, answer: bytes) -> bytes:
        """The answer as it arrives: with a bit turned while packets are corrupted."""
        if self.corrupt and len(answer) > 9:
            self.corrupt -= 1
            place = int(self._rng.integers(8, len(answer)))
            answer = (
                answer[:place]
                + bytes([answer[place] ^ 1 << int(self._rng.integers(8))])
                + answer[place + 1 :]
            )
        return answer
