"""Everything that can go wrong on a servo bus, by one call: ``inject(kind, at_s)``."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace

import numpy as np

from stancekit.runner.emulators.bus_process import BusProcess
from stancekit.runner.emulators.servo_bus import EmulatedBus
from stancekit.runner.worlds.dynamixel.calibration import Calibration
from stancekit.runner.worlds.dynamixel.control_table import RAD, TICKS

HOST_KILLED, WRONG_CALIBRATION = "host killed", "wrong calibration"
BUS = (
    "silent servo",
    "corrupted packet",
    "corrupted packets",
    "delay",
    "overload",
    "power loss",
    "cable pulled",
)
KINDS = (*BUS, WRONG_CALIBRATION, HOST_KILLED)


class BusFaults:
    """Faults of a bus and of its host. A wrong calibration is wrong from the start: ``spoiled``
    makes one.
    """

    kinds = KINDS

    def __init__(self, bus: EmulatedBus | BusProcess, host_pid: int | None = None) -> None:
        self._bus, self._host = bus, host_pid

    def inject(self, kind: str, at_s: float = 0.0) -> None:
        """Let it happen in so many seconds."""
        if kind == HOST_KILLED:
            assert self._host is not None, "whom to kill"
            threading.Timer(at_s, os.kill, (self._host, signal.SIGKILL)).start()
        elif kind != WRONG_CALIBRATION:
            self._bus.inject(kind, at_s)


def spoiled(calibration: Calibration, rng: np.random.Generator) -> tuple[Calibration, str]:
    """A valid calibration with one joint that turns the other way or has its zero elsewhere, and
    which that is.
    """
    joint = str(rng.choice(list(calibration.joints)))
    right = calibration.joints[joint]
    turned = rng.random() < 0.5
    direction = -right.direction if turned else right.direction
    shift = 0 if turned else int(rng.choice([-1, 1]) * rng.integers(300, 900))
    zero = right.zero_tick + shift
    room = sorted(direction * (tick - zero) * RAD for tick in (1, TICKS - 2))
    wrong = replace(
        right,
        direction=direction,
        zero_tick=zero,
        lower_rad=max(right.lower_rad, room[0]),
        upper_rad=min(right.upper_rad, room[1]),
    )
    return replace(calibration, joints=calibration.joints | {joint: wrong}), joint
