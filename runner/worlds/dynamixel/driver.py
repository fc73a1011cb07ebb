"""A robot of DYNAMIXEL X-series servos as a world (extra ``machines``): targets by sync write,
angles by sync read.

Servos run in current-based position control, so that their current, and with it their torque, is
limited. Each has its bus watchdog set: when nothing is heard of the host for a while, it stops
where it is and holds, whatever has happened to the host. After a stop no packet leaves but those
that read, and those that switch the torque off. What is measured is judged (``MeasurementJudge``),
and asked for again, before it is believed.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import Actuators
from stancekit.planners.robot.robot_file import Servo

from ..hardware import HardwareWorld, listed
from ..world import Drives, WorldSettings
from . import control_table as table
from .bus import (
    BABBLE,
    Doubt,
    MeasurementJudge,
    ServoBus,
    blame,
    late,
    signed,
    unanswered,
    unsigned,
)
from .control_table import Calibration

_ROUNDS = 3
"""Number of times that a setting that did not arrive is written."""


def _check_servos(bus: ServoBus, model: table.ServoModel) -> None:
    """All are there, of this model, with a bus watchdog; the bus reads fast if all can.

    Servos are set to answer reads and writes (Status Return Level 2), before anything is read.
    Raises HardwareFault for silent servos and a bus that cannot be talked to, InvalidInput for
    other models and old firmware.
    """
    if not bus.listen():
        raise HardwareFault(f"port {bus.port}: {BABBLE}")
    count = len(bus.ids)
    numbers = list[int | None]()
    for index in range(count):
        numbers.append(bus.ping(index))
        if numbers.count(None) == 1 and numbers[-1] is None:
            numbers[-1] = late(bus, index)
    silent = [i for i, number in enumerate(numbers) if number is None]
    if silent:
        unanswered(bus, silent)
    others = [
        f"{bus.label(i)} is model {number}"
        for i, number in enumerate(numbers)
        if number != model.number
    ]
    if others:
        raise InvalidInput(
            f"port {bus.port}: expected servos {model.name} (model {model.number}): "
            f"{listed(others)}"
        )
    bus.fast = False
    bus.write_all(table.STATUS_RETURN, np.full(count, 2))
    firmware = bus.read_all(table.FIRMWARE.address, 1)[:, 0]
    old = [
        f"{bus.label(int(i))} has {firmware[i]}"
        for i in np.flatnonzero(firmware < table.WATCHDOG_FIRMWARE)
    ]
    if old:
        raise InvalidInput(
            f"expected firmware {table.WATCHDOG_FIRMWARE} or newer, for its watchdog: {listed(old)}"
        )
    bus.fast = bool((firmware >= table.FAST_FIRMWARE).all())


def _configure(bus: ServoBus, current: NDArray[np.int64]) -> None:
    """Bring what the driver relies on into every servo; the EEPROM is written only where it
    differs.

    Arguments:
        current: Current Limit, in its units, shape (S,).

    Raises:
        InvalidInput: for a setting that differs on a servo whose torque is on, HardwareFault for
            whatever a servo refuses.
    """
    count = len(bus.ids)
    free = bus.read_all(table.TORQUE_ENABLE.address, 1)[:, 0] == 0
    for register, wanted in (
        (table.OPERATING_MODE, np.full(count, table.CURRENT_BASED_POSITION)),
        (table.RETURN_DELAY, np.zeros(count, np.int64)),
        (table.CURRENT_LIMIT, current),
        (table.DRIVE_MODE, np.zeros(count, np.int64)),  # a goal must never switch the torque on
        (table.STATUS_RETURN, np.full(count, 2)),
    ):
        _settle(bus, register, wanted, free)
    shutdown = unsigned(bus.read_all(table.SHUTDOWN.address, 1))
    _settle(bus, table.SHUTDOWN, shutdown | table.SHUTDOWN_ON, free)
    places = [each.address + k for each in table.WATCHED for k in range(each.size)]
    rows = np.tile(np.array(places, dtype="<u2").view(np.uint8), (count, 1))
    if not np.array_equal(bus.read_all(table.INDIRECT_ADDRESS.address, rows.shape[1]), rows):
        bus.write_rows(table.INDIRECT_ADDRESS.address, rows)
        values = bus.read_all(table.INDIRECT_ADDRESS.address, rows.shape[1])
        bus.refuse((values != rows).any(axis=1), "did not take its indirect addresses")


def _settle(
    bus: ServoBus, register: table.Register, wanted: NDArray[np.int64], free: NDArray[np.bool_]
) -> None:
    """Write a field where it differs, and see that it was taken.

    Looked at by a reading of all servos, whose length says that it is no late answer to something
    else; the SDK takes any answer of a servo for that to its last question.
    """
    for _ in range(_ROUNDS):
        values = unsigned(bus.read_all(register.address, register.size))
        wrong = np.flatnonzero(values != wanted).tolist()
        if not wrong:
            return
        for index in wrong:
            if not free[index] and register.address < table.TORQUE_ENABLE.address:
                raise InvalidInput(
                    f"{bus.label(index)}: expected {register.name} {wanted[index]}, got "
                    f"{values[index]}; it cannot be "
                    "written while the torque is on: relax the robot first"
                )
            bus.write(index, register, int(wanted[index]))
    bus.refuse(
        unsigned(bus.read_all(register.address, register.size)) != wanted,
        f"did not keep its {register.name}",
    )


_REST_RAD = 0.35
"""A robot at rest, its torque off, has its joints this near to where the calibration says."""
OFF = "its torque went off: did it restart, was its power gone?"
_AGAIN_S = 0.02
"""Two measurements before a robot is believed to be where it says are so far apart."""
_CALM_S = 0.12
"""After a measurement that may have come late the bus is quiet for so long before the next is asked
for."""
_STANDS_RAD_S, _STANDING_S = 0.05, 0.2
"""Servos stand that turn no faster; a hold waits so long for them to."""


class DynamixelWorld(HardwareWorld):
    """Servos on a bus; not thread-safe.

    Torques are what the measured current stands for, roughly. Raises InvalidInput for a calibration
    that lacks joints, and without the SDK or pinocchio.
    """

    name = "dynamixel"
    alone = "the servos are stopped by their own bus watchdogs, and hold"
    catch_up = 3.0

    def __init__(
        self,
        robot: Robot,
        calibration: Calibration,
        servo: Servo | None = None,
        *,
        rate_hz: float | None = None,
        actuators: Actuators | None = None,
    ) -> None:
        drives = Drives.of(
            robot.legs_with(servo or robot.servo),
            actuators or Actuators(joints={"*": calibration.model}),
        )
        stiffer = 1.0 if actuators is not None else calibration.p_gain / table.P_GAIN
        drives = replace(
            drives,
            stiffness_nm_rad=stiffer * drives.stiffness_nm_rad,
            damping_nms_rad=stiffer * drives.damping_nms_rad,
            yields=not calibration.desk,
            assigned=None if calibration.desk else drives.assigned,
        )
        super().__init__(robot, servo, drives, rate_hz)
        self.calibration = calibration
        calibration.check(self.joints)
        self._servos = calibration.ordered(self.joints)
        self._turning, self._kind = calibration.turning(self.joints), calibration.kind
        self._current = np.array([round(each.current_a / table.AMPERE) for each in self._servos])
        ids = [each.id for each in self._servos]
        self.bus = ServoBus(
            calibration.port,
            calibration.baud,
            ids,
            self.joints,
            latency_ms=calibration.latency_ms,
            latch=self.latch,
            blame=blame,
        )
        self.capabilities = self._capable(replaced=actuators is not None)
        self._judge = MeasurementJudge(self.bus, drives.velocity_rad_s)
        self._was_on: NDArray[np.bool_] | None = (
            None  # which torques were on before an arming that did not end well
        )

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``JointBus``."""
        calibration = settings.device(Calibration, "a calibration file", cls.name)
        return cls(
            settings.robot,
            calibration,
            settings.servo,
            rate_hz=settings.rate_hz,
            actuators=settings.actuators,
        )

    def stop(self, *, torque_off: bool = False) -> str:
        """Send nothing any more: servos keep the last target they were sent, and no step is taken
        until armed again; or have no torque.

        A goal of its own would only give up what the servos lean on; their watchdogs hold them
        where they are. Waits until they are measured to stand. Raises HardwareFault where they do
        not in time, or cannot be seen to: then their bus watchdogs stop them, and the message says
        when. After an arming that was interrupted the torque is off; only a robot that was held
        before, all of it, is held on. Raises HardwareFault that names the servos of which that, or
        their torque off, cannot be made sure.
        """
        self.armed = False
        if torque_off:
            self._relax()
        elif self._was_on is not None:
            self._disarm()
        elif self._driven:
            self._stand()
        return ""

    def close(self) -> None:
        """Give the port back.

        Torque stays as it is, and a servo whose torque is on is stopped by its watchdog.
        """
        self.armed = self._open = False
        self.bus.close()

    def _relax(self) -> None:
        self._driven = False
        if not self._open:
            return
        for again in (True, False):
            self._everywhere(table.TORQUE_ENABLE, 0, stopping=True)
            try:
                rows = self.bus.read_all(table.TORQUE_ENABLE.address, 1, alerts=False)
            except HardwareFault:
                if not again:
                    raise
            else:
                if not rows.any():
                    self._was_on = None
                    return
        self.bus.refuse(rows[:, 0] > 0, "its torque did not go off")

    def _reached(self) -> tuple[Array, Array, Array]:
        """Check and set up all servos, and measure them twice: what is old or random shows.

        Raises InvalidInput for a port that is absent or busy, servos of another model, and a robot
        without torque that is not at rest as calibrated.
        """
        if not self._open:
            self.bus.open()
            self._open = True
        with self.bus.patient():
            _check_servos(self.bus, self._kind)
            _configure(self.bus, self._current)
            self._judge.begin()
            before = self._watched()
            time.sleep(_AGAIN_S)
            rows = self._watched()
            why = self._judge.clocks(unsigned(before[:, 13:15]), unsigned(rows[:, 13:15]))
            if why:
                raise HardwareFault(why)
        measured = self._told(rows)
        if not rows[:, 0].any():
            self._check_rest(measured[0])
        return measured

    def _stand(self) -> None:
        """Wait until no servo turns.

        Raises HardwareFault where that cannot be seen in time.
        """
        within = (
            f"bus watchdogs stop the servos {self.calibration.watchdog_s:g} s after the last packet"
        )
        until, seen = time.monotonic() + _STANDING_S, ""
        while not seen or time.monotonic() < until:
            try:
                rows = self.bus.peek(table.INDIRECT_DATA.address, table.WATCHED_BYTES)
            except HardwareFault as fault:
                raise HardwareFault(f"{fault}; {within}") from None
            seen = f"port {self.bus.port}: servos cannot be seen to stand"
            if rows is not None:
                rates = np.abs(signed(rows[:, 5:9])) * table.RAD_S
                turning = int(np.argmax(rates))
                seen = f"{self.bus.label(turning)}: still turns at {rates[turning]:.2f} rad/s"
                if rates[turning] <= _STANDS_RAD_S:
                    self._driven = False
                    return
            time.sleep(0.5 * _AGAIN_S)
        raise HardwareFault(f"{seen}; {within}")

    def _capable(self, *, replaced: bool) -> Drives:
        """The robot's own limits, the servos', and the calibration's, whichever are narrower; its
        file's torques count unless a person replaced them.
        """
        can, own = self.capabilities, self._kinematics.torque_nm
        torque = np.array([each.current_a for each in self._servos]) * self._kind.nm_a
        torque = np.minimum(torque, can.torque_nm)
        return replace(
            can,
            lower_rad=np.maximum(can.lower_rad, [each.lower_rad for each in self._servos]),
            upper_rad=np.minimum(can.upper_rad, [each.upper_rad for each in self._servos]),
            # on a desk that of the robot that is planned for: here it is no load
            torque_nm=np.where(np.isfinite(own), own, torque)
            if self.calibration.desk
            else np.minimum(torque, np.inf if replaced else own),
        )

    def _switched_on(self) -> None:
        """Switch the torque on, with current limits and watchdogs set.

        A servo in a shutdown stays off. Arming clears watchdogs that have stopped their servo. The
        latch is asked for every packet, and after the last.
        """
        with self.bus.patient():
            self._was_on = self._watched()[:, 0] > 0
            units = self.calibration.watchdog_units
            self._everywhere(table.BUS_WATCHDOG, 0)
            self.bus.write_all(table.GOAL_CURRENT, self._current)
            self._everywhere(table.POSITION_P_GAIN, self.calibration.p_gain)
            self._everywhere(table.PROFILE_ACCELERATION, 0)
            fastest = np.maximum(self.capabilities.velocity_rad_s / table.RAD_S, 1.0)  # 0: no limit
            self.bus.write_all(table.PROFILE_VELOCITY, fastest.astype(np.int64))
            angles, _, _ = self._told(self._watched())
            self._check_angles(angles)
            self._sent = self._put(angles)
            self._everywhere(
                table.BUS_WATCHDOG, units
            )  # before the torque: a host that dies here leaves none without
            rows = self._watched()
            self.bus.refuse(
                rows[:, 2] != units, f"expected a bus watchdog of {20 * units} ms, got another"
            )
            self._driven = True
            self._everywhere(table.TORQUE_ENABLE, 1)
            self.armed = True
            self._watched()
            self.latch.check()
            self._was_on = None

    def _disarm(self) -> None:
        """Torque off after an arming that was interrupted; a robot that was held before goes on
        holding.
        """
        with self.bus.patient():
            if self._was_on is None or not self._was_on.all():
                self._relax()
                return
            units = self.calibration.watchdog_units
            self._everywhere(table.BUS_WATCHDOG, units, stopping=True)
            rows = self.bus.read_all(table.BUS_WATCHDOG.address, 1, alerts=False)
            self.bus.refuse(rows[:, 0] != units, "its bus watchdog could not be set")
            self._was_on = None

    def _label(self, index: int) -> str:
        return self.bus.label(index)

    def _check_rest(self, angles: Array) -> None:
        for index, each in enumerate(self._servos):
            if each.rest_rad is not None and abs(angles[index] - each.rest_rad) > _REST_RAD:
                raise InvalidInput(
                    f"{self.bus.label(index)}: expected its rest at {each.rest_rad:.2f} rad, "
                    "measured "
                    f"{angles[index]:.2f}: is its calibration right, and the robot at rest?"
                )

    def _put(self, angles_rad: Array) -> Array:
        ticks = np.rint(self._turning.told(angles_rad)).astype(np.int64)
        self.bus.write_all(table.GOAL_POSITION, ticks)
        return self._turning.angles(ticks)

    def _measured(self) -> tuple[Array, Array, Array]:
        return self._told(self._watched())

    def _watched(self) -> NDArray[np.uint8]:
        """Bytes that are read in every period, shape (J, 15), after a look at what the servos say
        of themselves.

        A measurement that cannot be true is asked for once more, after a pause. Raises
        HardwareFault.
        """
        before = self.bus.retried
        rows = self.bus.read_all(table.INDIRECT_DATA.address, table.WATCHED_BYTES)
        once = (
            self.bus.retried == before
        )  # no question is open whose answer may have been taken for this one
        if (doubt := self._doubt(rows, calm=once)).why:
            self.bus.retried += 1
            self.bus.calm(_CALM_S if doubt.late else 1e-3 * self.bus.latency_ms)
            rows = self.bus.read_all(table.INDIRECT_DATA.address, table.WATCHED_BYTES)
            if why := self._doubt(rows, calm=True).why:
                if self.armed:  # one that restarted has lost its indirect addresses, too
                    torque = self.bus.read_all(table.TORQUE_ENABLE.address, 1)
                    self.bus.refuse(torque[:, 0] == 0, OFF)
                raise HardwareFault(why)
        for index in np.flatnonzero(rows[:, 1]):
            raise HardwareFault(
                f"{self.bus.label(int(index))}: {table.hardware_errors(int(rows[index, 1]))}"
            )
        if self.armed:
            self.bus.refuse(
                rows[:, 2] == table.TRIPPED, "its bus watchdog stopped it: the host was silent"
            )
            self.bus.refuse(rows[:, 0] == 0, OFF)
        return rows

    def _doubt(self, rows: NDArray[np.uint8], *, calm: bool = False) -> Doubt:
        """Doubt whether these bytes can be true, as ``MeasurementJudge.doubt``."""
        position, velocity = signed(rows[:, 9:13]), signed(rows[:, 5:9])
        return self._judge.doubt(
            time.monotonic(), position, velocity, unsigned(rows[:, 13:15]), calm=calm
        )

    def _told(self, rows: NDArray[np.uint8]) -> tuple[Array, Array, Array]:
        """Angles, rates and torques in these bytes, shape (J,) each."""
        current, rate = signed(rows[:, 3:5]), signed(rows[:, 5:9])
        turned = self._turning.direction
        rates = np.asarray(turned * rate * table.RAD_S, dtype=np.float64)
        torques = np.asarray(turned * current * table.AMPERE * self._kind.nm_a, dtype=np.float64)
        return self._turning.angles(signed(rows[:, 9:13])), rates, torques

    def _everywhere(self, register: table.Register, value: int, *, stopping: bool = False) -> None:
        self.bus.write_all(register, np.full(len(self.joints), value), stopping=stopping)
