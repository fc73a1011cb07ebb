"""Servos of the X series as a bus sees them: a control table, a shaft that follows its goal, limits
and protection.

Written from the public manual of the XM540-W270 and the notes on Bus Watchdog and Shutdown, sharing
no number with the driver that is tested against it. The shaft is of second order: a position loop
of 6 Hz, a current limit, a profile of limited velocity and mechanical stops. ``load_nm`` is what
turns every shaft from outside.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .protocol2 import ACCESS, ALERT, DATA_LENGTH, DATA_LIMIT, DATA_RANGE

MODEL, FIRMWARE = 1120, 45
REALTIME_TICK = 120
TICKS_RAD = 4096 / (2 * np.pi)
UNIT_RAD_S = 0.229 * 2 * np.pi / 60
UNIT_A = 2.69e-3
NM_A = 10.6 / 4.4
INERTIA, LOOP_HZ = 0.02, 6.0
STIFFNESS = INERTIA * (2 * np.pi * LOOP_HZ) ** 2
DAMPING = 2 * INERTIA * (2 * np.pi * LOOP_HZ)
PHYSICS_S = 2e-3
OVERLOAD_S, OVERLOAD = 0.3, 0x20
TRIPPED = 0xFF
REST_RAD_S = 0.02
INDIRECT, INDIRECT_DATA, INDIRECT_COUNT = 168, 224, 28

FIELDS: dict[int, tuple[int, bool, int, int, int]] = {
    # address: (bytes, writable, at the factory, least, most)
    0: (2, False, MODEL, 0, 0),
    6: (1, False, FIRMWARE, 0, 0),
    7: (1, True, 1, 0, 252),
    8: (1, True, 3, 0, 7),
    9: (1, True, 250, 0, 254),
    10: (1, True, 0, 0, 13),
    11: (1, True, 3, 0, 16),
    12: (1, True, 255, 0, 255),
    13: (1, True, 2, 1, 2),
    20: (4, True, 0, -1044479, 1044479),
    31: (1, True, 80, 0, 100),
    36: (2, True, 885, 0, 885),
    38: (2, True, 2047, 0, 2047),
    44: (4, True, 128, 0, 1023),
    48: (4, True, 4095, 0, 4095),
    52: (4, True, 0, 0, 4095),
    63: (1, True, 52, 0, 255),
    64: (1, True, 0, 0, 1),
    65: (1, True, 0, 0, 1),
    68: (1, True, 2, 0, 2),
    70: (1, False, 0, 0, 0),
    80: (2, True, 0, 0, 16383),
    82: (2, True, 0, 0, 16383),
    84: (2, True, 800, 0, 16383),
    98: (1, True, 0, 0, 127),
    100: (2, True, 885, -885, 885),
    102: (2, True, 2047, -2047, 2047),
    104: (4, True, 0, -1023, 1023),
    108: (4, True, 0, 0, 32767),
    112: (4, True, 0, 0, 32767),
    116: (4, True, 0, -1048575, 1048575),
    120: (2, False, 0, 0, 0),
    122: (1, False, 0, 0, 0),
    126: (2, False, 0, 0, 0),
    128: (4, False, 0, 0, 0),
    132: (4, False, 0, 0, 0),
    144: (2, False, 120, 0, 0),
    146: (1, False, 36, 0, 0),
    **{INDIRECT + 2 * i: (2, True, INDIRECT_DATA + i, 64, 251) for i in range(INDIRECT_COUNT)},
}
EEPROM_END = 64
GOALS = (100, 102, 104, 116)


class Servos:
    """Some servos and the time that passes for them.

    Arguments:
        stops_rad: their mechanical stops, from tick 2048.
        model, firmware: numbers that all of them answer with.
    """

    def __init__(
        self,
        ids: Sequence[int],
        position_rad: Sequence[float] | None = None,
        stops_rad: tuple[float, float] = (-3, 3),
        *,
        model: int = MODEL,
        firmware: int = FIRMWARE,
    ) -> None:
        self.ids = list(ids)
        n = len(self.ids)
        self.position = np.zeros(n) if position_rad is None else np.array(position_rad, dtype=float)
        self.rate, self.current, self.profile, self.goal = (
            np.zeros(n),
            np.zeros(n),
            self.position.copy(),
            np.zeros(n),
        )
        self.jammed, self.powered = np.zeros(n, bool), np.ones(n, bool)
        self.heard_s, self.at_limit_s = np.zeros(n), np.zeros(n)
        self.moved_s = 0.0
        self.goal_writes, self.refused_goals = 0, 0
        self.stops, self.now = stops_rad, 0.0
        self.load_nm = np.zeros(n)
        self.table = [bytearray(256) for _ in self.ids]
        for index in range(n):
            self._factory(index, range(256))
            self._put(index, 7, self.ids[index])
            self._put(index, 0, model)
            self._put(index, 6, firmware)
        self._began_s = np.zeros(n)  # when each of them was switched on
        self._limits()

    def advance(self, now: float) -> None:
        """Let time pass until ``now``."""
        if not self.now:
            self.now, self.heard_s[:] = now, now
        if self._changed:
            self._limits()
        while self.now + PHYSICS_S <= now:
            self.now += PHYSICS_S
            self._watchdogs()
            self._move()

    def hear(self, index: int, now: float) -> None:
        """An instruction packet went by; said before time advances, or a late emulator would be
        taken for silence.
        """
        self.heard_s[index] = now

    def read(self, index: int, address: int, size: int, measured: bytes = b"") -> tuple[int, bytes]:
        """Error and bytes.

        Arguments:
            measured: bytes from Realtime Tick on in place of those measured now.
        """
        if address + size > 256 or not size:
            return self.alert(index) | ACCESS, b""
        self._measure(index)
        table = bytearray(self.table[index])
        table[REALTIME_TICK : REALTIME_TICK + len(measured)] = measured
        data = bytearray(table[address : address + size])
        for offset in range(size):
            place = address + offset - INDIRECT_DATA
            if 0 <= place < INDIRECT_COUNT:
                data[offset] = table[
                    int.from_bytes(table[INDIRECT + 2 * place : INDIRECT + 2 * place + 2], "little")
                ]
        return self.alert(index), bytes(data)

    def write(self, index: int, address: int, data: bytes) -> int:
        """Write all fields that the bytes cover; the error of the first that cannot be."""
        while data:
            field = FIELDS.get(address)
            if field is None or not field[1]:
                return self.alert(index) | ACCESS
            size, _, _, least, most = field
            if len(data) < size:
                return self.alert(index) | DATA_LENGTH
            value = int.from_bytes(data[:size], "little", signed=True)
            error = self._write_field(index, address, value, size, (least, most))
            if error:
                return self.alert(index) | error
            address, data = address + size, data[size:]
        return self.alert(index)

    def fail(self, index: int, error: int) -> None:
        """Let a hardware error be found; those that Shutdown has switch the torque off."""
        self._put(index, 70, self.get(index, 70) | error)
        if self.get(index, 63) & error:
            self._put(index, 64, 0)
            self._changed = True

    def reboot(self, index: int) -> None:
        """Reset all that is not in the EEPROM to the factory's values; torque off."""
        self._factory(index, range(EEPROM_END, 256))
        self.jammed[index] = False
        self._began_s[index] = self.now
        self._limits()

    def get(self, index: int, address: int, signed: bool = False) -> int:
        """A field as it is kept."""
        size = FIELDS[address][0]
        return int.from_bytes(self.table[index][address : address + size], "little", signed=signed)

    def _write_field(
        self, index: int, address: int, value: int, size: int, range_: tuple[int, int]
    ) -> int:
        least, most = range_
        if least >= 0 and value < 0:
            value += 1 << 8 * size
        torque = self.get(index, 64)
        if (address < EEPROM_END and torque) or (address == 64 and value and self.get(index, 70)):
            return ACCESS  # ROM lock; after a shutdown only a reboot brings the torque back
        if not least <= value <= most:
            return DATA_RANGE
        if address == 102 and abs(value) > self.get(index, 38):
            return DATA_LIMIT
        if address in GOALS and self.get(index, 98) == TRIPPED:
            self.refused_goals += address == 116
            return DATA_RANGE
        if address == 116:
            if self.get(index, 11) == 3 and not self.get(index, 52) <= value <= self.get(index, 48):
                return DATA_LIMIT
            self.goal[index] = (value - 2048) / TICKS_RAD
            self.goal_writes += 1
        if address == 64 and value and not torque:
            self.profile[index] = self.position[index]
            self.heard_s[index] = self.now
        self._put(index, address, value)
        self._changed = self._changed or (address < INDIRECT and address != 116)
        return 0

    def _limits(self) -> None:
        """Read the numbers that the physics needs from the tables."""
        self._changed = False
        n = range(len(self.ids))
        self._torque = np.array([bool(self.get(i, 64)) for i in n])
        modes = [self.get(i, 11) for i in n]
        self._most_a = UNIT_A * np.array(
            [abs(self.get(i, 102, True)) if modes[i] == 5 else 2047 for i in n]
        )
        self._watch_s = np.array(
            [0.02 * w if 0 < (w := self.get(i, 98)) < 128 else np.inf for i in n]
        )
        profile = np.array([self.get(i, 112) for i in n]) * UNIT_RAD_S
        self._fastest = np.where(profile > 0, profile, 30.0 * 2 * np.pi / 60)
        self._stiffness = STIFFNESS / 800 * np.array([self.get(i, 84) for i in n])

    def _watchdogs(self) -> None:
        late = self._torque & (self.now - self.heard_s > self._watch_s) & self.powered
        for index in np.flatnonzero(late).tolist():
            self.profile[index] = self.goal[index] = self.position[index]
            self._put(index, 98, TRIPPED)
            self._put(index, 112, 0)
            self._watch_s[index] = np.inf

    def _move(self) -> None:
        step = self._fastest * PHYSICS_S
        drives = self._torque & self.powered
        self.profile += np.where(drives, np.clip(self.goal - self.profile, -step, step), 0.0)
        wanted = (self._stiffness * (self.profile - self.position) - DAMPING * self.rate) / NM_A
        self.current = np.where(drives, np.clip(wanted, -self._most_a, self._most_a), 0.0)
        self.current[self.jammed & drives] = self._most_a[self.jammed & drives]
        push = np.where(drives, NM_A * self.current + self.load_nm, -2.0 * self.rate)
        self.rate = np.where(self.jammed, 0.0, self.rate + PHYSICS_S * push / INERTIA)
        moved = self.position + PHYSICS_S * self.rate
        self.position = np.clip(moved, *self.stops)
        self.rate[self.position != moved] = 0.0
        if (np.abs(self.rate) > REST_RAD_S).any():
            self.moved_s = self.now
        pressing = (
            drives & (np.abs(self.current) >= 0.98 * self._most_a) & (np.abs(self.rate) < 0.05)
        )
        self.at_limit_s = np.where(pressing, self.at_limit_s + PHYSICS_S, 0.0)
        for index in np.flatnonzero(self.at_limit_s > OVERLOAD_S).tolist():
            if self.get(index, 63) & OVERLOAD:
                self.fail(index, OVERLOAD)
                self.at_limit_s[index], self._torque[index] = 0.0, False

    def _measure(self, index: int) -> None:
        """Realtime Tick, Present Current, Velocity and Position."""
        self._put(index, REALTIME_TICK, int(1e3 * (self.now - self._began_s[index])) % 32768)
        self._put(index, 126, round(float(self.current[index]) / UNIT_A))
        self._put(index, 128, round(float(self.rate[index]) / UNIT_RAD_S))
        self._put(index, 132, round(2048 + float(self.position[index]) * TICKS_RAD))
        self._put(index, 122, int(abs(self.rate[index]) > 0.2))

    def alert(self, index: int) -> int:
        """Alert bit of every status packet of a servo in error."""
        return ALERT if self.get(index, 70) else 0

    def _put(self, index: int, address: int, value: int) -> None:
        size = FIELDS[address][0]
        self.table[index][address : address + size] = (value & ((1 << 8 * size) - 1)).to_bytes(
            size, "little"
        )

    def _factory(self, index: int, addresses: range) -> None:
        for address, (_, _, value, _, _) in FIELDS.items():
            if address in addresses:
                self._put(index, address, value)
